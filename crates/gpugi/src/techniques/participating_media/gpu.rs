//! Structs shared with the shaders of this folder.

use bytemuck::{Pod, Zeroable};

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
    pub sees_surfaces: u32,
    pub marched_lights: u32,
    pub window: u32,
    pub padding: [u32; 2],
}
