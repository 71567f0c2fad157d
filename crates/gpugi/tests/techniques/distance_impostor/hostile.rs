//! Scenes that cannot be shown correctly: pictures stay finite and plausible, and settings that cannot work are
//! rejected.

use std::sync::Arc;

use glam::{Mat4, Vec3, vec3};
use gpugi::gpu::Gpu;
use gpugi::{LightingError, Renderer};
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{Camera, Environment, Image, Mesh, Pixels, Scene};

use super::scenes::{
    HALF, add, glass, mirror, renderer, room, set, shining_room, toward, with_ball,
};
use crate::common::{Picture, gpu, picture};

/// The picture of a scene. It must be finite, without negative light, and no brighter than what emits light in it.
fn seen(gpu: &Gpu, scene: &Scene, camera: &Camera, settings: &[(&str, &str)]) -> Picture {
    seen_by(&mut renderer(gpu, scene, settings), &scene.name, camera)
}

fn seen_by(renderer: &mut Renderer, name: &str, camera: &Camera) -> Picture {
    let found = picture(renderer, camera);
    let brightest = found.radiance.iter().copied().fold(0.0, f32::max);
    let least = found.radiance.iter().copied().fold(f32::MAX, f32::min);
    assert!(
        least >= 0.0 && brightest < 100.0,
        "{name}: {least} to {brightest}"
    );
    found
}

/// Mean radiance of an instance, roughly its luminance.
fn brightness(picture: &Picture, instance: usize) -> f32 {
    let of_instance = picture
        .lit()
        .filter(|point| point.instance as usize == instance);
    let (sum, count) = of_instance.fold((0.0, 0), |(sum, count), point| {
        (sum + point.radiance.element_sum() / 3.0, count + 1)
    });
    assert!(count > 50, "{count} points");
    sum / count as f32
}

fn white_sky() -> Environment {
    Environment {
        image: Arc::new(Image {
            name: "white".into(),
            width: 1,
            height: 1,
            pixels: Pixels::Rgba32Float(vec![1.0; 4]),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    }
}

#[test]
fn impossible_places_stay_finite() {
    let Some(gpu) = gpu() else { return };
    for material in [mirror(), glass(1.5)] {
        let mut scene = with_ball(room(), material.clone(), Vec3::ZERO);
        scene.name = format!("{} ball", material.name);
        let mut renderer = renderer(&gpu, &scene, &[("resolution", "32")]);
        // In a wall, on it, far outside, so far that floats overflow, on the ball and in the light.
        for reference in [
            "2,0,0",
            "2,1.5,2",
            "50,0,0",
            "0,1e30,0",
            "3e38,3e38,0",
            "0,0.5,0",
            "0.9,1.2,0.7",
            "auto",
        ] {
            for search in ["secant", "false-position", "pure-secant", "none", "walk"] {
                for setting in [("reference", reference), ("search", search)] {
                    set(&mut renderer, setting);
                }
                seen_by(&mut renderer, &scene.name, &toward(Vec3::ZERO));
            }
        }
        // Through the walls, as large as the world, on a wall and in a corner, flat, and too small to see.
        for (scale, at) in [
            (Vec3::splat(6.0), Vec3::ZERO),
            (Vec3::splat(1e6), Vec3::ZERO),
            (Vec3::ONE, vec3(HALF.x - 0.5, 0.0, 0.0)),
            (Vec3::ONE, HALF),
            (vec3(1.0, 0.0, 1.0), Vec3::ZERO),
            (Vec3::ZERO, Vec3::ZERO),
            (Vec3::splat(1e-7), Vec3::ZERO),
        ] {
            scene.instances.last_mut().expect("a ball").world_from_mesh =
                Mat4::from_translation(at) * Mat4::from_scale(scale);
            renderer.update(&scene).expect("an update");
            seen_by(&mut renderer, &scene.name, &toward(at));
        }
    }
}

#[test]
fn open_scenes_show_the_environment() {
    let Some(gpu) = gpu() else { return };
    for (material, expected) in [(mirror(), 0.95), (glass(1.5), 1.0)] {
        let mut scene = with_ball(Scene::new("open"), material.clone(), Vec3::ZERO);
        let dark = seen(&gpu, &scene, &toward(Vec3::ZERO), &[]);
        assert_eq!(brightness(&dark, 0), 0.0, "{}", material.name);
        scene.environment = Some(white_sky());
        let mut renderer = renderer(&gpu, &scene, &[]);
        for search in ["walk", "secant", "false-position", "pure-secant", "none"] {
            set(&mut renderer, ("search", search));
            let lit = seen_by(&mut renderer, search, &toward(Vec3::ZERO));
            let found = brightness(&lit, 0);
            assert!(
                (found / expected - 1.0).abs() < 0.03,
                "{}, {search}: {found}",
                material.name
            );
        }
    }
}

/// A ball without its upper half, a mesh of one triangle, and one without visible triangles.
#[test]
fn refractors_need_not_be_closed() {
    let Some(gpu) = gpu() else { return };
    let mut bowl = sphere(0.5, 32);
    let kept = bowl.indices.len() / 2;
    bowl.indices.drain(..kept);
    let pane = quad(vec3(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y, 1);
    let mut line = quad(vec3(-0.5, 0.0, 0.0), Vec3::X, Vec3::X * 0.5, 2);
    line.normals.fill(Vec3::Y);
    for (name, mesh, shows) in [
        ("bowl", bowl, true),
        ("pane", pane, true),
        ("line", line, false),
    ] {
        let mut scene = shining_room();
        scene.name = name.into();
        let index = add(&mut scene, name, mesh, glass(1.5), Vec3::ZERO);
        let found = seen(&gpu, &scene, &toward(Vec3::ZERO), &[]);
        if shows {
            let found = brightness(&found, index);
            assert!((0.05..1.0).contains(&found), "{name}: {found}");
        }
    }
}

#[test]
fn more_mirrors_than_cubes_are_seen() {
    let Some(gpu) = gpu() else { return };
    let mut scene = room();
    let ball = scene.add_mesh(sphere(0.15, 16));
    let material = scene.add_material(mirror());
    let first = scene.instances.len();
    for number in 0..20 {
        let at = vec3(
            (number % 5) as f32 * 0.6 - 1.2,
            (number / 5) as f32 * 0.6 - 0.9,
            -0.5,
        );
        scene.add_instance("ball", ball, material, Mat4::from_translation(at));
    }
    let camera = Camera::look_at("", vec3(0.0, 0.0, 1.8), vec3(0.0, 0.0, -0.5), 1.0);
    let lit = |settings: &[(&str, &str)]| {
        let found = seen(&gpu, &scene, &camera, settings);
        let shining: std::collections::BTreeSet<u32> = found
            .lit()
            .filter(|point| point.instance as usize >= first && point.radiance.max_element() > 0.0)
            .map(|point| point.instance)
            .collect();
        shining.len()
    };
    let small = ("resolution", "16");
    assert_eq!(lit(&[small]), 20);
    assert_eq!(lit(&[small, ("cubes", "3")]), 20);
    assert_eq!(lit(&[small, ("objects", "ball")]), 20);
}

#[test]
fn settings_that_cannot_work_are_refused() {
    let Some(gpu) = gpu() else { return };
    let scene = with_ball(room(), mirror(), Vec3::ZERO);
    let mut renderer = renderer(&gpu, &scene, &[]);
    for (name, value) in [
        ("resolution", "100"),
        ("resolution", "2048"),
        ("shape-resolution", "48"),
        ("objects", "ball, cup"),
        ("reference", "1,2"),
        ("reference", "1,2,nan"),
        ("reference", "middle"),
        ("search", "linear"),
        ("bounces", "17"),
        ("renew", "0"),
        ("renew", "often"),
        ("threshold", "-1"),
        ("faces-per-frame", "7"),
        ("lobes", "wide"),
        ("cubes", "2"),
    ] {
        let refused = renderer.set("distance-impostor", name, value);
        assert!(
            matches!(refused, Err(LightingError::Setting { .. })),
            "{name}={value}: {refused:?}"
        );
    }
    picture(&mut renderer, &toward(Vec3::ZERO));
}

/// After changes of the scene, pictures match those of a new renderer.
#[test]
fn changes_of_the_scene_are_followed() {
    let Some(gpu) = gpu() else { return };
    let first = with_ball(room(), mirror(), vec3(0.5, 0.0, 0.0));
    let mut moved = first.clone();
    moved.instances.last_mut().expect("a ball").world_from_mesh =
        Mat4::from_translation(vec3(-0.4, 0.2, -0.3));
    let mut joined = moved.clone();
    add(
        &mut joined,
        "new",
        sphere(0.3, 24),
        glass(1.5),
        vec3(0.7, 0.0, 0.3),
    );
    let mut other_material = joined.clone();
    let ball = other_material.instances.len() - 2;
    let material = other_material.instances[ball].material;
    other_material.materials[material] = glass(1.3);
    let mut removed = other_material.clone();
    removed.instances.remove(ball);
    let mut darker = removed.clone();
    darker.lights[0].intensity *= 0.25;
    let mut none = darker.clone();
    none.instances.pop();
    let steps = [first, moved, joined, other_material, removed, darker, none];
    let camera = Camera::look_at("", vec3(0.1, 0.3, 1.7), Vec3::ZERO, 0.9);
    let mut kept = renderer(&gpu, &steps[0], &[]);
    let mut before = picture(&mut kept, &camera);
    for (number, pair) in steps.windows(2).enumerate() {
        kept.update(&pair[1]).expect("an update");
        let found = picture(&mut kept, &camera);
        let fresh = seen(&gpu, &pair[1], &camera, &[]);
        let worst = |other: &Picture| {
            let pairs = found.radiance.iter().zip(&other.radiance);
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        assert!(worst(&before) > 0.05, "step {number} changes nothing");
        assert!(worst(&fresh) < 1e-3, "step {number}: {}", worst(&fresh));
        before = found;
    }
}

/// A mesh without triangles.
#[test]
fn a_mirror_without_triangles_shows_nothing() {
    let Some(gpu) = gpu() else { return };
    let mut scene = room();
    add(&mut scene, "nothing", Mesh::default(), mirror(), Vec3::ZERO);
    let mut of_glass = scene.clone();
    add(
        &mut of_glass,
        "nothing",
        Mesh::default(),
        glass(1.5),
        Vec3::ZERO,
    );
    for scene in [scene, of_glass] {
        seen(&gpu, &scene, &toward(Vec3::ZERO), &[]);
    }
}
