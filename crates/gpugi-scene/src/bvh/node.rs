//! The packed node: 80 bytes, stored as five rows of four words, after Ylitie, Karras and Laine, "Efficient Incoherent
//! Ray Traversal on GPUs Through Compressed Wide BVHs" (HPG 2017).
//!
//! ```text
//! row 0   origin x, y, z (f32)            | grid exponents along x, y, z (biased, 8 bits), mask of inner children
//! row 1   row of first child, of first leaf item | eight bytes of meta, one per child
//! row 2   smallest x of eight children (8 bytes) | largest x
//! row 3   the same for y
//! row 4   the same for z
//! ```
//! Child i spans origin + 2^exponent * [smallest, largest]. The meta byte has three high bits and five low bits. For an
//! inner child they are 001 and 24 + slot; for a leaf, the number of items (0 to 3, unary) and the first item; for an
//! empty slot, the byte is 0.

use glam::DVec3;

use super::rows::Row;
use super::tree::Tree;
use crate::Bounds;

/// Rows per node.
pub const NODE_ROWS: u32 = 5;

/// Encodes a tree's nodes; returns their rows and their boxes. `boxes`: the boxes of primitives, by number.
/// `first_row`: the row of the first node; leaf items of `item_rows` rows each follow the nodes.
pub(super) fn encode(
    tree: &Tree,
    boxes: &[Bounds],
    first_row: u32,
    item_rows: u32,
) -> (Vec<Row>, Vec<Bounds>) {
    let mut bounds = vec![Bounds::EMPTY; tree.nodes.len()];
    let mut rows = vec![Row::default(); tree.nodes.len() * NODE_ROWS as usize];
    // Children follow their parents, so a backward pass knows the boxes of all children.
    for index in (0..tree.nodes.len()).rev() {
        let children = child_bounds(tree, boxes, &bounds, index);
        bounds[index] = children.into_iter().fold(Bounds::EMPTY, Bounds::union);
        let encoded = encode_node(tree, index, &children, first_row, item_rows);
        let at = index * NODE_ROWS as usize;
        rows[at..at + encoded.len()].copy_from_slice(&encoded);
    }
    (rows, bounds)
}

/// The boxes of a node's children, taken from `boxes` of the primitives and `bounds` of the nodes below it.
pub(super) fn child_bounds(
    tree: &Tree,
    boxes: &[Bounds],
    bounds: &[Bounds],
    index: usize,
) -> [Bounds; 8] {
    let node = &tree.nodes[index];
    std::array::from_fn(|slot| {
        if node.is_child_empty(slot) {
            Bounds::EMPTY
        } else if node.is_leaf(slot) {
            let (first, count) = node.child_primitives(slot);
            let items = &tree.order[first as usize..(first + count) as usize];
            items
                .iter()
                .fold(Bounds::EMPTY, |all, &item| all.union(boxes[item as usize]))
        } else {
            bounds[node.child_node_index(slot) as usize]
        }
    })
}

/// The rows of one node with these boxes of children.
pub(super) fn encode_node(
    tree: &Tree,
    index: usize,
    children: &[Bounds; 8],
    first_row: u32,
    item_rows: u32,
) -> [Row; NODE_ROWS as usize] {
    let node = &tree.nodes[index];
    let first_item = first_row + tree.nodes.len() as u32 * NODE_ROWS;
    let grid = Grid::around(
        &children
            .iter()
            .fold(Bounds::EMPTY, |all, bounds| all.union(*bounds)),
    );
    let steps_per_unit = grid.steps_per_unit();
    let mut planes = [[0_u8; 8]; 6];
    for (slot, child) in children.iter().enumerate() {
        if child.is_empty() {
            continue;
        }
        let [min, max] = grid.cells(child, &steps_per_unit);
        for axis in 0..3 {
            planes[axis * 2][slot] = min[axis];
            planes[axis * 2 + 1][slot] = max[axis];
        }
    }
    let words = |bytes: [u8; 8]| {
        let (low, high) = bytes.split_at(4);
        [low, high].map(|four| u32::from_le_bytes([four[0], four[1], four[2], four[3]]))
    };
    let [x, y, z] = grid.origin.map(f32::to_bits);
    let [ex, ey, ez] = grid.exponents.map(u32::from);
    let frame = ex | ey << 8 | ez << 16 | u32::from(node.imask) << 24;
    let [meta_low, meta_high] = words(node.child_meta);
    let along = |axis: usize| {
        let [min, max] = [words(planes[axis * 2]), words(planes[axis * 2 + 1])];
        [min[0], min[1], max[0], max[1]]
    };
    [
        [x, y, z, frame],
        [
            first_row + node.child_base_idx * NODE_ROWS,
            first_item + node.primitive_base_idx * item_rows,
            meta_low,
            meta_high,
        ],
        along(0),
        along(1),
        along(2),
    ]
}

/// The grid, with 256 planes per axis, on which the boxes of a node's children are quantized.
struct Grid {
    origin: [f32; 3],
    /// Exponents of the grid step, biased by 127.
    exponents: [u8; 3],
}

impl Grid {
    fn around(bounds: &Bounds) -> Self {
        if bounds.is_empty() {
            return Self {
                origin: [0.0; 3],
                exponents: [127; 3],
            };
        }
        let min = bounds.min.as_dvec3();
        let extent = bounds.max.as_dvec3() - min;
        // Give flat nodes a grid of nonzero height, too: rounding errors are a fraction of that height.
        let extent = extent.max(DVec3::splat(extent.max_element() * 2.0_f64.powi(-16)));
        Self {
            origin: bounds.min.to_array(),
            exponents: extent
                .to_array()
                .map(|length| ((length / 255.0).log2().ceil().max(-120.0) as i32 + 127) as u8),
        }
    }

    /// Steps of the grid per unit of length, powers of two: along the axes.
    fn steps_per_unit(&self) -> [f64; 3] {
        self.exponents
            .map(|biased| 2.0_f64.powi(127 - i32::from(biased)))
    }

    /// The grid planes around a box inside the grid, rounded outward.
    fn cells(&self, child: &Bounds, steps_per_unit: &[f64; 3]) -> [[u8; 3]; 2] {
        let cell = |position: f32, axis: usize| {
            (f64::from(position) - f64::from(self.origin[axis])) * steps_per_unit[axis]
        };
        [
            std::array::from_fn(|axis| cell(child.min[axis], axis).floor().max(0.0) as u8),
            std::array::from_fn(|axis| cell(child.max[axis], axis).ceil().min(255.0) as u8),
        ]
    }
}
