//! Cascades of a directional light: depth views that follow a camera.

use glam::{Vec3, Vec4};
use gpugi_scene::Bounds;

use crate::capture::View;
use crate::capture::depth::DepthViewSpec;

/// `count` cascades of `side` texels of a directional light (one if rays are parallel), fitted to what the camera sees
/// of the scene. Each covers a sphere around its slice of the view. So its size does not change when the camera turns;
/// and it moves in whole texels, so its edges do not crawl.
pub fn cascades(
    direction: Vec3,
    count: u32,
    side: u32,
    bounds: &Bounds,
    view: &View,
) -> Vec<DepthViewSpec> {
    let center = bounds.center();
    let radius = (bounds.diagonal() / 2.0).max(1e-6);
    let up = direction.any_orthonormal_vector();
    let right = direction.cross(up);
    let eye = view.world_from_view.w_axis.truncate();
    let forward = -view.world_from_view.z_axis.truncate();
    // The part of the view's axis along which something may be visible.
    let middle = (center - eye).dot(forward);
    let near = (middle - radius).max(radius * 1e-3);
    let far = (middle + radius).max(near * 1.01);
    let count = if view.is_perspective { count } else { 1 };
    let split = |index: u32| {
        // Split half-way between equal ratios, which suit perspective, and equal lengths (Zhang et al. 2006).
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
            // Space outside the scene needs no texels.
            let (cascade_center, half) = if slice_radius < radius {
                (slice_center, slice_radius)
            } else {
                (center, radius)
            };
            // Add room for the filter. The size changes in steps of a sixth of an octave: if texels grew slightly with
            // every camera movement, edges would crawl.
            let half = (((half * 1.05).log2() * 6.0).ceil() / 6.0).exp2();
            let texel = 2.0 * half / side as f32;
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
                side,
            )
        })
        .collect()
}

/// The sphere around the slice of a view between two distances.
fn slice_sphere(view: &View, eye: Vec3, forward: Vec3, from: f32, to: f32) -> (Vec3, f32) {
    if !view.is_perspective {
        let half = (to - from) / 2.0;
        return (
            eye + forward * (from + half),
            half.hypot(view.half_extent.length()),
        );
    }
    let spread = view.half_extent.length_squared();
    // The point on the axis at equal distances from the near and the far corners.
    let middle = ((to + from) * (1.0 + spread) / 2.0).min(to);
    let corner = Vec4::new(to * spread.sqrt(), to - middle, 0.0, 0.0).length();
    (eye + forward * middle, corner)
}
