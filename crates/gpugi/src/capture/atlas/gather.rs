//! The gather of a technique that keeps data in texels. A camera's points look it up where they lie in the atlas; the
//! atlas's own points read their own texels.

use std::sync::OnceLock;

use super::AtlasCapture;
use crate::capture::{PerReceiver, Receiver, ReceiverKernel};
use crate::gpu::{Frame, Gpu, GpuError, Shader};
use crate::scene::GpuScene;

/// A pass over points that reads texels of an atlas.
#[derive(Debug)]
pub(crate) struct TexelGather {
    kernel: ReceiverKernel,
    /// For points that are the atlas's own texels, compiled when first needed.
    own: OnceLock<ReceiverKernel>,
    /// The atlas, and the data in its texels.
    kept: wgpu::BindGroup,
    bound: PerReceiver<[wgpu::BindGroup; 2]>,
}

impl TexelGather {
    /// The pass of a shader with these bind groups: 1 the points; 2 `kept`, which is an atlas and the data in its
    /// texels; 3 `radiance` and `hits`.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        shader: &Shader,
        constants: &[(&str, f64)],
        kept: &[(&str, wgpu::BindingResource<'_>)],
    ) -> Result<Self, GpuError> {
        let kernel = ReceiverKernel::new(gpu, scene, shader, constants)?;
        Ok(Self {
            kept: kernel.to_bind().bind(gpu, 2, kept)?,
            own: OnceLock::new(),
            kernel,
            bound: PerReceiver::default(),
        })
    }

    /// Adds the light at the receiver's points to its target, in the pass `name`. `texels` is the capture of the atlas.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        name: &str,
        scene: &GpuScene,
        texels: &AtlasCapture,
        receiver: &Receiver,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let Receiver { points, target, .. } = receiver;
        let mut pieces = texels.pieces().iter();
        let kernel = if pieces.any(|piece| piece.points.points == points.points) {
            own_variant(&self.own, &self.kernel, gpu)?.of(gpu, points)?
        } else {
            self.kernel.of(gpu, points)?
        };
        let [seen, added] = self.bound.of(receiver, || {
            let resources = [
                ("radiance", target.radiance.as_entire_binding()),
                ("hits", wgpu::BindingResource::TextureView(&points.hits)),
            ];
            Ok([points.bind(gpu, kernel)?, kernel.bind(gpu, 3, &resources)?])
        })?;
        frame.compute(name, |pass| {
            let groups = [
                (0, &scene.bind_group),
                (1, seen),
                (2, &self.kept),
                (3, added),
            ];
            kernel.dispatch(pass, &groups, [points.count, 1, 1]);
        });
        Ok(())
    }
}

/// The variant of `kernel` for points that are the atlas's own texels.
fn own_variant<'a>(
    own: &'a OnceLock<ReceiverKernel>,
    kernel: &ReceiverKernel,
    gpu: &Gpu,
) -> Result<&'a ReceiverKernel, GpuError> {
    if let Some(own) = own.get() {
        return Ok(own);
    }
    let made = kernel.variant(gpu, &[("IS_OWN", 1.0)])?;
    Ok(own.get_or_init(|| made))
}
