//! The truth beside the picture: the path tracer, on a thread and a device of its own, so that the window never waits
//! for it. Not on a page: the path tracer waits for the GPU, which pages cannot.

use std::ops::ControlFlow;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use gpugi::LightingError;
#[cfg(not(target_arch = "wasm32"))]
use gpugi::gpu::AtWork;
use gpugi::gpu::{AdapterChoice, Gpu, Shader};
use gpugi::reference::{PathTracer, Settings};
use gpugi_scene::{Camera, Scene};

/// Whether there can be one here.
pub const IS_POSSIBLE: bool = !cfg!(target_arch = "wasm32");
/// Time between two states of the picture.
const INTERVAL: Duration = Duration::from_millis(400);

/// A picture to be traced.
#[derive(Debug, Clone)]
pub struct View {
    /// The scene, and the number of its state.
    pub scene: Arc<Scene>,
    /// Grows with every change of the scene.
    pub version: u64,
    /// The camera.
    pub camera: Camera,
    /// Width and height (pixels).
    pub size: [u32; 2],
    /// Samples per pixel after which it is done.
    pub samples: u32,
}

impl View {
    /// Whether both show the same.
    pub fn is_of(&self, version: u64, camera: &Camera, size: [u32; 2]) -> bool {
        self.version == version && self.camera == *camera && self.size == size
    }
}

/// The picture so far.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// Number of the request.
    number: u64,
    /// Mean linear radiance, three floats per pixel, row by row from the top.
    pub radiance: Vec<f32>,
    /// Samples per pixel.
    pub samples: u32,
    /// Estimated rel-mse.
    pub noise: f64,
}

/// The path tracer at work.
#[derive(Debug)]
pub struct Truth {
    requests: Sender<(u64, View)>,
    /// The newest: pictures that nobody looks at take no memory.
    answer: Arc<Mutex<Option<Result<Reference, String>>>>,
    asked: Option<View>,
    number: u64,
}

impl Truth {
    /// Starts the thread, on the adapter of `gpu` and with its shaders. `wake` is called whenever the picture is better.
    pub fn start(gpu: &Gpu, wake: impl Fn() + Send + 'static) -> Self {
        let (requests, to_do) = channel();
        let answer = Arc::new(Mutex::new(None));
        let slot = Arc::downgrade(&answer);
        let choice = AdapterChoice::Named(gpu.adapter.name.clone());
        let shaders = gpu.replaced_shaders();
        #[cfg(not(target_arch = "wasm32"))]
        let at_work = AtWork::begin();
        thread::spawn(move || {
            #[cfg(not(target_arch = "wasm32"))]
            let _at_work = at_work;
            let answer = |answer| {
                let Some(slot) = slot.upgrade() else {
                    return false;
                };
                *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(answer);
                wake();
                true
            };
            if let Err(error) = work(&choice, shaders, &to_do, &answer) {
                answer(Err(error.to_string()));
            }
        });
        Self {
            requests,
            answer,
            asked: None,
            number: 0,
        }
    }

    /// What is being traced.
    pub fn asked(&self) -> Option<&View> {
        self.asked.as_ref()
    }

    /// Traces another view.
    pub fn ask(&mut self, view: View) {
        self.number += 1;
        self.asked = Some(view.clone());
        // A thread that has ended has said why.
        let _ = self.requests.send((self.number, view));
    }

    /// The latest picture of the view that was asked for, if there is a new one.
    ///
    /// # Errors
    /// Why there will be none.
    pub fn latest(&self) -> Result<Option<Reference>, String> {
        let mut slot = self.answer.lock().unwrap_or_else(PoisonError::into_inner);
        let latest = slot.take().transpose()?;
        Ok(latest.filter(|one| one.number == self.number))
    }
}

fn work(
    choice: &AdapterChoice,
    shaders: Vec<Shader>,
    requests: &Receiver<(u64, View)>,
    answer: &dyn Fn(Result<Reference, String>) -> bool,
) -> Result<(), LightingError> {
    let Ok(mut request) = requests.recv() else {
        return Ok(());
    };
    let gpu = Gpu::open(choice)?;
    gpu.replace_shaders(shaders);
    let mut tracer: Option<(PathTracer, u64, [u32; 2])> = None;
    loop {
        // Older ones are of no interest any more.
        if let Some(newer) = requests.try_iter().last() {
            request = newer;
        }
        let (number, view) = &request;
        let (current, _, _) = match &mut tracer {
            Some(kept) if (kept.1, kept.2) == (view.version, view.size) => {
                kept.0.restart(0)?;
                kept
            }
            other => {
                let new = PathTracer::new(&gpu, &view.scene, view.size, &Settings::default())?;
                other.insert((new, view.version, view.size))
            }
        };
        let mut next = None;
        while next.is_none() && current.samples() < view.samples {
            let started = Instant::now();
            current.render(&view.camera, view.samples, &mut |_| {
                match requests.try_recv() {
                    Ok(newer) => next = Some(newer),
                    Err(TryRecvError::Empty) if started.elapsed() < INTERVAL => {
                        return ControlFlow::Continue(());
                    }
                    Err(_) => {}
                }
                ControlFlow::Break(())
            })?;
            let reference = Reference {
                number: *number,
                radiance: current.radiance()?,
                samples: current.samples(),
                noise: current.noise()?,
            };
            if !answer(Ok(reference)) {
                return Ok(());
            }
        }
        request = match next.map_or_else(|| requests.recv().ok(), Some) {
            Some(next) => next,
            None => return Ok(()),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gpugi_scene::builtin::builtin;

    #[test]
    fn the_latest_view_is_traced_to_its_end() {
        let gpu = match Gpu::open(&AdapterChoice::Best) {
            Ok(gpu) => gpu,
            Err(_) if std::env::var_os("GPUGI_SKIP_GPU").is_some() => return,
            Err(error) => panic!("{error}"),
        };
        let scene = Arc::new(builtin("cornell", 1).unwrap());
        let (woken, wakes) = channel();
        let mut truth = Truth::start(&gpu, move || woken.send(()).unwrap_or_default());
        let view = |samples| View {
            scene: scene.clone(),
            version: 0,
            camera: scene.cameras[0].clone(),
            size: [16, 12],
            samples,
        };
        truth.ask(view(1 << 20));
        wakes.recv().unwrap();
        truth.ask(view(8));
        let mut last = None;
        while last.as_ref().is_none_or(|one: &Reference| one.samples < 8) {
            wakes.recv().unwrap();
            last = truth.latest().unwrap().or(last);
        }
        let last = last.unwrap();
        assert_eq!((last.samples, last.radiance.len()), (8, 16 * 12 * 3));
        assert!(last.noise > 0.0);
        let mut expected = PathTracer::new(&gpu, &scene, [16, 12], &Settings::default()).unwrap();
        expected
            .render(&scene.cameras[0], 8, &mut |_| ControlFlow::Continue(()))
            .unwrap();
        assert_eq!(last.radiance, expected.radiance().unwrap());
    }
}
