//! Sampling by rays from every texel.

use std::ops::Range;

use super::Settings;
use super::gpu::SettingsUniform;
use crate::capture::atlas::{AtlasCapture, AtlasLookup, AtlasPiece};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
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
    /// Bind group of the atlas lookup, for the texels that are hit.
    corners: wgpu::BindGroup,
    /// The points that each step handles: number of a piece and range of its points.
    chunks: Vec<(usize, Range<u32>)>,
    /// Rays per point and step.
    at_once: u32,
    directions: u32,
}

impl Rays {
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        capture: &AtlasCapture,
        settings: &Settings,
        lookup: &AtlasLookup,
    ) -> Result<Self, GpuError> {
        let [_, transmits] = scene.passages();
        let transmits = ("SCENE_TRANSMITS", f64::from(u8::from(transmits)));
        let constants = [transmits, super::solution::colored(settings)];
        let kernel = scene.ray_kernel(gpu, &shader!("techniques.obscurances.rays"), &constants)?;
        let chunks_of = |(number, piece): (usize, &AtlasPiece)| {
            let count = piece.points.count;
            let firsts = (0..count).step_by(RAYS_OF_STEP as usize);
            firsts.map(move |first| (number, first..count.min(first + RAYS_OF_STEP)))
        };
        let chunks: Vec<_> = capture
            .pieces()
            .iter()
            .enumerate()
            .flat_map(chunks_of)
            .collect();
        let most = chunks.iter().map(|(_, points)| points.len() as u32).max();
        Ok(Self {
            corners: kernel.bind(gpu, 2, &[("atlas", lookup.words.as_entire_binding())])?,
            kernel,
            chunks,
            at_once: (RAYS_OF_STEP / most.unwrap_or(1).max(1))
                .clamp(1, settings.directions.min(MOST_RAYS)),
            directions: settings.directions,
        })
    }

    /// Number of steps until every texel has all its samples.
    pub fn steps(&self) -> u64 {
        self.chunks.len() as u64 * u64::from(self.directions.div_ceil(self.at_once))
    }

    /// Takes one step; returns the number of its rays.
    pub fn step(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        capture: &AtlasCapture,
        texels: &wgpu::Buffer,
        number: u64,
        base: SettingsUniform,
    ) -> Result<u64, GpuError> {
        let gpu = frame.gpu;
        let chunks = self.chunks.len() as u64;
        let (piece, points) = &self.chunks[(number % chunks) as usize];
        let piece = &capture.pieces()[*piece];
        let first_sample = (number / chunks) as u32 * self.at_once;
        let settings = SettingsUniform {
            first_texel: piece.rows.start * capture.size,
            first_point: points.start,
            end_point: points.end,
            first_sample,
            end_sample: (first_sample + self.at_once).min(self.directions),
            ..base
        };
        let rays = settings.end_sample - settings.first_sample;
        let settings = gpu.uniform("obscurances", &settings)?;
        let resources = [
            ("settings", settings.as_entire_binding()),
            ("points", piece.points.points.as_entire_binding()),
            ("texels", texels.as_entire_binding()),
        ];
        let group = self.kernel.bind(gpu, 1, &resources)?;
        frame.compute("obscurances.rays", |pass| {
            let groups = [(0, &scene.ray_bind_group), (1, &group), (2, &self.corners)];
            self.kernel
                .dispatch(pass, &groups, [points.len() as u32, 1, 1]);
        });
        Ok(points.len() as u64 * u64::from(rays))
    }
}
