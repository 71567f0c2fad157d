//! A layer beside the depths of an atlas: which light passes the see-through casters in front of them. It exists if
//! there are such casters. See capture/transmittance.wesl.

use super::DepthAtlas;
use crate::capture::{frustum_planes, visible_ranges};
use crate::gpu::{DepthTest, Frame, Gpu, GpuError, RasterKernel, RasterState};
use crate::scene::{Casters, Claims, GpuScene};
use crate::shader;

/// Optical depths in rgb, the place of the nearest surface in alpha.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// Bytes of a texel.
pub const TRANSMITTANCE_BYTES: u32 = 8;

/// The pipelines that draw the layer.
#[derive(Debug)]
pub(super) struct LayerKernels {
    draw: RasterKernel,
    clear: RasterKernel,
}

impl LayerKernels {
    /// Compiles them. Objects with the claim `whole` cast whole shadows.
    pub fn new(gpu: &Gpu, scene: &GpuScene, whole: Claims) -> Result<Self, GpuError> {
        let add = |operation| wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::One,
            dst_factor: wgpu::BlendFactor::One,
            operation,
        };
        let state = RasterState {
            colors: &[FORMAT],
            blend: Some(wgpu::BlendState {
                color: add(wgpu::BlendOperation::Add),
                alpha: add(wgpu::BlendOperation::Max),
            }),
            constants: &[("WHOLE_CLAIM", whole.bits().into())],
            cull: None,
            slope_bias: 0.0,
            has_vertices: true,
            has_fragment: true,
            depth: DepthTest::InFront,
        };
        let clear = RasterState {
            blend: None,
            constants: &[],
            has_vertices: false,
            depth: DepthTest::Off,
            ..state
        };
        Ok(Self {
            draw: RasterKernel::new(
                gpu,
                &shader!("capture.depth.transmittance"),
                Some(&scene.layout),
                &state,
            )?,
            clear: RasterKernel::new(gpu, &shader!("capture.depth.clear"), None, &clear)?,
        })
    }
}

/// The layer; a single texel, which is not read, without see-through casters.
#[derive(Debug)]
pub(super) struct Layer {
    pub texture: wgpu::Texture,
    pub view: wgpu::TextureView,
    /// The atlas's views, for the pass that draws it.
    group: Option<wgpu::BindGroup>,
}

impl Layer {
    /// A texture for the layer of an atlas of `side` texels.
    pub fn texture(
        gpu: &Gpu,
        kernels: Option<&LayerKernels>,
        side: u32,
    ) -> Result<wgpu::Texture, GpuError> {
        let side = if kernels.is_some() { side } else { 1 };
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
        gpu.texture_2d("transmittance", [side, side, 1], FORMAT, usage)
    }

    pub fn new(
        gpu: &Gpu,
        kernels: Option<&LayerKernels>,
        texture: wgpu::Texture,
        views: &wgpu::Buffer,
    ) -> Result<Self, GpuError> {
        let bind = |kernels: &LayerKernels| {
            let views = [("views", views.as_entire_binding())];
            kernels.draw.bind(gpu, 1, &views)
        };
        Ok(Self {
            view: texture.create_view(&Default::default()),
            texture,
            group: kernels.map(bind).transpose()?,
        })
    }
}

impl DepthAtlas {
    /// Draws the layer of the views that `is_drawn` accepts, in front of the depths drawn before. The other views keep
    /// theirs.
    pub(super) fn record_layer(
        &self,
        frame: &mut Frame<'_>,
        name: &str,
        kernels: &super::DepthKernels,
        casters: Casters<'_>,
        is_drawn: impl Fn(usize) -> bool,
    ) {
        let (Some(layer), Some(group)) = (&kernels.layer, &self.layer.group) else {
            return;
        };
        let drawn = || (0..self.specs.len()).filter(|&index| is_drawn(index));
        let keeps = drawn().count() < self.specs.len();
        let name = format!("{name}.transmittance");
        frame.render_in_front(&name, keeps, &self.layer.view, &self.view, |pass| {
            if keeps {
                layer.clear.set(pass);
                for index in drawn() {
                    self.place(pass, index);
                    pass.draw(0..3, 0..1);
                }
            }
            layer.draw.set(pass);
            pass.set_vertex_buffer(0, casters.scene.vertices.slice(..));
            pass.set_index_buffer(casters.indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.set_bind_group(0, &casters.scene.bind_group, &[]);
            pass.set_bind_group(1, group, &[]);
            for index in drawn() {
                let planes = frustum_planes(&self.specs[index].clip_from_world);
                let passes = |draw: &_| casters.scene.is_see_through(draw, kernels.whole_claim);
                self.place(pass, index);
                for (is_see_through, range) in visible_ranges(casters.draws, &planes, passes) {
                    if is_see_through {
                        let view = index as u32;
                        pass.draw_indexed(range, 0, view..view + 1);
                    }
                }
            }
        });
    }
}
