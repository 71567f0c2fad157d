//! Depth of field of live pictures, whose frames see through the middle of the lens: what is out of focus is gathered over
//! the image of the aperture. At rest, samples through points of the lens replace it. docs/effects/depth-of-field.md.

#[cfg(test)]
mod tests;

use bytemuck::{Pod, Zeroable};
use glam::Vec2;
use gpugi_scene::Lens;

use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Kernel, Named};
use crate::picture::film::{Shot, texture};
use crate::picture::live::Live;
use crate::sequences::sobol;
use crate::shader;

crate::settings! {
    /// Settings of depth of field.
    #[derive(Copy)]
    pub struct Settings {
        /// Points of the aperture over which a pixel out of focus is gathered; 0: off, everything is sharp while it moves.
        pub samples: u32 = 64 => in_range(0.0, MOST_SAMPLES as f64),
    }
}

/// Length of `aperture` in gather.wesl.
const MOST_SAMPLES: u32 = 128;
/// Side of a tile (pixels): `TILE` of circle.wesl.
const TILE: u32 = 16;
/// Largest radius, as a part of the picture's height.
const MOST_RADIUS: f32 = 0.1;
/// Samples at rest after which the gathered picture no longer counts.
const REST_SAMPLES: u32 = 32;

/// `Lens` of circle.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct LensUniform {
    size: [u32; 2],
    tiles: [u32; 2],
    aperture: f32,
    focus: f32,
    most: f32,
    points: u32,
    spacing: f32,
    is_parallel: u32,
    padded: [f32; 2],
}

/// `Fade` of fade.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct FadeUniform {
    size: [u32; 2],
    part: f32,
    padding: u32,
}

#[derive(Debug, Clone)]
struct Kernels {
    prepare: Kernel,
    spread: Kernel,
    gather: Kernel,
    fade: Kernel,
}

/// What pictures of one size need.
#[derive(Debug)]
struct Images {
    /// Colour and radius, from half the size on.
    smaller: wgpu::TextureView,
    levels: [wgpu::TextureView; 4],
    /// Largest radius in front of the focus in each tile, and of all that reach it.
    nearest: wgpu::Buffer,
    reaching: wgpu::Buffer,
    blurred: wgpu::TextureView,
    faded: wgpu::TextureView,
    lens: HostBuffer,
    aperture: HostBuffer,
    /// Lens and number of the points in `aperture`.
    points_of: Option<(Lens, u32)>,
    /// Whether `blurred` holds the last live picture.
    has_picture: bool,
}

/// The passes and their images, made on first use.
#[derive(Debug, Default)]
pub(in crate::picture) struct Pass {
    kernels: Option<Kernels>,
    images: Option<Images>,
}

impl Kernels {
    fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let kernel = |shader| Kernel::new(gpu, &shader, "main", None);
        Ok(Self {
            prepare: kernel(shader!("picture.effects.depth_of_field.prepare"))?,
            spread: kernel(shader!("picture.effects.depth_of_field.spread"))?,
            gather: kernel(shader!("picture.effects.depth_of_field.gather"))?,
            fade: kernel(shader!("picture.effects.depth_of_field.fade"))?,
        })
    }
}

fn tiles(size: [u32; 2]) -> [u32; 2] {
    size.map(|side| side.div_ceil(TILE))
}

impl Images {
    fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let half_floats = wgpu::TextureFormat::Rgba16Float;
        let [across, down] = tiles(size);
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING;
        let half = [across, down].map(|tiles| tiles * TILE / 2);
        let storage = |label| {
            let bytes = u64::from(across * down) * 4;
            gpu.buffer(label, bytes, wgpu::BufferUsages::STORAGE)
        };
        let uniform = |label, bytes: usize| {
            HostBuffer::new(gpu, label, bytes as u64, wgpu::BufferUsages::UNIFORM)
        };
        let smaller = gpu.texture_with_levels(
            "depth-of-field.smaller",
            [half[0], half[1], 1],
            4,
            half_floats,
            usage,
        )?;
        let level = |level: usize| {
            smaller.create_view(&wgpu::TextureViewDescriptor {
                base_mip_level: level as u32,
                mip_level_count: Some(1),
                ..Default::default()
            })
        };
        Ok(Self {
            levels: std::array::from_fn(level),
            smaller: smaller.create_view(&Default::default()),
            nearest: storage("depth-of-field.nearest")?,
            reaching: storage("depth-of-field.reaching")?,
            blurred: texture(gpu, "depth-of-field", half_floats, size)?,
            faded: texture(gpu, "depth-of-field.faded", half_floats, size)?,
            lens: uniform("lens", size_of::<LensUniform>())?,
            aperture: uniform("aperture", MOST_SAMPLES as usize * 16)?,
            points_of: None,
            has_picture: false,
        })
    }
}

/// Points of an aperture of radius 1, to the right and down, and the radius of the aperture on whose edge each lies.
fn points(lens: &Lens, count: u32) -> Vec<[f32; 4]> {
    let unit = Lens {
        aperture: 1.0,
        ..*lens
    };
    let point = |index| {
        let Vec2 { x, y } = unit.sample(sobol(index));
        [x, -y, unit.edge(Vec2::new(x, y)), 0.0]
    };
    (0..count).map(point).collect()
}

impl Pass {
    /// The same for pictures of another size; it compiles nothing.
    pub fn resized(&self) -> Self {
        Self {
            kernels: self.kernels.clone(),
            images: None,
        }
    }

    /// Begins to compile what a picture through `lens` needs.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn prepare(&mut self, gpu: &Gpu, lens: &Lens, settings: &Settings) -> Result<(), GpuError> {
        let is_on = settings.samples > 0 && !lens.is_pinhole();
        if is_on && self.kernels.is_none() {
            self.kernels = Some(Kernels::new(gpu)?);
        }
        if !is_on {
            self.images = None;
        }
        Ok(())
    }

    /// Forgets the last picture.
    pub fn forget(&mut self) {
        if let Some(images) = &mut self.images {
            images.has_picture = false;
        }
    }

    /// Blurs what is out of focus in a picture of `size` pixels: pass `picture.depth-of-field`. Returns the picture, which
    /// is `radiance` if everything is sharp.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        radiance: &wgpu::TextureView,
        film: &Live,
        shot: &Shot,
        size: [u32; 2],
        settings: &Settings,
    ) -> Result<wgpu::TextureView, GpuError> {
        let gpu = frame.gpu;
        let Some(kernels) = self
            .kernels
            .as_ref()
            .filter(|_| settings.samples > 0 && !shot.lens.is_pinhole())
        else {
            return Ok(radiance.clone());
        };
        if self.images.is_none() {
            self.images = Some(Images::new(gpu, size)?);
        }
        let Some(images) = &mut self.images else {
            return Ok(radiance.clone());
        };
        let count = settings.samples.min(MOST_SAMPLES);
        if images.points_of != Some((shot.lens, count)) {
            let mut points = points(&shot.lens, count);
            points.resize(MOST_SAMPLES as usize, [0.0; 4]);
            images.aperture.write(gpu, &points);
            images.points_of = Some((shot.lens, count));
        }
        let unit = Lens {
            aperture: 1.0,
            ..shot.lens
        };
        let tiles = tiles(size);
        images.lens.write(
            gpu,
            &[LensUniform {
                size,
                tiles,
                aperture: shot.lens.aperture * shot.pixels_per_metre(size),
                focus: shot.lens.focus,
                most: MOST_RADIUS * size[1] as f32,
                points: count,
                spacing: (unit.area() / count as f32).sqrt(),
                is_parallel: (shot.tangent == 0.0).into(),
                padded: tiles.map(|tiles| (tiles * TILE) as f32),
            }],
        );
        let surfaces = &film.now().surfaces;
        let [half, quarter, eighth, sixteenth] = &images.levels;
        let of_prepare: [Named<'_>; 8] = [
            ("radiance", radiance),
            ("surfaces", surfaces),
            ("lens", &images.lens),
            ("half_size", half),
            ("quarter", quarter),
            ("eighth", eighth),
            ("sixteenth", sixteenth),
            ("nearest", &images.nearest),
        ];
        let of_spread: [Named<'_>; 3] = [
            ("nearest", &images.nearest),
            ("lens", &images.lens),
            ("reaching", &images.reaching),
        ];
        let of_gather: [Named<'_>; 7] = [
            ("radiance", radiance),
            ("surfaces", surfaces),
            ("smaller", &images.smaller),
            ("reaching", &images.reaching),
            ("aperture", &images.aperture),
            ("lens", &images.lens),
            ("blurred", &images.blurred),
        ];
        frame.compute("picture.depth-of-field", |pass| {
            let padded = tiles.map(|tiles| tiles * TILE);
            kernels
                .prepare
                .run(pass, None, &of_prepare, [padded[0], padded[1], 1])?;
            kernels
                .spread
                .run(pass, None, &of_spread, [tiles[0], tiles[1], 1])?;
            kernels
                .gather
                .run(pass, None, &of_gather, [size[0], size[1], 1])
        })?;
        images.has_picture = true;
        Ok(images.blurred.clone())
    }

    /// At rest: the mean of `samples` samples through points of the lens, of which there will be `of`, after the last
    /// gathered picture. Pass `picture.depth-of-field`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn fade(
        &mut self,
        frame: &mut Frame<'_>,
        radiance: &wgpu::TextureView,
        size: [u32; 2],
        [samples, of]: [u32; 2],
    ) -> Result<wgpu::TextureView, GpuError> {
        let part = samples as f32 / REST_SAMPLES.min(of).max(1) as f32;
        let images = self
            .images
            .as_ref()
            .filter(|images| images.has_picture && part < 1.0);
        let (Some(images), Some(kernels)) = (images, &self.kernels) else {
            return Ok(radiance.clone());
        };
        let uniform = FadeUniform {
            size,
            part,
            padding: 0,
        };
        let uniform = frame.gpu.constant("fade", &uniform)?;
        let resources: [Named<'_>; 4] = [
            ("radiance", radiance),
            ("before", &images.blurred),
            ("fade", &uniform),
            ("faded", &images.faded),
        ];
        frame.compute("picture.depth-of-field", |pass| {
            kernels
                .fade
                .run(pass, None, &resources, [size[0], size[1], 1])
        })?;
        Ok(images.faded.clone())
    }
}
