//! The box around many boxes, and the largest of them, of which a few change: a binary tree of unions.

use gpugi_scene::Bounds;

/// Boxes by number, and their unions.
#[derive(Debug, Clone)]
pub(super) struct BoundsTree {
    /// The root is at 1, the children of n at 2 n and 2 n + 1; the second half are the boxes.
    nodes: Vec<Node>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Node {
    bounds: Bounds,
    /// The longest diagonal of the boxes in it (m).
    longest: f32,
}

impl Node {
    fn of(bounds: Bounds) -> Self {
        Self {
            bounds,
            longest: bounds.diagonal(),
        }
    }

    fn union(self, other: Self) -> Self {
        Self {
            bounds: self.bounds.union(other.bounds),
            longest: self.longest.max(other.longest),
        }
    }
}

impl BoundsTree {
    pub fn new(boxes: impl ExactSizeIterator<Item = Bounds>) -> Self {
        let leaves = boxes.len().next_power_of_two();
        let mut nodes = vec![Node::of(Bounds::EMPTY); 2 * leaves];
        for (leaf, bounds) in nodes[leaves..].iter_mut().zip(boxes) {
            *leaf = Node::of(bounds);
        }
        for index in (1..leaves).rev() {
            nodes[index] = nodes[2 * index].union(nodes[2 * index + 1]);
        }
        Self { nodes }
    }

    /// Replaces a box.
    pub fn set(&mut self, number: usize, bounds: Bounds) {
        let mut index = self.nodes.len() / 2 + number;
        self.nodes[index] = Node::of(bounds);
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

    /// The longest diagonal of a box (m).
    pub fn longest(&self) -> f32 {
        self.nodes[1].longest
    }

    /// The boxes, or where there are more than `most`, boxes around groups of them.
    pub fn at_most(&self, most: usize) -> Vec<Bounds> {
        let leaves = self.nodes.len() / 2;
        let first = leaves.min(1 << most.max(1).ilog2());
        let boxes = self.nodes[first..2 * first].iter();
        boxes
            .map(|node| node.bounds)
            .filter(|bounds| !bounds.is_empty())
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
