//! The film of a live picture: radiance in 16-bit floats, beside what the pixels see and how it has moved since the picture
//! before, and the memory of that picture.

use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec3};

use super::film::{Shot, Strip, texture};
use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Kernel, Named, join};
use crate::scene::GpuScene;
use crate::shader;

/// `Shots` of live.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct ShotsUniform {
    film_from_world: [[f32; 4]; 4],
    film_from_world_before: [[f32; 4]; 4],
    eye_before: [f32; 4],
    /// 1 / number of samples of a strip.
    scale: f32,
    has_moved: u32,
    padding: [u32; 2],
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
    kernels: Kernels,
    /// Mean radiance of this picture, as frames light it: rgba16float. Alpha: what it counts as among those of other frames.
    pub radiance: wgpu::TextureView,
    /// Velocity (pixels since the picture before: x to the right, y down), character of the surface, how far each pixel's
    /// triangle reaches from its centre, and the velocity of what it mirrors (film.wesl): rgba32uint.
    pub motion: wgpu::TextureView,
    images: [Image; 2],
    /// Which of them is this picture's.
    current: usize,
    /// Whether it shows anything.
    has_picture: bool,
    /// [`ShotsUniform`] of each strip.
    shots: Vec<HostBuffer>,
}

/// What a film compiles.
#[derive(Debug, Clone)]
struct Kernels {
    fill: Kernel,
    resample: Kernel,
    between: wgpu::Sampler,
}

impl Live {
    pub fn new(gpu: &Gpu, scene: &GpuScene, size: [u32; 2]) -> Result<Self, GpuError> {
        let kernels = Kernels {
            fill: Kernel::new(gpu, &shader!("picture.live"), "main", Some(&scene.layout))?,
            resample: Kernel::new(gpu, &shader!("picture.resample"), "main", None)?,
            between: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("film"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
        };
        Self::by(kernels, gpu, size)
    }

    /// The same for pictures of another size, which shows this picture until frames light its pixels: pass
    /// `picture.resample`. It compiles nothing.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn resized(&self, frame: &mut Frame<'_>, size: [u32; 2]) -> Result<Self, GpuError> {
        let mut film = Self::by(self.kernels.clone(), frame.gpu, size)?;
        if !self.has_picture {
            return Ok(film);
        }
        // The picture that has begun may not have been shown yet. The film alone has one that was seen through a lens.
        let images = [self.now(), self.before()];
        let remembered = images.into_iter().find(|image| image.shot.is_some());
        let (radiance, surfaces) = match remembered {
            Some(image) => (&image.radiance, &image.surfaces),
            None => (&self.radiance, &self.now().surfaces),
        };
        let wgpu::Extent3d { width, height, .. } = self.radiance.texture().size();
        let scale = Vec3::new(
            size[0] as f32 / width as f32,
            size[1] as f32 / height as f32,
            1.0,
        );
        let shot = remembered.and_then(|image| image.shot);
        film.images[film.current].shot = shot.map(|shot| Shot {
            film_from_world: Mat4::from_scale(scale) * shot.film_from_world,
            ..shot
        });
        film.has_picture = true;
        // The next picture has it before itself, and around the pixels that its first frames light.
        for image in &film.images {
            let resources: [Named<'_>; 7] = [
                ("radiance_before", radiance),
                ("surfaces_before", surfaces),
                ("between", &self.kernels.between),
                ("resampled", &image.radiance),
                ("surfaces", &image.surfaces),
                ("radiance", &film.radiance),
                ("motion", &film.motion),
            ];
            let pixels = [size[0], size[1], 1];
            let kernel = &self.kernels.resample;
            frame.run("picture.resample", kernel, None, &resources, pixels)?;
        }
        Ok(film)
    }

    fn by(kernels: Kernels, gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let half_floats = wgpu::TextureFormat::Rgba16Float;
        let image = || {
            Ok::<_, GpuError>(Image {
                radiance: texture(gpu, "film.history", half_floats, size)?,
                surfaces: texture(gpu, "film.surfaces", wgpu::TextureFormat::Rgba32Uint, size)?,
                shot: None,
            })
        };
        Ok(Self {
            kernels,
            radiance: texture(gpu, "film", half_floats, size)?,
            motion: texture(gpu, "film.motion", wgpu::TextureFormat::Rgba32Uint, size)?,
            images: [image()?, image()?],
            current: 0,
            has_picture: false,
            shots: Vec::new(),
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
        self.end_history();
        self.has_picture = false;
    }

    /// The next picture has nothing to do with those before it, which stay on show.
    pub fn end_history(&mut self) {
        for image in &mut self.images {
            image.shot = None;
        }
    }

    /// Begins another picture: this one becomes the one before.
    pub fn advance(&mut self) {
        self.current = 1 - self.current;
        self.images[self.current].shot = None;
    }

    /// Fills the film with strips of `shot`: pass `picture.film`.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        strips: &[Strip<'_>],
        shot: Shot,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        self.images[self.current].shot = Some(shot);
        self.has_picture = true;
        let before = self.before().shot.unwrap_or(shot);
        let vertices_before = scene.vertices_at(before.versions.geometry);
        let uniform = ShotsUniform {
            film_from_world: shot.film_from_world.to_cols_array_2d(),
            film_from_world_before: before.film_from_world.to_cols_array_2d(),
            eye_before: before.eye.to_array(),
            scale: 1.0,
            has_moved: vertices_before.is_some().into(),
            padding: [0; 2],
        };
        while self.shots.len() < strips.len() {
            self.shots.push(shots(gpu)?);
        }
        let scene_group = Some(&scene.bind_group);
        for (index, strip) in strips.iter().enumerate() {
            let rows = strip.rows.end - strip.rows.start;
            let shots = &self.shots[index];
            let scale = 1.0 / strip.samples.max(1) as f32;
            shots.write(gpu, &[ShotsUniform { scale, ..uniform }]);
            let own: [Named<'_>; 6] = [
                ("vertices", &scene.vertices),
                (
                    "vertices_before",
                    vertices_before.unwrap_or(&scene.vertices),
                ),
                ("shots", shots),
                ("radiance_mean", &self.radiance),
                ("surfaces", &self.now().surfaces),
                ("motion", &self.motion),
            ];
            let resources = join(&strip.receiver.resources(), &own);
            let invocations = [strip.receiver.points.count / rows.max(1), rows, 1];
            frame.compute("picture.film", |pass| {
                self.kernels
                    .fill
                    .run(pass, scene_group, &resources, invocations)
            })?;
        }
        Ok(())
    }
}

fn shots(gpu: &Gpu) -> Result<HostBuffer, GpuError> {
    let bytes = size_of::<ShotsUniform>() as u64;
    HostBuffer::new(gpu, "shots", bytes, wgpu::BufferUsages::UNIFORM)
}
