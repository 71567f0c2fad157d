//! The structs that the technique shares with its shaders.

use bytemuck::{Pod, Zeroable};

/// `Rays` of rays.wesl, excluding its rows. What comes before `capacity` is zero when a chunk begins.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Header {
    pub alive: u32,
    pub side: u32,
    pub generation: u32,
    pub listed: u32,
    pub triangle: u32,
    pub step: u32,
    pub capacity: u32,
    pub counted: Counted,
    pub padding: u32,
}

/// `Counted` of rays.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Counted {
    pub tests: [u32; 2],
    pub tests_left: [u32; 2],
    pub rays: [u32; 16],
}

/// `Chunk` of rays.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Chunk {
    pub first: u32,
    pub count: u32,
    pub bounces: u32,
    pub split: u32,
    pub tests: u32,
    pub sees_only_environment: u32,
    pub media_directions: u32,
    pub marched_lights: u32,
}
