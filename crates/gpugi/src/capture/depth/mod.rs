//! Depth captures of many views into one atlas: by one render pass, which sets a viewport and a scissor rectangle and
//! draws per view; or by compute.

pub mod compute;
mod rasterizer;
#[cfg(test)]
mod tests;
mod view;

use bytemuck::{Pod, Zeroable};
use glam::{Mat4, UVec2, Vec4};

pub use rasterizer::{DepthDrawing, DepthRasterizer, Rasterizer};
pub use view::DepthViewSpec;

use super::{frustum_planes, visible_ranges};
use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, RasterKernel, RasterState, Shader};
use crate::scene::{Casters, DrawClass, GpuScene};
use crate::shader;

/// Largest side of an atlas (texels): WebGPU's default limit.
pub const ATLAS_SIDE: u32 = 8192;

/// `DepthView` of capture/depth_view.wesl.
#[allow(missing_docs)] // Documented in the shader.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct DepthViewUniform {
    pub clip_from_world: [f32; 16],
    pub tile: [f32; 4],
    pub texel: f32,
    pub near: f32,
    pub range: f32,
    pub atlas_texel: f32,
}

/// A depth texture that holds many views.
#[derive(Debug)]
pub struct DepthAtlas {
    /// The texture: 32-bit float, nearer is greater.
    pub texture: wgpu::Texture,
    /// View of the texture.
    pub view: wgpu::TextureView,
    /// `array<DepthView>`, which lookups read.
    pub(crate) views: HostBuffer,
    specs: Vec<DepthViewSpec>,
    corners: Vec<[u32; 2]>,
    group: wgpu::BindGroup,
    alpha_group: wgpu::BindGroup,
    plan: Option<compute::Plan>,
}

/// The pipelines that draw depth.
#[derive(Debug)]
pub struct DepthKernels {
    second_depth: RasterKernel,
    whole: RasterKernel,
    alpha: RasterKernel,
}

impl DepthKernels {
    /// Compiles the three pipelines for maps of lamps: back faces only, all faces, alpha. The last two move surfaces
    /// away by their change of depth over a texel. Objects with caustics cast whole shadows.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn of_lamps(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        Self::new(gpu, scene, &shader!("capture.depth_alpha"), 1.0)
    }

    /// Compiles the pipelines for parallel views of the environment, without bias. Its light passes see-through
    /// surfaces straight.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn of_environment(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        Self::new(gpu, scene, &shader!("capture.depth_straight"), 0.0)
    }

    fn new(gpu: &Gpu, scene: &GpuScene, alpha: &Shader, slope_bias: f32) -> Result<Self, GpuError> {
        let state = |cull, slope_bias, has_fragment| RasterState {
            colors: &[],
            cull,
            slope_bias,
            has_vertices: true,
            has_fragment,
            has_depth: true,
        };
        let depth = shader!("capture.depth");
        Ok(Self {
            second_depth: RasterKernel::new(
                gpu,
                &depth,
                None,
                &state(Some(wgpu::Face::Front), 0.0, false),
            )?,
            whole: RasterKernel::new(gpu, &depth, None, &state(None, slope_bias, false))?,
            alpha: RasterKernel::new(
                gpu,
                alpha,
                Some(&scene.layout),
                &state(None, slope_bias, true),
            )?,
        })
    }
}

/// How a draw class is drawn into depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum DepthDraw {
    SecondDepth,
    Whole,
    Alpha,
}

impl DepthDraw {
    const ALL: [Self; 3] = [Self::SecondDepth, Self::Whole, Self::Alpha];
}

impl DepthAtlas {
    /// Whether one atlas has room for `specs`.
    pub fn has_room(specs: &[DepthViewSpec]) -> bool {
        let (_, size) = pack(specs);
        size.iter().all(|&side| side <= ATLAS_SIDE)
    }

    /// An atlas for `specs`, packed into rows.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the tiles do not fit [`ATLAS_SIDE`] squared.
    pub fn new(
        gpu: &Gpu,
        kernels: &DepthKernels,
        specs: Vec<DepthViewSpec>,
    ) -> Result<Self, GpuError> {
        let (_, [width, height]) = pack(&specs);
        if !Self::has_room(&specs) {
            return Err(GpuError::TooLarge {
                what: format!(
                    "a shadow atlas of {} views, texels a side (lower the resolution or the number of samples)",
                    specs.len()
                ),
                needed: height.max(width).into(),
                limit: ATLAS_SIDE.into(),
                adapter: gpu.adapter.name.clone(),
            });
        }
        // Square, so that a texel is equally wide along both axes of texture coordinates.
        let side = width.max(height).max(1);
        let texture = gpu.texture(&wgpu::TextureDescriptor {
            label: Some("depth atlas"),
            size: wgpu::Extent3d {
                width: side,
                height: side,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Depth32Float,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        })?;
        Self::in_texture(gpu, kernels, specs, texture)
    }

    /// An atlas that draws into the texture of another one, which must have at least as much room; the other's contents
    /// are lost.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn in_texture(
        gpu: &Gpu,
        kernels: &DepthKernels,
        specs: Vec<DepthViewSpec>,
        texture: wgpu::Texture,
    ) -> Result<Self, GpuError> {
        let (corners, _) = pack(&specs);
        let side = texture.width();
        let uniforms = uniforms(&specs, &corners, side);
        let size = std::mem::size_of_val(uniforms.as_slice()) as u64;
        let usage = wgpu::BufferUsages::STORAGE;
        let views = HostBuffer::new(gpu, "shadow views [bytes]", size, usage)?;
        views.write(gpu, &uniforms);
        let group = kernels
            .whole
            .bind(gpu, 1, &[("views", views.as_entire_binding())])?;
        let alpha_group = kernels
            .alpha
            .bind(gpu, 1, &[("views", views.as_entire_binding())])?;
        Ok(Self {
            view: texture.create_view(&Default::default()),
            texture,
            views,
            specs,
            corners,
            group,
            alpha_group,
            plan: None,
        })
    }

    /// Gives the same tiles new views. Returns false, and changes nothing, if `specs` needs different tiles.
    pub fn update(&mut self, gpu: &Gpu, specs: &[DepthViewSpec]) -> bool {
        let same = self.specs.len() == specs.len()
            && self
                .specs
                .iter()
                .zip(specs)
                .all(|(old, new)| old.size == new.size);
        if same {
            self.specs = specs.to_vec();
            self.views.write(gpu, &self.uniforms());
        }
        same
    }

    /// What `views` holds.
    pub(crate) fn uniforms(&self) -> Vec<DepthViewUniform> {
        uniforms(&self.specs, &self.corners, self.texture.width())
    }

    /// The atlas's texels and depth from world space, of an orthographic view.
    pub fn texels_from_world(&self, index: usize) -> Mat4 {
        let spec = &self.specs[index];
        let [corner, size] =
            [self.corners[index], spec.size].map(|texels| UVec2::from(texels).as_vec2());
        let texels_from_clip = Mat4::from_cols(
            Vec4::new(0.5 * size.x, 0.0, 0.0, 0.0),
            Vec4::new(0.0, -0.5 * size.y, 0.0, 0.0),
            Vec4::Z,
            (corner + 0.5 * size).extend(0.0).extend(1.0),
        );
        texels_from_clip * spec.clip_from_world
    }

    /// Draws every view.
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        name: &str,
        kernels: &DepthKernels,
        casters: Casters<'_>,
    ) {
        frame.render(name, &[], &self.view, |pass| {
            self.draw(pass, kernels, casters, &DepthDraw::ALL);
        });
    }

    /// Draws into every view, but only what is drawn as one of `draws`.
    fn draw(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        kernels: &DepthKernels,
        casters: Casters<'_>,
        draws: &[DepthDraw],
    ) {
        let kind = |class, second_depth| match class {
            DrawClass::Closed if second_depth => DepthDraw::SecondDepth,
            DrawClass::Closed | DrawClass::Open | DrawClass::DoubleSided => DepthDraw::Whole,
            DrawClass::Alpha | DrawClass::AlphaDoubleSided => DepthDraw::Alpha,
        };
        let visible: Vec<_> = self
            .specs
            .iter()
            .map(|spec| {
                let planes = frustum_planes(&spec.clip_from_world);
                visible_ranges(casters.draws, &planes, |draw| {
                    kind(draw.class, spec.second_depth)
                })
            })
            .collect();
        pass.set_vertex_buffer(0, casters.scene.vertices.slice(..));
        pass.set_index_buffer(casters.indices.slice(..), wgpu::IndexFormat::Uint32);
        // Pipeline by pipeline, so that the pipeline changes three times in all and not three times per view.
        for &draw in draws {
            if !visible.iter().flatten().any(|(one, _)| *one == draw) {
                continue;
            }
            let (kernel, group) = match draw {
                DepthDraw::SecondDepth => (&kernels.second_depth, &self.group),
                DepthDraw::Whole => (&kernels.whole, &self.group),
                DepthDraw::Alpha => (&kernels.alpha, &self.alpha_group),
            };
            kernel.set(pass);
            if draw == DepthDraw::Alpha {
                pass.set_bind_group(0, &casters.scene.bind_group, &[]);
            }
            pass.set_bind_group(1, group, &[]);
            for (index, ranges) in visible.iter().enumerate() {
                let [x, y] = self.corners[index];
                let [width, height] = self.specs[index].size;
                let mut placed = false;
                for (_, range) in ranges.iter().filter(|(one, _)| *one == draw) {
                    if !placed {
                        pass.set_viewport(
                            x as f32,
                            y as f32,
                            width as f32,
                            height as f32,
                            0.0,
                            1.0,
                        );
                        pass.set_scissor_rect(x, y, width, height);
                        placed = true;
                    }
                    let view = index as u32;
                    pass.draw_indexed(range.clone(), 0, view..view + 1);
                }
            }
        }
    }
}

/// Uniforms of the views in a square atlas of `side` texels.
fn uniforms(specs: &[DepthViewSpec], corners: &[[u32; 2]], side: u32) -> Vec<DepthViewUniform> {
    let scale = 1.0 / side as f32;
    specs
        .iter()
        .zip(corners)
        .map(|(spec, corner)| DepthViewUniform {
            clip_from_world: spec.clip_from_world.to_cols_array(),
            tile: [corner[0], corner[1], spec.size[0], spec.size[1]]
                .map(|texels| texels as f32 * scale),
            texel: spec.texel,
            near: spec.near,
            range: spec.range,
            atlas_texel: scale,
        })
        .collect()
}

/// Packs rectangles into rows of equal height, tallest first; returns their corners and the size used.
fn pack(specs: &[DepthViewSpec]) -> (Vec<[u32; 2]>, [u32; 2]) {
    let sizes: Vec<[u32; 2]> = specs.iter().map(|spec| spec.size).collect();
    let area: u64 = sizes
        .iter()
        .map(|size| u64::from(size[0]) * u64::from(size[1]))
        .sum();
    let widest = sizes.iter().map(|size| size[0]).max().unwrap_or(1);
    // A multiple of the widest tile, so that equal tiles leave no gap at the right.
    let width = ((area as f64).sqrt().ceil() as u32)
        .next_multiple_of(widest.max(1))
        .min(ATLAS_SIDE);
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|&index| std::cmp::Reverse(sizes[index][1]));
    let mut corners = vec![[0, 0]; sizes.len()];
    let (mut x, mut y, mut row) = (0, 0, 0);
    for index in order {
        let [w, h] = sizes[index];
        if x + w > width {
            (x, y, row) = (0, y + row, 0);
        }
        corners[index] = [x, y];
        x += w;
        row = row.max(h);
    }
    (corners, [width, y + row])
}
