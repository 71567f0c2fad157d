//! From a scene's lights to light samples and the depth views that they need.

use glam::{Vec3, Vec4};
use gpugi_scene::{Bounds, Light, LightKind};

use super::Settings;
use super::gpu::LightSample;
use super::warp::warped;
use crate::capture::View;
use crate::capture::depth::DepthViewSpec;
use crate::scene::Emitter;
use crate::sequence::{R2, R3, additive};

/// Samples and views under construction.
#[derive(Debug, Default)]
pub struct LightList {
    /// What the gather sums over.
    pub samples: Vec<LightSample>,
    /// What the depth atlas holds.
    pub views: Vec<DepthViewSpec>,
}

/// Any unit vector perpendicular to a unit vector.
pub fn perpendicular(direction: Vec3) -> Vec3 {
    direction.any_orthonormal_vector()
}

impl LightList {
    fn push(&mut self, mut sample: LightSample, views: &[DepthViewSpec]) {
        sample.first_view = self.views.len() as u32;
        sample.view_count = views.len() as u32;
        self.views.extend_from_slice(views);
        self.samples.push(sample);
    }

    /// Adds a punctual light: six faces for a point light, one view for a spot light, cascades for a directional one.
    pub fn add_light(&mut self, light: &Light, settings: &Settings, bounds: &Bounds, view: &View) {
        let diagonal = bounds.diagonal().max(1e-6);
        let near = diagonal * 1e-4;
        let (position, direction) = (light.position(), light.direction());
        let gutter = settings.gutter(light.radius);
        let sample = punctual(light);
        let side = settings.resolution;
        let first_view = self.views.len();
        match light.kind {
            LightKind::Point => {
                self.push(sample, &DepthViewSpec::cube(position, near, side, gutter))
            }
            LightKind::Spot {
                outer_cone_angle, ..
            } => {
                let tangent = outer_cone_angle.clamp(0.01, 1.55).tan();
                let up = perpendicular(direction);
                let plain = DepthViewSpec::perspective(
                    position, direction, up, tangent, near, side, gutter,
                );
                let spec = if settings.warp {
                    warped(plain, direction, bounds, view, gutter)
                } else {
                    plain
                };
                self.push(sample, &[spec]);
            }
            LightKind::Directional => {
                self.push(sample, &cascades(direction, settings, bounds, view));
            }
        }
        for view in &mut self.views[first_view..] {
            view.second_depth = settings.second_depth;
        }
    }

    /// Adds the sample points of [`on_emitters`], each with a hemicube of faces of `side` texels.
    pub fn add_emitters(
        &mut self,
        emitters: &[Emitter],
        count: u32,
        side: u32,
        gutter: u32,
        diagonal: f32,
    ) {
        let near = diagonal * 1e-4;
        for sample in on_emitters(emitters, count, 0) {
            let [position, normal, tangent] =
                [sample.position, sample.direction, sample.tangent].map(Vec3::from_array);
            let faces = if sample.kind == LightSample::AREA_TWO_SIDED {
                DepthViewSpec::hemicubes(position, normal, tangent, near, side, gutter).to_vec()
            } else {
                DepthViewSpec::hemicube(position, normal, tangent, near, side, gutter).to_vec()
            };
            self.push(sample, &faces);
        }
    }
}

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
            let (inner, outer) = (inner_cone_angle.cos(), outer_cone_angle.cos());
            sample.kind = LightSample::SPOT;
            sample.cone_scale = 1.0 / (inner - outer).max(1e-3);
            sample.cone_offset = -outer * sample.cone_scale;
        }
        LightKind::Directional => {
            sample.kind = LightSample::DIRECTIONAL;
            sample.radius = light.radius.tan();
        }
    }
    sample
}

/// `count` sample points on emissive triangles, stratified by emitted power: each stands for the same share of it. A sample's L A is the power
/// share over pi in the triangle's colour. Without views. Another `turn` has other points.
pub fn on_emitters(emitters: &[Emitter], count: u32, turn: u32) -> Vec<LightSample> {
    let weights: Vec<f64> = emitters.iter().map(Emitter::power).collect();
    let total: f64 = weights.iter().sum();
    if !(total > 0.0 && total.is_finite()) {
        return Vec::new();
    }
    // All points of a turn are shifted alike: they lie as evenly over the emitters as those of the first, and so do those of one number in
    // all turns.
    let shift = additive(R3, turn);
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
        let [x, y] = additive(R2, number);
        let [x, y] = [x + shift[1], y + shift[2]].map(|one| (0.5 + one).fract() as f32);
        // A point of the unit square to a point of the triangle, areas kept in proportion (Heitz 2019).
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
            tangent: (b - a).normalize_or(perpendicular(normal)).to_array(),
            area,
            ..bytemuck::Zeroable::zeroed()
        }
    };
    (0..count).map(sample).collect()
}

/// Cascades of a directional light, fitted to what the camera sees of the scene. Each covers a sphere around its slice of the view, so that its
/// size does not change when the camera turns, and moves in whole texels, so that its edges do not crawl.
fn cascades(
    direction: Vec3,
    settings: &Settings,
    bounds: &Bounds,
    view: &View,
) -> Vec<DepthViewSpec> {
    let center = bounds.center();
    let radius = (bounds.diagonal() / 2.0).max(1e-6);
    let up = perpendicular(direction);
    let right = direction.cross(up);
    let eye = view.world_from_view.w_axis.truncate();
    let forward = -view.world_from_view.z_axis.truncate();
    // The part of the view's axis along which there may be something to see.
    let middle = (center - eye).dot(forward);
    let near = (middle - radius).max(radius * 1e-3);
    let far = (middle + radius).max(near * 1.01);
    let count = if view.is_perspective {
        settings.cascades
    } else {
        1
    };
    let split = |index: u32| {
        // Half-way between equal ratios, which fit perspective, and equal lengths (Zhang et al. 2006).
        let part = index as f32 / count as f32;
        0.5 * (near * (far / near).powf(part) + near + (far - near) * part)
    };
    (0..count)
        .map(|index| {
            let (from, to) = (
                if index == 0 { 0.0 } else { split(index) },
                split(index + 1),
            );
            let (slice_center, slice_radius) = slice_sphere(view, eye, forward, from, to);
            // What lies outside the scene needs no texels.
            let (cascade_center, half) = if slice_radius < radius {
                (slice_center, slice_radius)
            } else {
                (center, radius)
            };
            // Room for the filter; in steps of a sixth of an octave, because a texel that grew a little with every step of the camera
            // would make edges crawl.
            let half = (((half * 1.05).log2() * 6.0).ceil() / 6.0).exp2();
            let texel = 2.0 * half / settings.resolution as f32;
            let snapped = |axis: Vec3| (cascade_center.dot(axis) / texel).round() * texel;
            let origin =
                right * snapped(right) + up * snapped(up) + direction * center.dot(direction);
            DepthViewSpec::orthographic(
                origin,
                direction,
                up,
                half,
                -radius * 1.05,
                radius * 1.05,
                settings.resolution,
            )
        })
        .collect()
}

/// The sphere around the part of a view between two distances.
fn slice_sphere(view: &View, eye: Vec3, forward: Vec3, from: f32, to: f32) -> (Vec3, f32) {
    if !view.is_perspective {
        let half = (to - from) / 2.0;
        return (
            eye + forward * (from + half),
            half.hypot(view.half_extent.length()),
        );
    }
    let spread = view.half_extent.length_squared();
    // The point on the axis that is equally far from the near and the far corners.
    let middle = ((to + from) * (1.0 + spread) / 2.0).min(to);
    let corner = Vec4::new(to * spread.sqrt(), to - middle, 0.0, 0.0).length();
    (eye + forward * middle, corner)
}
