//! Texels chosen by their power, on the GPU alone: those that shoot, and those that light-sampled rays are aimed at.

use super::gpu::{CHILDREN, Chosen, Level, MOST_CHOSEN};
use super::solution::ForStep;
use crate::capture::atlas::AtlasLookup;
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::scene::GpuScene;
use crate::shader;

/// Chooses texels.
#[derive(Debug)]
pub(super) struct Choosing {
    /// Bytes of its buffers.
    pub bytes: u64,
    power: Kernel,
    sum: Kernel,
    choose: Kernel,
    /// Bind group of the atlas lookup in `choose`.
    corners: wgpu::BindGroup,
    levels: Vec<(u32, wgpu::BindGroup)>,
    pieces: Vec<PieceGroups>,
}

/// Bind groups for one piece. `power_texels` and `choose_texels`: by the index of the buffer that holds the last
/// iterate.
#[derive(Debug)]
struct PieceGroups {
    count: u32,
    power: wgpu::BindGroup,
    choose: wgpu::BindGroup,
    power_texels: [wgpu::BindGroup; 2],
    choose_texels: [wgpu::BindGroup; 2],
}

/// Creates the buffer for the chosen texels, large enough for one iterate.
///
/// # Errors
/// [`GpuError::OutOfMemory`].
pub(super) fn room(gpu: &Gpu) -> Result<wgpu::Buffer, GpuError> {
    let bytes = u64::from(MOST_CHOSEN) * size_of::<Chosen>() as u64;
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::UNIFORM;
    gpu.buffer("chosen texels [bytes]", bytes, usage)
}

impl Choosing {
    /// Prepares to choose among `texels` texels, which `lookup` finds, and write them to `chosen`; `steps`: the inputs of each piece's passes.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        lookup: &AtlasLookup,
        texels: u32,
        iterates: &[wgpu::Buffer; 2],
        steps: &[ForStep<'_>],
        chosen: &wgpu::Buffer,
    ) -> Result<Self, GpuError> {
        let kernel = |shader| Kernel::new(gpu, &shader, "main", None);
        let power = kernel(shader!("techniques.radiosity.power"))?;
        let sum = kernel(shader!("techniques.radiosity.sum"))?;
        let choose = scene.ray_kernel(gpu, &shader!("techniques.radiosity.choose"), &[])?;
        let corners = choose.bind(gpu, 2, &[("atlas", lookup.words.as_entire_binding())])?;
        let mut nodes = vec![texels];
        while nodes.last().is_some_and(|count| *count > 1) {
            nodes.extend(nodes.last().map(|count| count.div_ceil(CHILDREN)));
        }
        let storage = wgpu::BufferUsages::STORAGE;
        let all: u64 = nodes.iter().map(|&count| u64::from(count)).sum();
        let pyramid = gpu.buffer("pyramid of power [bytes]", all * 4, storage)?;
        let mut fine = 0;
        let mut levels = Vec::new();
        for pair in nodes.windows(2) {
            let level = Level {
                fine,
                fine_count: pair[0],
                coarse: fine + pair[0],
                padding: 0,
            };
            fine = level.coarse;
            let level = gpu.uniform("level of a pyramid", &level)?;
            let resources = [
                ("level", level.as_entire_binding()),
                ("pyramid", pyramid.as_entire_binding()),
            ];
            levels.push((pair[1], sum.bind(gpu, 0, &resources)?));
        }
        let piece = |step: &ForStep<'_>| {
            let points = [
                ("work", step.work.as_entire_binding()),
                ("points", step.points.as_entire_binding()),
            ];
            let power_of = |last: usize| {
                let resources = [
                    ("before", iterates[last].as_entire_binding()),
                    ("pyramid", pyramid.as_entire_binding()),
                ];
                power.bind(gpu, 3, &resources)
            };
            let choose_of = |last: usize| {
                let resources = [
                    ("before", iterates[last].as_entire_binding()),
                    ("pyramid", pyramid.as_entire_binding()),
                    ("chosen_texels", chosen.as_entire_binding()),
                ];
                choose.bind(gpu, 3, &resources)
            };
            Ok(PieceGroups {
                count: step.count,
                power: power.bind(gpu, 1, &points)?,
                choose: choose.bind(gpu, 1, &points)?,
                power_texels: [power_of(0)?, power_of(1)?],
                choose_texels: [choose_of(0)?, choose_of(1)?],
            })
        };
        Ok(Self {
            pieces: steps.iter().map(piece).collect::<Result<_, GpuError>>()?,
            bytes: pyramid.size() + chosen.size(),
            power,
            sum,
            choose,
            corners,
            levels,
        })
    }

    /// Chooses `count` texels: pass `radiosity.choose`. `last`: index of the buffer that holds the last iterate.
    pub fn record(&self, frame: &mut Frame<'_>, scene: &GpuScene, last: usize, count: u32) {
        frame.compute("radiosity.choose", |pass| {
            for piece in &self.pieces {
                let groups = [(1, &piece.power), (3, &piece.power_texels[last])];
                self.power.dispatch(pass, &groups, [piece.count, 1, 1]);
            }
            for (count, level) in &self.levels {
                self.sum.dispatch(pass, &[(0, level)], [*count, 1, 1]);
            }
            for piece in &self.pieces {
                let groups = [
                    (0, &scene.ray_bind_group),
                    (1, &piece.choose),
                    (2, &self.corners),
                    (3, &piece.choose_texels[last]),
                ];
                self.choose.dispatch(pass, &groups, [count, 1, 1]);
            }
        });
    }
}
