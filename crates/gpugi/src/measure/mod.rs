//! Measures the error of a set of techniques by comparing their image with the path tracer's on the same light paths,
//! and measures their cost. See docs/measuring.md.

mod cache;
mod equal_time;
mod live;
mod moves;
mod truth;

pub use cache::Cache;
pub use equal_time::{LiveInTime, StillInTime, live_in_time, path_traced_in_time, stills_in_time};
pub use live::{Live, LiveTruth, measure_live, trace_live};
pub use moves::Moves;
pub use truth::{Quality, Subject, TracedPart, Truth, trace};

use std::ops::ControlFlow;

use gpugi_scene::image::metrics::{Comparison, Metric, MetricError, Picture, compare};
use gpugi_scene::{Camera, Scene};

use crate::gpu::{Gpu, Timing};
use crate::light_paths::{LightClass, LightPaths, all_light, overlap, parts};
use crate::lighting::{LightingError, Readiness};
use crate::reference;
use crate::renderer::Renderer;
use crate::shutter::Motion;
use crate::techniques::Map;

/// The reference counts as exact if its own error is below this fraction of the technique's.
const WELL_BELOW: f64 = 0.1;

/// Samples between progress reports, where the caller may break off.
const REPORT_EVERY: u32 = 8;

/// The reason why a measurement failed.
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    /// An image could not be rendered.
    #[error(transparent)]
    Render(#[from] LightingError),
    /// An image contains values that cannot be compared.
    #[error("the picture of {of}: {reason}")]
    Picture {
        /// Whose image it is.
        of: &'static str,
        /// What is wrong with the image.
        reason: String,
    },
    /// The progress callback broke off.
    #[error("interrupted: nothing is measured")]
    Interrupted,
}

impl From<crate::gpu::GpuError> for MeasureError {
    fn from(error: crate::gpu::GpuError) -> Self {
        Self::Render(error.into())
    }
}

/// Progress of a measurement.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress {
    /// What is being rendered.
    pub stage: String,
    /// Fraction of the stage that is done, 0 to 1.
    pub fraction: f64,
    /// Progress in words.
    pub state: String,
}

impl Progress {
    /// That of maps before the first sample.
    fn of_maps(readiness: Readiness) -> Self {
        Self {
            stage: "maps".to_owned(),
            fraction: f64::from(readiness.progress()),
            state: format!("{:.0} %", readiness.progress() * 100.0),
        }
    }
}

/// A callback that receives progress and may break off.
pub type Report<'a> = &'a mut dyn FnMut(&Progress) -> ControlFlow<()>;

/// Options of a measurement.
#[derive(Debug, Clone)]
pub struct Options {
    /// Samples per pixel for the techniques.
    pub samples: u32,
    /// Required quality of the reference.
    pub reference: Quality,
    /// Seed of all random numbers.
    pub seed: u32,
    /// What moves while the shutter is open. References with motion are not kept.
    pub motion: Option<Motion>,
    /// Steps in which the techniques' maps follow it.
    pub shutter_steps: u32,
    /// Where references are kept between measurements.
    pub cache: Option<Cache>,
    /// Whether the reference has all light paths, instead of those of the techniques: light that the techniques lack
    /// counts as error.
    pub all_light: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            samples: 64,
            reference: Quality::default(),
            seed: 0,
            motion: None,
            shutter_steps: 8,
            cache: None,
            all_light: false,
        }
    }
}

/// GPU time of a pass.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct PassTime {
    /// The pass, such as `shadow-map.gather`.
    pub pass: String,
    /// Number of frames in which the pass ran: those in which the maps converge, and the samples.
    pub ran: u32,
    /// Median over these frames (GPU milliseconds).
    pub milliseconds: f64,
}

/// GPU memory for the techniques' image (bytes).
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Memory {
    /// Geometry, tables and images.
    pub scene: u64,
    /// Maps that the techniques look up.
    pub maps: u64,
    /// Working memory in which the techniques build their maps.
    pub work: u64,
    /// Surface points and radiance.
    pub picture: u64,
}

/// The result of a measurement.
#[derive(Debug, Clone)]
pub struct Measured {
    /// Width and height (pixels).
    pub size: [u32; 2],
    /// Linear radiance of the techniques' image, three floats per pixel, in rows from top to bottom.
    pub radiance: Vec<f32>,
    /// The path tracer's reference.
    pub truth: Truth,
    /// The difference of the two images by every metric that applies.
    pub metrics: Vec<(Metric, Comparison)>,
    /// Number of frames in which the maps converged, before the first sample.
    pub map_frames: u32,
    /// GPU time of each pass; empty if the adapter cannot time passes.
    pub passes: Vec<PassTime>,
    /// GPU memory for the techniques' image.
    pub memory: Memory,
    /// Caveats for interpreting the numbers.
    pub notes: Vec<String>,
}

impl Measured {
    /// The value of a metric.
    pub fn value(&self, metric: Metric) -> Option<f64> {
        let mut metrics = self.metrics.iter();
        metrics
            .find(|(measured, _)| *measured == metric)
            .map(|(_, comparison)| comparison.value)
    }
}

/// Measures the techniques of `renderer`, which renders `scene`, as seen by `camera`. Maps converge first.
///
/// # Errors
/// [`MeasureError`].
pub fn measure(
    gpu: &Gpu,
    scene: &Scene,
    camera: &Camera,
    renderer: &mut Renderer,
    options: &Options,
    report: Report<'_>,
) -> Result<Measured, MeasureError> {
    let size = renderer.size();
    let (map_frames, passes) = render(gpu, renderer, camera, options, report)?;
    let radiance = renderer.radiance()?;
    let memory = Memory {
        scene: renderer.scene().bytes,
        maps: renderer.maps().iter().map(Map::bytes).sum(),
        work: renderer.work_bytes(),
        picture: renderer.picture_bytes(),
    };
    let (covered, classes) = (renderer.light_paths(), renderer.light_classes());
    let parts = if options.all_light {
        vec![all_light(&classes)]
    } else {
        parts(&covered, &classes)
    };
    let subject = Subject {
        scene,
        camera,
        size,
    };
    let mut truth = trace(gpu, &subject, &parts, options, report)?;
    let mut notes = std::mem::take(&mut truth.notes);
    let caustics = LightPaths::new(LightClass::Punctual, "LS.*[DGV].*E");
    let left_out = reference::left_out(scene, &reference::Settings::default());
    if !left_out.is_empty()
        && let Some((_, path)) = overlap(&covered, &[caustics])
    {
        notes.push(format!(
            "the path tracer lacks {} ({path}): they count as error; measure with area lights",
            left_out.join(", ")
        ));
    }
    let test = picture("the techniques", &radiance, size)?;
    let reference = picture("the path tracer", &truth.radiance, size)?;
    let mut metrics = Vec::new();
    for metric in Metric::ALL {
        match compare(metric, &test, &reference) {
            Ok(comparison) => metrics.push((metric, comparison)),
            Err(reason @ (MetricError::TooSmall | MetricError::SizesDiffer { .. })) => {
                notes.push(format!("no {}: {reason}", metric.name()));
            }
        }
    }
    if passes.is_empty() {
        notes.push(format!("{} cannot time passes", gpu.adapter.name));
    }
    let mut measured = Measured {
        size,
        radiance,
        truth,
        metrics,
        map_frames,
        passes,
        memory,
        notes,
    };
    let noise = measured.truth.rel_mse();
    if let Some(error) = measured.value(Metric::RelMse)
        && noise > WELL_BELOW * error
    {
        measured.notes.push(format!(
            "the reference is itself off by an estimated rel-mse of {noise:.1e}, not well below the {error:.1e} measured, which includes it: \
             give it more samples"
        ));
    }
    Ok(measured)
}

/// A picture that can be compared; `of` names who made it.
fn picture(of: &'static str, radiance: &[f32], size: [u32; 2]) -> Result<Picture, MeasureError> {
    Picture::of_radiance(size[0], size[1], radiance.to_vec())
        .map_err(|reason| MeasureError::Picture { of, reason })
}

/// The error of a picture, made by `of`.
fn error(
    metric: Metric,
    (of, shown): (&'static str, &[f32]),
    truth: &[f32],
    size: [u32; 2],
) -> Result<f64, MeasureError> {
    let shown = picture(of, shown, size)?;
    let truth = picture("the path tracer", truth, size)?;
    let result = compare(metric, &shown, &truth);
    Ok(result.expect("pictures of one size").value)
}

/// Renders the techniques' image. Returns the number of frames in which its maps converged, and the times of its
/// passes.
fn render(
    gpu: &Gpu,
    renderer: &mut Renderer,
    camera: &Camera,
    options: &Options,
    report: Report<'_>,
) -> Result<(u32, Vec<PassTime>), MeasureError> {
    renderer.set_seed(options.seed);
    renderer.set_motion(options.motion.clone(), options.shutter_steps)?;
    let names: Vec<&str> = renderer
        .techniques()
        .iter()
        .map(|technique| technique.info().name)
        .collect();
    let stage = names.join(", ");
    let mut times = Vec::new();
    let mut map_frames = 0;
    let readiness = renderer.converge(camera, true, |readiness, frame| {
        collect(&mut times, frame);
        map_frames += 1;
        report(&Progress::of_maps(readiness))
    })?;
    if readiness != Readiness::Ready {
        return Err(MeasureError::Interrupted);
    }
    for sample in 1..=options.samples {
        let frame = renderer
            .render_sample(camera, options.samples, None, true)?
            .wait()?;
        collect(&mut times, frame);
        if sample % REPORT_EVERY != 0 {
            continue;
        }
        gpu.wait()?;
        let progress = Progress {
            stage: stage.clone(),
            fraction: f64::from(sample) / f64::from(options.samples),
            state: format!("{sample} of {} samples", options.samples),
        };
        if report(&progress).is_break() {
            return Err(MeasureError::Interrupted);
        }
    }
    Ok((map_frames, medians(times)))
}

/// The median time of each pass.
fn medians(times: Vec<(String, Vec<f64>)>) -> Vec<PassTime> {
    let median = |(pass, mut times): (String, Vec<f64>)| {
        times.sort_by(f64::total_cmp);
        PassTime {
            pass,
            ran: times.len() as u32,
            milliseconds: times[times.len() / 2],
        }
    };
    times.into_iter().map(median).collect()
}

/// Adds a frame's times to those of earlier frames. A pass that ran several times in a frame counts once, with the sum
/// of its times.
fn collect(times: &mut Vec<(String, Vec<f64>)>, frame: Vec<Timing>) {
    let mut of_frame: Vec<Timing> = Vec::new();
    for timing in frame {
        match of_frame.iter_mut().find(|known| known.pass == timing.pass) {
            Some(known) => known.milliseconds += timing.milliseconds,
            None => of_frame.push(timing),
        }
    }
    for timing in of_frame {
        match times.iter_mut().find(|(pass, _)| *pass == timing.pass) {
            Some((_, times)) => times.push(timing.milliseconds),
            None => times.push((timing.pass, vec![timing.milliseconds])),
        }
    }
}
