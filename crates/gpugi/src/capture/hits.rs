//! Visibility buffers: hit records drawn with a depth buffer, for one view or several side by side.

use glam::Mat4;

use super::{ViewUniform, frustum_planes, visible_ranges};
use crate::gpu::{DepthTest, Gpu, GpuError, HostBuffer, RasterKernel, RasterState, Shader};
use crate::scene::{Draw, DrawClass, GpuScene};

/// A texture for hit records that is also used as `usage`.
///
/// # Errors
/// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
pub(super) fn hit_texture(
    gpu: &Gpu,
    size: [u32; 2],
    usage: wgpu::TextureUsages,
) -> Result<wgpu::Texture, GpuError> {
    target(
        gpu,
        "hit records",
        wgpu::TextureFormat::R32Uint,
        size,
        usage,
    )
}

/// A texture for the hit records of points that a compute pass finds: written there, read by gathers.
///
/// # Errors
/// As [`hit_texture`].
pub(crate) fn hits_of_points(gpu: &Gpu, size: [u32; 2]) -> Result<wgpu::TextureView, GpuError> {
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING;
    Ok(hit_texture(gpu, size, usage)?.create_view(&Default::default()))
}

/// The depth that goes with hit records.
///
/// # Errors
/// As [`hit_texture`].
pub(super) fn depth_texture(
    gpu: &Gpu,
    size: [u32; 2],
    usage: wgpu::TextureUsages,
) -> Result<wgpu::Texture, GpuError> {
    target(gpu, "depth", wgpu::TextureFormat::Depth32Float, size, usage)
}

fn target(
    gpu: &Gpu,
    label: &str,
    format: wgpu::TextureFormat,
    [width, height]: [u32; 2],
    usage: wgpu::TextureUsages,
) -> Result<wgpu::Texture, GpuError> {
    let usage = usage | wgpu::TextureUsages::RENDER_ATTACHMENT;
    gpu.texture_2d(label, [width, height, 1], format, usage)
}

/// One view's part of a visibility buffer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Image<'a> {
    /// Top left pixel.
    pub corner: [u32; 2],
    /// Width and height (pixels).
    pub size: [u32; 2],
    pub clip_from_world: &'a Mat4,
    /// Bind group 1, opaque and alpha.
    pub groups: &'a [wgpu::BindGroup; 2],
}

/// The pipelines that draw hit records, single-sided and double-sided.
#[derive(Debug, Clone)]
pub(super) struct HitKernels {
    pub opaque: [RasterKernel; 2],
    pub alpha: [RasterKernel; 2],
}

impl HitKernels {
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        opaque: &Shader,
        alpha: &Shader,
    ) -> Result<Self, GpuError> {
        let raster = |shader, cull| {
            RasterKernel::new(
                gpu,
                shader,
                Some(&scene.layout),
                &RasterState {
                    colors: &[wgpu::TextureFormat::R32Uint],
                    blend: None,
                    constants: &[],
                    cull,
                    slope_bias: 0.0,
                    has_fragment: true,
                    depth: DepthTest::Nearest,
                    has_vertices: true,
                },
            )
        };
        let back = Some(wgpu::Face::Back);
        Ok(Self {
            opaque: [raster(opaque, back)?, raster(opaque, None)?],
            alpha: [raster(alpha, back)?, raster(alpha, None)?],
        })
    }

    /// Draws some images of one visibility buffer.
    pub fn draw<'a>(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        scene: &GpuScene,
        images: impl Iterator<Item = Image<'a>>,
        class_of: impl Fn(&Draw) -> Option<DrawClass>,
    ) {
        pass.set_bind_group(0, &scene.bind_group, &[]);
        pass.set_vertex_buffer(0, scene.vertices.slice(..));
        pass.set_index_buffer(scene.indices.slice(..), wgpu::IndexFormat::Uint32);
        for image in images {
            let ([left, top], [width, height]) = (image.corner, image.size);
            let [x, y, columns, rows] = [left, top, width, height].map(|pixels| pixels as f32);
            pass.set_viewport(x, y, columns, rows, 0.0, 1.0);
            pass.set_scissor_rect(left, top, width, height);
            let [opaque, alpha] = image.groups;
            let planes = frustum_planes(image.clip_from_world);
            let mut current = None;
            for (class, range) in visible_ranges(&scene.draws, &planes, &class_of) {
                let Some(class) = class else {
                    continue;
                };
                let (kernel, group) = match class {
                    DrawClass::Closed | DrawClass::Open => (&self.opaque[0], opaque),
                    DrawClass::DoubleSided => (&self.opaque[1], opaque),
                    DrawClass::Alpha => (&self.alpha[0], alpha),
                    DrawClass::AlphaDoubleSided => (&self.alpha[1], alpha),
                };
                if current != Some(class) {
                    kernel.set(pass);
                    pass.set_bind_group(1, group, &[]);
                    current = Some(class);
                }
                pass.draw_indexed(range, 0, 0..1);
            }
        }
    }
}

/// One matrix per image of a visibility buffer, each as the shaders' `clip_from_world`.
#[derive(Debug)]
pub(super) struct Matrices {
    buffer: HostBuffer,
    images: u32,
    /// Bind group 1 of each image, opaque and alpha.
    pub groups: Vec<[wgpu::BindGroup; 2]>,
}

impl Matrices {
    /// Floats of an image's uniform.
    const WORDS: usize = 20;
    /// Floats between images: uniforms begin at multiples of 256 bytes.
    const STRIDE: usize = 64;

    pub fn new(gpu: &Gpu, kernels: &HitKernels, images: u32) -> Result<Self, GpuError> {
        let bytes = u64::from(images) * Self::STRIDE as u64 * 4;
        let buffer = HostBuffer::new(gpu, "clip_from_world", bytes, wgpu::BufferUsages::UNIFORM)?;
        let mut matrices = Self {
            buffer,
            images,
            groups: Vec::new(),
        };
        let groups = matrices.bindings().map(|of_image| {
            Ok([
                kernels.opaque[0].bind(gpu, 1, &[("clip_from_world", of_image.clone())])?,
                kernels.alpha[0].bind(gpu, 1, &[("alpha_view", of_image)])?,
            ])
        });
        matrices.groups = groups.collect::<Result<_, GpuError>>()?;
        Ok(matrices)
    }

    /// The uniform of each image.
    pub fn bindings(&self) -> impl Iterator<Item = wgpu::BindingResource<'_>> {
        (0..u64::from(self.images)).map(|image| {
            wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer: &self.buffer,
                offset: image * Self::STRIDE as u64 * 4,
                size: wgpu::BufferSize::new(Self::WORDS as u64 * 4),
            })
        })
    }

    /// Writes each image's matrix, and what its hashed thresholds depend on: the view's seed and top row.
    pub fn write<'a>(&self, gpu: &Gpu, images: impl Iterator<Item = (&'a Mat4, &'a ViewUniform)>) {
        let mut words = Vec::with_capacity(self.images as usize * Self::STRIDE);
        for (matrix, view) in images {
            let seed = view
                .seed
                .wrapping_add(view.sample_index.wrapping_mul(0x9e37_79b9));
            words.extend(matrix.to_cols_array());
            words.extend([seed, view.top].map(f32::from_bits));
            words.resize(words.len().next_multiple_of(Self::STRIDE), 0.0);
        }
        self.buffer.write(gpu, &words);
    }
}
