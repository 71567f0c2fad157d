//! Obscurances as a factor on the light of other techniques.

use super::Solution;
use crate::capture::atlas::TexelGather;
use crate::capture::{Receiver, SURFACE_POINT_BYTES, Target};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::scene::GpuScene;
use crate::shader;

/// Looks W and the open directions up at the points of receivers.
#[derive(Debug)]
pub struct Attenuation {
    /// The texels that it reads.
    texels: wgpu::Buffer,
    gather: TexelGather,
    factors: Target,
}

impl Attenuation {
    /// Compiles the pass.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, solution: &Solution) -> Result<Self, GpuError> {
        let [texels, _] = solution.buffers();
        let kept = [
            ("atlas", solution.lookup.words.as_entire_binding()),
            ("texels", texels.as_entire_binding()),
        ];
        let constants = [solution.least_samples()];
        let shader = shader!("techniques.obscurances.factor");
        Ok(Self {
            gather: TexelGather::new(gpu, scene, &shader, &constants, &kept)?,
            texels: texels.clone(),
            factors: Target::new(gpu, 1)?,
        })
    }

    /// Whether it reads this solution.
    pub fn is_of(&self, solution: &Solution) -> bool {
        let [texels, _] = solution.buffers();
        self.texels == *texels
    }

    /// Four floats per point of the receiver, in the order of the points: the mean open direction times the share of a
    /// uniform sky's light that arrives, and W. Pass `obscurances.factor`. Other receivers overwrite it.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
    ) -> Result<&wgpu::Buffer, GpuError> {
        let points = receiver.points.points.size() / SURFACE_POINT_BYTES;
        if self.factors.radiance.size() < 16 * points {
            self.factors = Target::new(frame.gpu, points as u32)?;
        }
        let receiver = Receiver::new(&receiver.points, &self.factors);
        let name = "obscurances.factor";
        self.gather.record(frame, name, scene, None, &receiver)?;
        Ok(&self.factors.radiance)
    }
}
