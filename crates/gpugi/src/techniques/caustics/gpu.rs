//! Structs shared with the shaders of this folder.

use bytemuck::{Pod, Zeroable};

use crate::capture::ViewUniform;
use crate::lights::gpu::LightSample;

/// `CausticMap` of photon.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct CausticMap {
    pub view: ViewUniform,
    pub light: LightSample,
    pub corner: [u32; 2],
    pub is_perspective: u32,
    pub pixel_area: f32,
    pub unit: f32,
    pub counts: f32,
    pub seed: u32,
    pub frame: u32,
}

/// `Batch` of photon.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Batch {
    pub reference: [f32; 3],
    pub cube_side: u32,
    pub first_map: u32,
    pub side: u32,
    pub first: u32,
    pub end: u32,
    pub lanes: u32,
    pub instance: u32,
    pub bounces: u32,
    pub padding: u32,
}

/// `LitCube` of gather.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct LitCube {
    pub reference: [f32; 3],
    pub side: u32,
    pub instance: u32,
    pub padding: [u32; 3],
}

/// Size of `Photon` of photon.wesl [bytes].
pub const PHOTON_BYTES: u64 = 32;
/// Size of `LitTexel` of lit_texel.wesl [bytes].
pub const LIT_TEXEL_BYTES: u64 = 32;
/// Size of one texel's counters [bytes].
pub const COUNTER_BYTES: u64 = 24;
