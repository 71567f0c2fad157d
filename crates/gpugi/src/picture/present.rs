//! Presents pictures on textures that others own: windows, engines.

use bytemuck::{Pod, Zeroable};

use super::Picture;
use crate::gpu::{Frame, Gpu, GpuError, Quad};
use crate::shader;

/// `Picture` of present.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct PictureUniform {
    pub size: [u32; 2],
    pub target_encodes: u32,
    pub padding: u32,
}

/// Draws display pictures onto colour targets of one format, pixel by pixel from the top left.
#[derive(Debug)]
pub struct Present {
    quad: Quad,
    target_encodes: bool,
}

impl Present {
    /// Compiles the pass for targets of `format`, with or without sRGB encoding.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Result<Self, GpuError> {
        Ok(Self {
            quad: Quad::new(gpu, &shader!("picture.present"), format)?,
            target_encodes: format.is_srgb(),
        })
    }

    /// Records the pass `picture.present`, which draws a picture as it is at this
    /// point of the frame.
    ///
    /// # Errors
    /// [`GpuError`].
    pub(crate) fn record(
        &self,
        frame: &mut Frame<'_>,
        shown: &Picture,
        target: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let uniform = gpu.uniform(
            "picture to present",
            &PictureUniform {
                size: shown.size,
                target_encodes: u32::from(self.target_encodes),
                padding: 0,
            },
        )?;
        let resources = [
            ("picture", uniform.as_entire_binding()),
            ("pixels", shown.encode.pixels.as_entire_binding()),
        ];
        let group = self.quad.bind(gpu, &resources)?;
        frame.draw_quad("picture.present", &self.quad, &group, target);
        Ok(())
    }
}
