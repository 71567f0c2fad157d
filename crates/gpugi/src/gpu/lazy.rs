//! Pipelines that are compiled while other work goes on.

use std::collections::VecDeque;
use std::fmt::{self, Debug, Formatter};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

#[cfg(not(target_arch = "wasm32"))]
use super::AtWork;
use super::Gpu;
use super::pipelines::{Made, Pipelines, Recipe};

/// A pipeline that compiles in the background: on another thread or, in a browser, by [`Gpu::is_compiling`]. The first use
/// waits for it.
#[derive(Debug, Clone)]
pub(super) struct Lazy<P> {
    made: Made<P>,
    uncompiled: Option<Uncompiled>,
}

impl<P: Debug + Send + Sync + 'static> Lazy<P> {
    /// The pipeline of `recipe`, which `create` compiles if `pipelines` do not hold it.
    pub fn compile(
        gpu: &Gpu,
        pipelines: &Pipelines<P>,
        recipe: Recipe,
        create: impl FnOnce() -> P + Send + 'static,
    ) -> Self {
        let (made, is_new) = pipelines.get(&recipe, &gpu.compiling);
        let lazy = Self {
            made: made.clone(),
            uncompiled: gpu.uncompiled.clone(),
        };
        if !is_new {
            return lazy;
        }
        let (pipelines, faults) = (pipelines.clone(), gpu.faults.clone());
        let work = move || {
            // What they hold of the device goes first.
            let (made, create) = (made, create);
            if pipelines.is_wanted(&recipe, &made) {
                // A panic in the driver's compiler must not leave other threads waiting: rayon then aborts the process.
                let _ = made.set(create());
                // Out of memory, for instance. Somebody else's fault costs this pipeline its place at most.
                let is_faulty = faults.lock().is_ok_and(|faults| faults.error.is_some());
                pipelines.done(recipe, made, is_faulty);
            }
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
        lazy
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
