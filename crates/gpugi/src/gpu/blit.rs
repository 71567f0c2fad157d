//! Scaled copies of textures: mip levels and images that do not fill their array. (wgpu's own blitter interpolates only when
//! it magnifies, which leaves mip levels unfiltered.)

use super::kernel::Interface;
use super::{Gpu, GpuError};
use crate::shader;

/// A pipeline that fills textures of one format.
#[derive(Debug)]
pub(crate) struct Blit {
    interface: Interface,
    pipeline: wgpu::RenderPipeline,
    sampler: wgpu::Sampler,
}

impl Blit {
    /// Compiles it for targets of `format`.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Result<Self, GpuError> {
        let shader = shader!("gpu.blit");
        gpu.scoped(shader.name, || {
            let stages = wgpu::ShaderStages::VERTEX_FRAGMENT;
            let (interface, _) = Interface::new(gpu, &shader, stages, None, false)?;
            let pipeline = gpu
                .device
                .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                    label: Some(shader.name),
                    layout: Some(&interface.pipeline_layout),
                    vertex: wgpu::VertexState {
                        module: &interface.module,
                        entry_point: Some("vertex"),
                        compilation_options: Default::default(),
                        buffers: &[],
                    },
                    primitive: Default::default(),
                    depth_stencil: None,
                    multisample: Default::default(),
                    fragment: Some(wgpu::FragmentState {
                        module: &interface.module,
                        entry_point: Some("fragment"),
                        compilation_options: Default::default(),
                        targets: &[Some(format.into())],
                    }),
                    multiview_mask: None,
                    cache: None,
                });
            let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some(shader.name),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            });
            Ok(Self {
                interface,
                pipeline,
                sampler,
            })
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
        let group = self.interface.bind(
            gpu,
            0,
            &[
                ("source", wgpu::BindingResource::TextureView(source)),
                (
                    "source_sampler",
                    wgpu::BindingResource::Sampler(&self.sampler),
                ),
            ],
        )?;
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("gpu.blit"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
        Ok(())
    }
}
