//! The path tracer in the viewer, beside the picture or in its place. Each frame traces a piece that leaves the frame
//! fluid, on the window's own device, and never waits for it: so a page has it, too. It follows edits and other sizes.
//! What takes long, the upload of another scene for rays and the start of the kernels, is a task of its own.

use std::sync::Arc;

use gpugi::LightingError;
use gpugi::gpu::{Gpu, GpuError};
use gpugi::picture::Comparison;
use gpugi::reference::{ImageFilter, PathTracer, Progress, Settings};
use gpugi_scene::{Camera, Document};

use crate::task::{Task, compiled};

/// Time from one piece to the next (s). Some frames pass until a page learns that a piece is done.
const PIECE_SECONDS: f32 = 0.1;
/// Fewest and most rays of a piece. The fewest keep the path tracer going where something else makes frames slow.
const RAYS: [u64; 2] = [1 << 14, 1 << 26];
/// Rays that take about as long as the filter of a pixel.
const RAYS_OF_FILTER: u64 = 32;
/// A picture is filtered again when it has this many times the samples.
const FILTERED_AGAIN: f32 = 1.25;

/// A picture to be traced.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// [`Document::revision`].
    pub revision: u64,
    /// The camera.
    pub camera: Camera,
    /// Width and height (pixels).
    pub size: [u32; 2],
    /// Samples per pixel after which it is done.
    pub samples: u32,
    /// Whether its noise is filtered out of what is shown.
    pub is_denoised: bool,
}

impl View {
    /// Whether the other has the same samples, be there more of them or their noise be filtered out.
    fn is_like(&self, other: &Self) -> bool {
        let of = |view: &Self| (view.revision, view.size);
        of(self) == of(other) && self.camera == other.camera
    }
}

/// The picture so far.
#[derive(Debug)]
pub struct Reference {
    /// The picture, to be compared with others.
    pub comparison: Comparison,
    /// Samples per pixel.
    pub samples: u32,
    /// Estimated rel-mse, once it is known.
    pub noise: Option<f64>,
}

/// A path tracer on its way, or why there is none.
type Making = Task<Result<(PathTracer, ImageFilter), String>>;

/// The filter of a picture.
struct Filtering {
    filter: ImageFilter,
    /// Samples that the picture has at least that it filters, or has filtered.
    samples: u32,
    is_at_work: bool,
}

/// The path tracer at work.
pub struct Truth {
    gpu: Gpu,
    settings: Settings,
    wake: Arc<dyn Fn() + Send + Sync>,
    /// A path tracer on its way, with the revision of its scene.
    making: Option<(Making, u64)>,
    /// The path tracer, with the revision that it has seen.
    tracer: Option<(PathTracer, u64)>,
    /// What it traces.
    view: Option<View>,
    progress: Option<Progress>,
    reference: Option<Reference>,
    /// Kept from picture to picture, so that its shaders are.
    filtering: Option<Filtering>,
    /// Rays of the next piece.
    rays: u64,
    /// Time since the last piece (s).
    waited: f32,
    /// Time since the view began (s).
    traced: f32,
    first_sample: Option<f32>,
    /// Whether it has failed.
    is_broken: bool,
}

impl Truth {
    /// A path tracer with these settings. `wake` is called when it is ready to begin.
    pub fn new(gpu: &Gpu, settings: Settings, wake: Arc<dyn Fn() + Send + Sync>) -> Self {
        Self {
            gpu: gpu.clone(),
            settings,
            wake,
            making: None,
            tracer: None,
            view: None,
            progress: None,
            reference: None,
            filtering: None,
            rays: RAYS[0],
            waited: 0.0,
            traced: 0.0,
            first_sample: None,
            is_broken: false,
        }
    }

    /// Traces a piece of a view of the scene as it is now, in a frame that comes `seconds` after the one before. In motion, a view that
    /// has no sample yet is shown before a newer one begins: else nothing would be seen. And a scene that would take an
    /// upload waits for rest: it may be another one in the next frame. Returns whether the picture is better than before.
    ///
    /// # Errors
    /// Why there will be no picture, once.
    pub fn frame(
        &mut self,
        document: &Document,
        view: &View,
        is_moving: bool,
        seconds: f32,
    ) -> Result<bool, LightingError> {
        if self.is_broken {
            return Ok(false);
        }
        let done = self.piece(document, view, is_moving, seconds);
        self.is_broken = done.is_err();
        done
    }

    fn piece(
        &mut self,
        document: &Document,
        view: &View,
        is_moving: bool,
        seconds: f32,
    ) -> Result<bool, LightingError> {
        if let Some((task, revision)) = &self.making {
            let Some(made) = task.result() else {
                return Ok(false);
            };
            let made = made.unwrap_or_else(|| Err("it could not begin; please report it".into()));
            let failed = |reason| GpuError::Pass {
                pass: "path-tracer".into(),
                reason,
            };
            let (tracer, filter) = made.map_err(failed)?;
            self.tracer = Some((tracer, *revision));
            self.filtering = Some(Filtering {
                filter,
                samples: 0,
                is_at_work: false,
            });
            (self.making, self.view) = (None, None);
        }
        let Some((mut tracer, mut revision)) = self.tracer.take() else {
            self.make(document, view);
            return Ok(false);
        };
        let is_other = (self.view.as_ref()).is_none_or(|traced| !traced.is_like(view));
        if is_other && (self.view.is_none() || tracer.samples() > 0 || !is_moving) {
            if revision != view.revision && !tracer.edit(&document.since(revision))? {
                self.view = None;
                if is_moving {
                    self.tracer = Some((tracer, revision));
                } else {
                    // The memory of the last one is free before the next one takes its own.
                    drop(tracer);
                    self.make(document, view);
                }
                return Ok(false);
            }
            revision = view.revision;
            if tracer.size() != view.size {
                tracer.resize(view.size)?;
            }
            tracer.restart(0)?;
            (self.progress, self.traced) = (None, 0.0);
            self.view = Some(view.clone());
            if let Some(filtering) = &mut self.filtering {
                (filtering.samples, filtering.is_at_work) = (0, false);
            }
        } else {
            self.traced += seconds;
        }
        let mut is_shown_anew = false;
        let camera = self.view.as_mut().map_or(&view.camera, |traced| {
            traced.samples = view.samples;
            is_shown_anew = traced.is_denoised != view.is_denoised;
            traced.is_denoised = view.is_denoised;
            &traced.camera
        });
        self.waited += seconds;
        let (before, pieces) = (tracer.samples(), tracer.pieces());
        let progress = tracer.try_render(camera, view.samples, self.rays)?;
        if tracer.pieces() > pieces {
            let factor = (PIECE_SECONDS / self.waited.max(1e-3)).clamp(0.5, 1.5);
            self.rays = ((self.rays as f32 * factor) as u64).clamp(RAYS[0], RAYS[1]);
            self.waited = 0.0;
        }
        self.progress = Some(progress);
        let is_better = progress.samples > before;
        if is_better && before == 0 {
            self.first_sample = Some(self.traced);
        }
        if let Some(reference) = &mut self.reference {
            reference.noise = progress.noise.or(reference.noise);
        }
        if let Some(filtering) = self.filtering.as_mut().filter(|_| is_shown_anew) {
            (filtering.samples, filtering.is_at_work) = (0, false);
        }
        let is_better = is_better || is_shown_anew && progress.samples > 0;
        let is_new = self.show(&tracer, is_better, view.is_denoised)?;
        self.tracer = Some((tracer, revision));
        Ok(is_new)
    }

    /// Shows the picture so far, if it is better than before, or the next rows of it filtered. What has one sample is not
    /// filtered, and neither is the next picture until its first rows are. Returns whether there is anything new to see.
    fn show(
        &mut self,
        tracer: &PathTracer,
        is_better: bool,
        is_denoised: bool,
    ) -> Result<bool, LightingError> {
        let (gpu, size, samples) = (&self.gpu, tracer.size(), tracer.samples());
        let filtering = self.filtering.as_mut().filter(|_| is_denoised);
        let is_filtered = filtering.is_some() && samples > 1;
        let is_of_size = |reference: &Reference| reference.comparison.size() == size;
        if is_better && (!is_filtered || !self.reference.as_ref().is_some_and(is_of_size)) {
            let comparison = match self.reference.take() {
                Some(reference) if reference.comparison.size() == size => reference.comparison,
                Some(reference) => reference.comparison.resized(gpu, size)?,
                None => Comparison::new(gpu, size)?,
            };
            tracer.show(&comparison)?;
            self.reference = Some(Reference {
                comparison,
                samples,
                noise: self.progress.and_then(|progress| progress.noise),
            });
        }
        let (Some(filtering), Some(reference)) = (filtering, &mut self.reference) else {
            return Ok(is_better);
        };
        if !is_filtered {
            return Ok(is_better);
        }
        reference.samples = samples;
        let is_complete = self
            .progress
            .is_some_and(|progress| progress.fraction == 1.0);
        let enough = match is_complete {
            true => filtering.samples + 1,
            false => (filtering.samples as f32 * FILTERED_AGAIN).ceil() as u32,
        };
        if !filtering.is_at_work && samples >= enough.max(2) {
            let pixels = (self.rays / RAYS_OF_FILTER).min(u64::from(u32::MAX)) as u32;
            filtering.filter = tracer.filter_in_steps(pixels)?;
            (filtering.samples, filtering.is_at_work) = (samples, true);
        }
        if filtering.is_at_work {
            filtering.is_at_work = filtering.filter.show_next(tracer, &reference.comparison)?;
            return Ok(true);
        }
        Ok(is_better)
    }

    /// Begins to make a path tracer for a view.
    fn make(&mut self, document: &Document, view: &View) {
        let (gpu, settings) = (self.gpu.clone(), self.settings.clone());
        let scene = document.scene().clone();
        let (wake, size) = (self.wake.clone(), view.size);
        let done = move || wake();
        let task = Task::start("path-tracer", done, move |stage| async move {
            stage.set("uploading").await;
            let made = || {
                let mut tracer = PathTracer::new(&gpu, &scene, size, &settings)?;
                tracer.keep_features()?;
                // Few pixels: until its size is known, only its shaders count.
                let filter = tracer.filter_in_steps(1)?;
                Ok::<_, LightingError>((tracer, filter))
            };
            let (tracer, filter) = made().map_err(|error| error.to_string())?;
            compiled(&gpu, &stage, || tracer.is_compiling()).await;
            Ok((tracer, filter))
        });
        self.making = Some((task, view.revision));
    }

    /// The last picture, which may be of another view.
    pub fn reference(&self) -> Option<&Reference> {
        self.reference.as_ref()
    }

    /// Forgets the last picture.
    pub fn forget(&mut self) {
        (self.reference, self.view) = (None, None);
    }

    /// How long the first sample of a view took (s), once per view.
    pub fn first_sample(&mut self) -> Option<f32> {
        self.first_sample.take()
    }

    /// The path tracer, if it traces this view.
    pub fn tracer(&self, view: &View) -> Option<&PathTracer> {
        let is_of_view = (self.view.as_ref()).is_some_and(|traced| traced.is_like(view));
        let tracer = self.tracer.as_ref().filter(|_| is_of_view);
        tracer.map(|(tracer, _)| tracer)
    }

    /// Whether another frame would not make the picture of this view better.
    pub fn is_done(&self, view: &View) -> bool {
        let is_of_view = self.view.as_ref() == Some(view);
        let Some((tracer, _)) = self.tracer.as_ref().filter(|_| is_of_view) else {
            return self.is_broken;
        };
        let is_complete = self
            .progress
            .is_some_and(|progress| progress.fraction == 1.0);
        let samples = tracer.samples();
        let is_filtered = match self.filtering.as_ref().filter(|_| view.is_denoised) {
            Some(filtering) => {
                !filtering.is_at_work && (samples < 2 || filtering.samples >= samples)
            }
            None => true,
        };
        self.is_broken || (is_complete && is_filtered)
    }
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use gpugi::gpu::AdapterChoice;
    use gpugi_scene::builtin::builtin;
    use gpugi_scene::{Edit, Scene};

    use super::*;

    /// Frames until the picture of a view is complete.
    fn traced(truth: &mut Truth, document: &Document, view: &View) -> Vec<f32> {
        for _ in 0..10_000 {
            truth.frame(document, view, false, 0.01).unwrap();
            if truth.is_done(view) {
                return truth.tracer(view).unwrap().radiance().unwrap();
            }
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        panic!("it never comes");
    }

    fn open() -> Option<Gpu> {
        match Gpu::open(&AdapterChoice::Best) {
            Ok(gpu) => Some(gpu),
            Err(_) if std::env::var_os("GPUGI_SKIP_GPU").is_some() => None,
            Err(error) => panic!("{error}"),
        }
    }

    fn expected(gpu: &Gpu, scene: &Scene, view: &View, samples: u32) -> Vec<f32> {
        let mut tracer = PathTracer::new(gpu, scene, view.size, &Settings::default()).unwrap();
        let mut go_on = |_: &Progress| ControlFlow::Continue(());
        tracer.render(&view.camera, samples, &mut go_on).unwrap();
        tracer.radiance().unwrap()
    }

    /// While a light is dragged, its light is seen, and no path tracer is made anew.
    #[test]
    fn what_is_dragged_is_traced_in_motion() {
        let Some(gpu) = open() else { return };
        let scene = builtin("room", 1).unwrap();
        let mut light = scene.lights[0].clone();
        let mut document = Document::new(scene.clone());
        let mut truth = Truth::new(&gpu, Settings::default(), Arc::new(|| {}));
        let mut view = View {
            revision: 0,
            camera: scene.cameras[0].clone(),
            size: [16, 12],
            samples: 4,
            is_denoised: false,
        };
        traced(&mut truth, &document, &view);
        let mut scenes = vec![scene];
        let mut pictures = 0;
        while pictures < 4 {
            light.world_from_light.w_axis.x += 0.001;
            let light = light.clone();
            document.edit(&[Edit::Light { index: 0, light }]);
            // Another size once in a while, as the pace chooses it.
            view.size = [16 + 4 * (pictures % 2), 12];
            view.revision = document.revision();
            scenes.push(document.scene().clone());
            assert!(view.revision < 10_000, "it never comes");
            let is_new = truth.frame(&document, &view, true, 0.01).unwrap();
            assert!(truth.making.is_none(), "an upload");
            if is_new && truth.reference().unwrap().samples == 1 {
                pictures += 1;
                assert!(truth.first_sample().is_some());
                let of = truth.view.clone().unwrap();
                let (tracer, _) = truth.tracer.as_ref().unwrap();
                let expected = expected(&gpu, &scenes[of.revision as usize], &of, 1);
                assert_eq!(tracer.radiance().unwrap(), expected);
            }
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        // At rest, the last scene is shown.
        let found = traced(&mut truth, &document, &view);
        assert_eq!(found, expected(&gpu, document.scene(), &view, 4));
        // What takes an upload waits for rest.
        let mut material = Box::new(document.scene().materials[0].clone());
        material.transmission = 1.0;
        document.edit(&[Edit::Material { index: 0, material }]);
        view.revision = document.revision();
        for _ in 0..20 {
            assert!(!truth.frame(&document, &view, true, 0.01).unwrap());
            assert!(truth.making.is_none(), "an upload in motion");
        }
        let found = traced(&mut truth, &document, &view);
        assert_eq!(found, expected(&gpu, document.scene(), &view, 4));
    }

    #[test]
    fn the_latest_view_is_traced_to_its_end() {
        let Some(gpu) = open() else { return };
        let document = Document::new(builtin("cornell", 1).unwrap());
        let scene = document.scene();
        let mut truth = Truth::new(&gpu, Settings::default(), Arc::new(|| {}));
        let mut first = View {
            revision: 0,
            camera: scene.cameras[0].clone(),
            size: [16, 12],
            samples: 8,
            is_denoised: false,
        };
        let mut second = first.clone();
        second.camera.world_from_view.w_axis.x += 0.1;
        for _ in 0..20 {
            truth.frame(&document, &first, false, 0.01).unwrap();
        }
        for view in [&mut second, &mut first] {
            // What is filtered for the eye is not what is saved.
            view.is_denoised = !view.is_denoised;
            let view = &*view;
            let found = traced(&mut truth, &document, view);
            let filtering = truth.filtering.as_ref().unwrap();
            assert_eq!((filtering.samples, filtering.is_at_work), (8, false));
            let reference = truth.reference().unwrap();
            assert_eq!(reference.samples, 8);
            assert!(reference.noise.unwrap() > 0.0);
            assert_eq!(found, expected(&gpu, scene, view, 8));
        }
        // The filter goes without another sample.
        first.is_denoised = false;
        assert!(truth.tracer(&first).is_some(), "the samples are kept");
        assert!(!truth.is_done(&first));
        assert!(truth.frame(&document, &first, false, 0.01).unwrap());
        assert!(truth.is_done(&first), "a picture of 8 samples");
        // A picture that is good enough has fewer samples than it may have.
        let settings = Settings {
            noise: 10.0,
            ..Settings::default()
        };
        let mut truth = Truth::new(&gpu, settings, Arc::new(|| {}));
        (first.samples, first.is_denoised) = (100_000, true);
        traced(&mut truth, &document, &first);
        assert!(truth.reference().unwrap().samples < 100_000);
    }
}
