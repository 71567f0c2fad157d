//! What mirrors and glass show of caustics of lights without extent, and of the light that these throw on: paths
//! `LS.*[DGV].*SE`. Rays from the eye never find the light there, and photons never the eye. So the eye is followed through
//! mirrors and glass to a point of a surface, and photons that land within a disc around the point light it: stochastic
//! progressive photon mapping (Hachisuka and Jensen 2009), in the form of Knaus and Zwicker, "Progressive photon mapping:
//! a probabilistic approach" (2011), whose discs shrink from sample to sample without statistics.
//!
//! A picture is blurred by the discs, so its error is no noise alone: the picture is consistent, but not unbiased.

#[cfg(test)]
mod tests;

use bytemuck::{Pod, Zeroable};

use super::{Tile, bind};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions};
use crate::reference::wavefront::Named;
use crate::scene::GpuScene;
use crate::shader;

/// Sizes in reference/photons/merging/points.wesl (bytes): of `Round`, the coarse grid and a row.
const HEADER_BYTES: u64 = size_of::<Round>() as u64;
const COARSE_BYTES: u64 = 4 << 15;
const ROW_BYTES: u64 = 16;
/// Least points of a round: a sample of a small tile has few, which would leave most of a GPU idle.
const POINTS: u32 = 1 << 20;
const POINTS_IN_SOFTWARE: u32 = 1 << 14;
/// The largest radius, in diagonals of the scene: larger ones take more time. The pixels of small pictures are larger; there,
/// it is the second number over the pixels along a side.
const LARGEST: f32 = 0.005;
const LARGEST_OF_SIDE: f32 = 0.3;
/// Rays that the path to a point takes, about.
const RAYS_OF_POINT: u64 = 2;
/// A cell of the highest level over one of the lowest: `LEVELS` of points.wesl.
const CELL_RATIO: f32 = (1_u32 << 23) as f32;
/// Samples over which the area of discs falls by a third at first. Then it falls as 1 / samples^(1/3), so that the bias and
/// the noise fall at the same pace (Knaus and Zwicker, section 4, alpha = 2/3).
const SAMPLES_OF_FIRST: f32 = 16.0;

/// `Round` of reference/photons/merging/points.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Round {
    first_point: u32,
    head_mask: u32,
    quads: u32,
    points: u32,
    first_sample: u32,
    radius: f32,
    most: f32,
    cell: f32,
}

/// The points that mirrors and glass show of a scene.
#[derive(Debug)]
pub(super) struct Merging {
    follow: Kernel,
    link: Kernel,
    of_eye: wgpu::BindGroup,
    of_follow: wgpu::BindGroup,
    of_link: wgpu::BindGroup,
    /// `shown`: a round, the coarse grid, heads, points.
    pub points: wgpu::Buffer,
    rows_of_point: u64,
    /// Points for which there is room, and heads.
    capacity: u32,
    heads: u32,
    /// Radius of the first discs (pixels).
    radius: f32,
    /// The largest radius (diagonals of the scene).
    largest: f32,
}

impl Merging {
    /// `constants` are those of path_state.wesl and bvh.wesl; `buffers`: `seen`, `settings` and `automaton` of the paths from
    /// the eye. `radius`: of the first discs (pixels). [`Merging::resize`] has to follow.
    pub fn new(
        gpu: &Gpu,
        on_gpu: &GpuScene,
        constants: &[(&str, f64)],
        buffers: &Named<'_>,
        radius: f32,
    ) -> Result<Self, GpuError> {
        let has_transmission = |(name, _): &&(&str, f64)| *name == "HAS_TRANSMISSION";
        let of_link: Vec<_> = constants.iter().filter(has_transmission).copied().collect();
        let rows_of_point = match of_link.iter().any(|(_, value)| *value != 0.0) {
            true => 5,
            false => 4,
        };
        // Indices are in range: those of the scene's tables because the host wrote them, those of points because there are
        // as many as the host made room for.
        let unchecked = true;
        let options = |constants| KernelOptions {
            constants,
            unchecked,
        };
        let layout = Some(&on_gpu.ray_layout);
        let of_follow: Vec<_> = constants
            .iter()
            .filter(|(name, _)| *name != "HAS_STRAIGHT")
            .copied()
            .collect();
        let follow = shader!("reference.photons.merging.follow");
        let follow = Kernel::with_options(gpu, &follow, "main", layout, &options(&of_follow))?;
        let link = shader!("reference.photons.merging.link");
        let link = Kernel::with_options(gpu, &link, "main", None, &options(&of_link))?;
        let points = buffer(gpu, rows_of_point, [1, 4])?;
        Ok(Self {
            of_eye: bind(gpu, &follow, 1, buffers)?,
            of_follow: bind(gpu, &follow, 2, &[("shown", &points)])?,
            of_link: bind(gpu, &link, 2, &[("words", &points)])?,
            follow,
            link,
            points,
            rows_of_point,
            capacity: 0,
            heads: 4,
            radius,
            largest: LARGEST,
        })
    }

    /// Makes room for tiles of `size` pixels, of a picture of so many `pixels`.
    pub fn resize(&mut self, gpu: &Gpu, size: [u32; 2], pixels: f64) -> Result<(), GpuError> {
        self.largest = LARGEST.max(LARGEST_OF_SIDE / pixels.sqrt() as f32);
        let least = match gpu.adapter.device_type {
            wgpu::DeviceType::Cpu => POINTS_IN_SOFTWARE,
            _ => POINTS,
        };
        let capacity = quads(size).max(least);
        let heads = capacity.next_power_of_two().max(4);
        if capacity != self.capacity {
            self.points = buffer(gpu, self.rows_of_point, [capacity, heads])?;
            let (follow, link) = (&self.follow, &self.link);
            self.of_follow = bind(gpu, follow, 2, &[("shown", &self.points)])?;
            self.of_link = bind(gpu, link, 2, &[("words", &self.points)])?;
            (self.capacity, self.heads) = (capacity, heads);
        }
        Ok(())
    }

    /// Samples per pixel of a round of a tile.
    pub fn samples_of_round(&self, tile: &Tile) -> u32 {
        self.capacity / quads(tile.size)
    }

    /// Points of a round of `samples` samples of a tile's pixels.
    pub fn points_of_round(tile: &Tile, samples: u32) -> u32 {
        quads(tile.size) * samples
    }

    /// Continues a round after `done` of its points, and traces no more than about `rays` rays; returns their number. The
    /// last points make the grid. `first_sample` and `samples` are those of the round.
    pub fn begin(
        &self,
        gpu: &Gpu,
        scene: &GpuScene,
        tile: &Tile,
        [first_sample, samples]: [u32; 2],
        done: u32,
        rays: u64,
    ) -> Result<u32, GpuError> {
        let most = self.largest * scene.diagonal();
        let shrunk = (1.0 + first_sample as f32 / SAMPLES_OF_FIRST).powf(-1.0 / 6.0);
        let round = Round {
            first_point: done,
            head_mask: self.heads - 1,
            quads: quads(tile.size),
            points: Self::points_of_round(tile, samples),
            first_sample,
            radius: self.radius * shrunk,
            most,
            cell: 2.0 * most / CELL_RATIO,
        };
        let left = round.points - done;
        let points = u64::from(left).min((rays / RAYS_OF_POINT).max(1)) as u32;
        gpu.write(&self.points, 0, std::slice::from_ref(&round));
        let mut frame = Frame::new(gpu, false);
        frame.compute("photons.follow", |pass| {
            let groups = [
                (0, &scene.ray_bind_group),
                (1, &self.of_eye),
                (2, &self.of_follow),
            ];
            self.follow.dispatch(pass, &groups, [points, 1, 1]);
        });
        if points == left {
            let grids = COARSE_BYTES + u64::from(self.heads) * 4;
            frame.clear_range(&self.points, HEADER_BYTES..HEADER_BYTES + grids);
            frame.compute("photons.link", |pass| {
                let all = [round.points, 1, 1];
                self.link.dispatch(pass, &[(2, &self.of_link)], all);
            });
        }
        frame.submit()?;
        Ok(points)
    }
}

/// Squares of 2 x 2 pixels. Each has one point per sample.
fn quads([width, height]: [u32; 2]) -> u32 {
    width.div_ceil(2) * height.div_ceil(2)
}

/// Room for a round, the coarse grid, heads and points.
fn buffer(
    gpu: &Gpu,
    rows_of_point: u64,
    [points, heads]: [u32; 2],
) -> Result<wgpu::Buffer, GpuError> {
    let of_points = u64::from(points) * rows_of_point * ROW_BYTES;
    let bytes = HEADER_BYTES + COARSE_BYTES + u64::from(heads) * 4 + of_points;
    gpu.buffer("photons.points [bytes]", bytes, wgpu::BufferUsages::STORAGE)
}
