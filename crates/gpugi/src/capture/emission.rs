//! The frame's own passes: light path LE, the first to write a target, and attenuation, the last.

use super::{Attenuation, Gather, Receiver};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::scene::GpuScene;
use crate::shader;

/// Light that emitters and the environment send straight to the viewpoint.
#[derive(Debug)]
pub struct Emission {
    pass: Gather,
    pub(crate) attenuation: Attenuation,
}

impl Emission {
    /// Compiles the pass.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        Ok(Self {
            pass: Gather::new(gpu, scene, &shader!("capture.emission"), &[])?,
            attenuation: Attenuation::default(),
        })
    }

    /// Writes the target with the first sample of an image and adds to it with the others: pass `frame.emission`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
    ) -> Result<(), GpuError> {
        self.pass
            .record(frame, "frame.emission", scene, receiver, &[])
    }
}
