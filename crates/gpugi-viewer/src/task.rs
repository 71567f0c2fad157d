//! Work that takes longer than a frame: on another thread, with its stage to show, and given up before its next stage when it
//! is dropped. A page has no threads: there, it runs between frames, from one stage to the next.

use std::future::{Future, poll_fn};
use std::pin::pin;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::Poll;

use gpugi::gpu::{Gpu, GpuError};

/// What a task says about itself: what it does now, and how far that is (0 to 1), if it is known.
#[derive(Debug, Clone, Default)]
pub struct Stage(Arc<Mutex<(&'static str, Option<f32>)>>);

impl Stage {
    /// Says what the task does now. A page shows that before the task goes on. A task that nobody waits for ends here.
    pub async fn set(&self, stage: &'static str) {
        self.set_progress(stage, None).await;
    }

    /// As [`Stage::set`], with how far that is (0 to 1).
    pub async fn set_progress(&self, stage: &'static str, progress: Option<f32>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = (stage, progress);
        #[cfg(target_arch = "wasm32")]
        crate::browser::pause().await;
        let mut has_paused = false;
        poll_fn(|context| {
            if has_paused {
                return Poll::Ready(());
            }
            has_paused = true;
            context.waker().wake_by_ref();
            Poll::Pending
        })
        .await;
    }

    /// What the task does now.
    pub fn get(&self) -> &'static str {
        self.with_progress().0
    }

    /// What the task does now, and how far that is (0 to 1), if it is known.
    pub fn with_progress(&self) -> (&'static str, Option<f32>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Waits until the GPU has done what was submitted. On another thread than the window's, it looks again and again: while
/// [`Gpu::wait`] waits, no other thread presents a picture.
///
/// # Errors
/// [`GpuError`].
pub async fn gpu_done(gpu: &Gpu) -> Result<(), GpuError> {
    #[cfg(target_arch = "wasm32")]
    crate::browser::gpu_done(gpu).await;
    #[cfg(not(target_arch = "wasm32"))]
    {
        let (done, is_done) = channel();
        // Perhaps nobody waits any more.
        let tell = move || done.send(()).unwrap_or_default();
        gpu.queue.on_submitted_work_done(tell);
        while is_done.try_recv() == Err(TryRecvError::Empty) {
            gpu.check()?;
            gpu.device.poll(wgpu::PollType::Poll).ok();
            std::thread::sleep(std::time::Duration::from_micros(200));
        }
    }
    gpu.check()
}

/// Waits until pipelines are compiled; what is on show goes on meanwhile. `is_compiling` as
/// [`gpugi::renderer::Renderer::is_compiling`].
pub async fn compiled(gpu: &Gpu, stage: &Stage, is_compiling: impl Fn() -> bool) {
    stage.set("compiling shaders").await;
    while is_compiling() {
        // The page draws between two pipelines.
        #[cfg(target_arch = "wasm32")]
        crate::browser::gpu_done(gpu).await;
        #[cfg(not(target_arch = "wasm32"))]
        {
            let _ = gpu;
            std::thread::sleep(std::time::Duration::from_millis(1));
            stage.set("compiling shaders").await;
        }
    }
}

/// A running task. Dropped before its end, it ends with the stage that it is in.
#[derive(Debug)]
pub struct Task<T> {
    /// What it works on, such as the name of a file.
    pub subject: String,
    /// What it does now.
    pub stage: Stage,
    result: Receiver<T>,
    /// Lives as long as somebody waits.
    _waiting: Arc<()>,
}

impl<T: Send + 'static> Task<T> {
    /// Starts `work`. `done` is called after its end, to wake the window.
    pub fn start<F: Future<Output = T> + 'static>(
        subject: &str,
        done: impl FnOnce() + Send + 'static,
        work: impl FnOnce(Stage) -> F + Send + 'static,
    ) -> Self {
        let stage = Stage::default();
        let (sender, result) = channel();
        let own_stage = stage.clone();
        let waiting = Arc::new(());
        let is_waited_for = Arc::downgrade(&waiting);
        let run = async move || {
            let mut work = pin!(work(own_stage));
            let result = poll_fn(|context| match is_waited_for.strong_count() {
                0 => Poll::Ready(None),
                _ => work.as_mut().poll(context).map(Some),
            });
            if let Some(result) = result.await {
                // It may have been dropped meanwhile.
                let _ = sender.send(result);
            }
            done();
        };
        #[cfg(target_arch = "wasm32")]
        wasm_bindgen_futures::spawn_local(async move { run().await });
        #[cfg(not(target_arch = "wasm32"))]
        {
            let at_work = gpugi::gpu::AtWork::begin();
            std::thread::spawn(move || {
                let _at_work = at_work;
                pollster::block_on(run());
            });
        }
        Self {
            subject: subject.to_owned(),
            stage,
            result,
            _waiting: waiting,
        }
    }

    /// The result, once: `Some(None)` if the thread ended without one.
    pub fn result(&self) -> Option<Option<T>> {
        match self.result.try_recv() {
            Ok(result) => Some(Some(result)),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(None),
        }
    }

    /// Waits for the result.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn wait(&self) -> Option<T> {
        self.result.recv().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_task_says_what_it_does_and_hands_over_its_result() {
        let (go, wait) = channel();
        let (woken, wakes) = channel();
        let task = Task::start(
            "three",
            move || woken.send(()).unwrap(),
            move |stage| async move {
                stage.set("counting").await;
                wait.recv().unwrap();
                3
            },
        );
        assert_eq!(task.result(), None);
        go.send(()).unwrap();
        wakes.recv().unwrap();
        assert_eq!(task.stage.get(), "counting");
        assert_eq!(task.result(), Some(Some(3)));
    }

    #[test]
    fn a_task_that_is_dropped_ends_before_its_next_stage() {
        let (go, wait) = channel::<()>();
        let (woken, wakes) = channel();
        let (reached, far) = channel();
        let task = Task::start(
            "nothing",
            move || woken.send(()).unwrap(),
            move |stage| async move {
                reached.send("first").unwrap();
                wait.recv().unwrap();
                stage.set("second").await;
                reached.send("second").unwrap();
            },
        );
        assert_eq!(far.recv(), Ok("first"));
        drop(task);
        go.send(()).unwrap();
        wakes.recv().unwrap();
        assert!(far.recv().is_err());
    }
}
