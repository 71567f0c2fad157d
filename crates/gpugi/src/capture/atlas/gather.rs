//! The gather of a technique that keeps data in texels. A camera's points look it up where they lie in the atlas; the
//! atlas's own points read their own texels.

use std::sync::OnceLock;

use super::AtlasCapture;
use crate::capture::gather::made_once;
use crate::capture::{Gather, Receiver};
use crate::gpu::{Frame, Gpu, GpuError, Named, Shader};
use crate::scene::GpuScene;

/// A pass over points that reads texels of an atlas.
#[derive(Debug)]
pub(crate) struct TexelGather {
    gather: Gather,
    /// For points that are the atlas's own texels, compiled when first needed.
    own: OnceLock<Gather>,
}

impl TexelGather {
    /// The pass of a shader.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        shader: &Shader,
        constants: &[(&str, f64)],
    ) -> Result<Self, GpuError> {
        Ok(Self {
            gather: Gather::new(gpu, scene, shader, constants)?,
            own: OnceLock::new(),
        })
    }

    /// Adds the light at the receiver's points to its target, in the pass `name`. `texels` is the capture of the atlas, if
    /// its own points may be lit; `kept`: the atlas, and the data in its texels.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        name: &str,
        scene: &GpuScene,
        texels: Option<&AtlasCapture>,
        receiver: &Receiver,
        kept: &[Named<'_>],
    ) -> Result<(), GpuError> {
        let mut pieces = texels.into_iter().flat_map(AtlasCapture::pieces);
        let gather = if pieces.any(|piece| piece.points.points == receiver.points.points) {
            let own = || self.gather.variant(frame.gpu, &[("IS_OWN", 1.0)]);
            made_once(&self.own, own)?
        } else {
            &self.gather
        };
        gather.record(frame, name, scene, receiver, kept)
    }
}
