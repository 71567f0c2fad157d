//! Depth captures of many views into one atlas: one render pass, and a viewport, a scissor and a draw a view.

use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec2, Vec3, Vec4};

use super::{frustum_planes, orthographic_reverse, perspective_reverse_infinite, visible_ranges};
use crate::gpu::{Frame, Gpu, GpuError, RasterKernel, RasterState};
use crate::scene::{DrawClass, GpuScene};
use crate::shader;

/// Largest side of an atlas (texels): WebGPU's default limit.
pub const ATLAS_SIDE: u32 = 8192;

/// What one tile of a depth atlas sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthViewSpec {
    /// Clip space (reverse depth) from world space.
    pub clip_from_world: Mat4,
    /// Tile size (texels).
    pub size: [u32; 2],
    /// Width of a texel: perspective, at distance 1; orthographic, everywhere (m).
    pub texel: f32,
    /// Perspective: near plane (m); orthographic: 0.
    pub near: f32,
    /// Orthographic: depth range (m).
    pub range: f32,
    /// Whether closed meshes may be drawn by their back faces. Not where texels are coarse: a filter that reaches under a mesh
    /// that stands on a floor would see that floor lit.
    pub second_depth: bool,
}

/// `DepthView` of capture/depth_view.wesl.
#[allow(missing_docs)] // The shader documents them.
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

/// A rigid frame to look along: `forward` and `up` are perpendicular unit vectors.
fn view_from_world(eye: Vec3, forward: Vec3, up: Vec3) -> Mat4 {
    let right = forward.cross(up);
    Mat4::from_cols(
        right.extend(0.0),
        up.extend(0.0),
        (-forward).extend(0.0),
        eye.extend(1.0),
    )
    .inverse()
}

impl DepthViewSpec {
    /// A square perspective view of `side` texels; its outermost `gutter` texels lie outside the field of view whose half-angle has
    /// the tangent `half_tangent`, so that filters may reach over the border.
    pub fn perspective(
        eye: Vec3,
        forward: Vec3,
        up: Vec3,
        half_tangent: f32,
        near: f32,
        side: u32,
        gutter: u32,
    ) -> Self {
        let inner = (side - 2 * gutter) as f32;
        let widened = half_tangent * side as f32 / inner;
        Self {
            clip_from_world: perspective_reverse_infinite(Vec2::splat(widened), near)
                * view_from_world(eye, forward, up),
            size: [side, side],
            texel: 2.0 * half_tangent / inner,
            near,
            range: 0.0,
            second_depth: false,
        }
    }

    /// The upper half of a 90 degree view: a side of a hemicube, whose `up` is the hemisphere's axis. `gutter` as above; below the
    /// horizon there are `gutter` rows, too.
    pub fn hemicube_side(
        eye: Vec3,
        forward: Vec3,
        up: Vec3,
        near: f32,
        side: u32,
        gutter: u32,
    ) -> Self {
        let full = Self::perspective(eye, forward, up, 1.0, near, side, gutter);
        let height = side / 2 + gutter;
        // Keep the rows from the top: y' in [-1, 1] for y in [1 - 2 height / side, 1].
        let kept = height as f32 / side as f32;
        let lift = Mat4::from_cols(
            Vec4::X,
            Vec4::new(0.0, 1.0 / kept, 0.0, 0.0),
            Vec4::Z,
            Vec4::new(0.0, 1.0 - 1.0 / kept, 0.0, 1.0),
        );
        Self {
            clip_from_world: lift * full.clip_from_world,
            size: [side, height],
            ..full
        }
    }

    /// A square parallel view of `side` texels: `half_extent` (m) around `center`, depth from `near` to `far` (m) along `forward`
    /// relative to `center`.
    pub fn orthographic(
        center: Vec3,
        forward: Vec3,
        up: Vec3,
        half_extent: f32,
        near: f32,
        far: f32,
        side: u32,
    ) -> Self {
        Self {
            clip_from_world: orthographic_reverse(Vec2::splat(half_extent), 0.0, far - near)
                * view_from_world(center + forward * near, forward, up),
            size: [side, side],
            texel: 2.0 * half_extent / side as f32,
            near: 0.0,
            range: far - near,
            second_depth: false,
        }
    }

    /// The six faces of a cube around `eye`: +X, -X, +Y, -Y, +Z, -Z.
    pub fn cube(eye: Vec3, near: f32, side: u32, gutter: u32) -> [Self; 6] {
        [
            (Vec3::X, Vec3::Y),
            (Vec3::NEG_X, Vec3::Y),
            (Vec3::Y, Vec3::Z),
            (Vec3::NEG_Y, Vec3::Z),
            (Vec3::Z, Vec3::Y),
            (Vec3::NEG_Z, Vec3::Y),
        ]
        .map(|(forward, up)| Self::perspective(eye, forward, up, 1.0, near, side, gutter))
    }

    /// The five faces of a hemicube above a plane: its top, then the sides toward +tangent, -tangent, +bitangent, -bitangent with
    /// bitangent = normal x tangent.
    pub fn hemicube(
        eye: Vec3,
        normal: Vec3,
        tangent: Vec3,
        near: f32,
        side: u32,
        gutter: u32,
    ) -> [Self; 5] {
        let bitangent = normal.cross(tangent);
        let wall = |forward| Self::hemicube_side(eye, forward, normal, near, side, gutter);
        [
            Self::perspective(eye, normal, tangent, 1.0, near, side, gutter),
            wall(tangent),
            wall(-tangent),
            wall(bitangent),
            wall(-bitangent),
        ]
    }

    /// The hemicubes of a light that shines to both sides: above, then below, whose sides come in the same order.
    pub fn hemicubes(
        eye: Vec3,
        normal: Vec3,
        tangent: Vec3,
        near: f32,
        side: u32,
        gutter: u32,
    ) -> [Self; 10] {
        let above = Self::hemicube(eye, normal, tangent, near, side, gutter);
        // Below, the bitangent -normal x tangent is turned: the face numbers of the shader expect it unturned.
        let mut below = Self::hemicube(eye, -normal, tangent, near, side, gutter);
        below.swap(3, 4);
        std::array::from_fn(|face| {
            if face < 5 {
                above[face]
            } else {
                below[face - 5]
            }
        })
    }
}

/// A depth texture that holds many views.
#[derive(Debug)]
pub struct DepthAtlas {
    /// The texture, 32-bit float, nearer is greater.
    pub texture: wgpu::Texture,
    /// Its view.
    pub view: wgpu::TextureView,
    /// `array<DepthView>` for lookups.
    pub views: wgpu::Buffer,
    specs: Vec<DepthViewSpec>,
    corners: Vec<[u32; 2]>,
    group: wgpu::BindGroup,
    alpha_group: wgpu::BindGroup,
}

/// Draws depth.
#[derive(Debug)]
pub struct DepthKernels {
    second_depth: RasterKernel,
    biased: RasterKernel,
    alpha: RasterKernel,
}

impl DepthKernels {
    /// Compiles the three pipelines: back faces only, all faces with a slope-scaled bias, alpha.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let state = |cull, slope_bias, has_fragment| RasterState {
            colors: &[],
            cull,
            slope_bias,
            has_fragment,
        };
        let depth = shader!("capture.depth");
        Ok(Self {
            second_depth: RasterKernel::new(
                gpu,
                &depth,
                None,
                &state(Some(wgpu::Face::Front), 0.0, false),
            )?,
            biased: RasterKernel::new(gpu, &depth, None, &state(None, 1.0, false))?,
            alpha: RasterKernel::new(
                gpu,
                &shader!("capture.depth_alpha"),
                Some(&scene.layout),
                &state(None, 1.0, true),
            )?,
        })
    }
}

/// How a draw class is drawn into depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum DepthDraw {
    SecondDepth,
    Biased,
    Alpha,
}

impl DepthAtlas {
    /// An atlas for `specs`, packed into rows.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when they do not fit [`ATLAS_SIDE`] squared.
    pub fn new(
        gpu: &Gpu,
        kernels: &DepthKernels,
        specs: Vec<DepthViewSpec>,
    ) -> Result<Self, GpuError> {
        let (_, [width, height]) = pack(&specs);
        if height > ATLAS_SIDE || width > ATLAS_SIDE {
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
        // Square, so that a texel has the same width along both axes of texture coordinates.
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

    /// An atlas that draws into the texture of another one, which has at least as much room; what that one drew is lost.
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
        let views = gpu.storage("shadow views [bytes]", &uniforms)?;
        let group = kernels
            .biased
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
        })
    }

    /// Lets the same tiles see something else. False, and nothing done, when `specs` needs other tiles.
    pub fn update(&mut self, gpu: &Gpu, specs: &[DepthViewSpec]) -> bool {
        let same = self.specs.len() == specs.len()
            && self
                .specs
                .iter()
                .zip(specs)
                .all(|(old, new)| old.size == new.size);
        if same {
            self.specs = specs.to_vec();
            let uniforms = uniforms(&self.specs, &self.corners, self.texture.width());
            gpu.queue
                .write_buffer(&self.views, 0, bytemuck::cast_slice(&uniforms));
        }
        same
    }

    /// The atlas's texture coordinates and depth from world space, of an orthographic view.
    pub fn atlas_from_world(&self, index: usize) -> Mat4 {
        let spec = &self.specs[index];
        let scale = 1.0 / self.texture.width() as f32;
        let corner = Vec2::from(self.corners[index].map(|texels| texels as f32 * scale));
        let size = Vec2::from(spec.size.map(|texels| texels as f32 * scale));
        let atlas_from_clip = Mat4::from_cols(
            Vec4::new(0.5 * size.x, 0.0, 0.0, 0.0),
            Vec4::new(0.0, -0.5 * size.y, 0.0, 0.0),
            Vec4::Z,
            (corner + 0.5 * size).extend(0.0).extend(1.0),
        );
        atlas_from_clip * spec.clip_from_world
    }

    /// Draws every view.
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        name: &str,
        kernels: &DepthKernels,
        scene: &GpuScene,
    ) {
        frame.render(name, &[], &self.view, |pass| {
            pass.set_vertex_buffer(0, scene.vertices.slice(..));
            pass.set_index_buffer(scene.indices.slice(..), wgpu::IndexFormat::Uint32);
            let kind = |class, second_depth| match class {
                DrawClass::Closed if second_depth => DepthDraw::SecondDepth,
                DrawClass::Closed | DrawClass::Open | DrawClass::DoubleSided => DepthDraw::Biased,
                DrawClass::Alpha | DrawClass::AlphaDoubleSided => DepthDraw::Alpha,
            };
            let visible: Vec<_> = self
                .specs
                .iter()
                .map(|spec| {
                    let planes = frustum_planes(&spec.clip_from_world);
                    visible_ranges(&scene.draws, &planes, |draw| {
                        kind(draw.class, spec.second_depth)
                    })
                })
                .collect();
            // One pipeline after the other, so that it changes three times and not three times a view.
            for (draw, kernel, group) in [
                (DepthDraw::SecondDepth, &kernels.second_depth, &self.group),
                (DepthDraw::Biased, &kernels.biased, &self.group),
                (DepthDraw::Alpha, &kernels.alpha, &self.alpha_group),
            ] {
                if !visible.iter().flatten().any(|(one, _)| *one == draw) {
                    continue;
                }
                kernel.set(pass);
                if draw == DepthDraw::Alpha {
                    pass.set_bind_group(0, &scene.bind_group, &[]);
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
        });
    }
}

/// What shaders read of each view in a square atlas of `side` texels.
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
    // Whole columns of the widest, so that equal tiles leave no gap at the right.
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
