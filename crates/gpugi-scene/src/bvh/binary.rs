//! Builds a binary tree top down by the binned surface area heuristic: Wald, "On Fast Construction of SAH-based
//! Bounding Volume Hierarchies" (2007). It takes O(n log n) for any input; the clustering that obvhs offers takes
//! O(n^2) for nested boxes.

use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, node::Bvh2Node};

/// Bins per axis.
const BINS: usize = 32;

/// Beyond this many levels, ranges are halved, so the tree's depth stays below this plus the logarithm of the number of
/// boxes.
const LEVELS_BY_COST: usize = 64;

/// A node to build: its number, its range in the order of primitives, and its depth.
struct Task {
    node: usize,
    first: usize,
    end: usize,
    depth: usize,
}

/// A tree over at least one box, with one box per leaf.
pub(super) fn build(boxes: &[Aabb]) -> Bvh2 {
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    let mut nodes = vec![Bvh2Node::default()];
    let mut tasks = vec![Task {
        node: 0,
        first: 0,
        end: boxes.len(),
        depth: 1,
    }];
    let mut depth = 1;
    while let Some(task) = tasks.pop() {
        let range = &mut order[task.first..task.end];
        let bounds = union(range.iter().map(|&index| boxes[index as usize]));
        depth = depth.max(task.depth);
        if range.len() == 1 {
            nodes[task.node] = Bvh2Node::new(bounds, 1, task.first as u32);
            continue;
        }
        let middle = task.first + split(boxes, range, task.depth < LEVELS_BY_COST);
        let children = nodes.len();
        nodes[task.node] = Bvh2Node::new(bounds, 0, children as u32);
        nodes.resize(children + 2, Bvh2Node::default());
        for (child, first, end) in [(0, task.first, middle), (1, middle, task.end)] {
            tasks.push(Task {
                node: children + child,
                first,
                end,
                depth: task.depth + 1,
            });
        }
    }
    Bvh2 {
        nodes,
        primitive_indices: order,
        children_are_ordered_after_parents: true,
        max_depth: depth + 1,
        ..Bvh2::default()
    }
}

/// Partitions `range` so that its first part becomes one child and the rest the other; returns the length of the first
/// part.
fn split(boxes: &[Aabb], range: &mut [u32], by_cost: bool) -> usize {
    let centers = union(
        range
            .iter()
            .map(|&index| Aabb::from_point(boxes[index as usize].center())),
    );
    let extent = centers.diagonal();
    let scale = Vec3A::select(
        extent.cmpgt(Vec3A::splat(1e-30)),
        BINS as f32 * 0.9999 / extent,
        Vec3A::ZERO,
    );
    let bin = |index: u32| ((boxes[index as usize].center() - centers.min) * scale).as_uvec3();
    let half = range.len() / 2;
    if by_cost
        && range.len() > 2
        && let Some((axis, last)) = best_plane(boxes, range, bin)
    {
        let mut left = 0;
        for index in 0..range.len() {
            if bin(range[index])[axis] <= last {
                range.swap(index, left);
                left += 1;
            }
        }
        return left;
    }
    let axis = centers.largest_axis();
    range.select_nth_unstable_by(half, |&a, &b| {
        let center = |index: u32| boxes[index as usize].center_axis(axis);
        center(a).total_cmp(&center(b))
    });
    half
}

/// The axis and the last bin of the first part that minimize the sum of area times count over both parts. `None` if all
/// boxes fall into the same bin.
fn best_plane(
    boxes: &[Aabb],
    range: &[u32],
    bin: impl Fn(u32) -> glam::UVec3,
) -> Option<(usize, u32)> {
    let mut bounds = [[Aabb::INVALID; BINS]; 3];
    let mut counts = [[0_u32; BINS]; 3];
    for &index in range {
        let bins = bin(index).to_array();
        for axis in 0..3 {
            let at = bins[axis] as usize;
            bounds[axis][at] = bounds[axis][at].union(&boxes[index as usize]);
            counts[axis][at] += 1;
        }
    }
    let mut best = (f32::INFINITY, 0, 0);
    for axis in 0..3 {
        let mut right_costs = [0.0; BINS];
        let (mut right, mut number) = (Aabb::INVALID, 0);
        for at in (1..BINS).rev() {
            right = right.union(&bounds[axis][at]);
            number += counts[axis][at];
            right_costs[at - 1] = if number == 0 {
                f32::INFINITY
            } else {
                cost(&right, number)
            };
        }
        let (mut left, mut number) = (Aabb::INVALID, 0);
        for at in 0..BINS - 1 {
            left = left.union(&bounds[axis][at]);
            number += counts[axis][at];
            let sum = cost(&left, number) + right_costs[at];
            if number > 0 && sum < best.0 {
                best = (sum, axis, at as u32);
            }
        }
    }
    best.0.is_finite().then_some((best.1, best.2))
}

/// Area times count. A small multiple of the extent is added to the area, so that boxes without area are split by
/// position, too.
fn cost(bounds: &Aabb, number: u32) -> f32 {
    let length = bounds.diagonal().element_sum();
    (bounds.half_area() + length * 1e-6) * number as f32
}

fn union(boxes: impl Iterator<Item = Aabb>) -> Aabb {
    boxes.fold(Aabb::INVALID, |all, bounds| all.union(&bounds))
}
