//! Measures how far samples and images jump from frame to frame while the sky turns: by its rotation, or texel by texel
//! with a warm or cold start. Prints the figures of docs/techniques/image-based-lighting.md: `cargo test --package
//! gpugi --lib stability -- --nocapture`.

use std::sync::Arc;

use std::f32::consts::{PI, TAU};

use glam::Vec3;
use gpugi_scene::{Pixels, Scene};

use super::{Decomposition, ImageBasedLighting, Settings, Sight, settings, still};
use crate::gpu::Gpu;
use crate::scene::GpuScene;
use crate::testing::test_gpu;

/// Columns of the sky's texels; it turns by one per frame.
const COLUMNS: usize = 128;
const FRAMES: usize = 5;

/// How the sky is turned, and where samples start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Turn {
    Rotation,
    Warm,
    Cold,
}

/// The scene `sky` with the environment moved eastward by `texels`.
fn turned(sky: &Scene, texels: usize) -> Scene {
    let mut scene = sky.clone();
    if let Some(environment) = &mut scene.environment
        && let Pixels::Rgba32Float(values) = &mut Arc::make_mut(&mut environment.image).pixels
    {
        for row in values.chunks_exact_mut(COLUMNS * 4) {
            row.rotate_right(texels * 4);
        }
    }
    scene
}

/// Samples in world space, and the image.
type Seen = (Vec<Vec3>, Vec<f32>);

fn frames(gpu: &Gpu, sky: &Scene, turn: Turn, settings: &Settings) -> Vec<Seen> {
    let mut scene = GpuScene::new(gpu, sky).unwrap();
    let mut technique = ImageBasedLighting::new(gpu, &scene).unwrap();
    technique.settings = settings.clone();
    let mut sight = Sight::new(gpu, &scene);
    let mut seen = |frame: usize| {
        // A rotation shares the image, whose texels stay where they are.
        let mut after = if turn == Turn::Rotation {
            sky.clone()
        } else {
            turned(sky, frame)
        };
        let environment = after.environment.as_mut().unwrap();
        if turn == Turn::Rotation {
            // Eastward means from -Z to +X, against a rotation about +Y.
            let angle = -TAU * frame as f32 / COLUMNS as f32;
            environment.rotation = glam::Quat::from_rotation_y(angle);
        }
        scene.update(gpu, &after).unwrap();
        if turn == Turn::Cold {
            technique.decomposition = Decomposition::new(gpu, &scene).unwrap();
        }
        let picture = sight.frame(gpu, &mut scene, &mut technique);
        let directions = super::directions(gpu, &mut technique, &scene);
        let samples = directions
            .iter()
            .map(|direction| direction.toward.into())
            .collect();
        (samples, picture)
    };
    (0..FRAMES).map(&mut seen).collect()
}

/// Largest and mean distance from a sample to the nearest one of the next frame, in mean distances between samples.
fn movement(frames: &[Seen], count: u32) -> [f32; 2] {
    let spacing = (4.0 * PI / count as f32).sqrt();
    let mut moved = Vec::new();
    for pair in frames.windows(2) {
        for sample in &pair[0].0 {
            let next = pair[1].0.iter().map(|other| other.distance(*sample));
            moved.push(next.fold(2.0, f32::min) / spacing);
        }
    }
    let largest = moved.iter().copied().fold(0.0, f32::max);
    [largest, moved.iter().sum::<f32>() / moved.len() as f32]
}

/// Mean square of the change from frame to frame, or of its difference from that of `truth` if given, relative to the
/// values, as in rel-mse.
fn change(frames: &[Seen], truth: Option<&[Seen]>) -> f32 {
    let mut sum = 0.0;
    let mut count = 0;
    for at in 1..frames.len() {
        let colors = frames[at].1.iter().enumerate();
        // The fourth channel is unused.
        for (index, &value) in colors.filter(|(index, _)| index % 4 < 3) {
            let mut step = value - frames[at - 1].1[index];
            if let Some(truth) = truth {
                step -= truth[at].1[index] - truth[at - 1].1[index];
            }
            sum += step * step / (value * value + 0.01);
            count += 1;
        }
    }
    sum / count as f32
}

#[test]
fn a_turning_sky_does_not_flicker() {
    let Some(gpu) = test_gpu() else { return };
    let sky = still([COLUMNS as u32, COLUMNS as u32 / 2]);
    let settings = Settings {
        resolution: 128,
        ..settings(128)
    };
    let most = Settings {
        samples: 1024,
        ..settings.clone()
    };
    let truth = frames(&gpu, &sky, Turn::Rotation, &most);
    println!("truth: changes by {:.1e}", change(&truth, None));
    let [rotation, warm, cold] = [Turn::Rotation, Turn::Warm, Turn::Cold].map(|turn| {
        let seen = frames(&gpu, &sky, turn, &settings);
        let [largest, mean] = movement(&seen, settings.samples);
        let (all, beyond) = (change(&seen, None), change(&seen, Some(&truth)));
        println!(
            "{turn:?}: samples move by {largest:.2} and {mean:.3}; changes by {all:.1e}, {beyond:.1e} beyond the truth"
        );
        (largest, mean, beyond)
    });
    // A rotated sky moves samples by at most one of its texels. With a warm start, samples move and flicker far less
    // than with a cold one.
    let texel = TAU / COLUMNS as f32 / (4.0 * PI / settings.samples as f32).sqrt();
    assert!(rotation.0 < 1.01 * texel, "{rotation:?}");
    assert!(warm.0 < 0.6 * cold.0, "{warm:?}, {cold:?}");
    assert!(warm.1 < 0.4 * cold.1, "{warm:?}, {cold:?}");
    assert!(warm.2 < 0.4 * cold.2, "{warm:?}, {cold:?}");
}
