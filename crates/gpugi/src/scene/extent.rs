//! What of a scene lies within a convex region, however large the scene is: for ranges of depth and cascades.

use glam::{Vec3, Vec4};
use gpugi_scene::Bounds;

use super::GpuScene;

/// Most boxes that a core is sought among: few enough for every frame in which something moves.
pub(super) const MOST_BOXES: usize = 1024;
/// An instance whose box is larger than this share of a region is cut by the region's planes; smaller ones count whole.
const LARGE: f32 = 0.25;

impl GpuScene {
    /// Calls `visit` with corners of polyhedra that together contain all instances within the region on the positive
    /// sides of `planes`, and with the diagonal (m) of the box that they come from. `size`: of the region (m).
    pub(crate) fn visit_within(
        &self,
        planes: &[Vec4],
        size: f32,
        mut visit: impl FnMut(&[Vec3], f32),
    ) {
        self.bounds_tree.visit(|bounds, is_instance| {
            let side = |plane: &Vec4, is_far: bool| {
                let toward = plane.truncate().cmpge(Vec3::ZERO);
                let toward = if is_far { toward } else { !toward };
                plane.dot(Vec3::select(toward, bounds.max, bounds.min).extend(1.0))
            };
            if planes.iter().any(|plane| side(plane, true) < 0.0) {
                return false;
            }
            let is_inside = planes.iter().all(|plane| side(plane, false) >= 0.0);
            let diagonal = bounds.diagonal();
            let is_small = diagonal < size * LARGE;
            if !is_instance && (!is_inside || !is_small) {
                return true;
            }
            if is_inside || is_small {
                visit(&bounds.corners(), diagonal);
            } else {
                let cut = planes
                    .iter()
                    .fold(box_faces(bounds), |faces, &plane| clip(faces, plane));
                visit(&cut.concat(), diagonal);
            }
            false
        });
    }

    /// Where the instances within a region begin and end along an axis (m); `None` if there are none. `planes` and `size`
    /// as in [`GpuScene::visit_within`].
    pub(crate) fn depths_within(&self, planes: &[Vec4], axis: Vec3, size: f32) -> Option<[f32; 2]> {
        let mut range = [f32::INFINITY, f32::NEG_INFINITY];
        self.visit_within(planes, size, |corners, _| {
            for depth in corners.iter().map(|corner| corner.dot(axis)) {
                range = [range[0].min(depth), range[1].max(depth)];
            }
        });
        (range[0] <= range[1]).then_some(range)
    }
}

/// The six faces of a box, corners in order around each.
pub(crate) fn box_faces(bounds: &Bounds) -> Vec<Vec<Vec3>> {
    let corners = bounds.corners();
    [
        [0, 1, 3, 2],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 3, 7, 6],
        [0, 2, 6, 4],
        [1, 3, 7, 5],
    ]
    .map(|face| face.map(|corner| corners[corner]).to_vec())
    .to_vec()
}

/// The part of a convex polyhedron on the positive side of a plane (Sutherland and Hodgman 1974), closed by a new face.
pub(crate) fn clip(faces: Vec<Vec<Vec3>>, plane: Vec4) -> Vec<Vec<Vec3>> {
    let height = |point: Vec3| plane.dot(point.extend(1.0));
    let mut cut = Vec::new();
    let mut kept: Vec<Vec<Vec3>> = Vec::new();
    for face in faces {
        let mut polygon = Vec::new();
        for (index, &from) in face.iter().enumerate() {
            let to = face[(index + 1) % face.len()];
            let (h_from, h_to) = (height(from), height(to));
            if h_from >= 0.0 {
                polygon.push(from);
            }
            if (h_from >= 0.0) != (h_to >= 0.0) {
                let crossing = from.lerp(to, h_from / (h_from - h_to));
                polygon.push(crossing);
                cut.push(crossing);
            }
        }
        if polygon.len() >= 3 {
            kept.push(polygon);
        }
    }
    if cut.len() >= 3 {
        let center = cut.iter().sum::<Vec3>() / cut.len() as f32;
        let normal = plane.truncate().normalize_or(Vec3::Y);
        let right = normal.any_orthonormal_vector();
        let up = normal.cross(right);
        let angle = |point: &Vec3| {
            (*point - center)
                .dot(up)
                .atan2((*point - center).dot(right))
        };
        cut.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        kept.push(cut);
    }
    kept
}
