//! How a picture progresses: seeds, samples in portions, interruption, tiles, and when it is good enough.

use std::ops::ControlFlow;

use glam::{Vec3, vec3};
use gpugi::reference::Settings;
use gpugi_scene::builtin::shapes::{cuboid, quad};
use gpugi_scene::image::metrics::rel_mse;
use gpugi_scene::{Camera, Material, Scene};

use super::{bounces, go_on, picture, tracer, white};
use crate::common::{floor, from_above, gpu, place};

/// A box on a floor under a lamp, with some sky.
fn furnished() -> (Scene, Camera) {
    let mut scene = floor(2.0);
    let mesh = cuboid(vec3(-0.4, 0.0, -0.4), vec3(0.4, 0.7, 0.4), 1);
    place(&mut scene, mesh, Material::metal("", Vec3::splat(0.8), 0.3));
    let lamp = quad(vec3(-0.5, 1.8, -0.5), Vec3::X, Vec3::Z, 1);
    place(&mut scene, lamp, Material::emitter("", Vec3::splat(4.0)));
    let mut sky = white();
    sky.intensity = 0.2;
    scene.environment = Some(sky);
    let camera = Camera::look_at("", vec3(1.0, 1.5, 2.5), vec3(0.0, 0.3, 0.0), 0.8);
    (scene, camera)
}

const SIZE: [u32; 2] = [21, 13];

#[test]
fn a_seed_is_a_picture() {
    let Some(gpu) = gpu() else { return };
    let (scene, camera) = furnished();
    let mut first = tracer(&gpu, &scene, SIZE, &Settings::default());
    let one = picture(&mut first, &camera, 7, 3);
    let other = picture(&mut first, &camera, 7, 4);
    let again = picture(&mut first, &camera, 7, 3);
    let elsewhere = picture(
        &mut tracer(&gpu, &scene, SIZE, &Settings::default()),
        &camera,
        7,
        3,
    );
    assert!(
        one == again,
        "a restart with the same seed gave another picture"
    );
    assert!(
        one == elsewhere,
        "a second path tracer gave another picture"
    );
    let changed = one.iter().zip(&other).filter(|(a, b)| a != b).count();
    assert!(
        changed > one.len() / 2,
        "another seed changed {changed} values"
    );
    // Nothing is left of the previous picture after a restart.
    first.restart(3).expect("a restart");
    assert_eq!(
        (first.samples(), first.segments().expect("segments")),
        (0, 0)
    );
    assert!(
        first
            .radiance()
            .expect("black")
            .iter()
            .all(|&value| value == 0.0)
    );
}

#[test]
fn samples_in_portions_are_the_same_samples() {
    let Some(gpu) = gpu() else { return };
    let (scene, camera) = furnished();
    let mut tracer = tracer(&gpu, &scene, SIZE, &Settings::default());
    let at_once = picture(&mut tracer, &camera, 40, 9);
    let segments = tracer.segments().expect("segments");
    tracer.restart(9).expect("a restart");
    for samples in [1, 2, 17, 17, 5, 40] {
        tracer
            .render(&camera, samples, &mut go_on)
            .expect("a portion");
    }
    assert_eq!(tracer.samples(), 40);
    assert_eq!(tracer.segments().expect("segments"), segments);
    for (a, b) in at_once.iter().zip(tracer.radiance().expect("radiance")) {
        assert!((a - b).abs() <= 1e-5 * a, "{a} at once, {b} in portions");
    }
}

#[test]
fn breaking_off_keeps_what_is_done() {
    let Some(gpu) = gpu() else { return };
    let (scene, camera) = furnished();
    let mut tracer = tracer(&gpu, &scene, SIZE, &Settings::default());
    let whole = picture(&mut tracer, &camera, 64, 2);
    tracer.restart(2).expect("a restart");
    let mut calls = 0;
    let mut last = 0.0;
    let progress = tracer
        .render(&camera, 64, &mut |progress| {
            assert!(progress.fraction >= last && progress.fraction < 1.0);
            last = progress.fraction;
            calls += 1;
            if calls == 9 {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        })
        .expect("a part");
    assert!(
        progress.samples < 64 && progress.fraction < 1.0,
        "{progress:?}"
    );
    assert_eq!(tracer.samples(), progress.samples);
    let part = tracer.radiance().expect("radiance");
    let mean = |picture: &[f32]| picture.iter().sum::<f32>() / picture.len() as f32;
    assert!(part.iter().all(|value| value.is_finite()));
    assert!((mean(&part) / mean(&whole) - 1.0).abs() < 0.1);
    // The picture can be resumed.
    tracer.render(&camera, 64, &mut go_on).expect("the rest");
    let end = mean(&tracer.radiance().expect("radiance"));
    assert!((end / mean(&whole) - 1.0).abs() < 0.02, "{end}");
}

/// Rendering stops where its own estimate says that the picture is good enough, and it is.
#[test]
fn the_noise_that_is_asked_for_is_reached() {
    let Some(gpu) = gpu() else { return };
    let (scene, camera) = furnished();
    let reference = picture(
        &mut tracer(&gpu, &scene, SIZE, &Settings::default()),
        &camera,
        2048,
        77,
    );
    for target in [0.003, 0.001] {
        let settings = Settings {
            noise: target,
            ..Settings::default()
        };
        let mut tracer = tracer(&gpu, &scene, SIZE, &settings);
        tracer.restart(1).expect("a restart");
        let progress = tracer
            .render(&camera, 100_000, &mut go_on)
            .expect("a picture");
        let estimate = progress.noise.expect("a measured noise");
        let radiance = tracer.radiance().expect("radiance");
        let error = rel_mse(radiance.iter().copied().zip(reference.iter().copied()));
        println!(
            "asked for {target}: estimate {estimate}, error {error}, {} samples",
            progress.samples
        );
        assert!(progress.samples < 2048 && progress.fraction == 1.0);
        assert!(estimate <= target && estimate > 0.5 * target, "{estimate}");
        // Well-distributed samples are better than independent ones, which the estimate assumes.
        assert!(
            error < 1.2 * target && error > 0.05 * target,
            "{error} of {target}"
        );
    }
}

/// The estimate of the variance compared with the spread over seeds. With one sample per pixel, which nothing can
/// distribute well, they agree.
#[test]
fn the_estimate_of_the_noise_is_the_spread_over_seeds() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(2.0);
    // Alpha is decided by a hash, so samples are independent: radiance 0.5 or 1.
    let veil = quad(vec3(-1.0, 0.5, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 1);
    let material = Material {
        alpha_mode: gpugi_scene::AlphaMode::Blend,
        base_color: glam::Vec4::new(0.0, 0.0, 0.0, 0.3),
        ..Material::emitter("veil", Vec3::ONE)
    };
    place(&mut scene, veil, material);
    scene.materials[0].emissive = Vec3::splat(0.5);
    let camera = from_above(1.0, 3.0);
    let mut tracer = tracer(&gpu, &scene, [16, 16], &bounces(0));
    const SEEDS: u32 = 24;
    let mut estimate = 0.0;
    let mut pictures = Vec::new();
    for seed in 0..SEEDS {
        pictures.push(picture(&mut tracer, &camera, 32, seed));
        estimate += tracer.noise().expect("noise") / f64::from(SEEDS);
    }
    // 0.5, plus 0.5 with probability 0.3.
    let expected = 0.65_f32;
    let values = pictures.iter().flatten().copied();
    let spread = rel_mse(values.map(|value| (value, expected)));
    let exact = 0.25 * 0.3 * 0.7 / 32.0 / (0.65 * 0.65 + 0.01);
    println!("noise: estimated {estimate}, found {spread}, exact {exact}");
    assert!((spread / exact - 1.0).abs() < 0.1, "{spread}, not {exact}");
    assert!(
        (estimate / exact - 1.0).abs() < 0.1,
        "{estimate}, not {exact}"
    );
}

/// More than one tile along both axes: each pixel sees the same as in a picture without tiles.
#[test]
fn a_picture_of_several_tiles_is_whole() {
    let Some(gpu) = gpu() else { return };
    // The sky's gradient, in a picture of 2052 x 2051 pixels: 2 x 2 tiles.
    let mut scene = Scene::new("sky");
    let texels: Vec<Vec3> = (0..8 * 4)
        .map(|at| vec3((at % 8) as f32, (at / 8) as f32, 1.0))
        .collect();
    scene.environment = Some(super::environment(8, &texels));
    let camera = Camera::look_at("", Vec3::ZERO, vec3(0.3, 0.1, -1.0), 1.0);
    let size = [2052, 2051];
    let large = picture(&mut tracer(&gpu, &scene, size, &bounces(0)), &camera, 1, 1);
    // Differences between adjacent pixels are as small across the borders of tiles as elsewhere.
    let at = |x: usize, y: usize| Vec3::from_slice(&large[(y * size[0] as usize + x) * 3..][..3]);
    let mut largest = [0.0_f32; 2];
    for y in (1..size[1] as usize).step_by(5).chain(2046..2051) {
        for x in (1..size[0] as usize).step_by(5).chain(2046..2052) {
            let across = (at(x, y) - at(x - 1, y)).abs().max_element();
            let down = (at(x, y) - at(x, y - 1)).abs().max_element();
            largest = [largest[0].max(across), largest[1].max(down)];
        }
    }
    assert!(largest[0] < 0.02 && largest[1] < 0.02, "{largest:?}");
    assert!(large.chunks(3).all(|pixel| pixel[2] > 0.99));
}
