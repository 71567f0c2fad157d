//! Texels chosen by their power, on the GPU alone: those that shoot, and those that light-sampled rays are aimed at.

use super::gpu::{CHILDREN, Chosen, Level, MOST_CHOSEN};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, join};
use crate::scene::GpuScene;
use crate::shader;

/// Chooses texels.
#[derive(Debug)]
pub(super) struct Choosing {
    power: Kernel,
    sum: Kernel,
    choose: Kernel,
    /// Sums of power: of each texel, then of ever more of them.
    pyramid: wgpu::Buffer,
    levels: Vec<Level>,
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
    /// Prepares to choose among `texels` texels.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, texels: u32) -> Result<Self, GpuError> {
        let kernel = |shader| Kernel::new(gpu, &shader, "main", None);
        let mut nodes = vec![texels];
        while nodes.last().is_some_and(|count| *count > 1) {
            nodes.extend(nodes.last().map(|count| count.div_ceil(CHILDREN)));
        }
        let all: u64 = nodes.iter().map(|&count| u64::from(count)).sum();
        let mut fine = 0;
        let levels = nodes.windows(2).map(|pair| {
            let level = Level {
                fine,
                fine_count: pair[0],
                coarse: fine + pair[0],
                padding: 0,
            };
            fine = level.coarse;
            level
        });
        Ok(Self {
            power: kernel(shader!("techniques.radiosity.power"))?,
            sum: kernel(shader!("techniques.radiosity.sum"))?,
            choose: scene.ray_kernel(gpu, &shader!("techniques.radiosity.choose"), &[])?,
            levels: levels.collect(),
            pyramid: gpu.room("pyramid of power [bytes]", all * 4)?,
        })
    }

    /// Bytes of its buffers.
    pub fn bytes(&self) -> u64 {
        self.pyramid.size()
    }

    /// Chooses `count` texels: pass `radiosity.choose`. `pieces`: what passes bind for each piece of the atlas, and its
    /// number of texels.
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        pieces: &[(u32, [Named<'_>; 8])],
        count: u32,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let pyramid: [Named<'_>; 1] = [("pyramid", &self.pyramid)];
        frame.compute("radiosity.choose", |pass| {
            for (texels, of_piece) in pieces {
                let resources = join(of_piece, &pyramid);
                self.power.run(pass, None, &resources, [*texels, 1, 1])?;
            }
            for level in &self.levels {
                let sums = level.fine_count.div_ceil(CHILDREN);
                let level = gpu.constant("level of a pyramid", level)?;
                let resources = join(&pyramid, &[("level", &level)]);
                self.sum.run(pass, None, &resources, [sums, 1, 1])?;
            }
            for (_, of_piece) in pieces {
                let (resources, scene) = (join(of_piece, &pyramid), Some(&scene.ray_bind_group));
                self.choose.run(pass, scene, &resources, [count, 1, 1])?;
            }
            Ok(())
        })
    }
}
