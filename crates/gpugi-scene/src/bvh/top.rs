//! The top level: a hierarchy over instances in world space. It is built when instances come or go, and refitted when
//! they move.

use std::collections::BTreeSet;
use std::ops::Range;

use glam::Mat4;

use super::tree::Tree;
use super::{
    BottomLevel, BvhError, BvhInstance, INSTANCE_ROWS, NODE_ROWS, Row, TOP_LEVELS, at_most, node,
    placed, row_number, traverse,
};
use crate::Bounds;

/// A top level over instances.
#[derive(Debug, Clone)]
pub struct TopLevel {
    /// Its rows, which follow the rows of the meshes.
    pub rows: Vec<Row>,
    /// Where rays start: a row and bits, see [`traverse`]. With a single instance, rays start inside it.
    pub start: [u32; 2],
    first_row: u32,
    tree: Tree,
    /// World-space boxes of leaf items, by primitive of the tree.
    boxes: Vec<Bounds>,
    /// World-space boxes of nodes.
    bounds: Vec<Bounds>,
    /// Parents by node; the root is its own parent.
    parents: Vec<u32>,
    /// Leaves by instance; `None` for instances that are left out.
    leaves: Vec<Option<Leaf>>,
}

/// Where an instance is in a top level.
#[derive(Debug, Clone, Copy)]
struct Leaf {
    /// Number of its box.
    primitive: u32,
    /// First of its rows among those of the top level.
    row: u32,
    /// The node above it.
    node: u32,
}

impl BottomLevel {
    /// A top level over `instances`. It leaves out instances of meshes without triangles and instances whose transform
    /// has no inverse in 32-bit floats.
    ///
    /// # Errors
    /// [`BvhError`].
    pub fn top_level(&self, instances: &[BvhInstance]) -> Result<TopLevel, BvhError> {
        let mut boxes = Vec::new();
        let mut items: Vec<[Row; INSTANCE_ROWS as usize]> = Vec::new();
        let mut numbers = Vec::new();
        for (number, instance) in instances.iter().enumerate() {
            let mesh = &self.meshes[instance.mesh];
            let Some((matrix, bounds)) = placed(mesh, &instance.world_from_mesh) else {
                continue;
            };
            let links = [mesh.root, number as u32, instance.flags, 0];
            let [x, y, z] = matrix_rows(&matrix);
            boxes.push(bounds);
            items.push([x, y, z, links]);
            numbers.push(number);
        }
        let tree = Tree::new(&boxes, TOP_LEVELS, 1);
        at_most("levels", tree.depth as usize, TOP_LEVELS)?;
        let (mut rows, bounds) = node::encode(&tree, &boxes, self.rows, INSTANCE_ROWS);
        let first_item = rows.len() as u32;
        rows.extend(tree.order.iter().flat_map(|&item| items[item as usize]));
        row_number(self.rows as usize + rows.len())?;
        let start = match items.len() {
            1 => [self.rows + NODE_ROWS, 1],
            _ => [self.rows, traverse::FIRST_NODE],
        };

        let mut parents = vec![0; tree.nodes.len()];
        let mut leaves = vec![None; instances.len()];
        for (index, node) in (0..).zip(&tree.nodes) {
            for slot in (0..8).filter(|&slot| !node.is_child_empty(slot)) {
                if !node.is_leaf(slot) {
                    parents[node.child_node_index(slot) as usize] = index;
                    continue;
                }
                let (first, count) = node.child_primitives(slot);
                for at in first..first + count {
                    let primitive = tree.order[at as usize];
                    leaves[numbers[primitive as usize]] = Some(Leaf {
                        primitive,
                        row: first_item + at * INSTANCE_ROWS,
                        node: index,
                    });
                }
            }
        }
        Ok(TopLevel {
            rows,
            start,
            first_row: self.rows,
            tree,
            boxes,
            bounds,
            parents,
            leaves,
        })
    }

    /// Whether moving this instance, of this mesh, to `world_from_mesh` keeps it in `top` or keeps it left out, as a
    /// new top level would.
    pub fn can_refit(
        &self,
        top: &TopLevel,
        number: usize,
        mesh: usize,
        world_from_mesh: &Mat4,
    ) -> bool {
        let is_placed = placed(&self.meshes[mesh], world_from_mesh).is_some();
        is_placed == top.leaves[number].is_some()
    }

    /// Moves instances of `top`, each given by its number, its mesh and its transform, for which
    /// [`BottomLevel::can_refit`] holds. Their boxes and those of the nodes above them fit as in a new top level, but
    /// each node keeps its instances. Returns the ranges of [`TopLevel::rows`] that changed, in order.
    pub fn refit(
        &self,
        top: &mut TopLevel,
        moved: impl IntoIterator<Item = (usize, usize, Mat4)>,
    ) -> Vec<Range<usize>> {
        let mut changed = Vec::new();
        let mut nodes = BTreeSet::new();
        for (number, mesh, world_from_mesh) in moved {
            let place = placed(&self.meshes[mesh], &world_from_mesh);
            let (Some(leaf), Some((matrix, bounds))) = (top.leaves[number], place) else {
                continue;
            };
            let row = leaf.row as usize;
            top.rows[row..row + 3].copy_from_slice(&matrix_rows(&matrix));
            top.boxes[leaf.primitive as usize] = bounds;
            // Report all rows of the instance: ranges of neighbours then follow each other without a gap, for one
            // upload.
            changed.push(row..row + INSTANCE_ROWS as usize);
            nodes.insert(leaf.node);
        }
        // Children follow their parents, so the boxes of the last node's children are final.
        while let Some(index) = nodes.pop_last() {
            let children = node::child_bounds(&top.tree, &top.boxes, &top.bounds, index as usize);
            let bounds = children.into_iter().fold(Bounds::EMPTY, Bounds::union);
            let rows = node::encode_node(
                &top.tree,
                index as usize,
                &children,
                top.first_row,
                INSTANCE_ROWS,
            );
            let row = (index * NODE_ROWS) as usize;
            top.rows[row..row + rows.len()].copy_from_slice(&rows);
            changed.push(row..row + rows.len());
            if index > 0 && bounds != top.bounds[index as usize] {
                nodes.insert(top.parents[index as usize]);
            }
            top.bounds[index as usize] = bounds;
        }
        changed.sort_unstable_by_key(|range| range.start);
        changed
    }
}

/// The three rows of an affine transform.
fn matrix_rows(matrix: &Mat4) -> [Row; 3] {
    [0, 1, 2].map(|row| matrix.row(row).to_array().map(f32::to_bits))
}
