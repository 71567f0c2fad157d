//! Film: the whole picture, filled from the strips in which it is lit. A still picture's holds radiance in 32-bit floats;
//! live.rs has that of a live one.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec2, Vec4};

use gpugi_scene::{Camera, Lens};

use crate::capture::{Receiver, View};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named};
use crate::scene::{GpuScene, Versions};
use crate::shader;

/// A strip of a picture, lit as a receiver of its own.
#[derive(Debug, Clone)]
pub struct Strip<'a> {
    /// Its pixels: surface points and summed radiance.
    pub receiver: &'a Receiver,
    /// Its rows in the picture.
    pub rows: Range<u32>,
    /// Samples that its radiance sums.
    pub samples: u32,
}

/// How a picture was seen: through pixel centres, without the jitter of its samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shot {
    /// Film coordinates from world space, homogeneous: x and y in pixels from the top left corner of the picture, and the
    /// distance along the view's axis (m) in place of the depth, which is not divided.
    pub film_from_world: Mat4,
    /// The eye in world space (m, w = 1), or the unit direction toward it (w = 0).
    pub eye: Vec4,
    /// The lens.
    pub lens: Lens,
    /// Time for which the shutter is open (s).
    pub shutter: f32,
    /// Half the height of what the picture shows at the distance of 1 m, or of all that it shows if rays are parallel (m).
    pub half_height: f32,
    /// Tangent of half the vertical field of view; 0 if all rays are parallel.
    pub tangent: f32,
    /// Versions of what was seen.
    pub versions: Versions,
}

impl Shot {
    /// The shot of a picture of `size` pixels in which `view` is a sample, taken by `camera`.
    pub fn new(view: &View, camera: &Camera, size: [u32; 2], scene: &GpuScene) -> Self {
        let half = Vec2::new(size[0] as f32, size[1] as f32) / 2.0;
        let [x, y] = (half / view.half_extent).to_array();
        let depth = Vec4::new(0.0, 0.0, -1.0, 0.0);
        // By rows. Of a perspective view, w is the distance along the axis.
        let rows = if view.is_perspective {
            [
                Vec4::new(x, 0.0, -half.x, 0.0),
                Vec4::new(0.0, -y, -half.y, 0.0),
                depth,
                depth,
            ]
        } else {
            [
                Vec4::new(x, 0.0, 0.0, half.x),
                Vec4::new(0.0, -y, 0.0, half.y),
                depth,
                Vec4::W,
            ]
        };
        let film_from_view = Mat4::from_cols_array_2d(&rows.map(|row| row.to_array())).transpose();
        Self {
            film_from_world: film_from_view * view.world_from_view.inverse(),
            eye: match view.is_perspective {
                true => view.world_from_view.w_axis,
                false => view.world_from_view.z_axis.normalize(),
            },
            lens: camera.lens,
            shutter: camera.shutter,
            half_height: view.half_extent.y,
            tangent: match view.is_perspective {
                true => view.half_extent.y,
                false => 0.0,
            },
            versions: scene.versions,
        }
    }
}

impl Shot {
    /// Pixels per metre in the plane in which the lens sees sharply, of a picture of `size` pixels.
    pub fn pixels_per_metre(&self, size: [u32; 2]) -> f32 {
        let distance = match self.tangent > 0.0 {
            true => self.lens.focus,
            false => 1.0,
        };
        size[1] as f32 / (2.0 * self.half_height * distance)
    }
}

/// `Strip` of still.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct StripUniform {
    width: u32,
    first_row: u32,
    pixel_count: u32,
    /// 1 / number of samples.
    scale: f32,
}

/// A texture of a picture.
///
/// # Errors
/// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
pub(super) fn texture(
    gpu: &Gpu,
    label: &str,
    format: wgpu::TextureFormat,
    [width, height]: [u32; 2],
) -> Result<wgpu::TextureView, GpuError> {
    let usage = wgpu::TextureUsages::TEXTURE_BINDING
        | wgpu::TextureUsages::STORAGE_BINDING
        | wgpu::TextureUsages::COPY_DST
        | wgpu::TextureUsages::COPY_SRC;
    let texture = gpu.texture_2d(label, [width, height, 1], format, usage)?;
    Ok(texture.create_view(&Default::default()))
}

/// A texture for mean radiance in 32-bit floats.
///
/// # Errors
/// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
pub(super) fn radiance_32(gpu: &Gpu, size: [u32; 2]) -> Result<wgpu::TextureView, GpuError> {
    texture(gpu, "film", wgpu::TextureFormat::Rgba32Float, size)
}

/// The film of a still picture: its mean radiance.
#[derive(Debug)]
pub(super) struct Still {
    kernel: Kernel,
    /// Mean radiance: rgba32float.
    pub radiance: wgpu::TextureView,
}

impl Still {
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        Ok(Self {
            kernel: Kernel::new(gpu, &shader!("picture.still"), "main", None)?,
            radiance: radiance_32(gpu, size)?,
        })
    }

    /// Fills the film with strips: pass `picture.film`.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        strips: &[Strip<'_>],
        width: u32,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        for strip in strips {
            let pixel_count = width * (strip.rows.end - strip.rows.start);
            let uniform = gpu.constant(
                "strip",
                &StripUniform {
                    width,
                    first_row: strip.rows.start,
                    pixel_count,
                    scale: 1.0 / strip.samples.max(1) as f32,
                },
            )?;
            let resources: [Named<'_>; 3] = [
                ("radiance", &strip.receiver.target.radiance),
                ("strip", &uniform),
                ("film", &self.radiance),
            ];
            frame.compute("picture.film", |pass| {
                self.kernel.run(pass, None, &resources, [pixel_count, 1, 1])
            })?;
        }
        Ok(())
    }
}
