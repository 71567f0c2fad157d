//! Structs shared with the shaders of this folder.

use bytemuck::{Pod, Zeroable};

/// `LightSample` of light_sample.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct LightSample {
    pub position: [f32; 3],
    pub kind: u32,
    pub direction: [f32; 3],
    pub first_view: u32,
    pub intensity: [f32; 3],
    pub view_count: u32,
    pub tangent: [f32; 3],
    pub radius: f32,
    pub cone_scale: f32,
    pub cone_offset: f32,
    pub inverse_range_squared: f32,
    pub area: f32,
}

impl LightSample {
    pub const POINT: u32 = 0;
    pub const SPOT: u32 = 1;
    pub const DIRECTIONAL: u32 = 2;
    pub const AREA: u32 = 3;
    pub const AREA_TWO_SIDED: u32 = 4;
}

/// `GatherRange` of gather.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct GatherRange {
    pub first_light: u32,
    pub end_light: u32,
    pub first_point: u32,
    pub end_point: u32,
}

/// `GatherSettings` of gather.wesl: a `ShadowFilter`, then the rest.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct GatherSettings {
    pub kind: u32,
    pub radius: f32,
    pub taps: u32,
    pub normal_offset: f32,
    pub cascade_blend: f32,
    pub second_depth: u32,
    pub area_taps: u32,
    pub padding: u32,
}
