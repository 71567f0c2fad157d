//! Tiles of an image: each has a film of its own, small enough for a binding.

use super::features::Looker;
use super::photons::{self, PhotonFilm, Photons};
use super::picture::Place;
use super::wavefront::Wavefront;
use crate::denoise::Features;
use crate::gpu::{Gpu, GpuError, Kernel};

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
    /// Where it lies: `Place` of picture.rs.
    pub place: wgpu::Buffer,
    pub film: wgpu::Buffer,
    pub film_group: wgpu::BindGroup,
    pub sums: wgpu::Buffer,
    pub sums_group: wgpu::BindGroup,
    pub shown_group: wgpu::BindGroup,
    /// The light tracer's part.
    pub photons: Option<PhotonFilm>,
    /// What its pixels see of surfaces, if that is kept.
    pub features: Option<wgpu::Buffer>,
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
}

/// Bytes of the sums of reference/noise.wesl over a tile of `pixels` pixels.
pub(super) fn sums_bytes(pixels: u32) -> u64 {
    u64::from(pixels.div_ceil(NOISE_PIXELS)) * 16
}

/// Creates the films that cover the whole image.
pub(super) fn tiles(
    gpu: &Gpu,
    size: [u32; 2],
    tile_side: u32,
    (wavefront, light_tracer, looker): (&Wavefront, Option<&Photons>, Option<&Looker>),
    parameters: &wgpu::Buffer,
    (noise_kernel, shown_kernel): (&Kernel, &Kernel),
) -> Result<Vec<Tile>, GpuError> {
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    let of_features = looker.map_or(0, |_| size_of::<Features>() as u64);
    let bytes = PIXEL_BYTES + light_tracer.map_or(0, |_| photons::BYTES) + of_features;
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
            let place = Place {
                tile_x: x,
                tile_y: y,
                tile_width: extent[0],
                tile_height: extent[1],
                image_width: size[0],
            };
            let place = gpu.uniform("path-tracer.place", &place)?;
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
                shown_group: shown_kernel.bind(
                    gpu,
                    1,
                    &[
                        ("place", place.as_entire_binding()),
                        ("pixels", film.as_entire_binding()),
                        ("light_film", photon_pixels.as_entire_binding()),
                    ],
                )?,
                photons,
                place,
                features: looker.map(|looker| looker.film(gpu, pixels)).transpose()?,
                film,
                sums,
            });
        }
    }
    Ok(tiles)
}
