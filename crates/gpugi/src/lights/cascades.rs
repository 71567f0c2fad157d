//! Cascades of a directional light: depth views that follow a camera.

use glam::{Vec3, Vec4};

use crate::capture::depth::DepthViewSpec;
use crate::capture::{View, frustum_planes};
use crate::scene::GpuScene;

/// `count` cascades of `side` texels of a directional light (one if rays are parallel), fitted to what the camera sees
/// of the scene. Each covers a sphere around its slice of the view. So its size does not change when the camera turns;
/// and it moves in whole texels, so its edges do not crawl.
pub fn cascades(
    direction: Vec3,
    count: u32,
    side: u32,
    scene: &GpuScene,
    view: &View,
) -> Vec<DepthViewSpec> {
    let bounds = &scene.bounds;
    let center = bounds.center();
    let radius = (bounds.diagonal() / 2.0).max(1e-6);
    let up = direction.any_orthonormal_vector();
    let right = direction.cross(up);
    let eye = view.world_from_view.w_axis.truncate();
    let forward = -view.world_from_view.z_axis.truncate();
    let [near, far] = seen_distances(scene, view);
    let count = if view.is_perspective { count } else { 1 };
    let split = |index: u32| {
        // Equal ratios suit perspective, where pixels are spread over the distances as texels are; equal lengths suit
        // what lies far from the eye in a narrow range (Zhang et al. 2006). Both count alike up to this ratio.
        const NARROW: f32 = 10.0;
        let part = index as f32 / count as f32;
        let lengths = 0.5 * (NARROW * near / far).min(1.0);
        let ratio = near * (far / near).powf(part);
        ratio + lengths * (near + (far - near) * part - ratio)
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
            let origin = right * snapped(right) + up * snapped(up);
            let sides = [right, -right, up, -up].map(|axis| axis.extend(half - axis.dot(origin)));
            // `origin` lies at 0 along the direction.
            let depths = scene.depths_within(&sides, direction, half);
            let [low, high] = depths.unwrap_or_default();
            let margin = 0.05 * (high - low) + 1e-3 * half;
            let [low, high] = [low - margin, high + margin];
            DepthViewSpec::orthographic(origin, direction, up, half, low, high, side)
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

/// Distances along a view's axis between which it may see something (m): powers of two, so that cascades keep their sizes
/// while the camera moves a little.
fn seen_distances(scene: &GpuScene, view: &View) -> [f32; 2] {
    /// An object around the eye is seen from about this share of its size on.
    const INSIDE: f32 = 0.02;
    let eye = view.world_from_view.w_axis.truncate();
    let forward = -view.world_from_view.z_axis.truncate();
    let planes = frustum_planes(&view.clip_from_world);
    // The far plane is infinitely far away.
    let planes = [planes[0], planes[1], planes[2], planes[3], planes[5]];
    let mut range = [f32::INFINITY, 0.0_f32];
    scene.visit_within(&planes, scene.diagonal(), |corners, diagonal| {
        let distances = || corners.iter().map(|&corner| (corner - eye).dot(forward));
        let nearest = distances().fold(f32::INFINITY, f32::min);
        let nearest = match nearest > diagonal * 1e-6 {
            true => nearest,
            false => diagonal * INSIDE,
        };
        range[0] = range[0].min(nearest);
        range[1] = distances().fold(range[1], f32::max);
    });
    let near = range[0].min(scene.diagonal()).max(scene.near());
    let near = near.log2().floor().exp2();
    [near, range[1].max(near * 1.01).log2().ceil().exp2()]
}
