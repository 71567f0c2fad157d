//! The shape of a tree over boxes, from obvhs: which boxes lie below which of eight children.

use glam::DVec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::{bvh2_to_cwbvh::bvh2_to_cwbvh, node::CwBvhNode};
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

use crate::Bounds;

/// Primitives of a leaf at most: what the node format can say.
const MAX_LEAF: u32 = 3;

/// An eight-wide tree. Boxes of nodes are encoded elsewhere.
pub(super) struct Tree {
    /// Of obvhs' nodes only the topology counts: which slots are filled, by what. Children follow their parents.
    pub nodes: Vec<CwBvhNode>,
    /// Primitives in the order of the leaves.
    pub order: Vec<u32>,
    /// Nodes on the longest way down.
    pub depth: u32,
}

impl Tree {
    /// A tree over boxes that are finite; none give one node without children.
    pub fn new(boxes: &[Bounds]) -> Self {
        if boxes.is_empty() {
            return Self {
                nodes: vec![CwBvhNode::default()],
                order: Vec::new(),
                depth: 1,
            };
        }
        let boxes = distinct(boxes);
        let order = (0..boxes.len() as u32).collect();
        let mut binary = PlocBuilder::new().build(
            PlocSearchDistance::High,
            &boxes,
            order,
            SortPrecision::U64,
            0,
        );
        ReinsertionOptimizer::default().run(&mut binary, 0.2, None);
        let wide = bvh2_to_cwbvh(&binary, MAX_LEAF, true, false);
        let mut levels = vec![1; wide.nodes.len()];
        for (index, node) in wide.nodes.iter().enumerate() {
            for child in 0..8 {
                if !node.is_child_empty(child) && !node.is_leaf(child) {
                    levels[node.child_node_index(child) as usize] = levels[index] + 1;
                }
            }
        }
        Self {
            nodes: wide.nodes,
            order: wide.primitive_indices,
            depth: levels.into_iter().max().unwrap_or(1),
        }
    }
}

/// The boxes scaled into the unit cube and grown by a little that differs from box to box: where costs tie, clustering merges one
/// pair a round.
fn distinct(boxes: &[Bounds]) -> Vec<Aabb> {
    let all = boxes.iter().fold(Bounds::EMPTY, |all, one| all.union(*one));
    let origin = all.min.as_dvec3();
    let extent = (all.max.as_dvec3() - origin).max_element();
    let scale = if extent > 0.0 { 1.0 / extent } else { 1.0 };
    boxes
        .iter()
        .enumerate()
        .map(|(index, one)| {
            let min = (one.min.as_dvec3() - origin) * scale;
            let max = (one.max.as_dvec3() - origin) * scale;
            let random = (index as f64 * 0.618_033_988_75).fract();
            let grown = DVec3::splat((max - min).max_element() / 512.0 + 1e-6) * random;
            Aabb::new((min - grown).as_vec3a(), (max + grown).as_vec3a())
        })
        .collect()
}
