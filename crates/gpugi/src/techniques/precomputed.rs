//! What techniques compute once for a still scene, and files hold.

use std::sync::Arc;

use gpugi_scene::{Atlas, Scene};

use super::{Info, Technique};
use crate::gpu::{Gpu, GpuError};

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

/// Whether what a scene's file holds fits the scene as it is now; checked again when one of `N` versions changes.
#[derive(Debug)]
pub(super) struct Fit<const N: usize>(Option<([u64; N], Result<(), String>)>);

impl<const N: usize> Default for Fit<N> {
    fn default() -> Self {
        Self(None)
    }
}

impl<const N: usize> Fit<N> {
    /// Whether it fits at these versions, according to `check`.
    pub fn holds(
        &mut self,
        versions: [u64; N],
        check: impl FnOnce() -> Result<(), String>,
    ) -> bool {
        if self.0.as_ref().is_none_or(|(known, _)| *known != versions) {
            self.0 = Some((versions, check()));
        }
        self.reason().is_none()
    }

    /// Forgets what was checked.
    pub fn forget(&mut self) {
        self.0 = None;
    }

    /// Why it does not fit.
    pub fn reason(&self) -> Option<&str> {
        let (_, fits) = self.0.as_ref()?;
        fits.as_ref().err().map(String::as_str)
    }
}
