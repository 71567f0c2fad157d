//! Scenes as strangers bring them: grounds of a hundred kilometres, forgotten objects, surfaces written as two faces,
//! panes before lamps, rooms of walls without thickness, suns that half floats do not hold.

use std::ops::ControlFlow;
use std::sync::Arc;

use crate::common::{floor, from_above, gpu, inside_out, lit_by, place, render};
use glam::{Vec3, vec3};
use gpugi::gpu::Gpu;
use gpugi::reference::{PathTracer, Progress, Settings};
use gpugi_scene::builtin::shapes::{cuboid, quad};
use gpugi_scene::{Camera, Environment, Image, Light, LightKind, Material, Pixels, Scene, Volume};

const SIZE: u32 = 24;

fn mean(radiance: &[f32]) -> f32 {
    radiance.iter().sum::<f32>() / radiance.len() as f32
}

/// Mean radiance of direct light by the path tracer.
fn traced(gpu: &Gpu, scene: &Scene, camera: &Camera, samples: u32) -> f32 {
    let settings = Settings {
        max_bounces: 1,
        ..Settings::default()
    };
    let mut tracer = PathTracer::new(gpu, scene, [SIZE; 2], &settings).unwrap();
    let mut on = |_: &Progress| ControlFlow::Continue(());
    tracer.render(camera, samples, &mut on).unwrap();
    mean(&tracer.radiance().unwrap())
}

/// Mean radiance of direct light by shadow maps.
fn drawn(gpu: &Gpu, scene: &Scene, camera: &Camera) -> f32 {
    mean(&render(gpu, scene, camera, SIZE, &["shadow-map.resolution=512"]).radiance)
}

fn sun(from: Vec3, irradiance: f32) -> Light {
    let light = Light::new("sun", LightKind::Directional, Vec3::splat(irradiance));
    light.aimed(from, Vec3::ZERO)
}

/// A box on a ground with sides of `2 half` (m), in the sun, and a camera beside it.
fn on_ground(half: f32) -> (Scene, Camera) {
    let mut scene = lit_by(floor(half), sun(vec3(1.0, 1.5, 0.5), 3.0));
    let cube = cuboid(vec3(-0.5, 0.0, -0.5), vec3(0.5, 1.0, 0.5), 1);
    place(&mut scene, cube, Material::matt("box", Vec3::splat(0.5)));
    let camera = Camera::look_at("", vec3(2.0, 2.5, 3.5), vec3(0.0, 0.3, 0.0), 0.6);
    (scene, camera)
}

#[test]
fn neither_large_grounds_nor_stray_objects_take_the_light() {
    let Some(gpu) = gpu() else { return };
    let (small, camera) = on_ground(50.0);
    let expected = drawn(&gpu, &small, &camera);
    let shadowless = {
        let mut scene = small.clone();
        scene.instances.pop();
        drawn(&gpu, &scene, &camera)
    };
    // The shadow matters.
    assert!(expected < 0.95 * shadowless, "{expected} {shadowless}");
    let mut stray = small.clone();
    let far = cuboid(vec3(1e5, 0.0, 0.0), vec3(1e5 + 1.0, 1.0, 1.0), 1);
    place(&mut stray, far, Material::matt("stray", Vec3::splat(0.5)));
    let others = [500.0, 1e3, 25e3, 50e3].map(|half| on_ground(half).0);
    for scene in others.iter().chain([&stray]) {
        let found = drawn(&gpu, scene, &camera);
        let extent = scene.bounds().diagonal();
        assert!(
            (found / expected - 1.0).abs() < 0.01,
            "{extent} m: {found}, not {expected}"
        );
    }
    let expected = traced(&gpu, &small, &camera, 32);
    let found = traced(&gpu, &stray, &camera, 32);
    assert!(
        (found / expected - 1.0).abs() < 0.01,
        "{found}, not {expected}"
    );
}

/// Some modellers write a surface that is seen from both sides as two faces.
#[test]
fn two_faces_in_one_place_are_a_surface_with_two_sides() {
    let Some(gpu) = gpu() else { return };
    let at = |y: f32| quad(vec3(-2.0, y, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0, 1);
    let camera = from_above(3.0, 4.0);
    let below = Camera {
        projection: camera.projection,
        ..Camera::look_at("below", Vec3::NEG_Y * 4.0, Vec3::ZERO, 1.0)
    };
    let grey = || Material::matt("grey", Vec3::splat(0.7));
    for flips_first in [false, true] {
        // Not in the origin's plane, where coordinates and with them rounding would vanish.
        let faces = [at(0.37), inside_out(at(0.37))];
        let mut scene = Scene::new("two faces");
        let mut order = [0, 1];
        if flips_first {
            order.reverse();
        }
        for face in order {
            place(&mut scene, faces[face].clone(), grey());
        }
        for (from, camera) in [
            (vec3(0.3, 1.0, 0.2), &camera),
            (vec3(0.3, -1.0, 0.2), &below),
        ] {
            let scene = lit_by(scene.clone(), sun(from, 2.0));
            let cosine = 1.0 / from.length();
            let expected = 0.7 * 2.0 * cosine / std::f32::consts::PI;
            let found = traced(&gpu, &scene, camera, 4);
            assert!(
                (found / expected - 1.0).abs() < 1e-3,
                "{found}, not {expected}"
            );
        }
    }
}

#[test]
fn light_passes_what_does_not_bend_it() {
    let Some(gpu) = gpu() else { return };
    // Below the glass.
    let camera = from_above(0.5, 0.7);
    let glass = |ior: f32, volume| Material {
        transmission: 1.0,
        roughness: 0.0,
        specular: 1.0,
        ior,
        double_sided: true,
        volume,
        ..Material::matt("glass", Vec3::ONE)
    };
    // Halves the light on a metre.
    let murky = Some(Volume {
        attenuation_distance: 1.0,
        attenuation_color: Vec3::splat(0.5),
    });
    let pane = || quad(vec3(-1.0, 1.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1);
    let block = || cuboid(vec3(-1.0, 0.8, -1.0), vec3(1.0, 1.3, 1.0), 1);
    let lamp = Light::new("lamp", LightKind::Point, Vec3::splat(4.0));
    let lights = [sun(Vec3::Y, 2.0), lamp.aimed(Vec3::Y * 3.0, Vec3::ZERO)];
    for light in lights {
        let open = lit_by(floor(4.0), light);
        let expected = traced(&gpu, &open, &camera, 8);
        let behind = |mesh, material| {
            let mut scene = open.clone();
            place(&mut scene, mesh, material);
            traced(&gpu, &scene, &camera, 8) / expected
        };
        // The reflectance of glass is 0.04 where light falls straight on it.
        let through_pane = behind(pane(), glass(1.5, None));
        assert!((through_pane - 0.96).abs() < 2e-3, "{through_pane}");
        let through_air = behind(block(), glass(1.0, None));
        assert!((through_air - 1.0).abs() < 2e-3, "{through_air}");
        let through_murk = behind(block(), glass(1.0, murky));
        assert!(
            (through_murk - 0.5_f32.sqrt()).abs() < 5e-3,
            "{through_murk}"
        );
        // What bends light leaves it to photons, and what scatters it does not let it pass straight.
        let frosted = Material {
            roughness: 0.5,
            ..glass(1.5, None)
        };
        assert!(behind(pane(), frosted) < 0.9);
        let board = Material::matt("board", Vec3::ONE);
        assert_eq!(behind(pane(), board), 0.0);
    }
}

/// No light of outside comes through the seams of a closed room, whose walls have no thickness.
#[test]
fn closed_rooms_stay_dark() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::new("room");
    let corner = vec3(-1.0, 0.0, -1.0);
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    for (first, a, b) in [
        (corner, z, x),
        (corner + y, x, z),
        (corner, x, y),
        (corner + z, y, x),
        (corner, y, z),
        (corner + x, z, y),
    ] {
        place(
            &mut scene,
            quad(first, a, b, 1),
            Material::matt("wall", Vec3::splat(0.7)),
        );
    }
    let camera = Camera::look_at("", vec3(-0.8, 1.7, 0.9), vec3(0.6, 0.3, -0.6), 1.2);
    let point = Light::new("lamp", LightKind::Point, Vec3::splat(8.0));
    let lit = |light| lit_by(scene.clone(), light);
    let under_lamp = {
        let mut scene = scene.clone();
        let panel = quad(vec3(1.5, 3.0, 1.5), Vec3::X, Vec3::Z, 1);
        let shine = Material {
            emissive: Vec3::splat(100.0),
            double_sided: true,
            ..Material::matt("panel", Vec3::ZERO)
        };
        place(&mut scene, panel, shine);
        scene
    };
    // The scene, and one of how many values may be lit: maps of area lights are coarse.
    for (closed, share) in [
        (lit(point.aimed(vec3(2.5, 0.5, 1.5), Vec3::ZERO)), 1000),
        (lit(sun(vec3(1.0, 0.9, 0.7), 3.0)), 1000),
        (under_lamp, 400),
    ] {
        let size = 96;
        let light = |scene: &Scene| render(&gpu, scene, &camera, size, &[]).radiance;
        let open = {
            let mut scene = closed.clone();
            scene.instances.drain(1..6);
            light(&scene)
        };
        let found = light(&closed);
        let leaks = found.iter().filter(|&&value| value > 0.01).count();
        let means = [mean(&open), mean(&found)];
        println!("{leaks} of {} values are lit; means {means:?}", found.len());
        assert!(means[0] > 0.01 && means[1] < 3e-3 * means[0], "{means:?}");
        assert!(leaks * share < found.len(), "{leaks}");
    }
}

/// Slats as wide as two texels of a lamp's maps, with nothing behind, are in the shadow of other slats alone.
#[test]
fn slats_before_nothing_keep_their_light() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::new("slats");
    let matt = || Material::matt("slat", Vec3::splat(0.7));
    for i in 0..20 {
        let at = -1.0 + 0.1 * i as f32;
        let upper = cuboid(vec3(at, 0.3, -1.0), vec3(at + 0.03, 0.33, 1.0), 1);
        let lower = cuboid(vec3(-1.0, 0.0, at), vec3(1.0, 0.03, at + 0.03), 1);
        place(&mut scene, upper, matt());
        place(&mut scene, lower, matt());
    }
    let panel = quad(vec3(-0.5, 2.0, -0.5), Vec3::X, Vec3::Z, 1);
    let shine = Material {
        emissive: Vec3::splat(10.0),
        ..Material::matt("panel", Vec3::ZERO)
    };
    place(&mut scene, panel, shine);
    let camera = Camera::look_at("", vec3(1.6, 1.5, 1.9), vec3(0.0, 0.1, 0.0), 0.25);
    let ratio = drawn(&gpu, &scene, &camera) / traced(&gpu, &scene, &camera, 64);
    assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
}

/// A sun in one texel of an environment, brighter than half floats go.
#[test]
fn bright_suns_keep_their_light() {
    let Some(gpu) = gpu() else { return };
    const SIDES: [u32; 2] = [64, 32];
    let radiance = 1e6;
    let (row, column) = (4, 20);
    let mut texels = vec![0.01_f32; 4 * (SIDES[0] * SIDES[1]) as usize];
    let at = 4 * (row * SIDES[0] + column) as usize;
    texels[at..at + 3].fill(radiance);
    let mut scene = floor(2.0);
    scene.environment = Some(Environment {
        image: Arc::new(Image {
            name: "sun".into(),
            width: SIDES[0],
            height: SIDES[1],
            pixels: Pixels::Rgba32Float(texels),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    });
    let angle = |row: u32| std::f64::consts::PI * f64::from(row) / f64::from(SIDES[1]);
    let solid_angle =
        std::f64::consts::TAU / f64::from(SIDES[0]) * (angle(row).cos() - angle(row + 1).cos());
    let cosine = ((angle(row) + angle(row + 1)) / 2.0).cos();
    let expected =
        (0.5 * (f64::from(radiance) * solid_angle * cosine / std::f64::consts::PI + 0.01)) as f32;
    let camera = from_above(1.0, 2.0);
    // Interpolation between texels spreads the sun.
    let found = traced(&gpu, &scene, &camera, 64);
    assert!(
        (found / expected - 1.0).abs() < 0.03,
        "{found}, not {expected}"
    );
    let found = mean(&render(&gpu, &scene, &camera, SIZE, &[]).radiance);
    assert!(
        (found / expected - 1.0).abs() < 0.03,
        "{found}, not {expected}"
    );
}
