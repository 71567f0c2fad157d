//! Film: the whole picture, filled from the strips in which it is lit. A still picture's holds radiance in 32-bit floats. A
//! live one's holds it in 16, beside what the pixels see and how it has moved since the picture before, and remembers
//! that picture ([`Live`]).

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec2, Vec4};

use gpugi_scene::{Camera, Lens};

use crate::capture::{Receiver, View};
use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Kernel, Named, join};
use crate::scene::{GpuScene, Versions};
use crate::shader;

/// A strip of a picture, lit as a receiver of its own.
#[derive(Debug, Clone)]
pub struct Strip<'a> {
    /// Its pixels: surface points and summed radiance.
    pub receiver: &'a Receiver,
    /// Its rows in the picture.
    pub rows: Range<u32>,
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

/// `Shots` of live.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct ShotsUniform {
    film_from_world: [[f32; 4]; 4],
    film_from_world_before: [[f32; 4]; 4],
    eye_before: [f32; 4],
    /// 1 / number of samples.
    scale: f32,
    has_moved: u32,
    padding: [u32; 2],
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

    /// Fills the film with strips of `samples` samples: pass `picture.film`.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        strips: &[Strip<'_>],
        width: u32,
        samples: u32,
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
                    scale: 1.0 / samples.max(1) as f32,
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

/// What the pixels of a live picture show and see.
#[derive(Debug)]
pub(super) struct Image {
    /// What effects made of its radiance: rgba16float. Alpha: the frames that it averages.
    pub radiance: wgpu::TextureView,
    /// Depth (f32, m), shading normal (octahedral), reflectance (rgb9e5) and instance of each pixel: rgba32uint.
    pub surfaces: wgpu::TextureView,
    /// How it was seen; `None` before the first time.
    pub shot: Option<Shot>,
}

/// The film of a live picture. Two images take turns: this picture's and the one before, which its history is.
#[derive(Debug)]
pub(super) struct Live {
    kernel: Kernel,
    /// Mean radiance of this picture: rgba16float.
    pub radiance: wgpu::TextureView,
    /// Velocity (pixels since the picture before: x to the right, y down), character of the surface, how far each pixel's triangle reaches from its centre, and the velocity of what it mirrors
    /// (film.wesl): rgba32uint.
    pub motion: wgpu::TextureView,
    images: [Image; 2],
    /// Which of them is this picture's.
    current: usize,
    shots: HostBuffer,
}

impl Live {
    pub fn new(gpu: &Gpu, scene: &GpuScene, size: [u32; 2]) -> Result<Self, GpuError> {
        let kernel = Kernel::new(gpu, &shader!("picture.live"), "main", Some(&scene.layout))?;
        Self::by(kernel, gpu, size)
    }

    /// The same for pictures of another size; it compiles nothing.
    pub fn resized(&self, gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        Self::by(self.kernel.clone(), gpu, size)
    }

    fn by(kernel: Kernel, gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let half_floats = wgpu::TextureFormat::Rgba16Float;
        let image = || {
            Ok::<_, GpuError>(Image {
                radiance: texture(gpu, "film.history", half_floats, size)?,
                surfaces: texture(gpu, "film.surfaces", wgpu::TextureFormat::Rgba32Uint, size)?,
                shot: None,
            })
        };
        Ok(Self {
            kernel,
            radiance: texture(gpu, "film", half_floats, size)?,
            motion: texture(gpu, "film.motion", wgpu::TextureFormat::Rgba32Uint, size)?,
            images: [image()?, image()?],
            current: 0,
            shots: HostBuffer::new(
                gpu,
                "shots",
                size_of::<ShotsUniform>() as u64,
                wgpu::BufferUsages::UNIFORM,
            )?,
        })
    }

    /// Which of two textures that take turns is this picture's.
    pub fn turn(&self) -> usize {
        self.current
    }

    /// This picture's image.
    pub fn now(&self) -> &Image {
        &self.images[self.current]
    }

    /// The image of the picture before.
    pub fn before(&self) -> &Image {
        &self.images[1 - self.current]
    }

    /// Forgets all pictures.
    pub fn forget(&mut self) {
        for image in &mut self.images {
            image.shot = None;
        }
    }

    /// Begins another picture: this one becomes the one before.
    pub fn advance(&mut self) {
        self.current = 1 - self.current;
        self.images[self.current].shot = None;
    }

    /// Fills the film with strips of `samples` samples of `shot`: pass `picture.film`.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        strips: &[Strip<'_>],
        samples: u32,
        shot: Shot,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        self.images[self.current].shot = Some(shot);
        let before = self.before().shot.unwrap_or(shot);
        let vertices_before = scene.vertices_at(before.versions.geometry);
        let uniform = ShotsUniform {
            film_from_world: shot.film_from_world.to_cols_array_2d(),
            film_from_world_before: before.film_from_world.to_cols_array_2d(),
            eye_before: before.eye.to_array(),
            scale: 1.0 / samples.max(1) as f32,
            has_moved: vertices_before.is_some().into(),
            padding: [0; 2],
        };
        self.shots.write(gpu, &[uniform]);
        let scene_group = Some(&scene.bind_group);
        for strip in strips {
            let rows = strip.rows.end - strip.rows.start;
            let own: [Named<'_>; 6] = [
                ("vertices", &scene.vertices),
                (
                    "vertices_before",
                    vertices_before.unwrap_or(&scene.vertices),
                ),
                ("shots", &self.shots),
                ("radiance_mean", &self.radiance),
                ("surfaces", &self.now().surfaces),
                ("motion", &self.motion),
            ];
            let resources = join(&strip.receiver.resources(), &own);
            let invocations = [strip.receiver.points.count / rows.max(1), rows, 1];
            frame.compute("picture.film", |pass| {
                self.kernel.run(pass, scene_group, &resources, invocations)
            })?;
        }
        Ok(())
    }
}
