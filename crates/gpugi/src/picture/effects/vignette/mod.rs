//! Vignette: pictures of lenses are darker toward their corners. It has no pass: exposure and encoding multiply what they
//! read. docs/effects/vignette.md.

#[cfg(test)]
mod tests;

use bytemuck::{Pod, Zeroable};

crate::settings! {
    /// Settings of the vignette.
    #[derive(Copy)]
    pub struct Settings {
        /// Share of the loss of light toward the corners that is shown; 0: off, 1: cos^4 of the angle to the axis.
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
    /// For a picture of `size` pixels. `tangent`: that of half its vertical field of view, or 0.
    pub fn new(settings: &Settings, size: [u32; 2], tangent: f32) -> Self {
        Self {
            pixel: 2.0 * tangent / size[1] as f32,
            strength: settings.strength,
            barrel: settings.barrel,
            padding: 0.0,
        }
    }
}
