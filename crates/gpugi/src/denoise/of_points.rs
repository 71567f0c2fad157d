//! Features of pictures whose pixels are surface points.

use super::Features;
use crate::capture::Receiver;
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named};
use crate::shader;

/// The kernel that adds surface points to the features of their pixels.
#[derive(Debug)]
pub struct OfPoints {
    kernel: Kernel,
}

impl OfPoints {
    /// Compiles it.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            kernel: Kernel::new(gpu, &shader!("denoise.of_points"), "main", None)?,
        })
    }

    /// Features of `points` points.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn film(gpu: &Gpu, points: u32) -> Result<wgpu::Buffer, GpuError> {
        let bytes = u64::from(points) * size_of::<Features>() as u64;
        gpu.buffer(
            "picture.features [bytes]",
            bytes,
            wgpu::BufferUsages::STORAGE,
        )
    }

    /// Adds the points of a receiver to `features`, or replaces these if its view begins a picture: pass
    /// `picture.features`.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        receiver: &Receiver,
        features: &wgpu::Buffer,
    ) -> Result<(), GpuError> {
        let own: [Named<'_>; 1] = [("film", features)];
        let resources = crate::gpu::join(&receiver.resources(), &own);
        let invocations = [receiver.points.count, 1, 1];
        frame.compute("picture.features", |pass| {
            self.kernel.run(pass, None, &resources, invocations)
        })
    }
}
