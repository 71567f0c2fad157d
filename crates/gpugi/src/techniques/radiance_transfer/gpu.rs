//! Structs shared with the shaders of this folder.

use bytemuck::{Pod, Zeroable};

/// `Work` of rays.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Work {
    pub first_texel: u32,
    pub first_point: u32,
    pub end_point: u32,
    pub rays: u32,
    pub seed: u32,
    pub padding_0: u32,
    pub padding_1: u32,
    pub padding_2: u32,
}

/// `Work` of glossy/matrices.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct MatrixWork {
    pub first_texel: u32,
    pub first_slot: u32,
    pub end_slot: u32,
    pub slots: u32,
    pub rays: u32,
    pub seed: u32,
    pub padding_0: u32,
    pub padding_1: u32,
}

/// `Slots` of glossy/relight.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Slots {
    pub count: u32,
    pub first_word: u32,
    pub padding_0: u32,
    pub padding_1: u32,
}

/// `Directional` of directional.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Directional {
    pub toward: [f32; 3],
    pub padding_0: u32,
    pub irradiance: [f32; 3],
    pub padding_1: u32,
}

/// `MOST` of shared/spherical_harmonics.wesl: functions of order 8.
pub const MOST_FUNCTIONS: u32 = 64;

/// Lanes of the workgroup that computes a texel's transfer vector.
pub const LANES: u32 = 64;

/// Bytes of one coefficient of a transfer vector.
pub const COEFFICIENT_BYTES: u64 = 8;

/// Texels per side of the cube that the environment is projected from, and of all faces: `SIDE` and `CUBE_TEXELS` of
/// haar/wavelets.wesl.
pub const CUBE_SIDE: u32 = 64;
pub const CUBE_TEXELS: u32 = 6 * CUBE_SIDE * CUBE_SIDE;
