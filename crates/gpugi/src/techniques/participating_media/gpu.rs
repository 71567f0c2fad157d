//! Structs shared with the shaders of this folder.

use bytemuck::{Pod, Zeroable};

/// `Medium` of media.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Medium {
    pub box_from_world: [[f32; 4]; 4],
    pub extinction: [f32; 3],
    pub first_density: u32,
    pub albedo: [f32; 3],
    pub asymmetry: f32,
    pub emission: [f32; 3],
    pub phase: u32,
    pub cells: [u32; 3],
    pub first_node: u32,
    pub nodes: [u32; 3],
    pub padding: u32,
}

/// `Particle` of network.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Particle {
    pub position: [f32; 3],
    pub radius: f32,
    pub medium: u32,
    pub padding: [u32; 3],
}

/// `Network` of network.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Network {
    pub particles: u32,
    pub directions: u32,
    pub lights: u32,
    pub nodes: u32,
    pub cells_origin: [f32; 3],
    pub cell_side: f32,
    pub cell_counts: [u32; 3],
    pub padding: u32,
}
