//! Openness: how much of a uniform sky's light reaches surfaces, which a technique may provide to those after it.

use crate::capture::Receiver;
use crate::gpu::{Frame, Gpu, GpuError};
use crate::scene::GpuScene;
use crate::stage::Stage;

/// Maps of openness.
pub trait Openness {
    /// The buffer that holds them. Lookups of another buffer are stale.
    fn map(&self) -> &wgpu::Buffer;

    /// Compiles the pass that looks them up.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    fn lookup(&self, gpu: &Gpu, scene: &GpuScene) -> Result<Box<dyn OpennessLookup>, GpuError>;
}

/// A pass that looks openness up at the points of receivers.
pub trait OpennessLookup: std::fmt::Debug + Send + Sync {
    /// Four floats per point of the receiver, in the order of the points: the mean open direction, a unit vector, times
    /// the share of a uniform sky's irradiance that arrives (0 to 1), and the factor on ambient light from near surfaces
    /// (0 to 1). The normal and 1 where nothing is known. Other receivers overwrite it.
    ///
    /// # Errors
    /// [`GpuError`].
    fn record(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
    ) -> Result<&wgpu::Buffer, GpuError>;
}

/// Has the lookup read the present `openness`, if there is any.
///
/// # Errors
/// [`GpuError::Pass`].
pub(super) fn follow(
    lookup: &mut Stage<wgpu::Buffer, Box<dyn OpennessLookup>>,
    openness: Option<&dyn Openness>,
    gpu: &Gpu,
    scene: &GpuScene,
) -> Result<(), GpuError> {
    let Some(openness) = openness else {
        lookup.clear();
        return Ok(());
    };
    let made = lookup.keep(openness.map().clone(), |_| openness.lookup(gpu, scene));
    made.map(drop)
}
