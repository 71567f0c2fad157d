//! What of a scene lies within a convex region, however large the scene is: for ranges of depth and cascades.

use std::cmp::Ordering;

use glam::{Vec3, Vec4};
use gpugi_scene::Bounds;

use super::GpuScene;

/// An instance whose box is larger than this share of a region is cut by the region's planes; smaller ones count whole.
const LARGE: f32 = 0.25;

/// Most boxes that a core is sought among: few enough for every frame in which something moves.
pub(super) const MOST_BOXES: usize = 1024;
/// A box that reaches this many times farther from the middle than all before it is no part of the core.
const GAP: f32 = 30.0;

/// The box around a scene's core: all but what is far larger than the rest or far away, such as the ground of a landscape,
/// the dome of a sky and what was left lying about. The box around all if no half of the boxes tells what the core is.
pub(super) fn core_of(boxes: &[Bounds], all: Bounds) -> Bounds {
    // Of an even number, each of the two in the middle may be outside of the core.
    let cores =
        [(boxes.len().max(1) - 1) / 2, boxes.len() / 2].map(|rank| core_around(boxes, rank));
    match cores {
        [Some(a), Some(b)] if a == b => a.0,
        [a, b] => {
            let count = |core: &Option<(Bounds, usize)>| core.map_or(0, |(_, count)| count);
            match count(&a).cmp(&count(&b)) {
                Ordering::Equal => all,
                Ordering::Greater => a.map_or(all, |core| core.0),
                Ordering::Less => b.map_or(all, |core| core.0),
            }
        }
    }
}

/// The core around the middle of the boxes, which has `rank` of their centres below it along each axis, and the number of
/// its boxes.
fn core_around(boxes: &[Bounds], rank: usize) -> Option<(Bounds, usize)> {
    let middle = Vec3::from_array([0, 1, 2].map(|axis| {
        let centers = boxes.iter().map(|one| one.center()[axis]);
        let mut centers: Vec<f32> = centers.collect();
        match rank < centers.len() {
            true => *centers.select_nth_unstable_by(rank, f32::total_cmp).1,
            false => 0.0,
        }
    }));
    let reach = |one: &Bounds| {
        let farthest = (one.max - middle).abs().max((one.min - middle).abs());
        farthest.length()
    };
    let mut by_reach: Vec<(f32, &Bounds)> = boxes.iter().map(|one| (reach(one), one)).collect();
    by_reach.sort_by(|a, b| a.0.total_cmp(&b.0));
    let is_gap = |pair: &[(f32, &Bounds)]| pair[1].0 > GAP * pair[0].0 && pair[0].0 > 0.0;
    let count = by_reach.windows(2).position(is_gap);
    let count = count.map_or(by_reach.len(), |last| last + 1);
    let core = by_reach[..count].iter().map(|(_, one)| **one);
    (2 * count >= boxes.len()).then(|| (core.fold(Bounds::EMPTY, Bounds::union), count))
}

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

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(center: Vec3, side: f32) -> Bounds {
        Bounds {
            min: center - side / 2.0,
            max: center + side / 2.0,
        }
    }

    fn core(boxes: &[Bounds]) -> Bounds {
        let all = boxes.iter().copied().fold(Bounds::EMPTY, Bounds::union);
        core_of(boxes, all)
    }

    #[test]
    fn what_is_far_larger_or_far_away_is_no_part_of_the_core() {
        let house = [-2.0, 0.0, 3.0].map(|x| cube(Vec3::new(x, 1.0, 0.0), 2.0));
        let alone = core(&house);
        assert_eq!(alone.max.x, 4.0);
        let ground = cube(Vec3::ZERO, 1e5);
        let stray = cube(Vec3::splat(1e5), 1.0);
        let with = |others: &[Bounds]| core(&[&house, others].concat());
        assert_eq!(with(&[ground]), alone);
        assert_eq!(with(&[stray]), alone);
        assert_eq!(with(&[ground, stray]), alone);
        // A ground ten times as large belongs to it.
        let garden = cube(Vec3::ZERO, 50.0);
        assert_eq!(with(&[garden]), garden);
        // A box on a ground; two boxes far apart, of which none is more than the other; nothing.
        let box_on_ground = cube(Vec3::new(0.0, 0.5, 0.0), 1.0);
        assert_eq!(core(&[ground, box_on_ground]), box_on_ground);
        assert_eq!(core(&[box_on_ground, stray]).max, stray.max);
        assert!(core(&[]).is_empty());
    }
}
