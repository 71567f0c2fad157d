//! Captures: rasterized "photos" of the scene. A view's triangles become hit records, hit records become surface points; light
//! views become depth.

pub mod depth;
pub mod distance_pyramid;
mod view;
mod visible;

#[cfg(test)]
mod tests;

pub(crate) use view::ViewUniform;
pub use view::{View, orthographic_reverse, perspective_reverse_infinite};
pub use visible::VisiblePoint;

use glam::{Mat4, Vec4};
use gpugi_scene::Bounds;

use crate::gpu::{Frame, Gpu, GpuError, Kernel, RasterKernel, RasterState};
use crate::scene::{Draw, DrawClass, GpuScene};
use crate::shader;

/// Bytes of a packed surface point (capture/surface_point.wesl).
pub const SURFACE_POINT_BYTES: u64 = 48;

/// Surface points in a buffer, with the view that saw them.
#[derive(Debug, Clone)]
pub struct SurfacePoints {
    /// Packed points, row by row.
    pub points: wgpu::Buffer,
    /// `View` uniform.
    pub view: wgpu::Buffer,
    /// Number of points.
    pub count: u32,
}

/// Where gathers add radiance: one vec4f a point, summed over samples.
#[derive(Debug, Clone)]
pub struct Target {
    /// Linear Rec. 709 radiance [W/sr/m^2] in rgb; a counts the samples that hit a surface.
    pub radiance: wgpu::Buffer,
}

/// Captures the surface points that a camera sees.
#[derive(Debug)]
pub struct CameraCapture {
    /// The latest points.
    pub points: SurfacePoints,
    /// Hit records: the provoking merged vertex of each pixel's triangle; all ones where there is none.
    pub hits: wgpu::Texture,
    size: [u32; 2],
    hits_view: wgpu::TextureView,
    depth: wgpu::TextureView,
    opaque: [RasterKernel; 2],
    alpha: [RasterKernel; 2],
    matrix: wgpu::Buffer,
    opaque_group: wgpu::BindGroup,
    alpha_group: wgpu::BindGroup,
    resolve: Kernel,
    resolve_groups: [wgpu::BindGroup; 2],
}

impl CameraCapture {
    /// Room for `size` points.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the adapter cannot hold them.
    pub fn new(gpu: &Gpu, scene: &GpuScene, size: [u32; 2]) -> Result<Self, GpuError> {
        let texture = |label, format, usage| {
            gpu.texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d {
                    width: size[0],
                    height: size[1],
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: usage | wgpu::TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            })
        };
        let hits = texture(
            "hit records",
            wgpu::TextureFormat::R32Uint,
            wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC,
        )?;
        let depth = texture(
            "depth",
            wgpu::TextureFormat::Depth32Float,
            wgpu::TextureUsages::empty(),
        )?;
        let count = size[0] * size[1];
        let points = SurfacePoints {
            points: gpu.buffer(
                "surface points [bytes]",
                u64::from(count) * SURFACE_POINT_BYTES,
                wgpu::BufferUsages::STORAGE,
            )?,
            view: gpu.buffer(
                "view",
                std::mem::size_of::<ViewUniform>() as u64,
                wgpu::BufferUsages::UNIFORM,
            )?,
            count,
        };
        let raster = |shader, cull| {
            RasterKernel::new(
                gpu,
                &shader,
                Some(&scene.layout),
                &RasterState {
                    colors: &[wgpu::TextureFormat::R32Uint],
                    cull,
                    slope_bias: 0.0,
                    has_vertices: true,
                    has_fragment: true,
                },
            )
        };
        let back = Some(wgpu::Face::Back);
        let opaque = [
            raster(shader!("capture.hits"), back)?,
            raster(shader!("capture.hits"), None)?,
        ];
        let alpha = [
            raster(shader!("capture.hits_alpha"), back)?,
            raster(shader!("capture.hits_alpha"), None)?,
        ];
        let matrix = gpu.buffer("clip_from_world", 80, wgpu::BufferUsages::UNIFORM)?;
        let opaque_group =
            opaque[0].bind(gpu, 1, &[("clip_from_world", matrix.as_entire_binding())])?;
        let alpha_group = alpha[0].bind(gpu, 1, &[("alpha_view", matrix.as_entire_binding())])?;
        let hits_view = hits.create_view(&Default::default());
        let resolve = Kernel::new(
            gpu,
            &shader!("capture.resolve"),
            "main",
            Some(&scene.layout),
        )?;
        let resolve_groups = [
            resolve.bind(
                gpu,
                1,
                &[
                    ("seen", points.view.as_entire_binding()),
                    ("points", points.points.as_entire_binding()),
                ],
            )?,
            resolve.bind(
                gpu,
                3,
                &[
                    ("hits", wgpu::BindingResource::TextureView(&hits_view)),
                    ("merged", scene.vertices.as_entire_binding()),
                ],
            )?,
        ];
        Ok(Self {
            points,
            hits,
            size,
            hits_view,
            depth: depth.create_view(&Default::default()),
            opaque,
            alpha,
            matrix,
            opaque_group,
            alpha_group,
            resolve,
            resolve_groups,
        })
    }

    /// Captures `view`: passes `capture.hits` and `capture.resolve`.
    pub fn record(&self, frame: &mut Frame<'_>, scene: &GpuScene, view: &View) {
        let queue = &frame.gpu.queue;
        queue.write_buffer(&self.points.view, 0, bytemuck::bytes_of(&view.uniform));
        let mut matrix = [0.0_f32; 20];
        matrix[..16].copy_from_slice(&view.clip_from_world.to_cols_array());
        let seed = view
            .uniform
            .seed
            .wrapping_add(view.uniform.sample_index.wrapping_mul(0x9e37_79b9));
        matrix[16] = f32::from_bits(seed);
        queue.write_buffer(&self.matrix, 0, bytemuck::cast_slice(&matrix));
        frame.render("capture.hits", &[&self.hits_view], &self.depth, |pass| {
            pass.set_bind_group(0, &scene.bind_group, &[]);
            pass.set_vertex_buffer(0, scene.vertices.slice(..));
            pass.set_index_buffer(scene.indices.slice(..), wgpu::IndexFormat::Uint32);
            let planes = frustum_planes(&view.clip_from_world);
            let mut current = None;
            for (class, range) in visible_ranges(&scene.draws, &planes, |draw| draw.seen) {
                let (kernel, group) = match class {
                    DrawClass::Closed | DrawClass::Open => (&self.opaque[0], &self.opaque_group),
                    DrawClass::DoubleSided => (&self.opaque[1], &self.opaque_group),
                    DrawClass::Alpha => (&self.alpha[0], &self.alpha_group),
                    DrawClass::AlphaDoubleSided => (&self.alpha[1], &self.alpha_group),
                };
                if current != Some(class) {
                    kernel.set(pass);
                    pass.set_bind_group(1, group, &[]);
                    current = Some(class);
                }
                pass.draw_indexed(range, 0, 0..1);
            }
        });
        frame.compute("capture.resolve", |pass| {
            self.resolve.dispatch(
                pass,
                &[
                    (0, &scene.bind_group),
                    (1, &self.resolve_groups[0]),
                    (3, &self.resolve_groups[1]),
                ],
                [self.size[0], self.size[1], 1],
            );
        });
    }
}

/// The planes of a clip space with depth in [0, 1] whose positive side is inside, world space.
pub(crate) fn frustum_planes(clip_from_world: &Mat4) -> [Vec4; 6] {
    let [x, y, z, w] = [0, 1, 2, 3].map(|row| clip_from_world.row(row));
    [w + x, w - x, w + y, w - y, z, w - z]
}

fn is_visible(bounds: &Bounds, planes: &[Vec4; 6]) -> bool {
    planes.iter().all(|plane| {
        // The corner furthest along the plane's normal.
        let corner = glam::Vec3::select(
            plane.truncate().cmpge(glam::Vec3::ZERO),
            bounds.max,
            bounds.min,
        );
        plane.dot(corner.extend(1.0)) >= 0.0
    })
}

/// Index ranges of the draws that a frustum may see, neighbours of one kind joined.
fn visible_ranges<K: PartialEq + Copy>(
    draws: &[Draw],
    planes: &[Vec4; 6],
    kind: impl Fn(&Draw) -> K,
) -> Vec<(K, std::ops::Range<u32>)> {
    let mut ranges: Vec<(K, std::ops::Range<u32>)> = Vec::new();
    for draw in draws.iter().filter(|draw| is_visible(&draw.bounds, planes)) {
        let kind = kind(draw);
        match ranges.last_mut() {
            Some((last, range)) if *last == kind && range.end == draw.indices.start => {
                range.end = draw.indices.end;
            }
            _ => ranges.push((kind, draw.indices.clone())),
        }
    }
    ranges
}
