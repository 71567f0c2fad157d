//! Scaled copies of textures: mip levels, and images that do not fill their array. (wgpu's own blitter interpolates
//! only for magnification, which leaves mip levels unfiltered.)

use super::{Gpu, GpuError, Quad};
use crate::shader;

/// A pipeline that fills textures of one format.
#[derive(Debug)]
pub(crate) struct Blit {
    quad: Quad,
    sampler: wgpu::Sampler,
}

impl Blit {
    /// Compiles the pipeline for targets of `format`.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Result<Self, GpuError> {
        Ok(Self {
            quad: Quad::new(gpu, &shader!("gpu.blit"), format)?,
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("blit"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
        })
    }

    /// Fills `target` with `source`.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when a view does not fit.
    pub fn copy(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        source: &wgpu::TextureView,
        target: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        let resources = [
            ("source", wgpu::BindingResource::TextureView(source)),
            (
                "source_sampler",
                wgpu::BindingResource::Sampler(&self.sampler),
            ),
        ];
        let group = self.quad.bind(gpu, &resources)?;
        self.quad.draw(encoder, "gpu.blit", &group, target);
        Ok(())
    }
}
