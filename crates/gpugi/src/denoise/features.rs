//! What pixels see of surfaces.

use bytemuck::{Pod, Zeroable};

/// What a pixel's samples see: sums over its samples. `Features` of features.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub struct Features {
    /// Albedo of the surfaces that the samples hit first: diffuse, plus what is reflected at normal incidence.
    pub albedo: [f32; 3],
    /// Samples that hit a surface.
    pub hits: f32,
    /// Shading normals of these surfaces, in world space, toward the viewer.
    pub normal: [f32; 3],
    /// Their distances along the view's axis (m).
    pub depth: f32,
    /// Albedo of the surfaces at the ends of chains of ideal mirrors and glass, times what these let through; 1 for the sky.
    pub followed_albedo: [f32; 3],
    /// Samples.
    pub samples: f32,
    /// Shading normals there; 0 for the sky.
    pub followed_normal: [f32; 3],
    /// Lengths of the chains (m); 0 for those that end in the sky.
    pub followed_distance: f32,
    /// Positions of the surfaces that the samples hit first, in world space (m).
    pub position: [f32; 3],
    /// 0.
    pub padding: u32,
}
