//! Pipelines that are compiled while other work goes on.

use std::collections::VecDeque;
use std::fmt::{self, Debug, Formatter};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

#[cfg(not(target_arch = "wasm32"))]
use super::AtWork;
use super::Gpu;

/// A pipeline that compiles in the background: on another thread or, in a browser, by [`Gpu::is_compiling`]. The first use
/// waits for it.
#[derive(Debug, Clone)]
pub(super) struct Lazy<P> {
    made: Arc<OnceLock<P>>,
    uncompiled: Option<Uncompiled>,
}

impl<P: Send + Sync + 'static> Lazy<P> {
    pub fn compile(gpu: &Gpu, create: impl FnOnce() -> P + Send + 'static) -> Self {
        let made = Arc::new(OnceLock::new());
        let (job, compiling) = (made.clone(), gpu.compiling.clone());
        compiling.fetch_add(1, Ordering::Relaxed);
        let work = move || {
            // What they hold of the device goes first.
            let (job, create) = (job, create);
            let is_wanted = Arc::strong_count(&job) > 1;
            if is_wanted {
                // A panic in the driver's compiler must not leave other threads waiting: rayon then aborts the process.
                let _ = job.set(create());
            }
            compiling.fetch_sub(1, Ordering::Relaxed);
        };
        if let Some(uncompiled) = &gpu.uncompiled {
            uncompiled.add(work);
        } else {
            #[cfg(not(target_arch = "wasm32"))]
            {
                let at_work = AtWork::begin();
                rayon::spawn(move || {
                    let _at_work = at_work;
                    work();
                });
            }
        }
        Self {
            made,
            uncompiled: gpu.uncompiled.clone(),
        }
    }

    /// `name`: of the pipeline.
    pub fn get(&self, name: &str) -> &P {
        if let Some(uncompiled) = &self.uncompiled
            && self.made.get().is_none()
        {
            uncompiled.note_wait(name);
            while self.made.get().is_none() && uncompiled.compile_next() {}
        }
        #[cfg(target_arch = "wasm32")]
        return self.made.get().expect("it was among them");
        #[cfg(not(target_arch = "wasm32"))]
        self.made.wait()
    }
}

/// Pipelines that a browser is yet to compile.
#[derive(Clone, Default)]
pub(super) struct Uncompiled {
    waiting: Arc<Mutex<VecDeque<Compile>>>,
    #[cfg(test)]
    waited_for: Arc<Mutex<Vec<String>>>,
}

type Compile = Box<dyn FnOnce() + Send>;

impl Uncompiled {
    fn waiting(&self) -> MutexGuard<'_, VecDeque<Compile>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn add(&self, compile: impl FnOnce() + Send + 'static) {
        self.waiting().push_back(Box::new(compile));
    }

    /// Compiles one; returns false if there is none.
    pub fn compile_next(&self) -> bool {
        let next = self.waiting().pop_front();
        next.map(|compile| compile()).is_some()
    }

    /// Takes notice of a frame that waits for a pipeline.
    fn note_wait(&self, _name: &str) {
        #[cfg(test)]
        self.waited_for.lock().unwrap().push(_name.to_owned());
    }

    #[cfg(test)]
    pub fn waited_for(&self) -> Vec<String> {
        self.waited_for.lock().unwrap().clone()
    }
}

impl Debug for Uncompiled {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} pipelines", self.waiting().len())
    }
}
