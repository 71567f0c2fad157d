//! Structs shared with the shaders of this folder.

use bytemuck::{Pod, Zeroable};

/// `Work` of texel.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Work {
    pub first_texel: u32,
    pub count: u32,
    pub rays: u32,
    pub burn_in: u32,
    pub seed: u32,
    pub with_environment: u32,
    pub with_emission: u32,
    pub texels: u32,
    pub chosen: u32,
    pub light_sampled: u32,
    pub first_traced: u32,
    pub end_traced: u32,
}

/// `Level` of sum.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Level {
    pub fine: u32,
    pub fine_count: u32,
    pub coarse: u32,
    pub padding: u32,
}

/// `CHILDREN` of pyramid.wesl.
pub const CHILDREN: u32 = 16;

/// Size of `Texel` of texel.wesl [bytes].
pub const TEXEL_BYTES: u64 = 32;

/// `Chosen` of chosen.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Chosen {
    pub position: [f32; 3],
    pub area: f32,
    pub normal: [f32; 3],
    pub turn: f32,
    pub outgoing: [f32; 3],
    pub power: f32,
}

/// `MOST_CHOSEN` of chosen.wesl.
pub const MOST_CHOSEN: u32 = 256;
