//! The path tracer's reference for some parts of a scene's light, rendered or read from the cache.

use std::time::Instant;

use gpugi_scene::{Camera, Scene};

use super::cache::{Entry, Key};
use super::{MeasureError, Options, Progress, Report};
use crate::gpu::Gpu;
use crate::light_paths::{Part, PatternError};
use crate::lighting::LightingError;
use crate::reference::{self, PathTracer, Settings};
use crate::settings::SettingError;

/// Required quality of a reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quality {
    /// Maximum number of samples per pixel. At least 16, because fewer cannot estimate their own noise.
    pub samples: u32,
    /// Stop when the estimated rel-mse of the whole reference falls to this value; 0 stops at the number of samples
    /// only.
    pub noise: f64,
}

impl Default for Quality {
    fn default() -> Self {
        Self {
            samples: 1024,
            noise: 0.0,
        }
    }
}

/// One run of the path tracer.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct TracedPart {
    /// Light classes and light paths.
    #[serde(flatten)]
    pub part: Part,
    /// Length of the longest paths followed (vertices between light and eye).
    pub max_bounces: u32,
    /// Samples per pixel.
    pub samples: u32,
    /// The part's own error: estimated relative mean squared error.
    pub estimated_rel_mse: f64,
    /// Render time (s); for a cached reference, that of the original rendering.
    pub seconds: f64,
    /// The adapter that rendered it.
    pub adapter: String,
    /// Whether it was read from the cache.
    pub cached: bool,
}

/// The scene, camera and image size to render.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// The camera.
    pub camera: &'a Camera,
    /// Width and height of the image (pixels).
    pub size: [u32; 2],
}

/// The path tracer's image of some parts of a scene's light.
#[derive(Debug, Clone)]
pub struct Truth {
    /// Linear radiance, three floats per pixel, in rows from top to bottom: the sum of the parts.
    pub radiance: Vec<f32>,
    /// The parts that are summed.
    pub parts: Vec<TracedPart>,
    /// Problems with the cache, and parts that are too noisy.
    pub notes: Vec<String>,
}

impl Truth {
    /// The reference's own error: estimated relative mean squared error. This is an upper estimate, because it adds the
    /// errors of the parts, each of which is relative to a darker image than the whole.
    pub fn rel_mse(&self) -> f64 {
        self.parts.iter().map(|part| part.estimated_rel_mse).sum()
    }

    /// Render time (s); for a cached reference, that of the original rendering.
    pub fn seconds(&self) -> f64 {
        self.parts.iter().map(|part| part.seconds).sum()
    }

    /// Whether all parts came from the cache.
    pub fn is_cached(&self) -> bool {
        self.parts.iter().all(|part| part.cached)
    }
}

/// Renders the camera's view of `parts`, or reads it from the cache.
///
/// # Errors
/// [`MeasureError::Render`], [`MeasureError::Interrupted`].
pub fn trace(
    gpu: &Gpu,
    subject: &Subject<'_>,
    parts: &[Part],
    options: &Options,
    report: Report<'_>,
) -> Result<Truth, MeasureError> {
    let size = subject.size;
    let mut truth = Truth {
        radiance: vec![0.0; size[0] as usize * size[1] as usize * 3],
        parts: Vec::new(),
        notes: Vec::new(),
    };
    let digests = [subject.scene.digest(), subject.camera.digest()];
    for part in parts {
        let settings = Settings {
            noise: options.reference.noise / parts.len() as f64,
            ..Settings::of_part(part).map_err(|error| no_pattern(part, &error))?
        };
        let key = Key::new(
            digests,
            size,
            &settings,
            options.reference.samples,
            options.seed,
        );
        let mut kept = None;
        let cache = options.cache.as_ref().filter(|_| options.motion.is_none());
        if let Some(cache) = cache {
            kept = cache.read(&key).unwrap_or_else(|damage| {
                truth.notes.push(format!("{damage}; rendered anew"));
                None
            });
        }
        let cached = kept.is_some();
        let entry = match kept {
            Some(entry) => entry,
            None => {
                let entry = render(gpu, subject, part, &settings, options, report)?;
                if let Some(cache) = cache
                    && let Err(error) = cache.write(&key, &entry)
                {
                    let note = format!("the reference is not kept for next time: {error}");
                    truth.notes.push(note);
                }
                entry
            }
        };
        if settings.noise > 0.0 && entry.rel_mse > settings.noise {
            truth.notes.push(format!(
                "after {} samples the reference's part {} still has an estimated rel-mse of {:.1e}",
                entry.samples, part.pattern, entry.rel_mse
            ));
        }
        for (sum, value) in truth.radiance.iter_mut().zip(&entry.radiance) {
            *sum += value;
        }
        truth.parts.push(TracedPart {
            part: part.clone(),
            max_bounces: settings.max_bounces,
            samples: entry.samples,
            estimated_rel_mse: entry.rel_mse,
            seconds: entry.seconds,
            adapter: entry.adapter,
            cached,
        });
    }
    Ok(truth)
}

fn no_pattern(part: &Part, error: &PatternError) -> LightingError {
    LightingError::Setting {
        technique: reference::INFO.name.to_owned(),
        source: SettingError::Value {
            name: "paths".to_owned(),
            value: part.pattern.clone(),
            reason: error.to_string(),
        },
    }
}

fn render(
    gpu: &Gpu,
    subject: &Subject<'_>,
    part: &Part,
    settings: &Settings,
    options: &Options,
    report: Report<'_>,
) -> Result<Entry, MeasureError> {
    let mut tracer = PathTracer::new(gpu, subject.scene, subject.size, settings)?;
    tracer.restart(options.seed)?;
    tracer.set_motion(options.motion.clone())?;
    let classes: Vec<String> = part.classes.iter().map(ToString::to_string).collect();
    let stage = format!("path tracer, {} ({})", part.pattern, classes.join(", "));
    let started = Instant::now();
    let mut is_interrupted = false;
    let done = tracer.render(subject.camera, options.reference.samples, &mut |progress| {
        let flow = report(&Progress {
            stage: stage.clone(),
            fraction: progress.fraction,
            state: format!("{} of {} samples", progress.samples, progress.of),
        });
        is_interrupted |= flow.is_break();
        flow
    })?;
    if is_interrupted {
        return Err(MeasureError::Interrupted);
    }
    Ok(Entry {
        radiance: tracer.radiance()?,
        samples: done.samples,
        rel_mse: tracer.noise()?,
        seconds: started.elapsed().as_secs_f64(),
        adapter: gpu.adapter.name.clone(),
    })
}
