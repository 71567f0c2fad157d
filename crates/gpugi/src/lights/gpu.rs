//! Structs shared with the shaders of this folder.

use std::f32::consts::{PI, TAU};

use bytemuck::{Pod, Zeroable};
use gpugi_scene::image::luminance;

use crate::capture::depth::DepthViewUniform;

/// `LightSample` of light_sample.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct LightSample {
    pub position: [f32; 3],
    pub kind: u32,
    pub direction: [f32; 3],
    pub first_view: u32,
    pub intensity: [f32; 3],
    pub view_count: u32,
    pub tangent: [f32; 3],
    pub radius: f32,
    pub cone_scale: f32,
    pub cone_end: f32,
    pub inverse_range_squared: f32,
    pub area: f32,
}

impl LightSample {
    pub const POINT: u32 = 0;
    pub const SPOT: u32 = 1;
    pub const DIRECTIONAL: u32 = 2;
    pub const AREA: u32 = 3;
    pub const AREA_TWO_SIDED: u32 = 4;
}

/// Scale and end of a spot's cone, as `cone` of light_falloff.wesl takes them. Equal angles are a hard edge.
///
/// The floor in the sample code of KHR_lights_punctual, 0.001, would dim cones with half angles below 2.6 degrees.
pub fn cone(inner_cone_angle: f32, outer_cone_angle: f32) -> [f32; 2] {
    // Steps between cosines close to 1 are as large as this.
    const STEP: f64 = 1.0 / (1 << 24) as f64;
    let [inner, outer] = [inner_cone_angle, outer_cone_angle].map(|angle| f64::from(angle).cos());
    // Even the narrowest cone holds its axis.
    let end = outer.min(1.0 - STEP);
    [(1.0 / (inner - end).max(STEP)) as f32, end as f32]
}

impl LightSample {
    /// Luminous power (W) that the sample emits into a scene of this radius (m).
    pub fn power(&self, scene_radius: f32) -> f32 {
        luminance(self.intensity.into())
            * match self.kind {
                Self::POINT => 4.0 * PI,
                Self::SPOT => TAU * (1.0 - self.cone_end),
                Self::DIRECTIONAL => PI * scene_radius * scene_radius,
                Self::AREA_TWO_SIDED => TAU,
                _ => PI,
            }
    }
}

/// `light_table` of table.wesl: a row that holds the index of the views' first row, then the samples, then the views.
pub(super) fn table(samples: &[LightSample], views: &[DepthViewUniform]) -> Vec<[u32; 4]> {
    let samples: &[[u32; 4]] = bytemuck::cast_slice(samples);
    let views = bytemuck::cast_slice(views);
    let header = [1 + samples.len() as u32, 0, 0, 0];
    [&[header], samples, views].concat()
}
