//! The topology of an eight-wide tree over boxes: which boxes lie below which child.

use obvhs::aabb::Aabb;
use obvhs::cwbvh::{bvh2_to_cwbvh::bvh2_to_cwbvh, node::CwBvhNode};

use serde::{Deserialize, Serialize};

use super::binary;
use crate::Bounds;

/// A tree whose boxes were fitted anew has become bad if its cost exceeds this multiple of the cost as built.
pub(super) const WORST_COST: f64 = 1.5;

/// An eight-wide tree. The boxes of its nodes are encoded elsewhere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Tree {
    /// Only the topology of obvhs' nodes is used: which slots are filled, and with what. Children follow their parents.
    #[serde(with = "crate::plain")]
    pub nodes: Vec<CwBvhNode>,
    /// Primitives in the order of the leaves.
    #[serde(with = "crate::plain")]
    pub order: Vec<u32>,
    /// Nodes on the longest path from the root.
    pub depth: u32,
}

impl Tree {
    /// A tree over finite boxes with at most `most_items` (1 to 3) primitives per leaf. Without boxes, a single node
    /// without children. If the tree would have more than `most_levels` levels, a balanced tree instead.
    pub fn new(boxes: &[Bounds], most_levels: u32, most_items: u32) -> Self {
        if boxes.is_empty() {
            return Self::of(vec![CwBvhNode::default()], Vec::new());
        }
        let binary = binary::build(&normalized(boxes));
        let wide = bvh2_to_cwbvh(&binary, most_items, true, false);
        let tree = Self::of(wide.nodes, wide.primitive_indices);
        if tree.depth <= most_levels {
            tree
        } else {
            Self::balanced(binary.primitive_indices, most_items)
        }
    }

    /// Nodes that a random ray through the root's box visits, by their surface areas, given the boxes of all nodes.
    pub fn cost(bounds: &[Bounds]) -> f64 {
        let root = bounds.first().map_or(0.0, area);
        if root > 0.0 {
            bounds.iter().map(area).sum::<f64>() / root
        } else {
            1.0
        }
    }

    fn of(nodes: Vec<CwBvhNode>, order: Vec<u32>) -> Self {
        let mut levels = vec![1; nodes.len()];
        for (index, node) in nodes.iter().enumerate() {
            for child in 0..8 {
                if !node.is_child_empty(child) && !node.is_leaf(child) {
                    levels[node.child_node_index(child) as usize] = levels[index] + 1;
                }
            }
        }
        Self {
            nodes,
            order,
            depth: levels.into_iter().max().unwrap_or(1),
        }
    }

    /// The tree that recursively divides `order` into eight equal parts: n levels hold 8^n leaves.
    fn balanced(order: Vec<u32>, most_items: u32) -> Self {
        let mut nodes = vec![CwBvhNode::default()];
        let mut ranges = vec![(0, order.len())];
        let mut at = 0;
        while at < nodes.len() {
            let (first, end) = ranges[at];
            let mut node = CwBvhNode {
                child_base_idx: nodes.len() as u32,
                primitive_base_idx: first as u32,
                ..CwBvhNode::default()
            };
            let part = |slot: usize| (end - first) * slot / 8;
            let are_leaves = end - first <= 8 * most_items as usize;
            for slot in 0..8 {
                let (from, to) = (part(slot), part(slot + 1));
                if !are_leaves {
                    node.child_meta[slot] = 0b001 << 5 | (24 + slot as u8);
                    node.imask |= 1 << slot;
                    nodes.push(CwBvhNode::default());
                    ranges.push((first + from, first + to));
                } else if to > from {
                    let unary = [0b001, 0b011, 0b111][to - from - 1];
                    node.child_meta[slot] = unary << 5 | from as u8;
                }
            }
            nodes[at] = node;
            at += 1;
        }
        Self::of(nodes, order)
    }
}

/// Half the surface area of a box.
fn area(bounds: &Bounds) -> f64 {
    if bounds.is_empty() {
        return 0.0;
    }
    let extent = bounds.max.as_dvec3() - bounds.min.as_dvec3();
    extent.x * extent.y + extent.y * extent.z + extent.z * extent.x
}

/// Scales the boxes to the unit cube: areas of tiny or huge boxes would leave the range of 32-bit floats.
fn normalized(boxes: &[Bounds]) -> Vec<Aabb> {
    let all = boxes
        .iter()
        .fold(Bounds::EMPTY, |all, bounds| all.union(*bounds));
    let origin = all.min.as_dvec3();
    let extent = (all.max.as_dvec3() - origin).max_element();
    let scale = if extent > 0.0 { 1.0 / extent } else { 1.0 };
    let place = |corner: glam::Vec3| ((corner.as_dvec3() - origin) * scale).as_vec3a();
    boxes
        .iter()
        .map(|bounds| Aabb::new(place(bounds.min), place(bounds.max)))
        .collect()
}
