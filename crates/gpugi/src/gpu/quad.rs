//! Passes that fill a whole texture with one triangle.

use super::kernel::{Interface, shader_module};
use super::{Gpu, GpuError, Shader};

/// The entry points `vertex` and `fragment` of a shader with bind group 0, for targets of one format.
#[derive(Debug)]
pub(crate) struct Quad {
    interface: Interface,
    pipeline: wgpu::RenderPipeline,
}

impl Quad {
    /// Compiles the pass.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, shader: &Shader, format: wgpu::TextureFormat) -> Result<Self, GpuError> {
        let module = shader_module(gpu, shader, false);
        let stages = wgpu::ShaderStages::VERTEX_FRAGMENT;
        let (interface, _) = Interface::new(gpu, shader, stages, None)?;
        let pipeline = gpu
            .device
            .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(shader.name),
                layout: Some(&interface.pipeline_layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("vertex"),
                    compilation_options: Default::default(),
                    buffers: &[],
                },
                primitive: Default::default(),
                depth_stencil: None,
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some("fragment"),
                    compilation_options: Default::default(),
                    targets: &[Some(format.into())],
                }),
                multiview_mask: None,
                cache: None,
            });
        Ok(Self {
            interface,
            pipeline,
        })
    }

    /// Binds resources by their names in the shader.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn bind(
        &self,
        gpu: &Gpu,
        resources: &[(&str, wgpu::BindingResource<'_>)],
    ) -> Result<wgpu::BindGroup, GpuError> {
        self.interface.bind(gpu, 0, resources)
    }

    /// Records the pass that fills `target`.
    pub fn draw(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        name: &str,
        group: &wgpu::BindGroup,
        target: &wgpu::TextureView,
    ) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(name),
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
        pass.set_bind_group(0, group, &[]);
        pass.draw(0..3, 0..1);
    }
}
