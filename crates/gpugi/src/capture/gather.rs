//! A pass over the points of receivers.

use super::{PerReceiver, Receiver, ReceiverKernel};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions, Shader};
use crate::scene::GpuScene;

/// A kernel with one invocation per point, with bind groups 0 (scene), 1 (points), 2 (maps, if it has any) and 3
/// (target). Bind groups 1 and 3 are kept per receiver.
#[derive(Debug)]
pub struct Gather {
    kernel: ReceiverKernel,
    bound: PerReceiver<[wgpu::BindGroup; 2]>,
}

impl Gather {
    /// Compiles the entry point `main` of a shader, with values of its pipeline-overridable constants.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        shader: &Shader,
        constants: &[(&str, f64)],
    ) -> Result<Self, GpuError> {
        let options = KernelOptions {
            constants,
            ..Default::default()
        };
        Self::with_options(gpu, scene, shader, &options)
    }

    /// The same with all options.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub(crate) fn with_options(
        gpu: &Gpu,
        scene: &GpuScene,
        shader: &Shader,
        options: &KernelOptions<'_>,
    ) -> Result<Self, GpuError> {
        Ok(Self {
            kernel: ReceiverKernel::with_options(gpu, scene, shader, options)?,
            bound: PerReceiver::default(),
        })
    }

    /// The kernel, to bind maps as group 2.
    pub fn kernel(&self) -> &Kernel {
        self.kernel.to_bind()
    }

    /// Records the pass: one dispatch per group of maps, or one without maps.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        pass: &str,
        scene: &GpuScene,
        receiver: &Receiver,
        maps: &[&wgpu::BindGroup],
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let kernel = self.kernel.of(gpu, &receiver.points)?;
        let [points, target] = self.bound.of(receiver, || receiver.bind(gpu, kernel))?;
        frame.compute(pass, |pass| {
            let mut groups = vec![(0, &scene.bind_group), (1, points), (3, target)];
            let invocations = [receiver.points.count, 1, 1];
            if maps.is_empty() {
                kernel.dispatch(pass, &groups, invocations);
            }
            for maps in maps {
                groups.truncate(3);
                groups.push((2, maps));
                kernel.dispatch(pass, &groups, invocations);
            }
        });
        Ok(())
    }
}
