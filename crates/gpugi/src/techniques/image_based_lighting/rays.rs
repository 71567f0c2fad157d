//! The gather with shadows by rays, without maps.

use super::Reflectivity;
use super::batches::Ranges;
use super::gpu::Direction;
use crate::capture::{Gather, Receiver};
use crate::gpu::{Frame, Gpu, GpuError, Named};
use crate::scene::{GpuScene, RayConstants};
use crate::shader;

/// Most rays per dispatch: about 100 ms on a slow GPU.
const DISPATCH_WORK: u64 = 1 << 24;

/// What the gather is compiled for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Variant {
    reflectivity: Reflectivity,
    has_clear: bool,
    has_media: bool,
    constants: RayConstants,
}

impl Variant {
    pub fn new(scene: &GpuScene, reflectivity: Reflectivity) -> Self {
        Self {
            reflectivity,
            has_clear: scene.has_clear_objects(),
            has_media: !scene.media.is_empty(),
            constants: scene.ray_constants(),
        }
    }
}

/// Directions, and the pass that traces a ray from each point to each of them.
#[derive(Debug)]
pub struct RayGather {
    gather: Gather,
    count: u32,
    /// The directions; `None` if there are none.
    directions: Option<wgpu::Buffer>,
}

impl RayGather {
    /// Compiles the pass.
    ///
    /// # Errors
    /// [`GpuError::Pass`], also if the scene was uploaded without rays.
    pub fn new(gpu: &Gpu, scene: &GpuScene, variant: Variant) -> Result<Self, GpuError> {
        scene.check_rays(super::INFO.name, "visibility=rays")?;
        let more = [
            ("REFLECTIVITY", f64::from(variant.reflectivity as u32)),
            ("HAS_CLEAR", f64::from(u8::from(variant.has_clear))),
            scene.media_constant(),
        ];
        let shader = shader!("techniques.image_based_lighting.rays");
        Ok(Self {
            gather: Gather::tracing_rays(gpu, scene, &shader, &more)?,
            count: 0,
            directions: None,
        })
    }

    /// Sets the directions.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn set(&mut self, gpu: &Gpu, directions: &[Direction]) -> Result<(), GpuError> {
        let count = directions.len() as u32;
        if let Some(buffer) = self.directions.as_ref().filter(|_| count == self.count) {
            gpu.write(buffer, 0, directions);
            return Ok(());
        }
        self.count = count;
        let make = || gpu.storage("directions [bytes]", directions);
        self.directions = (count > 0).then(make).transpose()?;
        Ok(())
    }

    /// Adds the light of every direction to the receiver's target: see rays.wesl.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn gather(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
    ) -> Result<(), GpuError> {
        let Some(directions) = &self.directions else {
            return Ok(());
        };
        let more: [Named<'_>; 1] = [("directions", directions)];
        let ranges = Ranges::new(0..self.count, receiver, DISPATCH_WORK);
        ranges.record(frame, &self.gather, scene, receiver, &more)
    }
}
