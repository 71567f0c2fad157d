//! Motion blur of live pictures, each of which is taken at one moment: what moves while the shutter is open is gathered along
//! its way. docs/effects/motion-blur.md.

#[cfg(test)]
mod tests;

use bytemuck::{Pod, Zeroable};

use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Kernel, Named};
use crate::picture::film::texture;
use crate::picture::live::Live;
use crate::shader;

crate::settings! {
    /// Settings of motion blur.
    #[derive(Copy)]
    pub struct Settings {
        /// Moments at which a pixel is looked up while the shutter is open; 0: off.
        pub samples: u32 = 16 => in_range(0.0, 64.0),
    }
}

/// Side of a tile (pixels): `TILE` of shutter.wesl.
const TILE: u32 = 16;
/// The farthest way of a pixel, as a part of the picture's height.
const MOST_WAY: f32 = 0.1;

/// `Shutter` of shutter.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct ShutterUniform {
    size: [u32; 2],
    tiles: [u32; 2],
    time: f32,
    most: f32,
    moments: u32,
    seed: u32,
}

#[derive(Debug, Clone)]
struct Kernels {
    in_tiles: Kernel,
    around: Kernel,
    gather: Kernel,
}

/// What pictures of one size need.
#[derive(Debug)]
struct Images {
    in_tiles: wgpu::Buffer,
    around: wgpu::Buffer,
    blurred: wgpu::TextureView,
    shutter: HostBuffer,
}

/// The passes and their images, made on first use.
#[derive(Debug, Default)]
pub(in crate::picture) struct Pass {
    kernels: Option<Kernels>,
    images: Option<Images>,
    frames: u32,
}

impl Kernels {
    fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let kernel = |shader| Kernel::new(gpu, &shader, "main", None);
        Ok(Self {
            in_tiles: kernel(shader!("picture.effects.motion_blur.in_tiles"))?,
            around: kernel(shader!("picture.effects.motion_blur.around"))?,
            gather: kernel(shader!("picture.effects.motion_blur.gather"))?,
        })
    }
}

impl Images {
    fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let [across, down] = size.map(|side| side.div_ceil(TILE));
        let ways = |label| {
            let bytes = u64::from(across * down) * 24;
            gpu.buffer(label, bytes, wgpu::BufferUsages::STORAGE)
        };
        let half_floats = wgpu::TextureFormat::Rgba16Float;
        let bytes = size_of::<ShutterUniform>() as u64;
        Ok(Self {
            in_tiles: ways("motion-blur.in tiles")?,
            around: ways("motion-blur.around")?,
            blurred: texture(gpu, "motion-blur", half_floats, size)?,
            shutter: HostBuffer::new(gpu, "shutter", bytes, wgpu::BufferUsages::UNIFORM)?,
        })
    }
}

impl Pass {
    /// The same for pictures of another size; it compiles nothing.
    pub fn resized(&self) -> Self {
        Self {
            kernels: self.kernels.clone(),
            images: None,
            frames: self.frames,
        }
    }

    /// Begins to compile what pictures need whose shutter is open for so long (s).
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        shutter: f32,
        settings: &Settings,
    ) -> Result<(), GpuError> {
        let is_on = settings.samples > 0 && shutter > 0.0;
        if is_on && self.kernels.is_none() {
            self.kernels = Some(Kernels::new(gpu)?);
        }
        if !is_on {
            self.images = None;
        }
        Ok(())
    }

    /// Blurs what moves in a picture of `size` pixels whose shutter is open for so long as `time` says, in times between
    /// pictures: pass `picture.motion-blur`. Returns the picture, which is `radiance` if that is 0.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        radiance: &wgpu::TextureView,
        film: &Live,
        time: f32,
        size: [u32; 2],
        settings: &Settings,
    ) -> Result<wgpu::TextureView, GpuError> {
        let gpu = frame.gpu;
        let is_on = settings.samples > 0 && time > 0.0;
        let Some(kernels) = self.kernels.as_ref().filter(|_| is_on) else {
            return Ok(radiance.clone());
        };
        let images = match self.images.take() {
            Some(images) => self.images.insert(images),
            None => self.images.insert(Images::new(gpu, size)?),
        };
        self.frames = self.frames.wrapping_add(1);
        let tiles = size.map(|side| side.div_ceil(TILE));
        images.shutter.write(
            gpu,
            &[ShutterUniform {
                size,
                tiles,
                time,
                most: MOST_WAY * size[1] as f32,
                moments: settings.samples,
                seed: self.frames,
            }],
        );
        let of_tiles: [Named<'_>; 4] = [
            ("motion", &film.motion),
            ("surfaces", &film.now().surfaces),
            ("opened", &images.shutter),
            ("found", &images.in_tiles),
        ];
        let of_around: [Named<'_>; 3] = [
            ("in_tiles", &images.in_tiles),
            ("opened", &images.shutter),
            ("found", &images.around),
        ];
        let of_gather: [Named<'_>; 6] = [
            ("radiance", radiance),
            ("surfaces", &film.now().surfaces),
            ("motion", &film.motion),
            ("around", &images.around),
            ("opened", &images.shutter),
            ("blurred", &images.blurred),
        ];
        frame.compute("picture.motion-blur", |pass| {
            let [width, height] = tiles.map(|tiles| tiles * TILE);
            (kernels.in_tiles).run(pass, None, &of_tiles, [width, height, 1])?;
            (kernels.around).run(pass, None, &of_around, [tiles[0], tiles[1], 1])?;
            (kernels.gather).run(pass, None, &of_gather, [size[0], size[1], 1])
        })?;
        Ok(images.blurred.clone())
    }
}
