//! Structs shared by host and shaders; a test compares them with the shaders'.

use bytemuck::{Pod, Zeroable};

/// `Grid` of reduce.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Grid {
    pub width: u32,
    pub height: u32,
    pub stride: u32,
    pub padding: u32,
}

/// `Settings` of domains.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Settings {
    pub width: u32,
    pub height: u32,
    pub stride: u32,
    pub side: u32,
    pub count: u32,
    pub squared: u32,
    pub warm: u32,
    pub tolerance: f32,
}

/// `State` of domains.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct State {
    pub most: f32,
    pub share: f32,
    pub moving: u32,
    pub movement: u32,
}

/// `Domain` of domains.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Domain {
    pub direction: [f32; 3],
    pub solid_angle: f32,
    pub flux_density: [f32; 3],
    pub lit_solid_angle: f32,
}

/// `Direction` of domain_light.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Direction {
    pub toward: [f32; 3],
    pub solid_angle: f32,
    pub flux_density: [f32; 3],
    pub texel: f32,
}

/// `DirectionMap` of visibility.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct DirectionMap {
    pub u: [f32; 4],
    pub v: [f32; 4],
    pub depth: [f32; 4],
    pub scale: [f32; 4],
    pub tile: [f32; 4],
}

/// `Range` of domain_light.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Range {
    pub first: u32,
    pub end: u32,
    pub padding_0: u32,
    pub padding_1: u32,
}

/// `LobeSums` of lobe_sums.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct LobeSums {
    pub lit_diffuse: [f32; 3],
    pub all_glossy_r: f32,
    pub all_diffuse: [f32; 3],
    pub all_glossy_g: f32,
    pub lit_glossy: [f32; 3],
    pub all_glossy_b: f32,
}
