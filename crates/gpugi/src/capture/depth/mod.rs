//! Depth captures of many views into one atlas: by one render pass, which sets a viewport and a scissor rectangle and
//! draws per view; or by compute.

pub mod compute;
mod rasterizer;
#[cfg(test)]
mod tests;
mod transmittance;
mod view;

use bytemuck::{Pod, Zeroable};
use glam::{Mat4, UVec2, Vec4};

pub use rasterizer::{DepthDrawing, DepthRasterizer, Rasterizer};
pub use transmittance::TRANSMITTANCE_BYTES;
use transmittance::{Layer, LayerKernels};
pub use view::DepthViewSpec;

use super::{frustum_planes, visible_ranges};
use crate::gpu::{DepthTest, Frame, Gpu, GpuError, HostBuffer, Keeps, RasterKernel, RasterState};
use crate::scene::{Casters, Claims, DrawClass, GpuScene};
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

/// A depth texture that holds many views, and a layer with the light that passes see-through surfaces.
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
    layer: Layer,
    plan: Option<compute::Plan>,
}

/// The pipelines that draw depth.
#[derive(Debug)]
pub struct DepthKernels {
    second_depth: RasterKernel,
    whole: RasterKernel,
    alpha: RasterKernel,
    /// Objects with this claim cast whole shadows.
    whole_claim: Claims,
    /// Exists if the scene has see-through casters.
    layer: Option<LayerKernels>,
}

/// The pipeline with which [`DepthAtlas::record_some`] clears tiles.
///
/// # Errors
/// [`GpuError::Pass`].
pub fn clear_tiles(gpu: &Gpu) -> Result<RasterKernel, GpuError> {
    let state = RasterState {
        colors: &[],
        blend: None,
        constants: &[],
        cull: None,
        slope_bias: 0.0,
        has_vertices: false,
        has_fragment: false,
        depth: DepthTest::Overwrite,
    };
    RasterKernel::new(gpu, &shader!("capture.depth.clear"), None, &state)
}

impl DepthKernels {
    /// Compiles the pipelines for maps of lamps: back faces only, all faces, alpha, transmittance. The middle two move
    /// surfaces away by their change of depth over a texel. Objects with caustics cast whole shadows.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn of_lamps(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        Self::new(gpu, scene, Claims::SHADOW, 1.0)
    }

    /// Compiles the pipelines for parallel views of the environment, without bias. Its light passes all see-through
    /// surfaces straight.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn of_environment(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        Self::new(gpu, scene, Claims::NONE, 0.0)
    }

    fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        whole_claim: Claims,
        slope_bias: f32,
    ) -> Result<Self, GpuError> {
        let state = |cull, slope_bias| RasterState {
            colors: &[],
            blend: None,
            constants: &[],
            cull,
            slope_bias,
            has_vertices: true,
            has_fragment: false,
            depth: DepthTest::Nearest,
        };
        let depth = shader!("capture.depth");
        let alpha = RasterState {
            constants: &[("WHOLE_CLAIM", whole_claim.bits().into())],
            has_fragment: true,
            ..state(None, slope_bias)
        };
        let has_layer = scene.has_see_through(whole_claim);
        Ok(Self {
            second_depth: RasterKernel::new(
                gpu,
                &depth,
                None,
                &state(Some(wgpu::Face::Front), 0.0),
            )?,
            whole: RasterKernel::new(gpu, &depth, None, &state(None, slope_bias))?,
            alpha: RasterKernel::new(
                gpu,
                &shader!("capture.depth_alpha"),
                Some(&scene.layout),
                &alpha,
            )?,
            whole_claim,
            layer: has_layer
                .then(|| LayerKernels::new(gpu, scene, whole_claim))
                .transpose()?,
        })
    }

    /// Whether atlases have a layer of transmittance.
    pub fn has_transmittance(&self) -> bool {
        self.layer.is_some()
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
        let format = wgpu::TextureFormat::Depth32Float;
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC;
        let texture = gpu.texture_2d("depth atlas", [side, side, 1], format, usage)?;
        let layer = Layer::texture(gpu, kernels.layer.as_ref(), side)?;
        Self::in_textures(gpu, kernels, specs, texture, layer)
    }

    /// An atlas that draws into the textures of this one, which must have at least as much room; this one's contents are
    /// lost.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn sharing_textures(
        &self,
        gpu: &Gpu,
        kernels: &DepthKernels,
        specs: Vec<DepthViewSpec>,
    ) -> Result<Self, GpuError> {
        let [depth, layer] = [&self.texture, &self.layer.texture].map(wgpu::Texture::clone);
        Self::in_textures(gpu, kernels, specs, depth, layer)
    }

    fn in_textures(
        gpu: &Gpu,
        kernels: &DepthKernels,
        specs: Vec<DepthViewSpec>,
        texture: wgpu::Texture,
        layer: wgpu::Texture,
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
            layer: Layer::new(gpu, kernels.layer.as_ref(), layer, &views)?,
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

    /// The views.
    pub fn specs(&self) -> &[DepthViewSpec] {
        &self.specs
    }

    /// Whether `specs` needs the same tiles.
    pub fn has_tiles_of(&self, specs: &[DepthViewSpec]) -> bool {
        let mut pairs = self.specs.iter().zip(specs);
        self.specs.len() == specs.len() && pairs.all(|(old, new)| old.size == new.size)
    }

    /// Gives the same tiles new views. Returns false, and changes nothing, if `specs` needs different tiles.
    pub fn update(&mut self, gpu: &Gpu, specs: &[DepthViewSpec]) -> bool {
        let same = self.has_tiles_of(specs);
        if same {
            self.specs = specs.to_vec();
            self.views.write(gpu, &self.uniforms());
        }
        same
    }

    /// The layer of transmittance: see capture/transmittance.wesl. A single texel if the kernels draw none.
    pub fn transmittance(&self) -> &wgpu::TextureView {
        &self.layer.view
    }

    /// Memory of the textures (bytes).
    pub fn bytes(&self) -> u64 {
        let bytes = |texture: &wgpu::Texture| {
            let format = texture.format();
            format.theoretical_memory_footprint(texture.size())
        };
        bytes(&self.texture) + bytes(&self.layer.texture)
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

    /// First and last positions in a tile without a border: left, upper, right, lower (texels).
    pub fn texels_within(&self, index: usize, border: u32) -> [f32; 4] {
        let ([x, y], [width, height]) = (self.corners[index], self.specs[index].size);
        [
            x + border,
            y + border,
            x + width - border,
            y + height - border,
        ]
        .map(|texels| texels as f32)
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
            self.draw(pass, kernels, casters, &DepthDraw::ALL, |_| true);
        });
        self.record_layer(frame, name, kernels, casters, |_| true);
    }

    /// Draws those views whose indices `is_drawn` accepts; the others keep their depth.
    pub fn record_some(
        &self,
        frame: &mut Frame<'_>,
        name: &str,
        (clear, kernels): (&RasterKernel, &DepthKernels),
        casters: Casters<'_>,
        is_drawn: impl Fn(usize) -> bool,
    ) {
        frame.render_onto(name, Keeps::Everything, &[], &self.view, |pass| {
            clear.set(pass);
            for index in (0..self.specs.len()).filter(|&index| is_drawn(index)) {
                self.place(pass, index);
                pass.draw(0..3, 0..1);
            }
            self.draw(pass, kernels, casters, &DepthDraw::ALL, &is_drawn);
        });
        self.record_layer(frame, name, kernels, casters, is_drawn);
    }

    /// Restricts a pass to a view's tile.
    fn place(&self, pass: &mut wgpu::RenderPass<'_>, index: usize) {
        let ([x, y], [width, height]) = (self.corners[index], self.specs[index].size);
        let [left, top, wide, high] = [x, y, width, height].map(|texels| texels as f32);
        pass.set_viewport(left, top, wide, high, 0.0, 1.0);
        pass.set_scissor_rect(x, y, width, height);
    }

    /// Draws into the views that `is_drawn` accepts, but only what is drawn as one of `draws`.
    fn draw(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        kernels: &DepthKernels,
        casters: Casters<'_>,
        draws: &[DepthDraw],
        is_drawn: impl Fn(usize) -> bool,
    ) {
        let kind = |class, second_depth| match class {
            DrawClass::Closed if second_depth => DepthDraw::SecondDepth,
            DrawClass::Closed | DrawClass::Open | DrawClass::DoubleSided => DepthDraw::Whole,
            DrawClass::Alpha | DrawClass::AlphaDoubleSided => DepthDraw::Alpha,
        };
        let visible: Vec<_> = self
            .specs
            .iter()
            .enumerate()
            .map(|(index, spec)| {
                if !is_drawn(index) {
                    return Vec::new();
                }
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
            if !visible.iter().flatten().any(|(kind, _)| *kind == draw) {
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
                let mut placed = false;
                for (_, range) in ranges.iter().filter(|(kind, _)| *kind == draw) {
                    if !placed {
                        self.place(pass, index);
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
