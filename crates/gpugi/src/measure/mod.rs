//! How far a set of techniques is from the truth: their picture against the path tracer's on the same light paths, and what it cost.
//! docs/measuring.md.

mod cache;
mod truth;

pub use cache::Cache;
pub use truth::{Quality, Subject, TracedPart, Truth, trace};

use std::ops::ControlFlow;

use gpugi_scene::image::metrics::{Comparison, Metric, MetricError, Picture, compare};
use gpugi_scene::{Camera, Scene};

use crate::gpu::{Gpu, PollType, Timing};
use crate::light_paths::{LightClass, never_found, parts};
use crate::renderer::{RenderError, Renderer};
use crate::techniques::Map;

/// The reference counts as exact where its own error is below this part of the technique's.
const WELL_BELOW: f64 = 0.1;

/// Samples between looks at the clock and at whoever may break off.
const REPORT_EVERY: u32 = 8;

/// A measurement that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    /// A picture could not be rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A picture holds what cannot be compared.
    #[error("the picture of {of}: {reason}")]
    Picture {
        /// Whose picture.
        of: &'static str,
        /// What is wrong with it.
        reason: String,
    },
    /// Whoever watched the progress broke off.
    #[error("interrupted: nothing is measured")]
    Interrupted,
}

impl From<crate::gpu::GpuError> for MeasureError {
    fn from(error: crate::gpu::GpuError) -> Self {
        Self::Render(error.into())
    }
}

/// How far a measurement is.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress {
    /// What is rendered.
    pub stage: String,
    /// Part of the stage that is done, 0 to 1.
    pub fraction: f64,
    /// How far, in words.
    pub state: String,
}

/// Hears of progress, and may break off.
pub type Report<'a> = &'a mut dyn FnMut(&Progress) -> ControlFlow<()>;

/// How to measure.
#[derive(Debug, Clone)]
pub struct Options {
    /// Samples a pixel of the techniques.
    pub samples: u32,
    /// How good the reference has to be.
    pub reference: Quality,
    /// Seed of all that is stochastic.
    pub seed: u32,
    /// Where references are kept from one measurement to the next.
    pub cache: Option<Cache>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            samples: 64,
            reference: Quality::default(),
            seed: 0,
            cache: None,
        }
    }
}

/// GPU time of a pass.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct PassTime {
    /// The pass, such as `shadow-map.gather`.
    pub pass: String,
    /// Samples it ran in: maps are made in the first, and again only when something changed.
    pub ran: u32,
    /// Median over these samples (GPU milliseconds).
    pub milliseconds: f64,
}

/// GPU memory of the techniques' picture (bytes).
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Memory {
    /// Geometry, tables and images.
    pub scene: u64,
    /// What techniques look up.
    pub maps: u64,
    /// What techniques hold to make their maps.
    pub work: u64,
    /// Surface points and radiance.
    pub picture: u64,
}

/// What was found.
#[derive(Debug, Clone)]
pub struct Measured {
    /// Width and height (pixels).
    pub size: [u32; 2],
    /// Linear radiance of the techniques, three floats a pixel, row by row from the top.
    pub radiance: Vec<f32>,
    /// The path tracer's.
    pub truth: Truth,
    /// The difference of the two, by every metric that can tell.
    pub metrics: Vec<(Metric, Comparison)>,
    /// What each pass took; empty where the adapter cannot time passes.
    pub passes: Vec<PassTime>,
    /// What the picture took.
    pub memory: Memory,
    /// What a reader of the numbers should know.
    pub notes: Vec<String>,
}

impl Measured {
    /// The value of a metric.
    pub fn value(&self, metric: Metric) -> Option<f64> {
        let mut metrics = self.metrics.iter();
        metrics
            .find(|(one, _)| *one == metric)
            .map(|(_, comparison)| comparison.value)
    }
}

/// Measures the techniques of `renderer`, which renders `scene`, in what `camera` sees.
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
    let passes = render(gpu, renderer, camera, options, report)?;
    let radiance = renderer.radiance()?;
    let memory = Memory {
        scene: renderer.scene().bytes,
        maps: renderer.maps().iter().map(Map::bytes).sum(),
        work: renderer.work_bytes(),
        picture: renderer.picture_bytes(),
    };
    let (covered, classes) = (renderer.light_paths(), renderer.light_classes());
    let parts = parts(&covered, &classes);
    let subject = Subject {
        scene,
        camera,
        size,
    };
    let mut truth = trace(gpu, &subject, &parts, options, report)?;
    let mut notes = std::mem::take(&mut truth.notes);
    if classes.contains(&LightClass::Punctual)
        && let Some(path) = never_found(&covered)
    {
        notes.push(format!(
            "the path tracer never finds light of points, spots and directions that meets a mirror or glass first ({path}): \
             it counts as error; measure with area lights"
        ));
    }
    let picture = |of: &'static str, radiance: &[f32]| {
        Picture::of_radiance(size[0], size[1], radiance.to_vec())
            .map_err(|reason| MeasureError::Picture { of, reason })
    };
    let test = picture("the techniques", &radiance)?;
    let reference = picture("the path tracer", &truth.radiance)?;
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

/// Renders the techniques' picture; returns what its passes took.
fn render(
    gpu: &Gpu,
    renderer: &mut Renderer,
    camera: &Camera,
    options: &Options,
    report: Report<'_>,
) -> Result<Vec<PassTime>, MeasureError> {
    renderer.set_seed(options.seed);
    let names: Vec<&str> = renderer
        .techniques()
        .iter()
        .map(|technique| technique.info().name)
        .collect();
    let stage = names.join(", ");
    let mut times = Vec::new();
    for sample in 1..=options.samples {
        let frame = renderer.render_sample(camera, options.samples, None, true)?;
        collect(&mut times, frame);
        if sample % REPORT_EVERY != 0 {
            continue;
        }
        gpu.device
            .poll(PollType::wait_indefinitely())
            .map_err(|error| crate::gpu::GpuError::Lost {
                reason: error.to_string(),
            })?;
        let progress = Progress {
            stage: stage.clone(),
            fraction: f64::from(sample) / f64::from(options.samples),
            state: format!("{sample} of {} samples", options.samples),
        };
        if report(&progress).is_break() {
            return Err(MeasureError::Interrupted);
        }
    }
    Ok(times
        .into_iter()
        .map(|(pass, mut times)| {
            times.sort_by(f64::total_cmp);
            PassTime {
                pass,
                ran: times.len() as u32,
                milliseconds: times[times.len() / 2],
            }
        })
        .collect())
}

/// Adds a frame's times to those of earlier frames, a pass that ran twice as one.
fn collect(times: &mut Vec<(String, Vec<f64>)>, frame: Vec<Timing>) {
    let mut of_frame: Vec<Timing> = Vec::new();
    for timing in frame {
        match of_frame.iter_mut().find(|one| one.pass == timing.pass) {
            Some(one) => one.milliseconds += timing.milliseconds,
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
