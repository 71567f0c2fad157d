//! Live frames in motion, and at rest after it, against all light.

use gpugi_scene::image::metrics::Metric;
use gpugi_scene::{Camera, Scene};

use super::moves::{COMPARED, FRAMES, Moves};
use super::{
    MeasureError, Options, PassTime, Progress, Report, Subject, collect, error, medians, trace,
};
use crate::gpu::Gpu;
use crate::light_paths::{LightClass, all_light};
use crate::lighting::Readiness;
use crate::picture::Effects;
use crate::renderer::Renderer;
use crate::techniques::Budget;

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
    /// HDR-FLIP of frames in motion: mean of three.
    pub moving: f64,
    /// HDR-FLIP after 16 frames at rest.
    pub still: f64,
    /// Mean difference between two frames in a row of a camera that stands still while frames count as being in motion, as a
    /// part of white on the display.
    pub flicker: f64,
    /// Radiance of the last frame in motion, as a part of its reference's: median over blocks of 16 x 16 pixels, so that
    /// lamps and their edges do not decide.
    pub brightness: f64,
    /// Estimated rel-mse of the references: the largest.
    pub reference_rel_mse: f64,
    /// The last frame in motion, and its reference: linear radiance, three floats per pixel.
    #[serde(skip)]
    pub last: [Vec<f32>; 2],
}

/// The path tracer's pictures of the frames in motion that are compared, with all light.
#[derive(Debug, Clone)]
pub struct LiveTruth {
    /// What moves.
    pub moves: Moves,
    /// The scene's time in the first frame (s).
    pub time: f32,
    /// Width and height (pixels).
    pub size: [u32; 2],
    /// Linear radiance, three floats per pixel, in rows from top to bottom.
    radiance: [Vec<f32>; COMPARED.len()],
    /// Estimated rel-mse: the largest.
    pub rel_mse: f64,
    /// As [`Truth::notes`](super::Truth::notes).
    pub notes: Vec<String>,
}

/// Traces the references of [`measure_live`] for the view of a subject, by the quality of `options`. `classes`: those that the
/// scene has. `moves`: what moves, and the scene's time in the first frame (s).
///
/// # Errors
/// [`MeasureError`].
pub fn trace_live(
    gpu: &Gpu,
    subject: &Subject<'_>,
    (moves, time): (&Moves, f32),
    classes: &[LightClass],
    options: &Options,
    report: Report<'_>,
) -> Result<LiveTruth, MeasureError> {
    let Subject {
        scene,
        camera,
        size,
    } = *subject;
    let parts = [all_light(classes)];
    let mut truth = LiveTruth {
        moves: moves.clone(),
        time,
        size,
        radiance: [const { Vec::new() }; COMPARED.len()],
        rel_mse: 0.0,
        notes: Vec::new(),
    };
    for (radiance, frame) in truth.radiance.iter_mut().zip(COMPARED) {
        let (scene, camera) = moves.at((scene, camera), time, frame);
        let subject = Subject {
            scene: &scene,
            camera: &camera,
            size,
        };
        let traced = trace(gpu, &subject, &parts, options, report)?;
        truth.rel_mse = truth.rel_mse.max(traced.rel_mse());
        *radiance = traced.radiance;
        truth.notes.extend(traced.notes);
    }
    Ok(truth)
}

/// Measures live frames of `renderer` with `effects`, such as those of a live view. It renders `scene`, as seen by `camera`,
/// while what `truth` says moves. Frames of another size than `truth`'s are enlarged, as a viewer enlarges them. Maps get
/// the work per frame that a view begins with. In the end, the renderer shows `scene` and has its budget again.
///
/// # Errors
/// [`MeasureError`].
pub fn measure_live(
    (scene, camera): (&Scene, &Camera),
    renderer: &mut Renderer,
    effects: &Effects,
    truth: &LiveTruth,
    options: &Options,
    report: Report<'_>,
) -> Result<Live, MeasureError> {
    let before = renderer.set_budget(Budget::UNLIMITED);
    let measured = measured(
        (scene, camera),
        &mut *renderer,
        effects,
        truth,
        options,
        report,
    );
    renderer.set_budget(before);
    if truth.moves != Moves::Camera {
        renderer.update(scene)?;
    }
    measured
}

fn measured(
    (scene, camera): (&Scene, &Camera),
    renderer: &mut Renderer,
    effects: &Effects,
    truth: &LiveTruth,
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
    let (size, of) = (truth.size, renderer.size());
    let shown_by =
        |renderer: &Renderer| Ok::<_, MeasureError>(enlarged(of, &renderer.live_radiance()?, size));
    let flip =
        |shown: &[f32], truth: &[f32]| error(Metric::Flip, ("the live view", shown), truth, size);
    let effects = &effects.clone().without_dither();
    let mut times = Vec::new();
    let mut whole = Vec::new();
    let mut errors = Vec::new();
    let mut last = Vec::new();
    renderer.set_seed(options.seed);
    let at = |frame| truth.moves.at((scene, camera), truth.time, frame);
    let (first, seen) = at(0);
    renderer.update(&first)?;
    // Maps that are made once are no part of a frame.
    let readiness = renderer.converge(&seen, false, |readiness, _| {
        report(&Progress::of_maps(readiness))
    })?;
    if readiness != Readiness::Ready {
        return Err(MeasureError::Interrupted);
    }
    renderer.forget();
    // Maps of what moves take turns, as in a view.
    renderer.set_budget(Budget::units(Budget::LIVE_VIEW_UNITS));
    for frame in 0..FRAMES {
        let (shown, seen) = at(frame);
        if truth.moves != Moves::Camera {
            renderer.update(&shown)?;
        }
        renderer.restart();
        let timings = renderer.render_sample(&seen, 1, Some(effects), true)?;
        let passes = timings.wait()?;
        if frame >= FRAMES / 2 {
            whole.push(passes.iter().map(|pass| pass.milliseconds).sum::<f64>());
            collect(&mut times, passes);
        }
        let compared = COMPARED.iter().position(|&compared| compared == frame);
        if let Some(compared) = compared {
            last = shown_by(renderer)?;
            errors.push(flip(&last, &truth.radiance[compared])?);
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
    renderer.set_budget(Budget::UNLIMITED);
    let (_, seen) = at(FRAMES - 1);
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
    // All stands still where it was in the last frame.
    let truth_of_last = &truth.radiance[COMPARED.len() - 1];
    let still = flip(&shown_by(renderer)?, truth_of_last)?;
    whole.sort_by(f64::total_cmp);
    let passes = medians(times);
    Ok(Live {
        milliseconds: (!passes.is_empty()).then(|| whole[whole.len() / 2]),
        passes,
        moving: errors.iter().sum::<f64>() / errors.len() as f64,
        still,
        flicker: difference(&pixels),
        brightness: brightness(size, [&last, truth_of_last]),
        reference_rel_mse: truth.rel_mse,
        last: [last, truth_of_last.clone()],
    })
}

/// A picture of `of` pixels with `size` pixels, linear between their centres.
fn enlarged(of: [u32; 2], picture: &[f32], size: [u32; 2]) -> Vec<f32> {
    if of == size {
        return picture.to_vec();
    }
    let place = |at: u32, axis: usize| {
        let place = (at as f32 + 0.5) * of[axis] as f32 / size[axis] as f32 - 0.5;
        let place = place.clamp(0.0, (of[axis] - 1) as f32);
        let first = place as usize;
        (first, (first + 1).min(of[axis] as usize - 1), place.fract())
    };
    let mut all = Vec::with_capacity(size[0] as usize * size[1] as usize * 3);
    for y in 0..size[1] {
        let (top, bottom, down) = place(y, 1);
        for x in 0..size[0] {
            let (left, right, across) = place(x, 0);
            all.extend((0..3).map(|channel| {
                let value = |x: usize, y: usize| picture[(y * of[0] as usize + x) * 3 + channel];
                let row = |y: usize| value(left, y) * (1.0 - across) + value(right, y) * across;
                row(top) * (1.0 - down) + row(bottom) * down
            }));
        }
    }
    all
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Linear between centres of pixels, and constant beyond those at the border.
    #[test]
    fn small_pictures_are_enlarged_evenly() {
        let ramp = |width: u32| -> Vec<f32> {
            let places = (0..width * 2).map(|pixel| (pixel % width) as f32 + 0.5);
            places
                .flat_map(|place| [place / width as f32, 1.0, 2.0])
                .collect()
        };
        let found = enlarged([4, 2], &ramp(4), [8, 6]);
        assert_eq!(found.len(), 8 * 6 * 3);
        for (row, pixels) in found.chunks(8 * 3).enumerate() {
            for (pixel, expected) in pixels.chunks(3).zip(ramp(8).chunks(3)).skip(1).take(6) {
                let far = pixel
                    .iter()
                    .zip(expected)
                    .any(|(a, b)| (a - b).abs() > 1e-6);
                assert!(!far, "{row}: {pixel:?} {expected:?}");
            }
            assert_eq!((pixels[0], pixels[21]), (0.125, 0.875));
        }
        assert_eq!(enlarged([4, 2], &ramp(4), [4, 2]), ramp(4));
    }
}
