//! The image so far: as numbers on the host, as a picture to be shown, and how noisy it is.

use std::future::Future;

use bytemuck::{Pod, Zeroable};

use super::PathTracer;
use super::tile::{NOISE_PIXELS, sums_bytes};
use crate::gpu::{Frame, GpuError, ReadBack, begin_read_buffer};
use crate::lighting::LightingError;
use crate::picture::Comparison;

/// `Place` of reference/place.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Place {
    pub tile_x: u32,
    pub tile_y: u32,
    pub tile_width: u32,
    pub tile_height: u32,
    pub image_width: u32,
}

/// `Pixel` of reference/film.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct FilmPixel {
    mean: [f32; 3],
    count: u32,
    m2: [f32; 3],
    segments: u32,
}

/// `PhotonPixel` of photons/film.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct PhotonPixel {
    mean: [f32; 3],
    weight: f32,
    m2: [f32; 3],
    passes: u32,
}

/// Sums of reference/noise.wesl over all tiles, on their way to the host.
#[derive(Debug)]
pub(super) struct Sums(Vec<ReadBack<Vec<[u32; 4]>>>);

/// What [`Sums`] hold, of all pixels.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Noise {
    /// Sum of the relative variances of both tracers, and of the light tracer alone.
    pub variance: f64,
    pub of_photons: f64,
    segments: u64,
}

impl Sums {
    /// The sums, once they have arrived.
    pub fn get(&self) -> Option<Result<Noise, GpuError>> {
        let of_tiles: Option<Vec<_>> = self.0.iter().map(ReadBack::get).collect();
        let of_tiles: Result<Vec<_>, _> = of_tiles?.into_iter().collect();
        Some(of_tiles.map(|tiles| summed(tiles.into_iter())))
    }

    pub fn wait(&self) -> Result<Noise, GpuError> {
        let of_tiles: Result<Vec<_>, _> = self.0.iter().map(ReadBack::wait).collect();
        Ok(summed(of_tiles?.into_iter()))
    }
}

fn summed(tiles: impl Iterator<Item = Vec<[u32; 4]>>) -> Noise {
    let mut noise = Noise::default();
    for [variance, of_photons, low, high] in tiles.flatten() {
        noise.variance += f64::from(f32::from_bits(variance));
        noise.of_photons += f64::from(f32::from_bits(of_photons));
        noise.segments += u64::from(low) + (u64::from(high) << 16);
    }
    noise
}

impl PathTracer {
    /// Estimated relative mean squared error of the image so far, computed from the variance of its samples as
    /// docs/measuring.md defines it. This is an upper estimate, because the samples are spread more evenly than
    /// independent ones.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn noise(&self) -> Result<f64, LightingError> {
        Ok(self.begin_sums()?.wait()?.variance / self.pixels())
    }

    /// Path segments (closest-hit rays) followed so far. Each pixel counts up to 2^32.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn segments(&self) -> Result<u64, LightingError> {
        Ok(self.begin_sums()?.wait()?.segments)
    }

    /// Sums of relative variances and of segments, one per workgroup of reference/noise.wesl.
    pub(super) fn begin_sums(&self) -> Result<Sums, GpuError> {
        let of_tile = |tile: &super::tile::Tile| {
            let mut frame = Frame::new(&self.gpu, false);
            frame.compute("path-tracer.noise", |pass| {
                let invocations = tile.pixels().div_ceil(NOISE_PIXELS) * 64;
                self.noise_kernel
                    .dispatch(pass, &[(1, &tile.sums_group)], [invocations, 1, 1]);
            });
            let sums = frame.read_back(&tile.sums, sums_bytes(tile.pixels()))?;
            frame.submit()?;
            Ok(sums)
        };
        let all: Result<Vec<_>, GpuError> = self.tiles.iter().map(of_tile).collect();
        Ok(Sums(all?))
    }

    /// Mean linear radiance, three floats per pixel, in rows from top to bottom. Pixels without a sample are black.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn radiance(&self) -> Result<Vec<f32>, LightingError> {
        let radiance = self.begin_radiance()?;
        self.gpu.wait()?;
        Ok(pollster::block_on(radiance)?)
    }

    /// The future of [`PathTracer::radiance`]: of the image so far, whatever is added before it resolves.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn begin_radiance(
        &self,
    ) -> Result<impl Future<Output = Result<Vec<f32>, GpuError>> + use<>, LightingError> {
        self.begin_pixels(|pixel| pixel.mean, |photons| photons.mean)
    }

    /// Estimated variance of [`PathTracer::radiance`], in the same order.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn variance(&self) -> Result<Vec<f32>, LightingError> {
        // `variance_of_mean` of film.wesl and of photons/film.wesl.
        let variance = self.begin_pixels(
            |pixel| {
                let n = pixel.count as f32;
                pixel.m2.map(|m2| m2 / (n * (n - 1.0)).max(1.0))
            },
            |photons| {
                let divisor = (photons.passes.max(2) - 1) as f32 * photons.weight;
                photons.m2.map(|m2| m2 / divisor.max(1e-20))
            },
        )?;
        self.gpu.wait()?;
        Ok(pollster::block_on(variance)?)
    }

    /// Three floats per pixel, in rows from top to bottom: the sum of what `of_paths` and `of_photons` make of both films.
    fn begin_pixels(
        &self,
        of_paths: fn(FilmPixel) -> [f32; 3],
        of_photons: fn(PhotonPixel) -> [f32; 3],
    ) -> Result<impl Future<Output = Result<Vec<f32>, GpuError>> + use<>, LightingError> {
        let [width, height] = self.size.map(|side| side as usize);
        let mut tiles = Vec::new();
        for tile in &self.tiles {
            let bytes = u64::from(tile.pixels()) * 32;
            let film = begin_read_buffer::<FilmPixel>(&self.gpu, &tile.film, bytes)?;
            let photons = tile.photons.as_ref();
            let photons = photons
                .map(|film| begin_read_buffer::<PhotonPixel>(&self.gpu, &film.pixels, bytes));
            tiles.push((tile.origin, tile.size, film, photons.transpose()?));
        }
        Ok(async move {
            let mut picture = vec![0.0; width * height * 3];
            for (origin, size, film, photons) in tiles {
                let [x, y] = origin.map(|first| first as usize);
                let mut pixels: Vec<_> = film.await?.into_iter().map(of_paths).collect();
                if let Some(photons) = photons {
                    for (sum, more) in pixels.iter_mut().zip(photons.await?) {
                        let more = of_photons(more);
                        (0..3).for_each(|channel| sum[channel] += more[channel]);
                    }
                }
                for (row, pixels) in pixels.chunks_exact(size[0] as usize).enumerate() {
                    let first = (y + row) * width + x;
                    for (target, pixel) in picture[first * 3..].chunks_exact_mut(3).zip(pixels) {
                        target.copy_from_slice(pixel);
                    }
                }
            }
            Ok(picture)
        })
    }

    /// Makes the image so far the reference of a comparison of its size, without the host.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn show(&self, comparison: &Comparison) -> Result<(), LightingError> {
        let picture = [("picture", comparison.reference().as_entire_binding())];
        let picture = self.shown_kernel.bind(&self.gpu, 2, &picture)?;
        let mut frame = Frame::new(&self.gpu, false);
        frame.compute("path-tracer.shown", |pass| {
            for tile in &self.tiles {
                let groups = [(1, &tile.shown_group), (2, &picture)];
                let invocations = [tile.pixels(), 1, 1];
                self.shown_kernel.dispatch(pass, &groups, invocations);
            }
        });
        frame.submit()?;
        Ok(())
    }
}
