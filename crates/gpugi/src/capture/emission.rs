//! Light path LE: the frame's own pass, the first to write a target.

use super::{PerTarget, SurfacePoints, Target};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::scene::GpuScene;
use crate::shader;

/// What emitters and the environment send straight to where points are seen from.
#[derive(Debug)]
pub struct Emission {
    kernel: Kernel,
    bound: PerTarget<[wgpu::BindGroup; 2]>,
}

impl Emission {
    /// Compiles the pass.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let shader = shader!("capture.emission");
        Ok(Self {
            kernel: Kernel::new(gpu, &shader, "main", Some(&scene.layout))?,
            bound: PerTarget::default(),
        })
    }

    /// Begins `target` with the first sample of a picture, adds to it with the others: pass `frame.emission`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        points: &SurfacePoints,
        target: &Target,
    ) -> Result<(), GpuError> {
        let (gpu, kernel) = (frame.gpu, &self.kernel);
        let [seen, added] = self.bound.of(points, target, || {
            Ok([points.bind(gpu, kernel)?, target.bind(gpu, kernel)?])
        })?;
        frame.compute("frame.emission", |pass| {
            let groups = [(0, &scene.bind_group), (1, seen), (3, added)];
            kernel.dispatch(pass, &groups, [points.count, 1, 1]);
        });
        Ok(())
    }
}
