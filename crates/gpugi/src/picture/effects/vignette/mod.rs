//! Vignette: pictures of lenses are darker toward their corners. It has no pass: exposure and encoding multiply what they
//! read. docs/effects/vignette.md.

#[cfg(test)]
mod tests;

use bytemuck::{Pod, Zeroable};

use crate::picture::Optics;

crate::settings! {
    /// Settings of the vignette.
    #[derive(Copy)]
    pub struct Settings {
        /// Share of the loss of light toward the corners that is shown, if the camera has an aperture; 0: off, 1: cos^4 of
        /// the angle to the axis.
        pub strength: f32 = 0.0 => in_range(0.0, 1.0),
        /// Length of the lens' barrel, which hides its opening from the side, in radii of the opening; 0: none.
        pub barrel: f32 = 0.0 => in_range(0.0, 10.0).unit("radii"),
    }
}

/// `Vignette` of vignette.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct VignetteUniform {
    pixel: f32,
    strength: f32,
    barrel: f32,
    padding: f32,
}

impl VignetteUniform {
    /// For a picture of `size` pixels by `camera`. A pinhole has no opening that could be seen from the side.
    pub fn new(settings: &Settings, size: [u32; 2], camera: Optics) -> Self {
        let tangent = match camera.lens.is_pinhole() {
            true => 0.0,
            false => camera.tangent,
        };
        Self {
            pixel: 2.0 * tangent / size[1] as f32,
            strength: settings.strength,
            barrel: settings.barrel,
            padding: 0.0,
        }
    }
}
