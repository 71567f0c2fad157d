//! The structs that shaders of paths share with their hosts.

use bytemuck::{Pod, Zeroable};

use crate::capture::ViewUniform;

/// `Settings` of paths/path_state.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Parameters {
    pub tile_x: u32,
    pub tile_y: u32,
    pub tile_width: u32,
    pub tile_height: u32,
    pub first_block: u32,
    pub samples: u32,
    pub first_sample: u32,
    pub max_bounces: u32,
    pub roulette_after: u32,
    pub light_count: u32,
    pub sky_probability: f32,
    pub emission_classes: u32,
    pub solids: [u32; 4],
    pub first_remembered: u32,
    pub places_of_block: u32,
    pub near_light: f32,
    pub padding: u32,
}

/// `Lens` of paths/lens.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct ThinLensUniform {
    pub right: [f32; 3],
    pub focus: f32,
    pub up: [f32; 3],
    pub blades: u32,
}

/// `Eye` of paths/path_state.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct EyeUniform {
    pub view: ViewUniform,
    pub lens: ThinLensUniform,
}

/// `Pool` of paths/pool.wesl, excluding its rows.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
pub(crate) struct Header {
    pub capacity: u32,
    pub items: u32,
    pub side: u32,
    pub kept: u32,
    pub alive: u32,
    pub first_item: u32,
    pub shadow_rays: u32,
    pub steps: u32,
    pub listed: u32,
    pub listed_shadow_rays: u32,
    pub seed: u32,
    pub first_sample: u32,
    pub interval: u32,
    pub first_x: u32,
    pub first_y: u32,
    pub padding: u32,
}
