//! Structs shared with the shaders of this folder.

use bytemuck::{Pod, Zeroable};

/// `Lobe` of prefilter.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Lobe {
    pub kind: u32,
    pub width: f32,
    pub samples: u32,
    pub padding: u32,
}

impl Lobe {
    pub const MIRROR: u32 = 0;
    pub const GGX: u32 = 1;
    pub const PHONG: u32 = 2;
}

/// `LookupSettings` of lookup.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct LookupSettings {
    pub irradiance: u32,
    pub phong_cosine: u32,
    pub last_level: f32,
    pub approximate_metals: u32,
}
