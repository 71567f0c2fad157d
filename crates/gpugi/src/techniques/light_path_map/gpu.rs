//! Structs shared with the shaders of this folder.

use bytemuck::{Pod, Zeroable};

/// `Work` of light_path.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Work {
    pub size: u32,
    pub first_texel: u32,
    pub first_point: u32,
    pub end_point: u32,
    pub texels: u32,
    pub entries: u32,
    pub points: u32,
    pub first_entry: u32,
    pub end_entry: u32,
    pub cluster: u32,
    pub walks: u32,
    pub depth: u32,
    pub near_rays: u32,
    pub seed: u32,
    pub bound: f32,
    pub reach: f32,
    pub entry_area: f32,
    pub first_word: u32,
    pub map_resolution: u32,
    pub continues: u32,
}

/// `Site` of light_path.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Site {
    pub position: [f32; 3],
    pub cluster: u32,
    pub normal: [f32; 3],
    pub normal_scale: f32,
}

/// `Sum` of sum.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Sum {
    pub size: u32,
    pub texels: u32,
    pub first_pane: u32,
    pub end_pane: u32,
    pub slots: u32,
    pub stride: u32,
    pub is_last: u32,
}

/// `Choice` of sum.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Choice {
    pub clusters: u32,
    pub panes: u32,
    pub left_out: f32,
}

/// Bytes of `Slot` of sum.wesl.
pub const SLOT_BYTES: u64 = 16;

/// Bytes of `VirtualLight` of light_path.wesl.
pub const VIRTUAL_LIGHT_BYTES: u64 = 32;

/// Bytes of a near surface of a texel.
pub const NEAR_BYTES: u64 = 8;

/// `RUN` of light_path.wesl.
pub const RUN: u32 = 8;

/// Texels per side of a tile of sum.wesl.
pub const TILE: u32 = 8;

/// Lanes of the workgroup that averages a cluster's light, and of those with one lane per texel of a tile.
pub const LANES: u32 = 64;

/// `LANES` of choose.wesl.
pub const CHOOSING_LANES: u32 = 128;
