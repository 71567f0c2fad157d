//! Paths that end on light of earlier frames find the same light, with less noise.

use glam::Mat4;
use gpugi_scene::Scene;
use gpugi_scene::builtin::builtin;

use super::super::INFO;
use crate::Renderer;
use crate::gpu::Gpu;
use crate::picture::Effects;
use crate::picture::effects::denoise::Filter;
use crate::testing::test_gpu;

const SIZE: [u32; 2] = [32, 28];
const FRAMES: usize = 32;

/// Frames of a live view at rest, without a filter, each of which begins anew; the last half of them, after the cells have
/// learned.
fn frames(gpu: &Gpu, scene: &Scene, ends: bool) -> Vec<Vec<f32>> {
    let mut renderer = Renderer::new(gpu, scene, SIZE, &[INFO.name]).unwrap();
    renderer
        .set(INFO.name, "cache", if ends { "true" } else { "false" })
        .unwrap();
    let mut effects = Effects::of_live_view().exposed(1.0).without_dither();
    effects.denoise.filter = Filter::None;
    effects.temporal_antialiasing.interval = 1;
    let frames = (0..FRAMES).map(|_| {
        renderer.restart();
        renderer
            .render_sample(&scene.cameras[0], 1, Some(&effects), false)
            .unwrap();
        renderer.radiance().unwrap()
    });
    frames.skip(FRAMES / 2).collect()
}

/// Mean of the frames, pixel by pixel, and the mean variance of what is no lamp.
fn moments(frames: &[Vec<f32>]) -> (f64, f64) {
    let count = frames.len() as f64;
    let (mut sum, mut variance) = (0.0, 0.0);
    for value in 0..frames[0].len() {
        let values = frames.iter().map(|frame| f64::from(frame[value].min(2.0)));
        let mean = values.clone().sum::<f64>() / count;
        sum += mean;
        variance += values.map(|value| (value - mean).powi(2)).sum::<f64>() / count;
    }
    (sum, variance)
}

/// In metres, and in centimetres far from the origin.
#[test]
fn the_light_is_the_same_and_its_noise_is_less() {
    let Some(gpu) = test_gpu() else { return };
    let near = builtin("cornell", 1).unwrap();
    let mut far = near.clone();
    let moved = Mat4::from_translation(glam::vec3(3e4, -2e4, 1e4)) * Mat4::from_scale(glam::Vec3::splat(100.0));
    for instance in &mut far.instances {
        instance.world_from_mesh = moved * instance.world_from_mesh;
    }
    for camera in &mut far.cameras {
        camera.world_from_view = moved * camera.world_from_view;
    }
    for scene in [near, far] {
        let [(without, noise_without), (with, noise_with)] =
            [false, true].map(|ends| moments(&frames(&gpu, &scene, ends)));
        println!("light {:.3}, noise {:.3}", with / without, noise_with / noise_without);
        assert!((with / without - 1.0).abs() < 0.03, "{with} of {without}");
        assert!(noise_with < 0.8 * noise_without, "{noise_with} of {noise_without}");
    }
}

/// Cells hold sums of whole numbers, so the order of paths does not matter.
#[test]
fn the_same_frames_have_the_same_bits() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("cornell", 1).unwrap();
    let [first, second] = [(); 2].map(|()| frames(&gpu, &scene, true));
    assert!(first == second, "the frames differ");
}
