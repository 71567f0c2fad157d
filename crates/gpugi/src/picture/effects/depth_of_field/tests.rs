//! Gathered pictures of shining squares against pictures whose samples see through the same lens.

use glam::{Vec3, vec3};
use gpugi_scene::builtin::shapes::quad;
use gpugi_scene::{Camera, Lens, Material, Projection, Scene};

use super::Settings;
use crate::gpu::Gpu;
use crate::picture::{Effects, ToneMap};
use crate::testing::test_gpu;
use crate::{Renderer, Techniques};

const SIZE: [u32; 2] = [96, 64];

/// A bright square behind, a grey one at the distance of 2 m, and one in front of it, before a dark wall.
fn squares() -> Scene {
    let mut scene = Scene::new("squares");
    for (x, side, distance, brightness) in [
        (-6.0, 12.0, 8.0, 0.05),
        (-1.2, 0.8, 6.0, 0.9),
        (-0.2, 0.4, 2.0, 0.4),
        (0.18, 0.16, 1.0, 0.7),
    ] {
        let corner = vec3(x, -side / 2.0, -distance);
        let mesh = scene.add_mesh(quad(corner, Vec3::X * side, Vec3::Y * side, 1));
        let material = Material::emitter("shining", Vec3::splat(brightness));
        let material = scene.add_material(material);
        scene.add_instance("", mesh, material, Default::default());
    }
    scene
}

fn camera(blades: u32) -> Camera {
    Camera {
        lens: Lens::new(0.11, 2.0, blades).unwrap(),
        ..Camera::look_at("", Vec3::ZERO, Vec3::NEG_Z, 2.0 * 0.3_f32.atan())
    }
}

/// Linear values from 0 to 1 of a picture's pixels.
fn values(renderer: &Renderer) -> Vec<f64> {
    let decoded = |value: u8| {
        let value = f64::from(value) / 255.0;
        match value <= 0.04045 {
            true => value / 12.92,
            false => ((value + 0.055) / 1.055).powf(2.4),
        }
    };
    let pixels = renderer.pixels().unwrap();
    pixels
        .chunks_exact(4)
        .map(|rgba| decoded(rgba[0]))
        .collect()
}

fn linear(of: Effects) -> Effects {
    let mut effects = of.exposed(0.0).without_dither();
    effects.tone_map.operator = ToneMap::None;
    effects
}

fn renderer(gpu: &Gpu) -> Renderer {
    Renderer::new(gpu, &squares(), SIZE, Techniques::Named(Vec::new())).unwrap()
}

fn live(renderer: &mut Renderer, camera: &Camera, samples: u32) -> Vec<f64> {
    let mut effects = linear(Effects::of_live_view());
    effects.depth_of_field = Settings { samples };
    renderer.forget();
    for _ in 0..16 {
        renderer.restart();
        renderer
            .render_sample(camera, 1, Some(&effects), false)
            .unwrap();
    }
    values(renderer)
}

fn still(renderer: &mut Renderer, camera: &Camera, samples: u32) -> Vec<f64> {
    let effects = linear(Effects::default());
    renderer.forget();
    for _ in 0..samples {
        renderer
            .render_sample(camera, samples, Some(&effects), false)
            .unwrap();
    }
    values(renderer)
}

fn rel_mse(test: &[f64], reference: &[f64]) -> f64 {
    let squares = test.iter().zip(reference);
    let squares = squares.map(|(a, b)| (a - b).powi(2) / (b * b + 0.01));
    squares.sum::<f64>() / test.len() as f64
}

/// Takes 3 s: a still picture that is exact enough has 128 samples.
#[test]
fn live_pictures_resemble_what_a_lens_sees() {
    let Some(gpu) = test_gpu() else { return };
    let mut renderer = renderer(&gpu);
    let parallel = Camera {
        projection: Projection::Orthographic { height: 2.0 },
        lens: Lens::new(0.06, 2.0, 0).unwrap(),
        ..camera(0)
    };
    for (name, camera) in [
        ("disc", camera(0)),
        ("pentagon", camera(5)),
        ("parallel", parallel),
    ] {
        let truth = still(&mut renderer, &camera, 128);
        let sharp = rel_mse(&live(&mut renderer, &camera, 0), &truth);
        let gathered = rel_mse(&live(&mut renderer, &camera, 64), &truth);
        println!("{name}: {sharp} sharp, {gathered} gathered");
        assert!(
            gathered < 0.25 * sharp,
            "{name}: {gathered}, {sharp} without"
        );
    }
}

/// What is in focus stays as sharp as through a pinhole, but for the image of what is in front of it.
#[test]
fn what_is_in_focus_stays_as_it_is() {
    let Some(gpu) = test_gpu() else { return };
    let mut renderer = renderer(&gpu);
    let camera = camera(0);
    let pictures = [0, 64].map(|samples| live(&mut renderer, &camera, samples));
    // The grey square reaches 10.7 pixels to each side of the middle. The front one begins 19 pixels right of the middle,
    // and its image 8 pixels earlier.
    for y in 22..42 {
        for x in 38..58 {
            let at = y * SIZE[0] as usize + x;
            let [sharp, gathered] = [&pictures[0], &pictures[1]].map(|picture| picture[at]);
            assert!(
                (sharp - gathered).abs() < 0.005,
                "pixel {x}, {y}: {gathered}, not {sharp}"
            );
        }
    }
}

/// At rest, the samples take the place of the gathered picture step by step.
#[test]
fn a_picture_at_rest_fades_to_its_samples() {
    let Some(gpu) = test_gpu() else { return };
    let mut renderer = renderer(&gpu);
    let camera = camera(0);
    let truth = still(&mut renderer, &camera, 64);
    let gathered = live(&mut renderer, &camera, 64);
    let effects = linear(Effects::of_live_view());
    renderer.restart();
    let mut last = gathered.clone();
    for sample in 1..=64 {
        renderer
            .render_sample(&camera, 64, Some(&effects), false)
            .unwrap();
        if sample % 8 != 0 && sample > 2 {
            continue;
        }
        let now = values(&renderer);
        let step = rel_mse(&now, &last);
        assert!(step < 0.003, "sample {sample}: {step}");
        last = now;
    }
    assert!(rel_mse(&last, &truth) < 1e-5);
    assert!(rel_mse(&last, &gathered) > 1e-5);
}
