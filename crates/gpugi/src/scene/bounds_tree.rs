//! The box around many boxes, of which a few change: a binary tree of unions.

use gpugi_scene::Bounds;

/// Boxes by number, and their unions.
#[derive(Debug, Clone)]
pub(super) struct BoundsTree {
    /// The root is at 1, the children of n at 2 n and 2 n + 1; the second half are the boxes.
    nodes: Vec<Bounds>,
}

impl BoundsTree {
    pub fn new(boxes: impl ExactSizeIterator<Item = Bounds>) -> Self {
        let leaves = boxes.len().next_power_of_two();
        let mut nodes = vec![Bounds::EMPTY; 2 * leaves];
        for (leaf, one) in nodes[leaves..].iter_mut().zip(boxes) {
            *leaf = one;
        }
        for index in (1..leaves).rev() {
            nodes[index] = nodes[2 * index].union(nodes[2 * index + 1]);
        }
        Self { nodes }
    }

    /// Replaces a box.
    pub fn set(&mut self, number: usize, bounds: Bounds) {
        let mut index = self.nodes.len() / 2 + number;
        self.nodes[index] = bounds;
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
        self.nodes[1]
    }
}
