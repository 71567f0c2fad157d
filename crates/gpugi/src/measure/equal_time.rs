//! Error at equal time: what a set of techniques, or the path tracer, shows when so many milliseconds have passed. Shaders are
//! compiled and scenes uploaded before. docs/equal-time.md.

use std::ops::ControlFlow;
use std::time::Instant;

use gpugi_scene::image::metrics::Metric;
use gpugi_scene::{Camera, Scene};

use super::{
    Live, LiveTruth, MeasureError, Options, Progress, Report, Subject, Truth, error, measure_live,
};
use crate::gpu::Gpu;
use crate::lighting::Readiness;
use crate::picture::Effects;
use crate::reference::{PathTracer, Settings};
use crate::renderer::Renderer;

/// Most samples of a still picture, and of the path tracer's at once.
const MOST_SAMPLES: u32 = 1 << 20;
const MOST_AT_ONCE: u32 = 256;
/// By how much a live frame may exceed its time.
const TOLERANCE: f64 = 1.1;
/// Part of the time for which a size is chosen, and how often it is.
const AIM: f64 = 0.95;
const TRIES: u32 = 3;
/// Fewest pixels of a live frame along a side.
const LEAST_SIDE: u32 = 16;

/// A still picture for which there was some time.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct StillInTime {
    /// Time that there was (ms).
    pub budget: f64,
    /// Time that it took: maps, samples, and filter (ms).
    pub milliseconds: f64,
    /// Samples per pixel.
    pub samples: u32,
    /// Error: HDR-FLIP.
    pub flip: f64,
    /// Relative mean squared error.
    pub rel_mse: f64,
}

/// Live frames of a size for which there was some time.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct LiveInTime {
    /// Time that there was for a frame (ms).
    pub budget: f64,
    /// GPU time of a frame in motion (ms).
    pub milliseconds: f64,
    /// Width and height (pixels). Frames are enlarged to the size of the picture.
    pub size: [u32; 2],
    /// HDR-FLIP in motion, as [`Live::moving`].
    pub moving: f64,
    /// HDR-FLIP at rest, as [`Live::still`].
    pub still: f64,
    /// As [`Live::flicker`].
    pub flicker: f64,
}

/// A picture is kept from so many samples' time before a time ends: the next one may take longer than the last.
const AHEAD: f64 = 4.0;

/// A picture, and what it took.
struct Made {
    radiance: Vec<f32>,
    milliseconds: f64,
    samples: u32,
}

/// Compares pictures with the truth as their times end.
struct Clock<'a> {
    size: [u32; 2],
    truth: &'a [f32],
    budgets: &'a [f64],
    found: Vec<Option<StillInTime>>,
    /// The last picture that was in time.
    last: Option<Made>,
}

impl<'a> Clock<'a> {
    /// `budgets`: ms, ascending.
    fn new(size: [u32; 2], truth: &'a Truth, budgets: &'a [f64]) -> Self {
        Self {
            size,
            truth: &truth.radiance,
            budgets,
            found: Vec::new(),
            last: None,
        }
    }

    /// The next time that ends (ms).
    fn next(&self) -> Option<f64> {
        self.budgets.get(self.found.len()).copied()
    }

    /// Follows a picture that takes `elapsed` (ms) so far, whose next sample may take `of_next`: keeps it if the next time
    /// soon ends, and compares what there was in time when it has.
    fn follow(
        &mut self,
        [elapsed, of_next]: [f64; 2],
        mut make: impl FnMut() -> Result<Option<Made>, MeasureError>,
    ) -> Result<(), MeasureError> {
        let mut is_kept = false;
        while let Some(budget) = self.next() {
            if !is_kept && elapsed <= budget && elapsed + AHEAD * of_next > budget {
                self.last = make()?.or(self.last.take());
                is_kept = true;
            }
            if elapsed + of_next <= budget {
                break;
            }
            self.end(budget)?;
        }
        Ok(())
    }

    /// Compares what there was when a time ended.
    fn end(&mut self, budget: f64) -> Result<(), MeasureError> {
        let made = self
            .last
            .as_ref()
            .filter(|made| made.milliseconds <= budget);
        let of = |metric, shown: &[f32]| {
            error(metric, ("the still picture", shown), self.truth, self.size)
        };
        let found = made.map(|made| {
            Ok::<_, MeasureError>(StillInTime {
                budget,
                milliseconds: made.milliseconds,
                samples: made.samples,
                flip: of(Metric::Flip, &made.radiance)?,
                rel_mse: of(Metric::RelMse, &made.radiance)?,
            })
        });
        self.found.push(found.transpose()?);
        Ok(())
    }

    /// The last picture counts for all times that have not ended.
    fn finish(mut self) -> Result<Vec<Option<StillInTime>>, MeasureError> {
        while let Some(budget) = self.next() {
            self.end(budget)?;
        }
        Ok(self.found)
    }

    fn progress(&self, name: &str, elapsed: f64, samples: u32) -> Progress {
        let last = self.budgets.last().copied().unwrap_or(1.0);
        Progress {
            stage: name.to_owned(),
            fraction: (elapsed / last).min(1.0),
            state: format!("{samples} samples"),
        }
    }
}

/// Still pictures by `renderer` for each of the times `budgets` (ms, ascending), from stale maps on: maps are made final,
/// and then samples are taken as long as another one fits. `None` where there is no sample in time.
///
/// # Errors
/// [`MeasureError`].
pub fn stills_in_time(
    gpu: &Gpu,
    camera: &Camera,
    renderer: &mut Renderer,
    (truth, budgets): (&Truth, &[f64]),
    options: &Options,
    report: Report<'_>,
) -> Result<Vec<Option<StillInTime>>, MeasureError> {
    renderer.set_seed(options.seed);
    renderer.set_motion(options.motion.clone(), options.shutter_steps)?;
    let mut clock = Clock::new(renderer.size(), truth, budgets);
    let converge = |renderer: &mut Renderer, report: Report<'_>| {
        let is_done = |readiness: Readiness, _| report(&Progress::of_maps(readiness));
        match renderer.converge(camera, false, is_done)? {
            Readiness::Ready => Ok(()),
            _ => Err(MeasureError::Interrupted),
        }
    };
    // Everything is compiled, uploaded and unwrapped.
    converge(renderer, report)?;
    renderer.render_sample(camera, MOST_SAMPLES, None, false)?;
    gpu.wait()?;
    renderer.invalidate();
    renderer.restart();
    let began = Instant::now();
    converge(renderer, report)?;
    let mut elapsed = milliseconds(began);
    let mut of_sample = 0.0;
    loop {
        let samples = renderer.samples();
        clock.follow([elapsed, of_sample], || {
            Ok((samples > 0).then_some(Made {
                radiance: renderer.radiance()?,
                milliseconds: elapsed,
                samples,
            }))
        })?;
        if clock.next().is_none() || samples == MOST_SAMPLES {
            return clock.finish();
        }
        let began = Instant::now();
        renderer.render_sample(camera, MOST_SAMPLES, None, false)?;
        gpu.wait()?;
        of_sample = milliseconds(began);
        elapsed += of_sample;
        if report(&clock.progress("samples", elapsed, samples + 1)).is_break() {
            return Err(MeasureError::Interrupted);
        }
    }
}

/// Still pictures by the path tracer for each of the times `budgets` (ms, ascending), without and with its noise filtered. `None`
/// where there is no sample in time.
///
/// # Errors
/// [`MeasureError`].
pub fn path_traced_in_time(
    gpu: &Gpu,
    subject: &Subject<'_>,
    (truth, budgets): (&Truth, &[f64]),
    options: &Options,
    report: Report<'_>,
) -> Result<[Vec<Option<StillInTime>>; 2], MeasureError> {
    let mut clocks = [(); 2].map(|()| Clock::new(subject.size, truth, budgets));
    let mut tracer = PathTracer::new(gpu, subject.scene, subject.size, &Settings::default())?;
    tracer.keep_features()?;
    tracer.set_motion(options.motion.clone())?;
    let mut trace = |tracer: &mut PathTracer, samples: u32, progress: &Progress| {
        let began = Instant::now();
        let mut flow = ControlFlow::Continue(());
        let mut follow = |_: &_| {
            flow = report(progress);
            flow
        };
        tracer.render(subject.camera, samples, &mut follow)?;
        gpu.wait()?;
        match flow {
            ControlFlow::Continue(()) => Ok(milliseconds(began)),
            ControlFlow::Break(()) => Err(MeasureError::Interrupted),
        }
    };
    let denoised = |tracer: &PathTracer| {
        let began = Instant::now();
        let radiance = tracer.denoised()?;
        Ok::<_, MeasureError>((radiance, milliseconds(began)))
    };
    // Everything is compiled.
    trace(&mut tracer, 2, &clocks[0].progress("path tracer", 0.0, 0))?;
    denoised(&tracer)?;
    let (_, of_filter) = denoised(&tracer)?;
    // The reference has other random numbers.
    tracer.restart(options.seed.wrapping_add(1))?;
    let (mut elapsed, mut of_sample) = (0.0, 0.0);
    loop {
        let samples = tracer.samples();
        let [plain, filtered] = &mut clocks;
        plain.follow([elapsed, of_sample], || {
            Ok((samples > 0).then_some(Made {
                radiance: tracer.radiance()?,
                milliseconds: elapsed,
                samples,
            }))
        })?;
        filtered.follow([elapsed + of_filter, of_sample], || {
            // A single sample has no variance to filter by.
            Ok((samples > 1).then_some(Made {
                radiance: denoised(&tracer)?.0,
                milliseconds: elapsed + of_filter,
                samples,
            }))
        })?;
        let left = |clock: &Clock<'_>, extra: f64| Some(clock.next()? - elapsed - extra);
        let [plain, filtered] = &clocks;
        let left = [left(plain, 0.0), left(filtered, of_filter)]
            .into_iter()
            .flatten();
        let left = left.reduce(f64::min).filter(|_| samples < MOST_SAMPLES);
        let Some(left) = left else {
            let [plain, filtered] = clocks;
            return Ok([plain.finish()?, filtered.finish()?]);
        };
        // Few samples are traced at less than a GPU's rate: as many at once as are sure to fit.
        let fit = match of_sample > 0.0 {
            true => 0.5 * left / of_sample,
            false => 1.0,
        };
        let count = (fit as u32)
            .clamp(1, MOST_AT_ONCE)
            .min(MOST_SAMPLES - samples);
        let progress = clocks[0].progress("path tracer", elapsed, samples);
        let took = trace(&mut tracer, samples + count, &progress)?;
        elapsed += took;
        of_sample = took / f64::from(count);
    }
}

/// Live frames by `renderer` for each of the times `budgets` (ms, ascending): of as many pixels as fit, up to `truth`'s. `None`
/// where no frame is short enough.
///
/// # Errors
/// [`MeasureError`]; [`MeasureError::Picture`] where the adapter cannot time passes.
pub fn live_in_time(
    (scene, camera): (&Scene, &Camera),
    renderer: &mut Renderer,
    effects: &Effects,
    (truth, budgets): (&LiveTruth, &[f64]),
    options: &Options,
    report: Report<'_>,
) -> Result<Vec<Option<LiveInTime>>, MeasureError> {
    let mut measured = |size: [u32; 2]| {
        renderer.resize(size)?;
        let subject = (scene, camera);
        let live = measure_live(subject, renderer, effects, truth, options, &mut *report)?;
        let milliseconds = live.milliseconds.ok_or_else(|| MeasureError::Picture {
            of: "the live view",
            reason: "this adapter cannot time passes".into(),
        })?;
        Ok::<_, MeasureError>((live, milliseconds))
    };
    let all = truth.size;
    let (mut size, (mut live, mut took)) = (all, measured(all)?);
    let mut found = Vec::new();
    for &budget in budgets.iter().rev() {
        let mut tries = 0;
        while took > budget * TOLERANCE
            && tries < TRIES
            && size.iter().all(|&side| side > LEAST_SIDE)
        {
            let least = f64::from(LEAST_SIDE) / f64::from(size[0].min(size[1]));
            let scale = (AIM * budget / took).sqrt().max(least);
            size = size.map(|side| (f64::from(side) * scale).round() as u32);
            (live, took) = measured(size)?;
            tries += 1;
        }
        let is_in_time = took <= budget * TOLERANCE;
        found.push(is_in_time.then(|| in_time(&live, budget, took, size)));
    }
    found.reverse();
    Ok(found)
}

fn in_time(live: &Live, budget: f64, milliseconds: f64, size: [u32; 2]) -> LiveInTime {
    LiveInTime {
        budget,
        milliseconds,
        size,
        moving: live.moving,
        still: live.still,
        flicker: live.flicker,
    }
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture that gets a sample every 30 ms, the last of which takes long: what was in time counts.
    #[test]
    fn what_was_there_in_time_counts() {
        let truth = Truth {
            radiance: vec![1.0; 16 * 16 * 3],
            parts: Vec::new(),
            notes: Vec::new(),
        };
        let mut clock = Clock::new([16, 16], &truth, &[10.0, 40.0, 100.0, 110.0]);
        let mut made = 0;
        for (samples, elapsed) in [(0, 5.0), (1, 35.0), (2, 65.0), (3, 95.0), (4, 500.0)] {
            let picture = || {
                made += 1;
                Ok((samples > 0).then_some(Made {
                    radiance: vec![samples as f32 / 4.0; 16 * 16 * 3],
                    milliseconds: elapsed,
                    samples,
                }))
            };
            let of_next = if samples > 0 { 30.0 } else { 0.0 };
            clock.follow([elapsed, of_next], picture).unwrap();
        }
        let samples = clock
            .found
            .iter()
            .map(|found| found.map(|found| found.samples));
        // Nothing is there after 10 ms; 100 and 110 are before the sample that took long.
        assert_eq!(
            samples.collect::<Vec<_>>(),
            [None, Some(1), Some(3), Some(3)]
        );
        assert!(clock.found[1].unwrap().flip > clock.found[2].unwrap().flip);
        assert_eq!(made, 3);
    }
}
