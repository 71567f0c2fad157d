//! Pictures by techniques and by the path tracer, as arrays.

use std::ops::ControlFlow;
use std::sync::Arc;

use gpugi::denoise::Features;
use gpugi::gpu::Gpu;
use gpugi::reference::{self, PathTracer};
use gpugi::{LightingError, Motion, Purpose};
use gpugi_cli::output::Aov;
use gpugi_cli::render::{BLURRED_SAMPLES, Chosen, TECHNIQUE_SAMPLES, path_tracer_settings};
use gpugi_scene::{Camera, Scene};
use pyo3::prelude::*;
use pyo3::types::{PyAny, PyDict};

use crate::busy::Busy;
use crate::camera::PyCamera;
use crate::errors::{raised, wrong};
use crate::gpu::device;
use crate::report::Report;
use crate::scene::{Kept, Shared, lock, scene_of};
use crate::values::image;

/// What a picture has beside its colour.
pub fn layers_of(names: &[String]) -> PyResult<(Vec<Aov>, bool)> {
    let mut aovs = Vec::new();
    let mut has_objects = false;
    for name in names {
        match (Aov::named(name), name.as_str()) {
            (Some(aov), _) => aovs.push(aov),
            (None, "instance") => has_objects = true,
            (None, _) => {
                let known: Vec<String> = Aov::names().chain(["instance".to_owned()]).collect();
                let reason = format!("there is no {name:?}; there are {}", known.join(", "));
                return Err(wrong("aovs", reason));
            }
        }
    }
    Ok((aovs, has_objects))
}

/// Adds the layers of what pixels see.
fn add_layers(
    py: Python<'_>,
    frame: &Bound<'_, PyDict>,
    size: [u32; 2],
    (aovs, seen): (&[Aov], &[Features]),
    scene: &Scene,
) -> PyResult<()> {
    for aov in aovs.iter().filter(|aov| **aov != Aov::Variance) {
        let channels = aov.channels();
        let values = seen.iter().flat_map(|seen| {
            let [x, y, z] = aov.value(seen, scene);
            [x, y, z].into_iter().take(channels)
        });
        let layer = image(py, size, channels, values.collect::<Vec<f32>>())?;
        frame.set_item(aov.identifier(), layer)?;
    }
    Ok(())
}

/// The size of a picture.
pub fn check_size(size: [i64; 2]) -> PyResult<[u32; 2]> {
    let side = |side: i64| u32::try_from(side).ok().filter(|&side| side > 0);
    match size.map(side) {
        [Some(width), Some(height)] => Ok([width, height]),
        _ => {
            let [width, height] = size;
            Err(wrong(
                "size",
                format!("{width}x{height} pixels are no picture"),
            ))
        }
    }
}

/// The number of samples.
fn check_samples(samples: i64) -> PyResult<u32> {
    match samples {
        1..=16_777_216 => Ok(samples as u32),
        _ => Err(wrong(
            "samples",
            format!("{samples} does not lie between 1 and 16777216"),
        )),
    }
}

/// Renders a scene by techniques.
#[pyclass(name = "Renderer", module = "gpugi._gpugi", frozen)]
pub struct PyRenderer {
    gpu: Gpu,
    shared: Shared,
    size: [u32; 2],
    state: Busy<State>,
}

struct State {
    chosen: Chosen,
    /// The scene that the renderer shows.
    shown: Arc<Scene>,
    has_features: bool,
    /// The seed of its maps, once there are some.
    seed: Option<u32>,
    /// Those that go with its pictures, once they are known; `None` after a change.
    sentences: Option<Sentences>,
}

/// The sentences that go with pictures.
#[derive(Clone)]
struct Sentences {
    left_out: Vec<String>,
    notes: Vec<String>,
}

#[pymethods]
impl PyRenderer {
    #[new]
    fn new(
        py: Python<'_>,
        scene: &Bound<'_, PyAny>,
        size: [i64; 2],
        techniques: Vec<String>,
        settings: Vec<String>,
        adapter: &str,
    ) -> PyResult<Self> {
        let size = check_size(size)?;
        let shared = scene_of(scene)?;
        let gpu = device(py, adapter)?;
        let shown = lock(&shared).scene.clone();
        let purpose = Purpose::StillPicture;
        let chosen = py.detach(|| Chosen::new(&gpu, &shown, size, purpose, &techniques, &settings));
        let state = State {
            chosen: chosen.map_err(raised)?,
            shown,
            has_features: false,
            seed: None,
            sentences: None,
        };
        Ok(Self {
            gpu,
            shared,
            size,
            state: Busy::new(state),
        })
    }

    /// The names of the techniques in use.
    #[getter]
    fn techniques(&self, py: Python<'_>) -> PyResult<Vec<&'static str>> {
        // Without Python's lock: a thread that renders takes that when it calls back.
        py.detach(|| {
            let state = self.state.lock()?;
            let techniques = state.chosen.renderer.techniques().iter();
            anyhow::Ok(techniques.map(|technique| technique.info().name).collect())
        })
        .map_err(raised)
    }

    /// Sets a technique's setting.
    fn set(&self, py: Python<'_>, technique: &str, name: &str, value: &str) -> PyResult<()> {
        py.detach(|| {
            let mut state = self.state.lock()?;
            state.sentences = None;
            state.chosen.set(technique, name, value)
        })
        .map_err(raised)
    }

    /// A picture of the scene as it is now.
    fn render<'py>(
        &self,
        py: Python<'py>,
        camera: &Bound<'py, PyCamera>,
        samples: Option<i64>,
        seed: u32,
        aovs: Vec<String>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let camera = camera.get().0.get()?;
        let samples = samples.map(check_samples).transpose()?;
        let (aovs, has_objects) = layers_of(&aovs)?;
        if aovs.contains(&Aov::Variance) {
            return Err(wrong("aovs", "path-tracer alone knows the variance"));
        }
        let kept = lock(&self.shared).clone();
        let is_blurred =
            !camera.lens.is_pinhole() || Motion::seen_by(&camera, &kept.scene, kept.time).is_some();
        let samples = samples.unwrap_or(match is_blurred {
            true => BLURRED_SAMPLES,
            false => TECHNIQUE_SAMPLES,
        });
        let mut report = Report::new(progress);
        let made = py.detach(|| {
            let mut state = self.state.lock()?;
            if !aovs.is_empty() && !state.has_features {
                state.chosen.renderer.keep_features()?;
                state.has_features = true;
            }
            let is_whole = self.add(&mut state, &kept, &camera, [samples, seed], &mut report)?;
            if !is_whole {
                return Ok(None);
            }
            let State {
                chosen, sentences, ..
            } = &mut *state;
            let renderer = &chosen.renderer;
            let sentences = sentences.get_or_insert_with(|| Sentences {
                left_out: renderer.left_out(),
                notes: chosen.notes(),
            });
            let seen = match aovs.is_empty() {
                true => Vec::new(),
                false => renderer.features()?,
            };
            let objects = match has_objects {
                true => renderer.surface_points()?,
                false => Vec::new(),
            };
            let objects = objects.into_iter();
            let objects = objects.map(|point| point.map_or(-1, |point| point.instance as i32));
            let Sentences {
                left_out,
                mut notes,
            } = sentences.clone();
            notes.extend(renderer.warnings());
            anyhow::Ok(Some((
                renderer.radiance()?,
                seen,
                objects.collect::<Vec<i32>>(),
                left_out,
                notes,
            )))
        });
        report.end()?;
        let made = made.map_err(raised)?;
        let (radiance, seen, objects, left_out, notes) =
            made.ok_or_else(|| raised(anyhow::anyhow!("the picture was not finished")))?;
        let frame = PyDict::new(py);
        frame.set_item("color", image(py, self.size, 3, radiance)?)?;
        frame.set_item("samples", samples)?;
        frame.set_item("left_out", left_out)?;
        frame.set_item("notes", notes)?;
        add_layers(py, &frame, self.size, (&aovs, &seen), &kept.scene)?;
        if has_objects {
            frame.set_item("instance", image(py, self.size, 1, objects)?)?;
        }
        Ok(frame)
    }
}

impl PyRenderer {
    /// Samples between two looks at Ctrl-C. Before each, somebody waits for the GPU, which slows a fast one.
    fn at_once(&self) -> u32 {
        match self.gpu.adapter.is_software() {
            true => 1,
            false => 8,
        }
    }

    /// Makes the picture. Returns whether it is whole.
    fn add(
        &self,
        state: &mut State,
        kept: &Kept,
        camera: &Camera,
        [samples, seed]: [u32; 2],
        report: &mut Report,
    ) -> anyhow::Result<bool> {
        let motion = Motion::seen_by(camera, &kept.scene, kept.time);
        let is_shown = |state: &State| Arc::ptr_eq(&state.shown, &kept.scene);
        if !is_shown(state) {
            state.sentences = None;
        }
        // Maps hold random numbers, too, and go on from those before; another scene may take other techniques.
        if state.seed.is_some_and(|before| before != seed)
            || (!is_shown(state) && !state.chosen.suits(&kept.scene))
        {
            state.chosen = state.chosen.anew(&kept.scene)?;
            state.shown = kept.scene.clone();
            if state.has_features {
                state.chosen.renderer.keep_features()?;
            }
        }
        state.seed = Some(seed);
        loop {
            let is_shown = is_shown(state);
            let renderer = &mut state.chosen.renderer;
            if !is_shown {
                renderer.update(&kept.scene)?;
                state.shown = kept.scene.clone();
            }
            renderer.forget();
            renderer.set_seed(seed);
            renderer.set_motion(motion.clone(), gpugi_cli::render::SHUTTER_STEPS)?;
            let made = renderer.converge(camera, false, |readiness, _| {
                report.step(f64::from(readiness.progress()), "maps")
            });
            match made {
                Ok(_) if report.has_ended() => return Ok(false),
                Ok(_) => break,
                Err(error) => {
                    state.chosen.without_atlas(error)?;
                    state.sentences = None;
                    state.chosen.renderer.update(&kept.scene)?;
                    if state.has_features {
                        state.chosen.renderer.keep_features()?;
                    }
                }
            }
        }
        let renderer = &mut state.chosen.renderer;
        for sample in 1..=samples {
            renderer.render_sample(camera, samples, None, false)?;
            if sample % self.at_once() != 0 && sample != samples {
                continue;
            }
            // Who reads the picture waits for the last ones.
            if sample != samples {
                self.gpu.wait()?;
            }
            let words = format!("{sample} of {samples} samples");
            let part = f64::from(sample) / f64::from(samples);
            if report.step(part, &words).is_break() {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// Renders a scene with all light: the reference.
#[pyclass(name = "PathTracer", module = "gpugi._gpugi", frozen)]
pub struct PyPathTracer {
    gpu: Gpu,
    shared: Shared,
    size: [u32; 2],
    settings: Vec<String>,
    state: Busy<Traced>,
}

struct Traced {
    tracer: PathTracer,
    shown: Arc<Scene>,
    has_features: bool,
    /// Its noise setting is in its own settings.
    noise: f64,
}

/// A path tracer of the scene as it is.
fn tracer_of(
    gpu: &Gpu,
    scene: &Arc<Scene>,
    size: [u32; 2],
    settings: &[String],
    noise: f64,
) -> anyhow::Result<Traced> {
    let mut settings = path_tracer_settings(settings)?;
    if noise > 0.0 {
        settings.noise = noise;
    }
    Ok(Traced {
        noise,
        tracer: PathTracer::new(gpu, scene, size, &settings)?,
        shown: scene.clone(),
        has_features: false,
    })
}

#[pymethods]
impl PyPathTracer {
    #[new]
    fn new(
        py: Python<'_>,
        scene: &Bound<'_, PyAny>,
        size: [i64; 2],
        settings: Vec<String>,
        adapter: &str,
    ) -> PyResult<Self> {
        let size = check_size(size)?;
        let shared = scene_of(scene)?;
        let gpu = device(py, adapter)?;
        let scene = lock(&shared).scene.clone();
        let state = py.detach(|| tracer_of(&gpu, &scene, size, &settings, 0.0));
        Ok(Self {
            gpu,
            shared,
            size,
            settings,
            state: Busy::new(state.map_err(raised)?),
        })
    }

    /// A picture of the scene as it is now.
    #[allow(clippy::too_many_arguments)]
    fn render<'py>(
        &self,
        py: Python<'py>,
        camera: &Bound<'py, PyCamera>,
        samples: i64,
        noise: f64,
        seed: u32,
        denoise: bool,
        aovs: Vec<String>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let camera = camera.get().0.get()?;
        let samples = check_samples(samples)?;
        if !(noise >= 0.0 && noise.is_finite()) {
            return Err(wrong(
                "noise",
                format!("{noise} is no relative mean squared error"),
            ));
        }
        let (aovs, has_objects) = layers_of(&aovs)?;
        if has_objects {
            return Err(wrong("aovs", "instance: a Renderer alone knows it"));
        }
        let kept = lock(&self.shared).clone();
        let mut report = Report::new(progress);
        let needs_features = denoise || !aovs.is_empty();
        let made = py.detach(|| {
            let mut state = self.state.lock()?;
            self.follow(&mut state, &kept, noise)?;
            if needs_features && !state.has_features {
                state.tracer.keep_features()?;
                state.has_features = true;
            }
            let tracer = &mut state.tracer;
            tracer.restart(seed)?;
            tracer.set_motion(Motion::seen_by(&camera, &kept.scene, kept.time))?;
            let mut is_whole = true;
            let done = tracer.render(&camera, samples, &mut |state| {
                let words = format!("{} of {} samples", state.samples, state.of);
                let flow = report.step(state.fraction, &words);
                is_whole &= flow.is_continue();
                match is_whole {
                    true => ControlFlow::Continue(()),
                    false => ControlFlow::Break(()),
                }
            })?;
            if !is_whole {
                return Ok(None);
            }
            let noise = tracer.noise()?;
            // One sample says nothing about its noise.
            let radiance = match denoise && done.samples > 1 {
                true => tracer.denoised()?,
                false => tracer.radiance()?,
            };
            let seen = match aovs.is_empty() {
                true => Vec::new(),
                false => tracer.features()?,
            };
            let variance = match aovs.contains(&Aov::Variance) {
                true => tracer.variance()?,
                false => Vec::new(),
            };
            anyhow::Ok(Some((radiance, seen, variance, done.samples, noise)))
        });
        report.end()?;
        let made = made.map_err(raised)?;
        let (radiance, seen, variance, samples, noise) =
            made.ok_or_else(|| raised(anyhow::anyhow!("the picture was not finished")))?;
        let frame = PyDict::new(py);
        frame.set_item("color", image(py, self.size, 3, radiance)?)?;
        frame.set_item("samples", samples)?;
        frame.set_item("noise", (samples > 1).then_some(noise))?;
        let settings = path_tracer_settings(&self.settings).map_err(raised)?;
        frame.set_item("left_out", reference::left_out(&kept.scene, &settings))?;
        frame.set_item("notes", Vec::<String>::new())?;
        add_layers(py, &frame, self.size, (&aovs, &seen), &kept.scene)?;
        if !variance.is_empty() {
            frame.set_item("variance", image(py, self.size, 3, variance)?)?;
        }
        Ok(frame)
    }
}

impl PyPathTracer {
    /// Follows the scene to what it is now; another noise is another path tracer.
    fn follow(&self, state: &mut Traced, kept: &Kept, noise: f64) -> Result<(), anyhow::Error> {
        let follows = noise == state.noise
            && (Arc::ptr_eq(&state.shown, &kept.scene) || state.tracer.update(&kept.scene)?);
        if !follows {
            *state = tracer_of(&self.gpu, &kept.scene, self.size, &self.settings, noise)?;
        }
        state.shown = kept.scene.clone();
        Ok::<(), LightingError>(()).map_err(Into::into)
    }
}
