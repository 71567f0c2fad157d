//! Tests that need access to internals: albedos against the quadratures of shared/cpu.rs, and different tile sizes.

use std::sync::Arc;

use std::ops::ControlFlow;

use glam::{Vec3, Vec4, vec3};
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::builtin::{BuiltinScene, SCENES, builtin};
use gpugi_scene::{
    AlphaMode, Camera, Environment, Image, Material, MaterialModel, Pixels, Projection, Scene,
    Volume,
};

use super::{PathTracer, Settings, TILE_SIDE};
use crate::gpu::Gpu;
use crate::shared::cpu::{Case, GOLD};
use crate::testing::test_gpu;

fn white() -> Environment {
    Environment {
        image: Arc::new(Image {
            name: "white".to_owned(),
            width: 1,
            height: 1,
            pixels: Pixels::Rgba32Float(vec![1.0; 4]),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    }
}

fn picture(tracer: &mut PathTracer, camera: &Camera, samples: u32, seed: u32) -> Vec<f32> {
    tracer.restart(seed).unwrap();
    let progress = tracer.render(camera, samples, &mut |_| ControlFlow::Continue(()));
    assert_eq!(progress.unwrap().samples, samples);
    tracer.radiance().unwrap()
}

/// A name, a material, and the radiance that it sends to an eye at the given angle (degrees) under uniform white light.
type Sample = (String, Material, Box<dyn Fn(f64) -> [f64; 3]>);

fn reflecting(name: &str, material: Material, case: Case) -> Sample {
    let albedo = move |degrees: f64| {
        let seen = case.seen_at(degrees);
        [0, 1, 2].map(|channel| seen.diffuse_albedo(channel) + seen.glossy_albedo(channel))
    };
    (
        format!("{name} {}", case.roughness),
        material,
        Box::new(albedo),
    )
}

fn samples() -> Vec<Sample> {
    let transmissive = |roughness: f32, volume: Option<Volume>| Material {
        transmission: 1.0,
        roughness,
        volume,
        ..Material::default()
    };
    let clear = Volume {
        attenuation_distance: f32::INFINITY,
        attenuation_color: Vec3::ONE,
    };
    let mut samples = Vec::new();
    for roughness in [0.15, 0.5, 1.0] {
        let dielectric = Material {
            roughness,
            ..Material::default()
        };
        samples.push(reflecting(
            "dielectric",
            dielectric,
            Case::dielectric(roughness),
        ));
        let metal = Material::metal("", vec3(1.0, 0.7, 0.2), roughness);
        samples.push(reflecting("metal", metal, Case::metal(roughness)));
        let pane = Case::pane(roughness);
        samples.push((
            format!("pane {roughness}"),
            transmissive(roughness, None),
            Box::new(move |degrees| {
                let seen = pane.seen_at(degrees);
                [0, 1, 2].map(|c| seen.glossy_albedo(c) + seen.transmitted_albedo())
            }),
        ));
        let glass = Case::glass(roughness, 1.5);
        samples.push((
            format!("glass {roughness}"),
            transmissive(roughness, Some(clear)),
            // White light behind the surface is as bright as in front of it; its radiance is divided by n^2 on its way
            // out.
            Box::new(move |degrees| {
                let seen = glass.seen_at(degrees);
                [0, 1, 2].map(|c| seen.glossy_albedo(c) + seen.transmitted_albedo() / 2.25)
            }),
        ));
    }
    let gold = Material {
        model: MaterialModel::Conductor {
            n: GOLD.0.into(),
            k: GOLD.1.into(),
        },
        roughness: 0.3,
        ..Material::default()
    };
    samples.push(reflecting("gold", gold, Case::gold(0.3)));
    let phong = Material {
        model: MaterialModel::Phong {
            kd: vec3(0.3, 0.0, 1.0),
            ks: vec3(0.7, 1.0, 0.0),
            shininess: 30.0,
        },
        ..Material::default()
    };
    samples.push(reflecting("Phong", phong, Case::phong(30.0)));
    let blinn = Material {
        model: MaterialModel::Blinn {
            kd: vec3(0.3, 0.0, 1.0),
            ks: vec3(0.7, 1.0, 0.0),
            shininess: 30.0,
        },
        ..Material::default()
    };
    samples.push(reflecting("Blinn", blinn, Case::blinn(30.0)));
    let veil = |alpha_mode| Material {
        base_color: Vec4::new(0.5, 0.5, 0.5, 0.3),
        alpha_mode,
        ..Material::matt("", Vec3::splat(0.5))
    };
    for (name, alpha_mode, seen) in [
        ("blend", AlphaMode::Blend, 0.3 * 0.5 + 0.7),
        ("masked away", AlphaMode::Mask { cutoff: 0.31 }, 1.0),
        ("mask kept", AlphaMode::Mask { cutoff: 0.29 }, 0.5),
    ] {
        samples.push((
            name.to_owned(),
            veil(alpha_mode),
            Box::new(move |_| [seen; 3]),
        ));
    }
    samples
}

/// Strips of materials lie side by side in one plane, where none sees another. Compares their albedos for an eye at an
/// angle.
#[test]
fn albedos_are_their_quadratures() {
    let Some(gpu) = test_gpu() else { return };
    const SEEDS: u32 = 8;
    const HEIGHT: usize = 8;
    let samples = samples();
    let mut scene = Scene::new("strips");
    scene.environment = Some(white());
    let count = samples.len();
    for (at, (_, material, _)) in samples.iter().enumerate() {
        let strip = quad(vec3(at as f32, 0.0, 50.0), Vec3::X, Vec3::NEG_Z * 100.0, 1);
        let mesh = scene.add_mesh(strip);
        let material = scene.add_material(material.clone());
        scene.add_instance("", mesh, material, glam::Mat4::IDENTITY);
    }
    let size = [count as u32 * 2, HEIGHT as u32];
    let mut tracer = PathTracer::new(&gpu, &scene, size, &Settings::default()).unwrap();
    for degrees in [10.0_f64, 45.0, 75.0] {
        // Two pixels per strip, whatever the angle.
        let middle = Vec3::X * (count as f32 / 2.0);
        let angle = degrees.to_radians() as f32;
        let eye = middle + vec3(0.0, angle.cos(), angle.sin()) * 10.0;
        let camera = Camera {
            projection: Projection::Orthographic {
                height: HEIGHT as f32 / 2.0,
            },
            ..Camera::look_at("", eye, middle, 1.0)
        };
        let pictures: Vec<Vec<f32>> = (1..=SEEDS)
            .map(|seed| picture(&mut tracer, &camera, 64, seed))
            .collect();
        for (at, (name, _, expected)) in samples.iter().enumerate() {
            for (channel, expected) in expected(degrees).into_iter().enumerate() {
                let means: Vec<f64> = pictures
                    .iter()
                    .map(|picture| {
                        let pixels = picture.chunks(3).enumerate();
                        let own = pixels.filter(|(pixel, _)| pixel % (2 * count) / 2 == at);
                        let sum: f64 = own.map(|(_, color)| f64::from(color[channel])).sum();
                        sum / (2 * HEIGHT) as f64
                    })
                    .collect();
                let mean = means.iter().sum::<f64>() / f64::from(SEEDS);
                let squares: f64 = means.iter().map(|of_seed| (of_seed - mean).powi(2)).sum();
                let error = (squares / f64::from(SEEDS * (SEEDS - 1))).sqrt();
                println!("{name} at {degrees}: {mean} of {expected}, error {error}");
                assert!(error < 0.01, "{name}: an error of {error}");
                // The quadratures are accurate to about 0.001.
                let tolerance = 0.0015 + 5.0 * error;
                assert!(
                    (mean - expected).abs() < tolerance,
                    "{name} at {degrees} degrees, channel {channel}: {mean}, not {expected}"
                );
            }
        }
    }
}

/// Tiling does not change a single bit, whether along one axis or along both.
#[test]
fn tiles_are_invisible() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("ball");
    scene.environment = Some(white());
    let mesh = scene.add_mesh(sphere(1.0, 8));
    let material = scene.add_material(Material::metal("", vec3(0.9, 0.5, 0.3), 0.4));
    scene.add_instance("", mesh, material, glam::Mat4::IDENTITY);
    let camera = Camera::look_at("", vec3(0.4, 1.0, 3.0), Vec3::ZERO, 0.8);
    let size = [37, 22];
    let with_tiles = |gpu: &Gpu, side: u32| {
        let settings = Settings::default();
        let tracer = PathTracer::with_tiles(gpu, &scene, size, &settings, side, true);
        let mut tracer = tracer.unwrap();
        tracer.keep_features().unwrap();
        let count = size[0].div_ceil(side) * size[1].div_ceil(side);
        assert_eq!(tracer.tiles.len(), count as usize);
        let picture = picture(&mut tracer, &camera, 5, 4);
        let denoised = (tracer.denoised().unwrap(), tracer.features().unwrap());
        assert!(denoised.0 != picture);
        let picture = (picture, denoised);
        (picture, tracer.segments().unwrap(), tracer.noise().unwrap())
    };
    let (whole, segments, noise) = with_tiles(&gpu, TILE_SIDE);
    for side in [8, 16, 30] {
        let tiled = with_tiles(&gpu, side);
        assert!(
            tiled.0 == whole,
            "tiles of {side} pixels give another picture"
        );
        assert_eq!(tiled.1, segments);
        assert!((tiled.2 / noise - 1.0).abs() < 1e-4, "{} {noise}", tiled.2);
    }
}

/// Some rows at a time, in place of the picture that is shown, the filter gives the bits that it gives at once.
#[test]
fn a_picture_is_filtered_step_by_step() {
    let Some(gpu) = test_gpu() else { return };
    let scene = gpugi_scene::builtin::builtin("cornell", 1).unwrap();
    let size = [20, 47];
    let mut tracer = PathTracer::new(&gpu, &scene, size, &Settings::default()).unwrap();
    tracer.keep_features().unwrap();
    let picture = picture(&mut tracer, &scene.cameras[0], 4, 0);
    let comparison = crate::picture::Comparison::new(&gpu, size).unwrap();
    let shown = || {
        let bytes = u64::from(size[0] * size[1]) * 16;
        let shown = crate::gpu::read_buffer::<[f32; 4]>(&gpu, comparison.reference(), bytes);
        let pixels = shown.unwrap().into_iter();
        pixels
            .flat_map(|[r, g, b, _]| [r, g, b])
            .collect::<Vec<_>>()
    };
    tracer.show(&comparison).unwrap();
    let expected = tracer.denoised().unwrap();
    let mut filter = tracer.filter_in_steps(10 * size[0]).unwrap();
    assert!(filter.show_next(&tracer, &comparison).unwrap());
    let row = size[0] as usize * 3;
    let first = shown();
    assert!(first[..10 * row] == expected[..10 * row], "filtered rows");
    assert!(first[10 * row..] == picture[10 * row..], "rows to come");
    let mut steps = 1;
    while filter.show_next(&tracer, &comparison).unwrap() {
        steps += 1;
    }
    assert_eq!(steps, 4);
    assert!(shown() == expected, "all rows");
    tracer.resize([20, 46]).unwrap();
    assert!(
        filter.show_next(&tracer, &comparison).is_err(),
        "another size"
    );
}

/// In pieces of a few rays, with other work between them, the picture is the same to the last bit.
#[test]
fn pieces_that_never_wait_make_the_same_picture() {
    let Some(gpu) = test_gpu() else { return };
    // One with photons, and one in several tiles.
    for (name, side) in [("cornell", 16), ("glass-room", TILE_SIDE)] {
        let scene = gpugi_scene::builtin::builtin(name, 1).unwrap();
        let camera = &scene.cameras[0];
        let settings = Settings::default();
        let size = [20, 17];
        let new = || PathTracer::with_tiles(&gpu, &scene, size, &settings, side, true).unwrap();
        let mut whole = new();
        let expected = picture(&mut whole, camera, 8, 5);
        let mut pieces = new();
        pieces.restart(5).unwrap();
        let mut count = 0;
        let progress = loop {
            count += 1;
            let progress = pieces.try_render(camera, 8, 1000).unwrap();
            assert!((0.0..=1.0).contains(&progress.fraction));
            if progress.fraction == 1.0 {
                break progress;
            }
            // However slow the machine is.
            pieces.rate = 1000.0;
            std::thread::sleep(std::time::Duration::from_millis(1));
        };
        assert!(count > 10, "{name}: {count} pieces");
        assert_eq!(progress.samples, 8);
        assert_eq!(pieces.radiance().unwrap(), expected, "{name}");
        assert_eq!(progress.noise, Some(whole.noise().unwrap()), "{name}");
        let comparison = crate::picture::Comparison::new(&gpu, size).unwrap();
        pieces.show(&comparison).unwrap();
        let bytes = u64::from(size[0] * size[1]) * 16;
        let shown: Vec<[f32; 4]> =
            crate::gpu::read_buffer(&gpu, comparison.reference(), bytes).unwrap();
        let shown: Vec<f32> = shown.iter().flat_map(|pixel| pixel[..3].to_vec()).collect();
        assert_eq!(shown, expected, "{name}");
        // What was begun in pieces may be finished at once.
        pieces.restart(5).unwrap();
        pieces.try_render(camera, 8, 1000).unwrap();
        let mut on = |_: &super::Progress| ControlFlow::Continue(());
        pieces.render(camera, 8, &mut on).unwrap();
        assert_eq!(pieces.radiance().unwrap(), expected, "{name}");
    }
}

#[test]
fn no_scene_lacks_light() {
    for &BuiltinScene { name, .. } in SCENES {
        let scene = builtin(name, 1).unwrap();
        let left_out = super::left_out(&scene, &Settings::default());
        assert!(left_out.is_empty(), "{name}: {left_out:?}");
        let unbiased = Settings {
            merge_radius: 0.0,
            ..Settings::default()
        };
        if ["room", "glass-room", "fog-room"].contains(&name) {
            let lacking = super::left_out(&scene, &unbiased);
            assert!(
                lacking[0].contains("LSDSE (punctual)"),
                "{name}: {lacking:?}"
            );
        }
    }
}
