//! Render pipelines for triangles, with bind-group layouts from shader reflection.

use super::kernel::{Interface, linked_constants, shader_module};
use super::lazy::Lazy;
use super::shader::Shader;
use super::{Gpu, GpuError};

/// Fixed-function state of a [`RasterKernel`].
#[derive(Debug, Clone, Copy)]
pub struct RasterState<'a> {
    /// Colour targets.
    pub colors: &'a [wgpu::TextureFormat],
    /// How colours blend with those of the targets; `None` replaces them.
    pub blend: Option<wgpu::BlendState>,
    /// Values of pipeline-overridable constants, by their names in WESL modules.
    pub constants: &'a [(&'a str, f64)],
    /// Which faces are culled.
    pub cull: Option<wgpu::Face>,
    /// Slope-scaled bias away from the viewer, in depth steps per slope; 0 is none.
    pub slope_bias: f32,
    /// Whether the pipeline takes the merged vertices as a vertex buffer; otherwise the shader fetches its vertices.
    pub has_vertices: bool,
    /// Whether a fragment shader runs.
    pub has_fragment: bool,
    /// Which fragments are drawn.
    pub depth: DepthTest,
}

/// Which fragments a [`RasterKernel`] draws, and whether it writes their depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DepthTest {
    /// All; depth stays as it is.
    Off,
    /// The nearest ones, whose depth is written.
    Nearest,
    /// Those in front of the depth, which stays as it is.
    InFront,
    /// All, and their depth is written.
    Overwrite,
}

/// A render pipeline for triangles, usually the merged world-space ones. Depth is 32-bit float; nearer is greater
/// (reverse z).
#[derive(Debug, Clone)]
pub struct RasterKernel {
    interface: Interface,
    pipeline: Lazy<wgpu::RenderPipeline>,
}

impl RasterKernel {
    /// Bytes of a merged vertex: world position (3 x f32) and instance index (u32).
    pub const VERTEX_STRIDE: u64 = 16;

    /// Compiles the entry points `vertex` and `fragment` of `shader`.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when the shader does not compile or has no such constant.
    pub fn new(
        gpu: &Gpu,
        shader: &Shader,
        scene: Option<&wgpu::BindGroupLayout>,
        state: &RasterState<'_>,
    ) -> Result<Self, GpuError> {
        let stages = wgpu::ShaderStages::VERTEX_FRAGMENT;
        let shader = gpu.current(shader);
        let (interface, reflection) = Interface::new(gpu, &shader, stages, scene)?;
        let constants = linked_constants(shader.name, &reflection.overridable, state.constants)?;
        let recipe = interface.recipe(&shader, &constants, format!("{} {state:?}", shader.name));
        let pipeline = Lazy::compile(gpu, &gpu.render_pipelines, recipe, {
            let (gpu, layout) = (gpu.clone(), interface.pipeline_layout.clone());
            let colors = state.colors.to_vec();
            let RasterState {
                blend,
                cull,
                slope_bias,
                has_vertices,
                has_fragment,
                depth,
                ..
            } = *state;
            move || {
                let module = shader_module(&gpu, &shader, false);
                let target = |&format: &wgpu::TextureFormat| {
                    Some(wgpu::ColorTargetState {
                        blend,
                        ..format.into()
                    })
                };
                let targets: Vec<_> = colors.iter().map(target).collect();
                let constants: Vec<_> = constants
                    .iter()
                    .map(|(name, value)| (name.as_str(), *value))
                    .collect();
                let compilation_options = wgpu::PipelineCompilationOptions {
                    constants: &constants,
                    ..Default::default()
                };
                let attributes = wgpu::vertex_attr_array![0 => Float32x3, 1 => Uint32];
                let vertices = [Some(wgpu::VertexBufferLayout {
                    array_stride: Self::VERTEX_STRIDE,
                    step_mode: wgpu::VertexStepMode::Vertex,
                    attributes: &attributes,
                })];
                gpu.device
                    .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                        label: Some(shader.name),
                        layout: Some(&layout),
                        vertex: wgpu::VertexState {
                            module: &module,
                            entry_point: Some("vertex"),
                            compilation_options: compilation_options.clone(),
                            buffers: if has_vertices { &vertices } else { &[] },
                        },
                        primitive: wgpu::PrimitiveState {
                            cull_mode: cull,
                            ..Default::default()
                        },
                        depth_stencil: Some(wgpu::DepthStencilState {
                            format: wgpu::TextureFormat::Depth32Float,
                            depth_write_enabled: Some(matches!(
                                depth,
                                DepthTest::Nearest | DepthTest::Overwrite
                            )),
                            depth_compare: Some(match depth {
                                DepthTest::Nearest | DepthTest::InFront => {
                                    wgpu::CompareFunction::Greater
                                }
                                DepthTest::Off | DepthTest::Overwrite => {
                                    wgpu::CompareFunction::Always
                                }
                            }),
                            stencil: Default::default(),
                            bias: wgpu::DepthBiasState {
                                constant: 0,
                                slope_scale: -slope_bias,
                                clamp: 0.0,
                            },
                        }),
                        multisample: Default::default(),
                        fragment: has_fragment.then(|| wgpu::FragmentState {
                            module: &module,
                            entry_point: Some("fragment"),
                            compilation_options: compilation_options.clone(),
                            targets: &targets,
                        }),
                        multiview_mask: None,
                        cache: None,
                    })
            }
        });
        Ok(Self {
            interface,
            pipeline,
        })
    }

    /// Binds resources by their names in the shader in `group`.
    ///
    /// # Errors
    /// As [`Kernel::bind`](super::Kernel::bind).
    pub fn bind(
        &self,
        gpu: &Gpu,
        group: u32,
        resources: &[(&str, wgpu::BindingResource<'_>)],
    ) -> Result<wgpu::BindGroup, GpuError> {
        self.interface.bind(gpu, group, resources)
    }

    /// Makes this the pipeline of `pass`.
    pub fn set(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_pipeline(self.pipeline.get(&self.interface.name));
    }
}
