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
    pub own: u32,
}

impl Probes {
    /// Lights of all reference points between which light bounces: `surfaces` of lights.wesl.
    pub const fn surfaces(&self) -> u32 {
        (1 + self.own) * self.count * 6 * self.side * self.side
    }

    /// Bytes of all reference points and their lights: rows of 16 bytes, two per point and two per light of a surface or
    /// of the sky.
    pub const fn light_bytes(&self) -> u64 {
        let of_sky = self.count as u64 * 6 * self.side as u64 * self.side as u64;
        32 * (self.count as u64 + of_sky + self.surfaces() as u64)
    }

    /// Bytes of the sources of surfaces' lights: `sources` of downsample.wesl.
    pub const fn source_bytes(&self) -> u64 {
        32 * self.surfaces() as u64
    }
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
    pub points: u32,
}
