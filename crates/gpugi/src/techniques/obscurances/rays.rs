//! Sampling by rays from every texel.

use std::ops::Range;

use super::Settings;
use super::gpu::SettingsUniform;
use crate::capture::atlas::{AtlasCapture, AtlasLookup, tiles_of};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named};
use crate::scene::GpuScene;
use crate::shader;

/// Rays per step: about 40 ms on a small GPU.
const RAYS_OF_STEP: u32 = 1 << 22;
/// Most rays per texel and step, however few texels there are.
const MOST_RAYS: u32 = 256;

/// Takes samples by rays.
#[derive(Debug)]
pub(super) struct Rays {
    kernel: Kernel,
    /// Where triangles find the texels that are hit.
    atlas: wgpu::Buffer,
    /// Number of a piece and range of its points, per tile.
    tiles: Vec<(usize, Range<u32>)>,
    /// Rays per point and step.
    at_once: u32,
}

impl Rays {
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        capture: &AtlasCapture,
        settings: &Settings,
        lookup: &AtlasLookup,
    ) -> Result<Self, GpuError> {
        let [_, transmits, _] = scene.ray_features();
        let transmits = ("SCENE_TRANSMITS", f64::from(u8::from(transmits)));
        let constants = [transmits, super::solution::colored(settings)];
        let kernel = scene.ray_kernel(gpu, &shader!("techniques.obscurances.rays"), &constants)?;
        let pieces = capture.points().map(|points| points.count);
        let tiles = tiles_of(pieces, RAYS_OF_STEP);
        let most = tiles.iter().map(|(_, points)| points.len() as u32).max();
        Ok(Self {
            atlas: lookup.words.clone(),
            kernel,
            tiles,
            at_once: (RAYS_OF_STEP / most.unwrap_or(1).max(1))
                .clamp(1, settings.directions.min(MOST_RAYS)),
        })
    }

    /// Number of tiles, whose texels are sampled together.
    pub fn tiles(&self) -> u32 {
        self.tiles.len() as u32
    }

    /// Most rays per texel and step.
    pub fn at_once(&self) -> u32 {
        self.at_once
    }

    /// The texels of a tile.
    pub fn texels_of(&self, capture: &AtlasCapture, tile: u32) -> Range<usize> {
        let (piece, points) = &self.tiles[tile as usize];
        let first = capture.pieces()[*piece].rows.start as usize * capture.size as usize;
        first + points.start as usize..first + points.end as usize
    }

    /// Takes some samples of a tile; returns the number of their rays.
    pub fn take(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        capture: &AtlasCapture,
        texels: &wgpu::Buffer,
        (tile, samples): (u32, &Range<u32>),
        base: SettingsUniform,
    ) -> Result<u64, GpuError> {
        let gpu = frame.gpu;
        let (piece, points) = &self.tiles[tile as usize];
        let piece = &capture.pieces()[*piece];
        let settings = SettingsUniform {
            first_texel: piece.rows.start * capture.size,
            first_point: points.start,
            end_point: points.end,
            first_sample: samples.start,
            end_sample: samples.end,
            ..base
        };
        let settings = gpu.constant("obscurances", &settings)?;
        let resources: [Named<'_>; 4] = [
            ("settings", &settings),
            ("points", &piece.points.points),
            ("texels", texels),
            ("atlas", &self.atlas),
        ];
        let (name, scene) = ("obscurances.rays", Some(&scene.ray_bind_group));
        let count = [points.len() as u32, 1, 1];
        frame.run(name, &self.kernel, scene, &resources, count)?;
        Ok(points.len() as u64 * samples.len() as u64)
    }
}
