//! Photons merged with what mirrors and glass show: against a closed form, against paths from the eye where these find the
//! light, and against themselves where a lobe becomes narrow. They take up to 20 s each in software: they have kernels of
//! their own, and as many photons as means need that have little noise.

use std::f64::consts::PI;

use glam::{Vec3, vec3};
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{Camera, Light, LightKind, Material, Projection, Scene};

use super::super::tests::{from_above, glass, keeping, mean, mirror, on_floor, place};
use crate::reference::Settings;
use crate::testing::test_gpu;

/// A mirror of 4 m by 4 m at a height, which faces down.
fn ceiling(scene: &mut Scene, height: f32) {
    let faces_down = quad(vec3(-2.0, height, -2.0), Vec3::X * 4.0, Vec3::Z * 4.0, 1);
    place(scene, faces_down, mirror(0.8), Vec3::ZERO);
}

/// Looks up from the height of 2 m, along parallel rays.
fn upward(side: f32) -> Camera {
    Camera {
        projection: Projection::Orthographic { height: side },
        ..Camera::look_at("", vec3(0.0, 2.0, 0.0), vec3(0.0, 3.0, 0.0), 1.0)
    }
}

/// A mirror stands at x = 1, and one hangs at y = 3. By reflection, a point at (0, 1, 0) seems to light the floor from
/// (2, 1, 0) and from (0, 5, 0), and the eye sees that in the mirror above.
#[test]
fn a_mirror_shows_what_mirrors_light() {
    let Some(gpu) = test_gpu() else { return };
    let stands = quad(vec3(1.0, 0.25, -0.6), Vec3::Z * 1.2, Vec3::Y * 1.35, 1);
    let mut scene = on_floor(stands, mirror(0.8), Vec3::ZERO);
    ceiling(&mut scene, 3.0);
    let light = Light::new("", LightKind::Point, Vec3::splat(3.0));
    scene.lights.push(light.aimed(Vec3::Y, Vec3::ZERO));
    let mut irradiance = 0.0;
    for at in 0..64 * 64 {
        let [x, z] = [at % 64, at / 64].map(|k| (f64::from(k) + 0.5) / 64.0 - 0.5);
        for (from, height) in [(2.0, 1.0), (0.0, 5.0)] {
            let squared = (from - x) * (from - x) + height * height + z * z;
            irradiance += 3.0 * height / (squared * squared.sqrt()) / 4096.0;
        }
    }
    let expected = 0.8 * 0.8 * irradiance * 0.5 / PI;
    let (value, error) = mean(&gpu, &scene, &upward(1.0), &keeping("LSDSE"), 8, true);
    println!("{value}, expected {expected}, error {error}");
    assert!(error < 0.03 * expected, "error {error}");
    assert!(
        (value - expected).abs() < 3.5 * error,
        "{value}, not {expected}"
    );
}

/// Caustics of a lamp in a mirror: paths from the eye find them, too.
#[test]
fn both_tracers_find_the_same_light_in_mirrors() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = on_floor(sphere(0.4, 32), glass(1.5), vec3(0.0, 0.45, 0.0));
    // A floor with gloss, which the eye follows.
    scene.materials[0] = Material {
        roughness: 0.2,
        ..scene.materials[0].clone()
    };
    let lamp = quad(vec3(-0.5, 1.8, -0.5), Vec3::X, Vec3::Z, 1);
    let emitter = Material::emitter("lamp", vec3(3.0, 2.0, 1.0));
    place(&mut scene, lamp, emitter, Vec3::ZERO);
    let wall = quad(vec3(-2.0, 0.0, -1.0), Vec3::X * 4.0, Vec3::Y * 2.0, 1);
    place(
        &mut scene,
        wall,
        Material::matt("wall", Vec3::splat(0.7)),
        Vec3::ZERO,
    );
    let small = quad(vec3(-0.3, 0.1, 0.8), Vec3::Y * 0.6, Vec3::X * 0.6, 1);
    place(&mut scene, small, mirror(0.8), Vec3::ZERO);
    let camera = Camera::look_at("", vec3(0.2, 0.5, 0.5), vec3(0.0, 0.35, 0.8), 0.9);
    let settings = keeping("LS.*D.*SE");
    let of = |samples, merges| mean(&gpu, &scene, &camera, &settings, samples, merges);
    let (alone, noise) = of(4, false);
    let (both, error) = of(6, true);
    println!("{alone} +- {noise} alone, {both} +- {error} with photons");
    let spread = noise.hypot(error);
    assert!(spread < 0.06 * alone, "{spread} of {alone}");
    assert!((both - alone).abs() < 3.5 * spread, "{both}, not {alone}");
}

/// The eye follows gloss of a roughness below 0.3, and ends at wider gloss. Just below and just above, the light is the
/// same: what a mirror throws on a floor of metal, and what it throws on a wall that the floor shows.
#[test]
fn narrow_gloss_shows_what_wide_gloss_shows() {
    let Some(gpu) = test_gpu() else { return };
    let of = |roughness: f32, paths: &str| {
        let stands = quad(vec3(1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::Y * 2.0, 1);
        let mut scene = on_floor(stands, mirror(0.9), Vec3::ZERO);
        scene.materials[0] = Material::metal("floor", Vec3::splat(0.7), roughness);
        let wall = quad(vec3(-0.5, 0.0, 1.0), Vec3::NEG_Z * 2.0, Vec3::Y * 2.0, 1);
        let white = Material::matt("wall", Vec3::splat(0.9));
        place(&mut scene, wall, white, Vec3::ZERO);
        ceiling(&mut scene, 3.0);
        let light = Light::new("", LightKind::Point, Vec3::splat(3.0));
        let at = vec3(0.8, 0.8, 0.0);
        scene.lights.push(light.aimed(at, Vec3::ZERO));
        let camera = Camera::look_at("", vec3(0.6, 2.0, 0.0), vec3(0.45, 3.0, 0.0), 0.4);
        mean(&gpu, &scene, &camera, &keeping(paths), 6, true)
    };
    for paths in ["LSGSE", "LSDGSE"] {
        let [(narrow, noise), (wide, error)] =
            [0.2999, 0.3001].map(|roughness| of(roughness, paths));
        println!("{paths}: {narrow} +- {noise}, {wide} +- {error}");
        let spread = noise.hypot(error);
        assert!(spread < 0.2 * wide, "{paths}: {spread} of {wide}");
        assert!(
            (narrow - wide).abs() < 3.0 * spread,
            "{paths}: {narrow}, not {wide}"
        );
    }
}

/// Without a radius, the light is missing.
#[test]
fn a_radius_of_zero_leaves_it_out() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = on_floor(sphere(0.4, 16), mirror(0.9), vec3(0.0, 0.45, 0.0));
    ceiling(&mut scene, 3.0);
    let light = Light::new("", LightKind::Point, Vec3::splat(3.0));
    scene
        .lights
        .push(light.aimed(vec3(1.0, 1.5, 0.5), Vec3::ZERO));
    let settings = |merge_radius| Settings {
        merge_radius,
        ..keeping("LS.*[DG].*E")
    };
    let of = |radius| mean(&gpu, &scene, &upward(2.0), &settings(radius), 1, true).0;
    assert!(of(2.0) > 0.01);
    assert_eq!(of(0.0), 0.0);
    // What the eye sees without a mirror stays.
    let below = mean(
        &gpu,
        &scene,
        &from_above(2.0, 2.5),
        &Settings {
            merge_radius: 0.0,
            ..keeping("LS.*[DG]E")
        },
        1,
        true,
    );
    assert!(below.0 > 0.01);
}
