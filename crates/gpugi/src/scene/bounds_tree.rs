//! The box around many boxes, and the largest of them, of which a few change: a binary tree of unions.

use glam::Mat4;
use gpugi_scene::Bounds;

/// A box in the world, and how far its corners may lie from it by rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Placed {
    pub bounds: Bounds,
    /// Its diagonal or, if the transform cancels larger numbers, the largest of these (m).
    pub longest: f32,
}

impl Placed {
    /// The box of a mesh under a transform.
    pub fn new(of_mesh: &Bounds, world_from_mesh: &Mat4) -> Self {
        let bounds = of_mesh.transformed(world_from_mesh);
        if bounds.is_empty() {
            return Self::EMPTY;
        }
        let largest = |bounds: &Bounds| bounds.min.abs().max(bounds.max.abs());
        let [x, y, z, w] = [0, 1, 2, 3].map(|axis| world_from_mesh.col(axis).truncate().abs());
        let of_mesh = largest(of_mesh);
        let terms = (x * of_mesh.x + y * of_mesh.y + z * of_mesh.z + w).max_element();
        let cancels = terms > 2.0 * largest(&bounds).max_element();
        Self {
            bounds,
            longest: bounds.diagonal().max(if cancels { terms } else { 0.0 }),
        }
    }

    const EMPTY: Self = Self {
        bounds: Bounds::EMPTY,
        longest: 0.0,
    };

    fn union(self, other: Self) -> Self {
        Self {
            bounds: self.bounds.union(other.bounds),
            longest: self.longest.max(other.longest),
        }
    }
}

/// Boxes by number, and their unions.
#[derive(Debug, Clone)]
pub(super) struct BoundsTree {
    /// The root is at 1, the children of n at 2 n and 2 n + 1; the second half are the boxes.
    nodes: Vec<Placed>,
}

impl BoundsTree {
    pub fn new(boxes: impl ExactSizeIterator<Item = Placed>) -> Self {
        let leaves = boxes.len().next_power_of_two();
        let mut nodes = vec![Placed::EMPTY; 2 * leaves];
        for (leaf, one) in nodes[leaves..].iter_mut().zip(boxes) {
            *leaf = one;
        }
        for index in (1..leaves).rev() {
            nodes[index] = nodes[2 * index].union(nodes[2 * index + 1]);
        }
        Self { nodes }
    }

    /// Replaces a box.
    pub fn set(&mut self, number: usize, placed: Placed) {
        let mut index = self.nodes.len() / 2 + number;
        self.nodes[index] = placed;
        while index > 1 {
            index /= 2;
            let union = self.nodes[2 * index].union(self.nodes[2 * index + 1]);
            if self.nodes[index] == union {
                return;
            }
            self.nodes[index] = union;
        }
    }

    /// The box around all.
    pub fn all(&self) -> Bounds {
        self.nodes[1].bounds
    }

    /// The largest [`Placed::longest`] (m).
    pub fn longest(&self) -> f32 {
        self.nodes[1].longest
    }

    /// The boxes, or where there are more than `most`, boxes around groups of them.
    pub fn at_most(&self, most: usize) -> Vec<Bounds> {
        let leaves = self.nodes.len() / 2;
        let first = leaves.min(1 << most.max(1).ilog2());
        let boxes = self.nodes[first..2 * first].iter();
        boxes
            .map(|one| one.bounds)
            .filter(|one| !one.is_empty())
            .collect()
    }

    /// Goes through the boxes from the root down. `enters` gets a box and whether it is one of the boxes themselves, and
    /// says whether to go on to those inside it.
    pub fn visit(&self, mut enters: impl FnMut(&Bounds, bool) -> bool) {
        let leaves = self.nodes.len() / 2;
        let mut stack = vec![1];
        while let Some(index) = stack.pop() {
            let is_leaf = index >= leaves;
            let one = &self.nodes[index].bounds;
            if !one.is_empty() && enters(one, is_leaf) && !is_leaf {
                stack.extend([2 * index, 2 * index + 1]);
            }
        }
    }
}
