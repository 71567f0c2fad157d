//! Obscurances as a factor on the light of other techniques.

use super::Solution;
use crate::capture::atlas::TexelGather;
use crate::capture::{Receiver, SURFACE_POINT_BYTES, Target};
use crate::gpu::{Frame, Gpu, GpuError, Named};
use crate::scene::GpuScene;
use crate::shader;
use crate::stage::Stage;

/// Looks W and the open directions up at the points of receivers.
#[derive(Debug)]
pub struct Attenuation {
    /// The texels that it reads, and where triangles find them.
    texels: wgpu::Buffer,
    atlas: wgpu::Buffer,
    gather: TexelGather,
    factors: Target,
}

impl Attenuation {
    /// Follows the present obscurances, if there are any.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn follow(
        stage: &mut Stage<wgpu::Buffer, Self>,
        gpu: &Gpu,
        scene: &GpuScene,
        solution: Option<&Solution>,
    ) -> Result<(), GpuError> {
        let Some(solution) = solution else {
            stage.clear();
            return Ok(());
        };
        let [texels, _] = solution.buffers();
        let made = stage.keep(texels.clone(), |_| {
            let constants = [solution.least_samples()];
            let shader = shader!("techniques.obscurances.factor");
            Ok(Self {
                gather: TexelGather::new(gpu, scene, &shader, &constants)?,
                texels: texels.clone(),
                atlas: solution.lookup.words.clone(),
                factors: Target::new(gpu, 1)?,
            })
        });
        made.map(drop)
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
        let (name, atlas) = ("obscurances.factor", &self.atlas);
        let kept: [Named<'_>; 2] = [("atlas", atlas), ("texels", &self.texels)];
        self.gather
            .record(frame, name, scene, None, &receiver, &kept)?;
        Ok(&self.factors.radiance)
    }
}
