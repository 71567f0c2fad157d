//! Structs shared with the shaders of this folder.

use bytemuck::{Pod, Zeroable};

/// `Impostor` of maps.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Impostor {
    pub reference: [f32; 3],
    pub instance: u32,
    pub center: [f32; 3],
    pub search: u32,
    pub iterations: u32,
    pub bounces: u32,
    pub is_refracting: u32,
    pub is_classical: u32,
    pub world_from_shape: [f32; 4],
    pub number: u32,
    pub is_rough: u32,
    pub draws_lobes: u32,
    pub is_shared: u32,
}
