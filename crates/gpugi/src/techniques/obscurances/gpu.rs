//! Structs shared with the shaders of this folder.

use bytemuck::{Pod, Zeroable};
use gpugi_scene::Bounds;

/// `Settings` of obscurance.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct SettingsUniform {
    pub distance: f32,
    pub falloff: u32,
    pub seed: u32,
    pub first_texel: u32,
    pub first_point: u32,
    pub end_point: u32,
    pub first_sample: u32,
    pub end_sample: u32,
}

/// `Box` of prepare.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct BoxRow {
    pub low: [f32; 3],
    pub padding_0: u32,
    pub high: [f32; 3],
    pub padding_1: u32,
}

impl BoxRow {
    pub fn new(bounds: &Bounds) -> Self {
        Self {
            low: bounds.min.to_array(),
            padding_0: 0,
            high: bounds.max.to_array(),
            padding_1: 0,
        }
    }
}

/// `Renewal` of prepare.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Renewal {
    pub all: u32,
    pub box_count: u32,
    pub finished: u32,
    pub padding: u32,
}

/// `Page` of resolve.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct PageUniform {
    pub first: u32,
    pub count: u32,
    pub side: u32,
    pub padding: u32,
}

/// Size of `Texel` of obscurance.wesl [bytes].
pub const TEXEL_BYTES: u64 = 48;

/// `AlphaView` of capture/raster.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct PeelView {
    pub clip_from_world: [[f32; 4]; 4],
    pub seed: [u32; 4],
}

/// `Bundle` of bundle.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Bundle {
    pub origin: [f32; 3],
    pub range: f32,
    pub origin_dx: [f32; 3],
    pub first_column: u32,
    pub origin_dy: [f32; 3],
    pub first_row: u32,
    pub direction: [f32; 3],
    pub end_column: u32,
    pub end_row: u32,
    pub side: u32,
    pub layers: u32,
    pub padding: u32,
}
