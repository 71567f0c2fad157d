//! Refraction at a single surface is exact, so the path tracer must see the same.

use std::sync::Arc;

use glam::{Vec3, vec3};
use gpugi::gpu::Gpu;
use gpugi::{LightingError, Renderer};
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{Camera, Material, Scene, Volume};

use super::{alone, ball, camera, error_in, sky};
use crate::common::{gpu, picture, place};

fn glass(ior: f32, roughness: f32) -> Material {
    Material {
        name: "glass".into(),
        base_color: vec3(0.7, 0.9, 0.8).extend(1.0),
        transmission: 1.0,
        roughness,
        ior,
        volume: Some(Volume {
            attenuation_distance: f32::INFINITY,
            attenuation_color: Vec3::ONE,
        }),
        ..Material::default()
    }
}

/// A horizontal surface above everything.
fn water(material: Material) -> Scene {
    let mut scene = Scene::new("water");
    let mesh = quad(
        vec3(-50.0, 0.0, 50.0),
        Vec3::X * 100.0,
        Vec3::NEG_Z * 100.0,
        1,
    );
    place(&mut scene, mesh, material);
    scene.environment = Some(sky());
    scene
}

/// Looks at the surface from `eye`; the surface fills the picture.
fn at_surface(eye: Vec3) -> Camera {
    Camera::look_at("", eye, Vec3::ZERO, 0.9)
}

fn error(gpu: &Gpu, material: Material, eye: Vec3, settings: &[(&str, &str)]) -> f64 {
    error_in(gpu, &water(material), &at_surface(eye), settings)
}

#[test]
fn a_surface_refracts_as_the_path_tracer_does() {
    let Some(gpu) = gpu() else { return };
    let above = vec3(0.3, 1.2, 1.0);
    let below = vec3(0.3, -1.2, 1.4);
    let thin = Material {
        volume: None,
        ..glass(1.5, 0.0)
    };
    let all = [("refraction", "all")];
    let rough_thin = Material {
        roughness: 0.3,
        ..thin.clone()
    };
    let half = Material {
        transmission: 0.5,
        ..glass(1.5, 0.0)
    };
    let cases: [(&str, Material, Vec3, &[_], f64); 8] = [
        ("from above", glass(1.5, 0.0), above, &[], 2e-3),
        ("denser", glass(2.4, 0.0), above, &[], 3e-3),
        ("less dense", glass(0.8, 0.0), above, &[], 2e-3),
        (
            "from below, total reflection",
            glass(1.33, 0.0),
            below,
            &[],
            4e-3,
        ),
        ("half diffuse", half, above, &[], 4e-3),
        ("rough", glass(1.5, 0.6), above, &[], 3e-2),
        ("thin wall", thin, above, &all, 2e-3),
        ("rough thin wall", rough_thin, above, &all, 5e-2),
    ];
    for (name, material, eye, settings, bound) in cases {
        let found = error(&gpu, material.clone(), eye, settings);
        println!("{name}: rel-mse {found:.1e}, at most {bound:.1e}");
        assert!(found < bound, "{name}: {found}");
        let without = error(&gpu, material, eye, &[("refraction", "none")]);
        assert!(without > 3.0 * found, "{name}, not refracted: {without}");
    }
}

#[test]
fn a_solid_is_entered_and_left() {
    let Some(gpu) = gpu() else { return };
    // PeeledLayer the second surface, light is as bright as in front of the first.
    let scene = ball(glass(1.5, 0.0), sky());
    let found = picture(&mut alone(&gpu, &scene, &[]), &camera());
    assert!(found.lit().count() > 200);
    let mut open = ball(glass(1.5, 0.0), sky());
    let indices = &mut Arc::make_mut(&mut open.meshes[0]).indices;
    indices.truncate(indices.len() - 3);
    let single = picture(&mut alone(&gpu, &open, &[]), &camera());
    // A point unaffected by the missing triangle at the lower pole, seen through the middle, where reflection is weak.
    let middle = found.points.len() / 2 + 16;
    let [closed, single] =
        [&found, &single].map(|picture| picture.points[middle].expect("the ball").radiance.y);
    let ratio = closed / single;
    assert!((2.0..2.25).contains(&ratio), "{ratio}");
}

#[test]
fn only_claimed_objects_are_seen_whole() {
    let Some(gpu) = gpu() else { return };
    let mut scene = ball(glass(1.5, 0.0), sky());
    scene.instances[0].name = "left ball".into();
    let mesh = sphere(0.5, 32);
    let other = place(
        &mut scene,
        mesh,
        Material {
            volume: None,
            ..glass(1.5, 0.0)
        },
    );
    scene.instances[other].name = "bubble".into();
    let mut renderer = alone(&gpu, &scene, &[]);
    let claims = |renderer: &Renderer| {
        let draws = &renderer.scene().draws;
        let mut whole: Vec<_> = draws
            .iter()
            .filter(|draw| draw.seen != draw.class)
            .collect();
        whole.sort_by_key(|draw| draw.instance);
        whole.iter().map(|draw| draw.instance).collect::<Vec<_>>()
    };
    assert_eq!(claims(&renderer), [0]);
    renderer
        .set("environment-map", "refraction", "all")
        .expect("a setting");
    assert_eq!(claims(&renderer), [0, 1]);
    renderer
        .set("environment-map", "refraction", "none")
        .expect("a setting");
    assert_eq!(claims(&renderer), [0_u32; 0]);
    let refused = renderer.set("environment-map", "objects", "*ball, cup");
    assert!(
        matches!(&refused, Err(LightingError::Setting { source, .. }) if source.to_string().contains("\"cup\"")),
        "{refused:?}"
    );
}
