//! The second layer of a cube's capture: what the centre would see if the nearest surfaces were not there. Depth
//! peeling: Everitt, "Interactive Order-Independent Transparency", NVIDIA 2001.

use super::hits::HitKernels;
use super::{Capture, CubeView, Faces, SURFACE_POINT_BYTES, SurfacePoints};
use crate::gpu::{Frame, Gpu, GpuError, Keeps};
use crate::scene::{Draw, DrawClass, GpuScene};
use crate::shader;

/// Captures what lies behind the surfaces that a cube saw.
#[derive(Debug)]
pub struct PeeledLayer {
    /// Points of the second layer. Where nothing lies behind the first, they repeat it: what surrounds an object
    /// continues behind it.
    points: wgpu::Buffer,
    /// Hit records of the points.
    hits: wgpu::Texture,
    hits_view: wgpu::TextureView,
    kernels: HitKernels,
    depth: wgpu::TextureView,
    /// Bind group 1 of each face, opaque and alpha.
    groups: Vec<[wgpu::BindGroup; 2]>,
}

impl PeeledLayer {
    /// Allocates the second layer of `capture`, which must be of a cube.
    ///
    /// # Errors
    /// [`GpuError::Pass`]; [`GpuError::TooLarge`] when the adapter cannot hold it.
    pub fn new(gpu: &Gpu, scene: &GpuScene, capture: &Capture) -> Result<Self, GpuError> {
        let kernels = HitKernels::new(
            gpu,
            scene,
            &shader!("capture.peeled_hits"),
            &shader!("capture.peeled_hits_alpha"),
        )?;
        let nearer = wgpu::BindingResource::TextureView(&capture.depth_view);
        let groups = capture.matrices.bindings().map(|view| {
            let opaque = [
                ("clip_from_world", view.clone()),
                ("nearer", nearer.clone()),
            ];
            let alpha = [("alpha_view", view), ("nearer", nearer.clone())];
            Ok([
                kernels.opaque[0].bind(gpu, 1, &opaque)?,
                kernels.alpha[0].bind(gpu, 1, &alpha)?,
            ])
        });
        let groups = groups.collect::<Result<_, GpuError>>()?;
        let like = |texture: &wgpu::Texture, label, usage| {
            let size = texture.size();
            let size = [size.width, size.height, size.depth_or_array_layers];
            let usage = usage | wgpu::TextureUsages::RENDER_ATTACHMENT;
            gpu.texture_2d(label, size, texture.format(), usage)
        };
        let depth = "depth of the peeled layer";
        let depth = like(&capture.depth, depth, wgpu::TextureUsages::empty())?;
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
        let hits = like(&capture.hits, "peeled hit records", usage)?;
        let size = u64::from(capture.points.count) * SURFACE_POINT_BYTES;
        let points = "peeled surface points [bytes]";
        Ok(Self {
            points: gpu.buffer(points, size, wgpu::BufferUsages::STORAGE)?,
            hits_view: hits.create_view(&Default::default()),
            hits,
            kernels,
            depth: depth.create_view(&Default::default()),
            groups,
        })
    }

    /// The latest points behind those that a cube saw: behind all of them or behind some.
    pub fn points(&self, seen: &SurfacePoints) -> SurfacePoints {
        SurfacePoints {
            points: self.points.clone(),
            hits: self.hits_view.clone(),
            ..seen.clone()
        }
    }

    /// Captures the second layer, after `capture` has recorded the same faces of `view`: passes `capture.peeled-hits`
    /// and `capture.resolve`. `class_of` gives the class as which each draw is drawn, or `None` to skip it.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        capture: &Capture,
        view: &CubeView,
        faces: &Faces,
        class_of: impl Fn(&Draw) -> Option<DrawClass>,
    ) -> Result<(), GpuError> {
        let resources = [
            ("hits", wgpu::BindingResource::TextureView(&self.hits_view)),
            ("merged", scene.vertices.as_entire_binding()),
        ];
        let resolve = &capture.kernels.resolve;
        let hits = resolve.bind(frame.gpu, 3, &resources)?;
        let [_, height] = faces.size;
        let rows = faces.range.start * height..faces.range.end * height;
        frame.copy_rows(&capture.hits, &self.hits, rows);
        let drawn = [&self.hits_view];
        let name = "capture.peeled-hits";
        frame.render_onto(name, Keeps::Colors, &drawn, &self.depth, |pass| {
            let images = faces.images(&view.clip_from_world, &self.groups);
            self.kernels.draw(pass, scene, images, class_of);
        });
        let points = self.points(&faces.points);
        let seen = points.bind(frame.gpu, resolve)?;
        capture.resolve(frame, scene, faces, &seen, &hits);
        Ok(())
    }
}
