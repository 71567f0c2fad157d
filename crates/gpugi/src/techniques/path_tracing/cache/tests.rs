//! Paths that end on light of earlier frames find the same light, with less noise. Each test takes 2 to 3 s, most of it to compile
//! shaders.

use glam::{Mat4, Vec3, vec3, vec4};
use gpugi_scene::Scene;
use gpugi_scene::builtin::builtin;

use super::super::{INFO, PathTracing};
use crate::Renderer;
use crate::gpu::Gpu;
use crate::picture::Effects;
use crate::picture::effects::denoise::Filter;
use crate::testing::test_gpu;

const SIZE: [u32; 2] = [112, 96];

/// Frames of a live view at rest, without a filter, each of which begins anew; the last half of them, after the cells have
/// learned.
fn frames(gpu: &Gpu, scene: &Scene, count: usize, ends: bool) -> Vec<Vec<f32>> {
    let mut renderer = Renderer::new(gpu, scene, SIZE, &[INFO.name]).unwrap();
    renderer
        .set(INFO.name, "cache", if ends { "true" } else { "false" })
        .unwrap();
    // So small a picture would teach few cells.
    let changed = renderer.change(|technique: &mut PathTracing| {
        technique.places_of_block = Some(64);
    });
    changed.unwrap();
    let mut effects = Effects::of_live_view().exposed(1.0).without_dither();
    effects.denoise.filter = Filter::None;
    effects.temporal_antialiasing.interval = 1;
    let frames = (0..count).map(|_| {
        renderer.restart();
        renderer
            .render_sample(&scene.cameras[0], 1, Some(&effects), false)
            .unwrap();
        renderer.radiance().unwrap()
    });
    frames.skip(count / 2).collect()
}

/// Mean of the frames, pixel by pixel, and the mean variance; lamps have none.
fn moments(frames: &[Vec<f32>]) -> (f64, f64) {
    let count = frames.len() as f64;
    let (mut sum, mut variance) = (0.0, 0.0);
    for value in 0..frames[0].len() {
        let values = frames.iter().map(|frame| f64::from(frame[value]));
        let mean = values.clone().sum::<f64>() / count;
        sum += mean;
        variance += values.map(|value| (value - mean).powi(2)).sum::<f64>() / count;
    }
    (sum, variance)
}

/// In centimetres, far from the origin, between white walls, whose light comes from many surfaces.
#[test]
fn the_light_is_the_same_and_its_noise_is_less() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = builtin("cornell", 1).unwrap();
    let place = Mat4::from_translation(vec3(3e4, -2e4, 1e4)) * Mat4::from_scale(Vec3::splat(100.0));
    for instance in &mut scene.instances {
        instance.world_from_mesh = place * instance.world_from_mesh;
    }
    for material in &mut scene.materials {
        material.base_color = vec4(0.9, 0.9, 0.9, 1.0);
    }
    for camera in &mut scene.cameras {
        camera.world_from_view.w_axis = place * camera.world_from_view.w_axis;
    }
    let [(without, noise_without), (with, noise_with)] =
        [false, true].map(|ends| moments(&frames(&gpu, &scene, 8, ends)));
    let (light, noise) = (with / without, noise_with / noise_without);
    println!("light {light:.3}, noise {noise:.3}");
    assert!((light - 1.0).abs() < 0.05, "light {light}");
    assert!(noise < 0.75, "noise {noise}");
}

/// Cells hold sums of whole numbers, so the order of paths does not matter.
#[test]
fn the_same_frames_have_the_same_bits() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("cornell", 1).unwrap();
    let [first, second] = [(); 2].map(|()| frames(&gpu, &scene, 6, true));
    assert!(first == second, "the frames differ");
}
