//! Converts a scene's lights to light samples.

use glam::{Mat4, Quat, Vec3};
use gpugi_scene::{Light, LightKind};

use super::gpu::{LightSample, cone};
use crate::scene::Emitter;
use crate::sequences::{GOLDEN_RATIO, R2, additive};

/// A punctual light as a sample without views.
pub fn punctual(light: &Light) -> LightSample {
    let mut sample = LightSample {
        position: light.position().to_array(),
        kind: LightSample::POINT,
        direction: light.direction().to_array(),
        intensity: light.intensity.to_array(),
        radius: light.radius,
        inverse_range_squared: light.range.map_or(0.0, |range| 1.0 / (range * range)),
        ..bytemuck::Zeroable::zeroed()
    };
    match light.kind {
        LightKind::Point => {}
        LightKind::Spot {
            inner_cone_angle,
            outer_cone_angle,
        } => {
            sample.kind = LightSample::SPOT;
            [sample.cone_scale, sample.cone_end] = cone(inner_cone_angle, outer_cone_angle);
        }
        LightKind::Directional => {
            sample.kind = LightSample::DIRECTIONAL;
            sample.radius = light.radius.tan();
        }
    }
    sample
}

/// A light without a radius at a point of one that has a radius: uniform over the sphere of a point or spot light, and
/// over the cap of directions of a directional one, as the path tracer samples them. `index` is the light's, so that
/// lights do not move alike; another `turn` gives another point.
pub fn within_radius(light: &Light, index: u32, turn: u32) -> Light {
    let shift = additive(R2, index.wrapping_mul(0x9e37));
    let [u, v] = additive(R2, turn);
    let [u, v] = [(u + shift[0]).fract() as f32, (v + shift[1]).fract() as f32];
    let is_directional = light.kind == LightKind::Directional;
    let z = if is_directional {
        light.radius.cos() + (1.0 - light.radius.cos()) * v
    } else {
        2.0 * v - 1.0
    };
    let (sine, phi) = ((1.0 - z * z).max(0.0).sqrt(), std::f32::consts::TAU * u);
    let direction = light.direction();
    let (x_axis, y_axis) = direction.any_orthonormal_pair();
    let drawn = (x_axis * phi.cos() + y_axis * phi.sin()) * sine + direction * z;
    let mut moved = Light {
        radius: 0.0,
        ..light.clone()
    };
    if is_directional {
        let turned = Quat::from_rotation_arc(direction, drawn);
        moved.world_from_light = Mat4::from_quat(turned) * light.world_from_light;
    } else {
        moved.world_from_light.w_axis += (drawn * light.radius).extend(0.0);
    }
    moved
}

/// `count` sample points on emissive triangles, without views. They are stratified by emitted power: each represents an
/// equal part of it. A sample's L A is its part of the power over pi, in the triangle's colour. Another `turn` gives
/// other points.
pub fn on_emitters(emitters: &[Emitter], count: u32, turn: u32) -> Vec<LightSample> {
    let weights: Vec<f64> = emitters.iter().map(Emitter::power).collect();
    let total: f64 = weights.iter().sum();
    if !(total > 0.0 && total.is_finite()) {
        return Vec::new();
    }
    // All points of a turn are shifted alike. So they cover the emitters as evenly as those of the first turn, and so
    // do the points of equal index over all turns.
    let shift = additive(R2, turn);
    let mut before = 0.0;
    let mut index = 0;
    let sample = |number| {
        let at = (f64::from(number) + (0.5 + shift[0]).fract()) / f64::from(count) * total;
        while index + 1 < emitters.len() && before + weights[index] <= at {
            before += weights[index];
            index += 1;
        }
        let emitter = &emitters[index];
        let [a, b, c] = emitter.corners;
        let normal = (b - a).cross(c - a).normalize_or(Vec3::Y);
        // The remainder within the triangle is as evenly spread as the power, which makes each triangle's points a
        // lattice: a quarter to half the error of an additive sequence in both dimensions.
        let x = ((at - before) / weights[index].max(f64::MIN_POSITIVE)).clamp(0.0, 1.0) as f32;
        let [y] = additive([GOLDEN_RATIO], number).map(|y| (0.5 + y + shift[1]).fract() as f32);
        // Map the unit square to the triangle, preserving relative areas (Heitz 2019).
        let (u, v) = if y > x {
            (x / 2.0, y - x / 2.0)
        } else {
            (x - y / 2.0, y / 2.0)
        };
        let sides = if emitter.two_sided { 2.0 } else { 1.0 };
        let share = total / f64::from(count) / std::f64::consts::PI;
        let area = share as f32 / (emitter.luminance() * sides);
        LightSample {
            position: (a + (b - a) * u + (c - a) * v).to_array(),
            kind: if emitter.two_sided {
                LightSample::AREA_TWO_SIDED
            } else {
                LightSample::AREA
            },
            direction: normal.to_array(),
            intensity: (emitter.radiance * area).to_array(),
            tangent: (b - a)
                .normalize_or(normal.any_orthonormal_vector())
                .to_array(),
            area,
            ..bytemuck::Zeroable::zeroed()
        }
    };
    (0..count).map(sample).collect()
}

#[cfg(test)]
mod tests {
    use glam::vec3;

    use super::*;

    /// The irradiance of a square lamp at points near it, against a sum over 100 x 100 points. An additive sequence in
    /// both dimensions errs by up to 4.4 % with these 64 points.
    #[test]
    fn points_on_a_lamp_stand_for_all_of_it() {
        let side = 0.6;
        let corner = |x: f32, z: f32| vec3((x - 0.5) * side, 1.55, (z - 0.5) * side);
        let emitters = [[(1.0, 0.0), (1.0, 1.0)], [(1.0, 1.0), (0.0, 1.0)]].map(|[b, c]| Emitter {
            instance: 0,
            primitive: 0,
            corners: [corner(0.0, 0.0), corner(b.0, b.1), corner(c.0, c.1)],
            radiance: Vec3::ONE,
            two_sided: false,
        });
        let irradiance = |from: Vec3, at: Vec3, normal: Vec3| {
            let away = at - from;
            let cosines = -away.y * -away.dot(normal);
            cosines.max(0.0) / away.length_squared().powi(2)
        };
        let places = [
            (vec3(-1.0, 1.2, -0.9), Vec3::X),
            (vec3(1.0, 1.0, 0.5), -Vec3::X),
            (vec3(0.3, 0.8, -1.0), Vec3::Z),
            (vec3(0.2, 0.0, 0.6), Vec3::Y),
            (vec3(0.5, 1.0, 0.1), Vec3::Y),
        ];
        for turn in 0..8 {
            let samples = on_emitters(&emitters, 64, turn);
            for (at, normal) in places {
                let of_sample = |sample: &LightSample| {
                    irradiance(Vec3::from_array(sample.position), at, normal) * sample.area
                };
                let found: f32 = samples.iter().map(of_sample).sum();
                let cells = (0..10_000).map(|cell| (cell % 100, cell / 100));
                let points =
                    cells.map(|(x, z)| corner((x as f32 + 0.5) / 100.0, (z as f32 + 0.5) / 100.0));
                let sum: f32 = points.map(|from| irradiance(from, at, normal)).sum();
                let ratio = found / (sum * side * side / 1e4);
                assert!((ratio - 1.0).abs() < 0.02, "turn {turn}, {at}: {ratio}");
            }
        }
    }
}
