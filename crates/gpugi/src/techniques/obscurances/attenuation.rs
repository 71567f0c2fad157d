//! Obscurances as a factor on the light of other techniques.

use super::Solution;
use crate::capture::atlas::TexelGather;
use crate::capture::{Receiver, SURFACE_POINT_BYTES, Target};
use crate::gpu::{Frame, Gpu, GpuError, Named};
use crate::scene::GpuScene;
use crate::shader;
use crate::techniques::{Openness, OpennessLookup};

/// Looks W and the open directions up at the points of receivers.
#[derive(Debug)]
struct Attenuation {
    /// The texels that it reads, and where triangles find them.
    texels: wgpu::Buffer,
    atlas: wgpu::Buffer,
    gather: TexelGather,
    factors: Target,
}

impl Openness for Solution {
    fn map(&self) -> &wgpu::Buffer {
        let [texels, _] = self.buffers();
        texels
    }

    fn lookup(&self, gpu: &Gpu, scene: &GpuScene) -> Result<Box<dyn OpennessLookup>, GpuError> {
        let constants = [self.least_samples()];
        let shader = shader!("techniques.obscurances.factor");
        Ok(Box::new(Attenuation {
            gather: TexelGather::new(gpu, scene, &shader, &constants)?,
            texels: self.map().clone(),
            atlas: self.lookup.words.clone(),
            factors: Target::new(gpu, 1)?,
        }))
    }
}

impl OpennessLookup for Attenuation {
    /// Pass `obscurances.factor`.
    fn record(
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
