//! Photons in media: against paths from the eye, where these find the light, and against the image of a light in a mirror.

use glam::{Mat4, Vec3, vec3};
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{Camera, Light, LightKind, Material, Medium, PhaseFunction, Scene};

use super::tests::{from_above, glass, keeping, mean, mirror, on_floor, place};
use crate::testing::test_gpu;

/// Fog that fills everything.
fn fog(extinction: Vec3) -> Medium {
    Medium {
        name: "fog".into(),
        world_from_box: None,
        extinction,
        albedo: Vec3::splat(0.8),
        phase: PhaseFunction::HenyeyGreenstein(0.3),
        emission: Vec3::ZERO,
        density: None,
        node: None,
    }
}

/// A mirror stands at x = 1; by reflection, a light at x = 0 seems to shine from x = 2.
#[test]
fn a_mirror_lights_fog_like_a_second_light() {
    let Some(gpu) = test_gpu() else { return };
    let extinction = vec3(0.3, 0.5, 0.7);
    let lit_by = |at: Vec3, intensity: f32| {
        let mut scene = Scene::new("fog");
        // Below the eye, because few photons come close to it, with much light.
        let place = Mat4::from_translation(vec3(1.0, 0.5, 0.0));
        scene.media.push(Medium {
            world_from_box: Some(place * Mat4::from_scale(vec3(8.0, 1.2, 8.0))),
            ..fog(extinction)
        });
        let light = Light::new("", LightKind::Point, Vec3::splat(intensity));
        scene.lights.push(light.aimed(at, Vec3::ZERO));
        scene
    };
    let mut mirrored = lit_by(vec3(0.0, 0.5, 0.0), 3.0);
    // It throws light on all that the eye sees.
    let stands = quad(vec3(1.0, -0.1, -1.1), Vec3::Z * 2.2, Vec3::Y * 2.2, 1);
    place(&mut mirrored, stands, mirror(0.8), Vec3::ZERO);
    let floor = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1);
    let black = Material::matt("black", Vec3::ZERO);
    place(&mut mirrored, floor.clone(), black.clone(), Vec3::ZERO);
    let mut second = lit_by(vec3(2.0, 0.5, 0.0), 0.8 * 3.0);
    place(&mut second, floor, black, Vec3::ZERO);
    let camera = Camera::look_at("", vec3(-0.4, 2.0, 0.4), Vec3::ZERO, 0.4);
    for camera in [camera, from_above(1.0, 2.0)] {
        let (expected, noise) = mean(&gpu, &second, &camera, &keeping("LVE"), 4, false);
        let (value, error) = mean(&gpu, &mirrored, &camera, &keeping("LSVE"), 48, true);
        println!("{value} +- {error}, expected {expected} +- {noise}");
        let spread = noise.hypot(error);
        assert!(spread < 0.03 * expected, "{spread} of {expected}");
        assert!(
            (value - expected).abs() < 3.5 * spread,
            "{value}, not {expected}"
        );
    }
}

/// Caustics of a lamp in fog, and in a mirror: paths from the eye find them, too.
#[test]
fn both_tracers_find_the_same_light_in_fog() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = on_floor(sphere(0.4, 32), glass(1.5), vec3(0.0, 0.45, 0.0));
    let lamp = quad(vec3(-0.5, 1.8, -0.5), Vec3::X, Vec3::Z, 1);
    let emitter = Material::emitter("lamp", vec3(3.0, 2.0, 1.0));
    place(&mut scene, lamp, emitter, Vec3::ZERO);
    scene.media = vec![
        fog(Vec3::splat(0.4)),
        Medium {
            world_from_box: Some(Mat4::from_translation(Vec3::Y * 0.5)),
            phase: PhaseFunction::CornetteShanks(-0.2),
            ..fog(vec3(0.2, 0.5, 1.0))
        },
    ];
    let small = quad(vec3(-0.4, 0.0, 0.8), Vec3::Y * 0.8, Vec3::X * 0.8, 1);
    place(&mut scene, small, mirror(0.8), Vec3::ZERO);
    let below = Camera::look_at("", vec3(0.9, 0.6, 0.9), vec3(0.0, 0.1, 0.0), 0.5);
    let behind = Camera::look_at("", vec3(0.2, 0.5, 0.55), vec3(0.0, 0.35, 0.8), 0.9);
    for (camera, paths, samples, most) in [
        (&below, "LS+VE", [32, 24], 0.05),
        (&behind, "LS+VSE", [32, 24], 0.08),
    ] {
        let of = |samples, has_photons| {
            let settings = keeping(paths);
            mean(&gpu, &scene, camera, &settings, samples, has_photons)
        };
        let [(alone, noise), (both, error)] = [of(samples[0], false), of(samples[1], true)];
        println!("{paths}: {alone} +- {noise} alone, {both} +- {error} with photons");
        let spread = noise.hypot(error);
        assert!(spread < most * alone, "{paths}: {spread} of {alone}");
        assert!(
            (both - alone).abs() < 3.5 * spread,
            "{paths}: {both}, not {alone}"
        );
    }
}
