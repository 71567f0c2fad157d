//! Captures: rasterized "photos" of the scene. A view rasterizes a visibility buffer of hit records, which are resolved
//! to surface points; light views rasterize depth. Texels of an atlas become surface points without any view.

pub mod atlas;
mod attenuation;
pub mod depth;
pub mod distance_pyramid;
mod emission;
mod gather;
mod hits;
mod images;
mod peeled_layer;
mod per_receiver;
mod receiver;
mod view;
mod visible;

#[cfg(test)]
mod tests;

pub(crate) use attenuation::Attenuation;
pub use emission::Emission;
pub use gather::Gather;
pub(crate) use hits::hits_of_points;
use hits::{HitKernels, Image, Matrices, depth_texture, hit_texture};
pub use images::HitImages;
pub use peeled_layer::PeeledLayer;
pub use per_receiver::PerReceiver;
pub use receiver::{Output, Probe, Receiver, Slots};
pub(crate) use view::ViewUniform;
pub use view::{CubeView, Lattice, View, orthographic_reverse, perspective_reverse_infinite};
pub use visible::VisiblePoint;

use std::ops::Range;

use glam::{Mat4, Vec4};
use gpugi_scene::Bounds;

use crate::gpu::{Bind, Bound, Frame, Gpu, GpuError, HostBuffer, Kernel, Named};
use crate::scene::{Draw, DrawClass, GpuScene};
use crate::shader;

/// Bytes of a packed surface point (capture/surface_point.wesl).
pub const SURFACE_POINT_BYTES: u64 = 48;

/// Surface points in a buffer, and the view that saw them.
#[derive(Debug, Clone)]
pub struct SurfacePoints {
    /// Packed points, row by row.
    pub points: wgpu::Buffer,
    /// `View` uniform, which says where in the buffer the points are.
    pub view: wgpu::Buffer,
    /// Index of the first of the points in the buffer.
    pub first: u32,
    /// Number of points.
    pub count: u32,
    /// Number of those that gathers light: all, but for pixels beside a [`Lattice`].
    pub lit: u32,
    /// Hit records from which the points were resolved: the provoking merged vertex of each point's triangle.
    pub hits: wgpu::TextureView,
    /// What gathers give at them.
    pub output: Output,
    /// Where their results lie in targets.
    pub slots: Slots,
}

impl SurfacePoints {
    /// Room for `width` x `rows` points that passes write, with their hit records.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub(crate) fn room(
        gpu: &Gpu,
        label: &str,
        [width, rows]: [u32; 2],
        view: wgpu::Buffer,
        output: Output,
    ) -> Result<Self, GpuError> {
        let count = width * rows;
        let bytes = u64::from(count) * SURFACE_POINT_BYTES;
        Ok(Self {
            points: gpu.buffer(label, bytes, wgpu::BufferUsages::STORAGE)?,
            view,
            first: 0,
            count,
            lit: count,
            hits: hits_of_points(gpu, [width, rows])?,
            output,
            slots: Slots::default(),
        })
    }

    /// Bind group 1 of a pass that reads the points.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn bind(&self, gpu: &Gpu, kernel: &Kernel) -> Result<wgpu::BindGroup, GpuError> {
        let resources = [
            ("seen", self.view.as_entire_binding()),
            ("points", self.points.as_entire_binding()),
        ];
        kernel.bind(gpu, 1, &resources)
    }

    /// What passes that read the points bind: `seen`, `points` and `hits`.
    pub fn resources(&self) -> [Named<'_>; 3] {
        [
            ("seen", &self.view),
            ("points", &self.points),
            ("hits", &self.hits),
        ]
    }

    /// Whether `other` are the same points in the same buffers, so that what was bound for one serves the other.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        self.points == other.points && self.view == other.view
    }
}

/// Size of `Noise` of capture/noise.wesl (bytes).
const NOISE_BYTES: u64 = 32;

/// Where gathers add radiance: one vec4f per point, summed over samples.
#[derive(Debug, Clone)]
pub struct Target {
    /// Linear Rec. 709 radiance [W/sr/m^2] in rgb; a counts the samples that hit a surface.
    pub radiance: wgpu::Buffer,
    /// How far along the mirrored ray lies what ideal mirrors show (m), written by techniques that know it: one f32 per
    /// pixel of a picture, 0 where none does. Other targets have a single one.
    pub mirrored: wgpu::Buffer,
    /// What part of `radiance` is noisy, because it is drawn for each point by chance: live pictures filter it. One `Noise`
    /// of capture/noise.wesl per pixel of a live picture with such techniques; other targets have a single one.
    pub noisy: wgpu::Buffer,
}

impl Target {
    /// Allocates a target for `count` points.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the adapter cannot hold them.
    pub fn new(gpu: &Gpu, count: u32) -> Result<Self, GpuError> {
        let size = u64::from(count) * 16;
        let radiance = gpu.buffer("radiance [bytes]", size, wgpu::BufferUsages::STORAGE)?;
        Self::of(gpu, radiance)
    }

    /// A target of this radiance.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn of(gpu: &Gpu, radiance: wgpu::Buffer) -> Result<Self, GpuError> {
        Ok(Self {
            radiance,
            mirrored: mirrored(gpu, 1)?,
            noisy: gpu.buffer("no noise", NOISE_BYTES, wgpu::BufferUsages::STORAGE)?,
        })
    }

    /// Whether techniques tell which part of their light is noisy.
    pub(crate) fn is_noisy(&self) -> bool {
        self.noisy.size() > NOISE_BYTES
    }

    /// A target for `count` pixels of a picture.
    ///
    /// # Errors
    /// As [`Target::new`].
    pub fn of_pixels(gpu: &Gpu, count: u32) -> Result<Self, GpuError> {
        Ok(Self {
            mirrored: mirrored(gpu, count)?,
            ..Self::new(gpu, count)?
        })
    }
}

/// [`Target::noisy`] of so many points, which more than one tells from the place holder of other targets.
///
/// # Errors
/// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
pub(crate) fn noisy(gpu: &Gpu, count: u32) -> Result<wgpu::Buffer, GpuError> {
    let bytes = u64::from(count.max(2)) * NOISE_BYTES;
    gpu.buffer("noisy radiance [bytes]", bytes, wgpu::BufferUsages::STORAGE)
}

fn mirrored(gpu: &Gpu, count: u32) -> Result<wgpu::Buffer, GpuError> {
    let bytes = u64::from(count) * 4;
    gpu.buffer(
        "mirrored distances [bytes]",
        bytes,
        wgpu::BufferUsages::STORAGE,
    )
}

impl Bind for Target {
    fn bound(&self) -> Bound<'_> {
        self.radiance.bound()
    }
}

/// The pipelines of captures.
#[derive(Debug, Clone)]
pub struct CaptureKernels {
    hits: HitKernels,
    resolve: Kernel,
}

impl CaptureKernels {
    /// Compiles the pipelines.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let (opaque, alpha) = (shader!("capture.hits"), shader!("capture.hits_alpha"));
        Ok(Self {
            hits: HitKernels::new(gpu, scene, &opaque, &alpha)?,
            resolve: Kernel::new(
                gpu,
                &shader!("capture.resolve"),
                "main",
                Some(&scene.layout),
            )?,
        })
    }
}

/// Captures the surface points that a camera or a cube sees.
#[derive(Debug)]
pub struct Capture {
    /// The latest points.
    pub points: SurfacePoints,
    /// Hit records: the provoking merged vertex of each pixel's triangle; all ones where there is none.
    pub hits: wgpu::Texture,
    size: [u32; 2],
    hits_view: wgpu::TextureView,
    depth: wgpu::Texture,
    depth_view: wgpu::TextureView,
    kernels: CaptureKernels,
    matrices: Matrices,
    all: Faces,
    /// The scene's merged vertices and the bind group with them. The scene replaces the vertices when it changes.
    resolve_hits: Option<(wgpu::Buffer, wgpu::BindGroup)>,
}

/// Faces of a capture that are captured and lit independently of the others.
#[derive(Debug, Clone)]
pub struct Faces {
    /// The faces' points, in the buffer of all faces.
    pub points: SurfacePoints,
    /// Indices of the faces.
    range: Range<u32>,
    /// Width and height of each face (pixels).
    size: [u32; 2],
    view: HostBuffer,
    resolve_seen: wgpu::BindGroup,
}

impl Faces {
    fn new(
        gpu: &Gpu,
        kernels: &CaptureKernels,
        points: wgpu::Buffer,
        hits: wgpu::TextureView,
        range: Range<u32>,
        size: [u32; 2],
    ) -> Result<Self, GpuError> {
        let uniform = std::mem::size_of::<ViewUniform>() as u64;
        let view = HostBuffer::new(gpu, "view", uniform, wgpu::BufferUsages::UNIFORM)?;
        let count = range.len() as u32 * size[0] * size[1];
        let points = SurfacePoints {
            points,
            view: wgpu::Buffer::clone(&view),
            first: range.start * size[0] * size[1],
            count,
            lit: count,
            hits,
            output: Output::RadianceToEye,
            slots: Slots::default(),
        };
        Ok(Self {
            resolve_seen: points.bind(gpu, &kernels.resolve)?,
            points,
            view,
            range,
            size,
        })
    }

    /// Number of faces.
    pub fn count(&self) -> u32 {
        self.range.len() as u32
    }

    /// The faces as images of the visibility buffer; `matrices` and `groups` have one entry per face of the capture.
    fn images<'a>(
        &self,
        matrices: &'a [Mat4],
        groups: &'a [[wgpu::BindGroup; 2]],
    ) -> impl Iterator<Item = Image<'a>> {
        let size = self.size;
        self.range.clone().map(move |face| Image {
            corner: [0, face * size[1]],
            size,
            clip_from_world: &matrices[face as usize],
            groups: &groups[face as usize],
        })
    }

    /// Writes the view of the faces' points.
    pub(crate) fn look(&self, gpu: &Gpu, view: &ViewUniform) {
        let view = ViewUniform {
            first_row: self.range.start * self.size[1],
            height: self.range.end * self.size[1],
            ..*view
        };
        self.view.write(gpu, std::slice::from_ref(&view));
    }
}

impl Capture {
    /// Allocates a capture of what a camera sees in an image of `size` pixels.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the adapter cannot hold it.
    pub fn of_camera(
        gpu: &Gpu,
        kernels: &CaptureKernels,
        size: [u32; 2],
    ) -> Result<Self, GpuError> {
        Self::new(gpu, kernels, size, 1)
    }

    /// Allocates a capture of what a cube sees, with faces of `side` x `side` texels.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the adapter cannot hold it.
    pub fn of_cube(gpu: &Gpu, kernels: &CaptureKernels, side: u32) -> Result<Self, GpuError> {
        Self::new(gpu, kernels, [side, 6 * side], 6)
    }

    fn new(
        gpu: &Gpu,
        kernels: &CaptureKernels,
        size: [u32; 2],
        faces: u32,
    ) -> Result<Self, GpuError> {
        let read = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC;
        let hits = hit_texture(gpu, size, read)?;
        // Only a cube's second layer reads this depth.
        let is_read = if faces > 1 {
            wgpu::TextureUsages::TEXTURE_BINDING
        } else {
            wgpu::TextureUsages::empty()
        };
        let depth = depth_texture(gpu, size, is_read)?;
        let points = gpu.buffer(
            "surface points [bytes]",
            u64::from(size[0] * size[1]) * SURFACE_POINT_BYTES,
            wgpu::BufferUsages::STORAGE,
        )?;
        let hits_view = hits.create_view(&Default::default());
        let face = [size[0], size[1] / faces];
        let all = Faces::new(gpu, kernels, points, hits_view.clone(), 0..faces, face)?;
        Ok(Self {
            points: all.points.clone(),
            hits,
            size,
            hits_view,
            depth_view: depth.create_view(&Default::default()),
            depth,
            kernels: kernels.clone(),
            matrices: Matrices::new(gpu, &kernels.hits, faces)?,
            all,
            resolve_hits: None,
        })
    }

    /// Width and height (pixels).
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Captures what a camera sees: passes `capture.hits` and `capture.resolve`. `class_of` gives the class as which
    /// each draw is drawn.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        view: &View,
        class_of: impl Fn(&Draw) -> DrawClass,
    ) -> Result<(), GpuError> {
        let (matrices, all) = ([view.clip_from_world], self.all_faces());
        self.draw(frame, scene, &view.uniform, &matrices, &all, |draw| {
            Some(class_of(draw))
        })
    }

    /// Captures what a cube sees: the same passes. `class_of` gives the class as which each draw is drawn, or `None` to
    /// skip it.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record_cube(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        view: &CubeView,
        class_of: impl Fn(&Draw) -> Option<DrawClass>,
    ) -> Result<(), GpuError> {
        self.record_faces(frame, scene, view, &self.all_faces(), class_of)
    }

    /// Captures what some faces of a cube see; the points of the other faces are kept.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record_faces(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        view: &CubeView,
        faces: &Faces,
        class_of: impl Fn(&Draw) -> Option<DrawClass>,
    ) -> Result<(), GpuError> {
        let matrices = &view.clip_from_world;
        self.draw(frame, scene, &view.uniform, matrices, faces, class_of)
    }

    /// All faces.
    pub fn all_faces(&self) -> Faces {
        self.all.clone()
    }

    /// Faces of a cube that are captured together, by their indices.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn faces(&self, gpu: &Gpu, range: Range<u32>) -> Result<Faces, GpuError> {
        if range == self.all.range {
            return Ok(self.all_faces());
        }
        let points = self.points.points.clone();
        let hits = self.hits_view.clone();
        Faces::new(gpu, &self.kernels, points, hits, range, self.all.size)
    }

    /// The bind group with the hit records and the merged vertices that they refer to.
    fn hits_of(&mut self, gpu: &Gpu, scene: &GpuScene) -> Result<wgpu::BindGroup, GpuError> {
        if let Some((vertices, group)) = &self.resolve_hits
            && *vertices == scene.vertices
        {
            return Ok(group.clone());
        }
        let resources = [
            ("hits", wgpu::BindingResource::TextureView(&self.hits_view)),
            ("merged", scene.vertices.as_entire_binding()),
        ];
        let group = self.kernels.resolve.bind(gpu, 3, &resources)?;
        self.resolve_hits = Some((scene.vertices.clone(), group.clone()));
        Ok(group)
    }

    fn draw(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        view: &ViewUniform,
        matrices: &[Mat4],
        drawn: &Faces,
        class_of: impl Fn(&Draw) -> Option<DrawClass>,
    ) -> Result<(), GpuError> {
        let hits = self.hits_of(frame.gpu, scene)?;
        drawn.look(frame.gpu, view);
        let written = matrices.iter().map(|matrix| (matrix, view));
        self.matrices.write(frame.gpu, written);
        let targets = [&self.hits_view];
        frame.render("capture.hits", &targets, &self.depth_view, |pass| {
            let images = drawn.images(matrices, &self.matrices.groups);
            self.kernels.hits.draw(pass, scene, images, class_of);
        });
        self.resolve(frame, scene, drawn, &drawn.resolve_seen, &hits);
        Ok(())
    }

    /// Resolves the hit records of some faces to the surface points of bind group `seen`.
    fn resolve(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        drawn: &Faces,
        seen: &wgpu::BindGroup,
        hits: &wgpu::BindGroup,
    ) {
        let [width, height] = drawn.size;
        frame.compute("capture.resolve", |pass| {
            let groups = [(0, &scene.bind_group), (1, seen), (3, hits)];
            let resolve = &self.kernels.resolve;
            resolve.dispatch(pass, &groups, [width, drawn.count() * height, 1]);
        });
    }
}

/// The planes of a clip space with depth in [0, 1], in world space; their positive sides face inward.
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

/// Index ranges of the draws that may be visible in a frustum. Adjacent ranges of the same kind are merged.
fn visible_ranges<K: PartialEq + Copy>(
    draws: &[Draw],
    planes: &[Vec4; 6],
    kind: impl Fn(&Draw) -> K,
) -> Vec<(K, Range<u32>)> {
    let mut ranges: Vec<(K, Range<u32>)> = Vec::new();
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
