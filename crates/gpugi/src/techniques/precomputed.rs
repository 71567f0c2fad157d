//! What techniques compute once for a still scene, and files hold.

use std::convert::Infallible;
use std::sync::Arc;

use gpugi_scene::{Atlas, Scene};

use super::{Info, Technique};
use crate::gpu::{Gpu, GpuError};
use crate::scene::Versions;
use crate::stage::Stage;

/// A technique that computes maps of a still scene's texels, which files hold. Its settings include `resolution`,
/// `density`, and `stored`: whether maps of the scene's file are used.
pub trait Precomputed: Technique {
    /// Its description.
    const INFO: &'static Info;

    /// What files hold.
    type Stored;

    /// Why files do not hold what this value of a setting asks for, if they do not.
    fn refusal(name: &str, value: &str) -> Option<&'static str>;

    /// The final maps, for a file. Hashes of the scene are left to the file's writer. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`], also if the maps are not final.
    fn finished(
        &mut self,
        gpu: &Gpu,
        scene: &Scene,
        atlas: Arc<Atlas>,
    ) -> Result<Self::Stored, GpuError>;
}

/// Whether what a scene's file holds fits the scene as it is now.
#[derive(Debug, Default)]
pub(super) struct Fit(Stage<Versions, Result<(), String>>);

impl Fit {
    /// What the file holds, if it is wanted and fits, according to `check`, the scene at these versions.
    pub fn of<T>(
        &mut self,
        stored: Option<&Arc<T>>,
        versions: Versions,
        check: impl FnOnce(&T) -> Result<(), String>,
    ) -> Option<Arc<T>> {
        let Some(stored) = stored else {
            self.0.clear();
            return None;
        };
        let Ok(fits) = (self.0).keep(versions, |_| Ok::<_, Infallible>(check(stored)));
        fits.is_ok().then(|| Arc::clone(stored))
    }

    /// Why it does not fit.
    pub fn reason(&self) -> Option<&str> {
        self.0.get()?.as_ref().err().map(String::as_str)
    }
}
