//! Structs shared with the shaders of this folder.

use bytemuck::{Pod, Zeroable};

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
    pub first_shared: u32,
    pub first_light: u32,
    pub end_light: u32,
    pub first_point: u32,
    pub end_point: u32,
    pub is_brief: u32,
    pub padding: [u32; 3],
}
