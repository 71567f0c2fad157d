//! Live frames in motion, and at rest after it, against all light.

use glam::{Mat4, Quat};
use gpugi_scene::image::metrics::{Metric, Picture, compare};
use gpugi_scene::{Camera, Scene};

use super::{MeasureError, Options, PassTime, Progress, Report, Subject, collect, medians, trace};
use crate::gpu::Gpu;
use crate::light_paths::all_light;
use crate::lighting::Readiness;
use crate::picture::Effects;
use crate::renderer::Renderer;

/// Frames of the orbit, and those of them that are compared.
const FRAMES: u32 = 36;
const COMPARED: [u32; 3] = [27, 31, 35];
/// Degrees per frame.
const SPEED: f32 = 0.3;
/// Frames at rest, of a picture that would have as many samples as views have.
const REST_FRAMES: u32 = 16;
const REST_SAMPLES: u32 = 64;

/// Live frames, measured.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Live {
    /// GPU time of a frame in motion: median (ms). `None` if the adapter cannot time passes.
    pub milliseconds: Option<f64>,
    /// GPU time of each pass.
    pub passes: Vec<PassTime>,
    /// HDR-FLIP of frames in orbit, 0.3 degrees per frame: mean of three.
    pub moving: f64,
    /// HDR-FLIP after 16 frames at rest.
    pub still: f64,
    /// Mean difference between two frames in a row of a camera that stands still while frames count as being in motion, as a
    /// part of white on the display.
    pub flicker: f64,
    /// Radiance of the last frame of the orbit, as a part of its reference's: median over blocks of 16 x 16 pixels, so that
    /// lamps and their edges do not decide.
    pub brightness: f64,
    /// Estimated rel-mse of the references: the largest.
    pub reference_rel_mse: f64,
    /// The last frame of the orbit, and its reference: linear radiance, three floats per pixel.
    #[serde(skip)]
    pub last: [Vec<f32>; 2],
}

/// Measures live frames of `renderer` with `effects`, such as those of a live view. It renders `scene`, as seen by `camera` in
/// orbit about the middle of its bounds.
///
/// # Errors
/// [`MeasureError`].
pub fn measure_live(
    gpu: &Gpu,
    (scene, camera): (&Scene, &Camera),
    renderer: &mut Renderer,
    effects: &Effects,
    options: &Options,
    report: Report<'_>,
) -> Result<Live, MeasureError> {
    if !effects.temporal_antialiasing.is_on() {
        return Err(MeasureError::Picture {
            of: "the live view",
            reason:
                "frames remember none before them: temporal-antialiasing.frames must be 2 or more"
                    .into(),
        });
    }
    let size = renderer.size();
    let parts = [all_light(&renderer.light_classes())];
    let truth = |camera: &Camera, report: Report<'_>| {
        let subject = Subject {
            scene,
            camera,
            size,
        };
        trace(gpu, &subject, &parts, options, report)
    };
    let effects = &effects.clone().without_dither();
    let mut times = Vec::new();
    let mut whole = Vec::new();
    let mut errors = Vec::new();
    let mut last = [Vec::new(), Vec::new()];
    let mut noise = 0.0_f64;
    renderer.set_seed(options.seed);
    // Maps that are made once are no part of a frame.
    let readiness = renderer.converge(&orbit(scene, camera, 0), false, |readiness, _| {
        report(&Progress {
            stage: "maps".to_owned(),
            fraction: f64::from(readiness.progress()),
            state: format!("{:.0} %", readiness.progress() * 100.0),
        })
    })?;
    if readiness != Readiness::Ready {
        return Err(MeasureError::Interrupted);
    }
    renderer.forget();
    for frame in 0..FRAMES {
        let seen = orbit(scene, camera, frame);
        renderer.restart();
        let timings = renderer.render_sample(&seen, 1, Some(effects), true)?;
        let passes = timings.wait()?;
        if frame >= FRAMES / 2 {
            whole.push(passes.iter().map(|pass| pass.milliseconds).sum::<f64>());
            collect(&mut times, passes);
        }
        if COMPARED.contains(&frame) {
            let shown = renderer.live_radiance()?;
            let truth = truth(&seen, report)?;
            noise = noise.max(truth.rel_mse());
            errors.push(flip(size, &shown, &truth.radiance)?);
            last = [shown, truth.radiance];
        }
        let progress = Progress {
            stage: "frames".to_owned(),
            fraction: f64::from(frame + 1) / f64::from(FRAMES),
            state: format!("{} of {FRAMES}", frame + 1),
        };
        if report(&progress).is_break() {
            return Err(MeasureError::Interrupted);
        }
    }
    let seen = orbit(scene, camera, FRAMES - 1);
    let mut pixels = [Vec::new(), Vec::new()];
    for frame in 0..4 {
        renderer.restart();
        renderer.render_sample(&seen, 1, Some(effects), false)?;
        pixels[frame % 2] = renderer.pixels()?;
    }
    renderer.restart();
    for _ in 0..REST_FRAMES {
        renderer.render_sample(&seen, REST_SAMPLES, Some(effects), false)?;
    }
    // The orbit ended where the camera stands.
    let still = flip(size, &renderer.live_radiance()?, &last[1])?;
    whole.sort_by(f64::total_cmp);
    let passes = medians(times);
    Ok(Live {
        milliseconds: (!passes.is_empty()).then(|| whole[whole.len() / 2]),
        passes,
        moving: errors.iter().sum::<f64>() / errors.len() as f64,
        still,
        flicker: difference(&pixels),
        brightness: brightness(size, [&last[0], &last[1]]),
        reference_rel_mse: noise,
        last,
    })
}

/// The camera after so many frames of an orbit.
fn orbit(scene: &Scene, camera: &Camera, frame: u32) -> Camera {
    let center = Mat4::from_translation(scene.bounds().center());
    let angle = SPEED * (frame as f32 + 1.0 - FRAMES as f32);
    let turn = Mat4::from_quat(Quat::from_rotation_y(angle.to_radians()));
    let mut moved = camera.clone();
    moved.world_from_view = center * turn * center.inverse() * camera.world_from_view;
    moved
}

fn flip(size: [u32; 2], shown: &[f32], truth: &[f32]) -> Result<f64, MeasureError> {
    let picture = |of: &'static str, radiance: &[f32]| {
        Picture::of_radiance(size[0], size[1], radiance.to_vec())
            .map_err(|reason| MeasureError::Picture { of, reason })
    };
    let shown = picture("the live view", shown)?;
    let truth = picture("the path tracer", truth)?;
    let result = compare(Metric::Flip, &shown, &truth);
    Ok(result.expect("pictures of one size").value)
}

/// Mean difference of two pictures' channels, as a part of white.
fn difference([a, b]: &[Vec<u8>; 2]) -> f64 {
    let steps: u64 = a
        .iter()
        .zip(b)
        .map(|(a, b)| u64::from(a.abs_diff(*b)))
        .sum();
    // Alpha is the same.
    steps as f64 / (a.len() as f64 * 0.75) / 255.0
}

/// [`Live::brightness`].
fn brightness([width, height]: [u32; 2], pictures: [&[f32]; 2]) -> f64 {
    const BLOCK: usize = 16;
    let [width, height] = [width as usize, height as usize];
    let sum = |radiance: &[f32], x: usize, y: usize| {
        let rows = y..(y + BLOCK).min(height);
        let of_row = |row: usize| {
            &radiance[(row * width + x) * 3..(row * width + (x + BLOCK).min(width)) * 3]
        };
        let values = rows.flat_map(of_row);
        values.copied().map(f64::from).sum::<f64>()
    };
    let mut ratios: Vec<f64> = (0..height)
        .step_by(BLOCK)
        .flat_map(|y| (0..width).step_by(BLOCK).map(move |x| (x, y)))
        .map(|(x, y)| pictures.map(|radiance| sum(radiance, x, y)))
        .filter(|[_, truth]| *truth > 0.0)
        .map(|[shown, truth]| shown / truth)
        .collect();
    ratios.sort_by(f64::total_cmp);
    ratios.get(ratios.len() / 2).copied().unwrap_or(1.0)
}
