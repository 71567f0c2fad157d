//! Punctual lights as sources of a flare. Bright places of the picture are found on the GPU.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use gpugi_scene::image::luminance;
use gpugi_scene::{Light, LightKind};

use crate::picture::film::Shot;

/// Most bright places of a picture: `PLACES` of sources.wesl.
pub const PLACES: u32 = 8;
/// Most punctual lights.
pub const LAMPS: usize = 8;

/// Least radius of the disc around a light of which some may be hidden (pixels): `LEAST_RADIUS` of seen.wesl.
const LEAST_RADIUS: f32 = 1.5;

/// `Source` of sources.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Source {
    pub irradiance: [f32; 3],
    pub width: f32,
    pub place: [f32; 2],
    pub about: f32,
    pub padding: f32,
}

impl Source {
    fn luminance(&self) -> f32 {
        luminance(self.irradiance.into())
    }
}

/// The punctual lights in the picture that shine into the lens, those of most light first.
pub fn lamps(lights: &[Light], shot: &Shot, size: [u32; 2]) -> Vec<Source> {
    let lamps = lights.iter().filter_map(|light| lamp(light, shot, size));
    let [x, y] = size.map(|side| shot.tangent * side as f32 / size[1] as f32);
    let is_inside = |lamp: &Source| {
        let around = lamp.width + 2.0 * shot.tangent / size[1] as f32 * LEAST_RADIUS;
        lamp.place[0].abs() < x + around && lamp.place[1].abs() < y + around
    };
    let lamps = lamps.filter(|lamp| lamp.luminance() > 0.0 && is_inside(lamp));
    let mut lamps: Vec<Source> = lamps.collect();
    lamps.sort_by(|one, other| other.luminance().total_cmp(&one.luminance()));
    lamps.truncate(LAMPS);
    lamps
}

fn lamp(light: &Light, shot: &Shot, size: [u32; 2]) -> Option<Source> {
    let toward = light.position() - shot.eye.truncate();
    let distance = toward.length();
    let (place, distance, radius) = match light.kind {
        LightKind::Directional => (-light.direction().extend(0.0), f32::MAX, light.radius.tan()),
        _ => (
            light.position().extend(1.0),
            distance,
            light.radius / distance,
        ),
    };
    let [x, y, _, w] = (shot.film_from_world * place).to_array();
    let pixel = 2.0 * shot.tangent / size[1] as f32;
    let [width, height] = size.map(|side| side as f32);
    let source = Source {
        irradiance: (light.intensity * arriving(light, toward)).to_array(),
        // A square of the area of a disc.
        width: std::f32::consts::PI.sqrt() * radius,
        place: [
            pixel * (x / w - width / 2.0),
            pixel * (height / 2.0 - y / w),
        ],
        about: distance,
        padding: 0.0,
    };
    let numbers: &[f32] = bytemuck::cast_slice(std::slice::from_ref(&source));
    (w > 0.0 && numbers.iter().all(|number| number.is_finite())).then_some(source)
}

/// Irradiance at the eye per intensity of a light, whose place is `toward` from there.
fn arriving(light: &Light, toward: Vec3) -> f32 {
    let squared = toward.length_squared();
    let falloff = match light.range {
        Some(range) => (1.0 - (squared / (range * range)).powi(2)).clamp(0.0, 1.0) / squared,
        None => 1.0 / squared,
    };
    match light.kind {
        LightKind::Directional => 1.0,
        LightKind::Point => falloff,
        LightKind::Spot {
            inner_cone_angle,
            outer_cone_angle,
        } => {
            let [scale, end] = crate::lights::gpu::cone(inner_cone_angle, outer_cone_angle);
            let cosine = -toward.normalize_or_zero().dot(light.direction());
            falloff * ((cosine - end) * scale).clamp(0.0, 1.0).powi(2)
        }
    }
}
