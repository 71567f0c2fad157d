//! Tiles of an image: each has a film of its own, small enough for a binding.

use super::photons::{self, PhotonFilm, Photons};
use super::wavefront::Wavefront;
use crate::gpu::{Gpu, GpuError, Kernel, read_buffer};

/// Size of `Pixel` in reference/film.wesl (bytes).
const PIXEL_BYTES: u64 = 32;
/// Pixels per workgroup, and pixels that one workgroup of reference/noise.wesl sums.
const BLOCK_SIDE: u32 = 8;
pub(super) const BLOCK_PIXELS: u32 = BLOCK_SIDE * BLOCK_SIDE;
pub(super) const NOISE_PIXELS: u32 = 1024;

/// A rectangle of the image with its own film.
#[derive(Debug)]
pub(super) struct Tile {
    pub origin: [u32; 2],
    pub size: [u32; 2],
    pub film: wgpu::Buffer,
    pub film_group: wgpu::BindGroup,
    pub sums: wgpu::Buffer,
    pub sums_group: wgpu::BindGroup,
    /// The light tracer's part.
    pub photons: Option<PhotonFilm>,
}

impl Tile {
    /// Blocks that cover the tile.
    pub fn blocks(&self) -> u32 {
        self.size[0].div_ceil(BLOCK_SIDE) * self.size[1].div_ceil(BLOCK_SIDE)
    }

    /// Number of pixels.
    pub fn pixels(&self) -> u32 {
        self.size[0] * self.size[1]
    }

    /// Mean radiance of each pixel.
    pub fn radiance(&self, gpu: &Gpu) -> Result<Vec<[f32; 3]>, GpuError> {
        let bytes = u64::from(self.pixels()) * PIXEL_BYTES;
        let film: Vec<[f32; 8]> = read_buffer(gpu, &self.film, bytes)?;
        let mut radiance: Vec<[f32; 3]> = film.iter().map(|one| [one[0], one[1], one[2]]).collect();
        if let Some(photons) = &self.photons {
            for (sum, more) in radiance.iter_mut().zip(photons.radiance(gpu)?) {
                *sum = [0, 1, 2].map(|channel| sum[channel] + more[channel]);
            }
        }
        Ok(radiance)
    }
}

/// Bytes of the sums of reference/noise.wesl over a tile of `pixels` pixels.
pub(super) fn sums_bytes(pixels: u32) -> u64 {
    u64::from(pixels.div_ceil(NOISE_PIXELS)) * 12
}

/// Creates the films that cover the whole image.
pub(super) fn tiles(
    gpu: &Gpu,
    size: [u32; 2],
    tile_side: u32,
    (wavefront, light_tracer): (&Wavefront, Option<&Photons>),
    parameters: &wgpu::Buffer,
    noise_kernel: &Kernel,
) -> Result<Vec<Tile>, GpuError> {
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    let bytes = PIXEL_BYTES + light_tracer.map_or(0, |_| photons::BYTES);
    let needed = pixels.saturating_mul(bytes);
    let no_memory = || GpuError::OutOfMemory {
        pass: format!(
            "the film of {} x {} pixels, which takes {needed} bytes",
            size[0], size[1]
        ),
    };
    // A software adapter uses the host's memory, and the host may promise memory that it does not have. Check first
    // that the memory can be reserved, including that for the image on the host.
    let on_host = match gpu.adapter.device_type {
        wgpu::DeviceType::Cpu => needed,
        _ => pixels.saturating_mul(12),
    };
    let mut probe: Vec<u8> = Vec::new();
    probe
        .try_reserve_exact(usize::try_from(on_host).unwrap_or(usize::MAX))
        .map_err(|_| no_memory())?;
    drop(probe);
    let mut tiles = Vec::new();
    for y in (0..size[1]).step_by(tile_side as usize) {
        for x in (0..size[0]).step_by(tile_side as usize) {
            let extent = [(size[0] - x).min(tile_side), (size[1] - y).min(tile_side)];
            let pixels = extent[0] * extent[1];
            let storage =
                |label: &str, bytes| gpu.buffer(label, bytes, wgpu::BufferUsages::STORAGE);
            let film = storage("path-tracer.film [bytes]", u64::from(pixels) * PIXEL_BYTES)
                .map_err(|error| match error {
                    GpuError::OutOfMemory { .. } => no_memory(),
                    other => other,
                })?;
            let sums = storage("path-tracer.sums [bytes]", sums_bytes(pixels))?;
            let photons = light_tracer
                .map(|photons| photons.film(gpu, pixels))
                .transpose()?;
            let photon_pixels = photons.as_ref().map_or(&film, |film| &film.pixels);
            tiles.push(Tile {
                origin: [x, y],
                size: extent,
                film_group: wavefront.film_group(gpu, parameters, &film)?,
                sums_group: noise_kernel.bind(
                    gpu,
                    1,
                    &[
                        ("pixels", film.as_entire_binding()),
                        ("sums", sums.as_entire_binding()),
                        ("light_film", photon_pixels.as_entire_binding()),
                    ],
                )?,
                photons,
                film,
                sums,
            });
        }
    }
    Ok(tiles)
}
