//! What rays through media read: the light that particles send out (along_ray.wesl), and the lights themselves
//! (single_scattering.wesl).

use crate::gpu::{Gpu, GpuError, Named};

/// What media send out along rays: sources of particles, how they are interpolated, and lights.
#[derive(Debug, Clone, PartialEq)]
pub struct MediaSources {
    /// Directions per particle; 0 without media.
    pub directions: u32,
    /// Lights that rays march toward: the first of `lights`.
    pub marched_lights: u32,
    /// Radiance that particles send out per unit of opacity: `source` of along_ray.wesl.
    pub source: wgpu::Buffer,
    /// Particles near the nodes of each medium's grid, and their weights: `neighbours` of field.wesl.
    pub neighbours: wgpu::Buffer,
    /// By medium, the nodes of its grid along the axes, and where they begin.
    pub fields: wgpu::Buffer,
    /// Light samples: `LightSample` of lights/light_sample.wesl.
    pub lights: wgpu::Buffer,
    /// Optical depths of the way to each light: light_depths.wesl.
    pub light_depths: wgpu::Buffer,
}

impl MediaSources {
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
