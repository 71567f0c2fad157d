//! Structs shared with the shaders of this folder.

use bytemuck::{Pod, Zeroable};

/// `Probes` of lights.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Probes {
    pub origin: [f32; 3],
    pub side: u32,
    pub spacing: [f32; 3],
    pub places: u32,
    pub counts: [u32; 3],
    pub count: u32,
    pub resolution: u32,
    pub cubes_per_row: u32,
    pub diagonal: f32,
    pub padding: u32,
}

/// `Work` of work.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Work {
    pub point: u32,
    pub side: u32,
    pub resolution: u32,
    pub cubes_per_row: u32,
    pub with_emission: u32,
    pub with_environment: u32,
    pub instance: u32,
    pub places: u32,
    pub low: [f32; 3],
    pub margin: f32,
    pub high: [f32; 3],
    pub padding: u32,
}

/// Bytes of a reference point and its lights: `point_row` of lights.wesl.
pub const fn point_bytes(side: u32) -> u64 {
    16 * (2 + 4 * 6 * side as u64 * side as u64)
}

/// Bytes of the sources of a reference point's lights: `sources` of downsample.wesl.
pub const fn source_bytes(side: u32) -> u64 {
    32 * 6 * side as u64 * side as u64
}
