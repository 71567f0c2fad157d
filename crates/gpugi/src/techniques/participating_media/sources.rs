//! What rays through media read: the light that particles send out (along_ray.wesl), and the lights themselves
//! (single_scattering.wesl).

use crate::gpu::{Gpu, GpuError, Named};

/// Sources of particles, and how they are interpolated.
#[derive(Debug, Clone, PartialEq)]
pub struct Sources {
    /// Directions per particle; 0 without media.
    pub directions: u32,
    /// Lights that rays march toward.
    pub marched_lights: u32,
    pub(super) source: wgpu::Buffer,
    pub(super) neighbours: wgpu::Buffer,
    pub(super) fields: wgpu::Buffer,
    pub(super) lights: wgpu::Buffer,
    pub(super) light_depths: wgpu::Buffer,
}

impl Sources {
    /// To be bound where there are no media.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn none(gpu: &Gpu) -> Result<Self, GpuError> {
        let empty = gpu.room("no media", 16)?;
        Ok(Self {
            directions: 0,
            marched_lights: 0,
            source: empty.clone(),
            neighbours: empty.clone(),
            fields: empty.clone(),
            lights: empty.clone(),
            light_depths: empty,
        })
    }

    /// What kernels bind that import along_ray.wesl or single_scattering.wesl.
    pub fn resources(&self) -> [Named<'_>; 5] {
        [
            ("source", &self.source),
            ("neighbours", &self.neighbours),
            ("fields", &self.fields),
            ("lights", &self.lights),
            ("light_depths", &self.light_depths),
        ]
    }
}
