//! Glow: a little of the light of each pixel is scattered over the picture, as the eye scatters it around what is bright. It
//! is a sum of smaller and smaller images of the picture. docs/effects/glow.md.

mod scattering;
#[cfg(test)]
mod tests;

use bytemuck::{Pod, Zeroable};

use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named};
use crate::picture::TANGENT;
use crate::picture::film::texture;
use crate::shader;
use scattering::Weights;

/// Images of a picture: the coarsest of a large one has about 4 to 8 texels a side.
const MOST_LEVELS: u32 = 10;

crate::settings! {
    /// Settings of the glow.
    #[derive(Copy)]
    pub struct Settings {
        /// Share of the light that is scattered as the eye scatters it; 0: off, 1: all, as in an eye.
        pub strength: f32 = 0.0 => in_range(0.0, 1.0),
    }
}

impl Settings {
    /// Whether light is scattered.
    pub fn is_on(&self) -> bool {
        self.strength > 0.0
    }
}

/// `Level` of glow.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct LevelUniform {
    size: [u32; 2],
    coarse_size: [u32; 2],
    own: f32,
    near: f32,
    scattered: f32,
    is_picture: u32,
}

/// The kernels for pictures of one format.
#[derive(Debug, Clone)]
struct Kernels {
    format: wgpu::TextureFormat,
    down: Kernel,
    up: Kernel,
}

/// An image of the pyramid.
#[derive(Debug)]
struct Image {
    size: [u32; 2],
    /// The picture in this size.
    made_smaller: wgpu::TextureView,
    /// The sum of this image and of all coarser ones; of the coarsest image, itself.
    sum: wgpu::TextureView,
}

/// Images of pictures of one size and format.
#[derive(Debug)]
struct Pyramid {
    /// From fine to coarse.
    images: Vec<Image>,
    result: wgpu::TextureView,
    format: wgpu::TextureFormat,
    /// The weights for pixels of this width.
    weights: Option<(f32, Weights)>,
}

/// The passes and their images, made on first use.
#[derive(Debug, Default)]
pub(in crate::picture) struct Pass {
    /// One of each format that was shown.
    kernels: Vec<Kernels>,
    pyramid: Option<Pyramid>,
}

impl Kernels {
    fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Result<Self, GpuError> {
        let shader = match format {
            wgpu::TextureFormat::Rgba16Float => shader!("picture.effects.glow.halves"),
            _ => shader!("picture.effects.glow.floats"),
        };
        Ok(Self {
            format,
            down: Kernel::new(gpu, &shader, "down", None)?,
            up: Kernel::new(gpu, &shader, "up", None)?,
        })
    }
}

impl Pyramid {
    fn new(gpu: &Gpu, size: [u32; 2], format: wgpu::TextureFormat) -> Result<Self, GpuError> {
        let texture = |label, size| texture(gpu, label, format, size);
        let count = levels(size);
        let images = (1..=count).map(|level| {
            let size = size.map(|side| side.div_ceil(1 << level));
            let made_smaller = texture("glow.image", size)?;
            let sum = match level == count {
                true => made_smaller.clone(),
                false => texture("glow.sum", size)?,
            };
            Ok(Image {
                size,
                made_smaller,
                sum,
            })
        });
        Ok(Self {
            images: images.collect::<Result<_, GpuError>>()?,
            result: texture("glow", size)?,
            format,
            weights: None,
        })
    }
}

/// The kernels for this format, made on first use.
fn kernels<'a>(
    made: &'a mut Vec<Kernels>,
    gpu: &Gpu,
    format: wgpu::TextureFormat,
) -> Result<&'a Kernels, GpuError> {
    let found = made.iter().position(|kernels| kernels.format == format);
    let index = found.unwrap_or(made.len());
    if found.is_none() {
        made.push(Kernels::new(gpu, format)?);
    }
    Ok(&made[index])
}

/// Number of images of a picture of `size` pixels.
fn levels(size: [u32; 2]) -> u32 {
    let longest = f64::from(size[0].max(size[1]));
    ((longest.log2().round() as u32).saturating_sub(2)).clamp(1, MOST_LEVELS)
}

impl Pass {
    /// The same for pictures of another size; it compiles nothing.
    pub fn resized(&self) -> Self {
        Self {
            kernels: self.kernels.clone(),
            pyramid: None,
        }
    }

    /// Begins to compile what pictures of this format need, if glow is on.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        format: wgpu::TextureFormat,
        settings: &Settings,
    ) -> Result<(), GpuError> {
        if settings.is_on() {
            kernels(&mut self.kernels, gpu, format)?;
        }
        Ok(())
    }

    /// Scatters the light of a picture of `size` pixels: pass `picture.glow`. `tangent`: that of half its vertical field of
    /// view. Returns the picture, which is `radiance` if glow is off.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        radiance: &wgpu::TextureView,
        size: [u32; 2],
        tangent: f32,
        settings: &Settings,
    ) -> Result<wgpu::TextureView, GpuError> {
        if !settings.is_on() {
            self.pyramid = None;
            return Ok(radiance.clone());
        }
        let gpu = frame.gpu;
        let format = radiance.texture().format();
        let kernels = kernels(&mut self.kernels, gpu, format)?;
        let pyramid = match self.pyramid.take() {
            Some(made) if made.format == format => self.pyramid.insert(made),
            _ => self.pyramid.insert(Pyramid::new(gpu, size, format)?),
        };
        // Parallel rays have no angles: as if the view were 45 degrees wide.
        let tangent = if tangent > 0.0 { tangent } else { TANGENT };
        let pixel = 2.0 * tangent / size[1] as f32;
        let images = &pyramid.images;
        let weights = match &mut pyramid.weights {
            Some((of, weights)) if *of == pixel => weights,
            other => {
                let weights = scattering::weights(pixel.into(), images.len() as u32);
                &mut other.insert((pixel, weights)).1
            }
        };
        let strength = settings.strength;
        frame.compute("picture.glow", |pass| {
            let mut run = |kernel: &Kernel, finer, coarser, level: LevelUniform, written| {
                let uniform = gpu.constant("glow.level", &level)?;
                let resources: [Named<'_>; 4] = [
                    ("finer_unfilterable", finer),
                    ("coarser_unfilterable", coarser),
                    ("level", &uniform),
                    ("written", written),
                ];
                let [width, height] = level.size;
                kernel.run(pass, None, &resources, [width, height, 1])
            };
            let mut finer = radiance;
            for (index, image) in images.iter().enumerate() {
                let level = LevelUniform {
                    size: image.size,
                    coarse_size: image.size,
                    is_picture: (index == 0).into(),
                    ..LevelUniform::zeroed()
                };
                run(&kernels.down, finer, finer, level, &image.made_smaller)?;
                finer = &image.made_smaller;
            }
            for (index, coarser) in images.iter().enumerate().rev() {
                let is_coarsest = index + 1 == images.len();
                let mut level = LevelUniform {
                    coarse_size: coarser.size,
                    scattered: match is_coarsest {
                        true => weights.levels[index] as f32,
                        false => 1.0,
                    },
                    ..LevelUniform::zeroed()
                };
                let (finer, written) = match index.checked_sub(1) {
                    Some(below) => {
                        level.size = images[below].size;
                        level.own = weights.levels[below] as f32;
                        (&images[below].made_smaller, &images[below].sum)
                    }
                    None => {
                        level.size = size;
                        level.own = 1.0 - strength + strength * weights.own as f32;
                        level.near = strength * weights.near as f32;
                        level.scattered *= strength;
                        level.is_picture = 1;
                        (radiance, &pyramid.result)
                    }
                };
                run(&kernels.up, finer, &coarser.sum, level, written)?;
            }
            Ok(())
        })?;
        Ok(pyramid.result.clone())
    }
}
