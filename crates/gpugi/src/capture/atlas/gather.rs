//! The gather of a technique that keeps data in texels. A camera's points look it up where they lie in the atlas; the
//! atlas's own points read their own texels.

use bytemuck::{Pod, Zeroable};

use super::AtlasCapture;
use crate::capture::{PerReceiver, Receiver, ReceiverKernel};
use crate::gpu::{Frame, Gpu, GpuError, Shader};
use crate::scene::GpuScene;

/// `Own` of capture/atlas/lookup.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct OwnUniform {
    pub first_texel: u32,
    pub is_own: u32,
    pub padding: [u32; 2],
}

/// A pass over points that reads texels of an atlas.
#[derive(Debug)]
pub(crate) struct TexelGather {
    kernel: ReceiverKernel,
    /// The atlas, and the data in its texels.
    kept: wgpu::BindGroup,
    bound: PerReceiver<[wgpu::BindGroup; 2]>,
}

impl TexelGather {
    /// The pass of a shader with these bind groups: 1 the points; 2 `kept`, which is an atlas and the data in its
    /// texels; 3 `radiance`, `hits` and `own`.
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
        let Receiver { points, target } = receiver;
        let kernel = self.kernel.of(gpu, points)?;
        let [seen, added] = self.bound.of(receiver, || {
            let mut pieces = texels.pieces().iter();
            let own = pieces.find(|piece| piece.points.points == points.points);
            let own = OwnUniform {
                first_texel: own.map_or(0, |piece| piece.rows.start * texels.size),
                is_own: u32::from(own.is_some()),
                padding: [0; 2],
            };
            let own = gpu.uniform("own texels", &own)?;
            let resources = [
                ("radiance", target.radiance.as_entire_binding()),
                ("hits", wgpu::BindingResource::TextureView(&points.hits)),
                ("own", own.as_entire_binding()),
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
