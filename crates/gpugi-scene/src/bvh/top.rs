//! The top level: a hierarchy over instances in world space. It is built when instances come or go. When they move, the
//! GPU refits its nodes.

use glam::{DMat4, DVec3, Mat4};

use super::bottom::{BottomLevel, MeshTree};
use super::error::{BvhError, at_most, row_number};
use super::node::NODE_ROWS;
use super::rows::{FLAG_SPHERE, INSTANCE_ROWS, ROUNDING, Row, TOP_LEVELS};
use super::tree::{Tree, WORST_COST};
use super::{node, traverse};
use crate::{Bounds, Sphere};

/// An instance to place in the top level.
#[derive(Debug, Clone, Copy)]
pub struct BvhInstance {
    /// Mesh number.
    pub mesh: usize,
    /// World space (m) from mesh space.
    pub world_from_mesh: Mat4,
    /// [`FLAG_ALPHA`](super::FLAG_ALPHA), [`FLAG_BLACK_BACK`](super::FLAG_BLACK_BACK), both or neither.
    pub flags: u32,
    /// The sphere that stands for the mesh's triangles, in mesh space.
    pub sphere: Option<Sphere>,
}

/// A top level over instances.
#[derive(Debug, Clone)]
pub struct TopLevel {
    /// Where rays start: a row and bits, see [`traverse`]. With a single instance, rays start inside it.
    pub start: [u32; 2],
    /// World-space boxes of leaf items, in the order of their rows.
    pub boxes: Vec<Bounds>,
    tree: Tree,
    /// Last rows of leaf items, which stay.
    links: Vec<Row>,
    /// Leaf item of each instance; `None` for instances that are left out.
    items: Vec<Option<u32>>,
    /// The sphere that each instance is, in mesh space.
    spheres: Vec<Option<Sphere>>,
    /// [`TopLevel::cost`] as built.
    built_cost: f64,
    /// Moves since the cost was last computed.
    moves: usize,
}

/// A leaf item at its new place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MovedItem {
    /// Index of the item, in the order of rows.
    pub item: u32,
    /// Its rows.
    pub rows: [Row; INSTANCE_ROWS as usize],
    /// World-space box.
    pub bounds: Bounds,
}

impl BottomLevel {
    /// A top level over `instances`, and its rows, which follow the rows of the meshes: nodes, leaf items, spheres. It
    /// leaves out instances of meshes without triangles and instances whose transform has no inverse in 32-bit floats.
    ///
    /// # Errors
    /// [`BvhError`].
    pub fn top_level(&self, instances: &[BvhInstance]) -> Result<(TopLevel, Vec<Row>), BvhError> {
        let mut boxes = Vec::new();
        let mut rows_of_items: Vec<[Row; INSTANCE_ROWS as usize]> = Vec::new();
        let mut numbers = Vec::new();
        let mut spheres: Vec<Row> = Vec::new();
        for (number, instance) in instances.iter().enumerate() {
            let mesh = &self.meshes[instance.mesh];
            let sphere = instance.sphere.as_ref();
            let Some((matrix, bounds)) = placed(mesh, sphere, &instance.world_from_mesh) else {
                continue;
            };
            let mut links = [mesh.root, number as u32, instance.flags, 0];
            if let Some(sphere) = sphere {
                links[2] |= FLAG_SPHERE;
                links[3] = spheres.len() as u32;
                spheres.push(sphere_row(sphere, mesh.units_from_mesh));
            }
            let [x, y, z] = matrix_rows(&matrix);
            boxes.push(bounds);
            rows_of_items.push([x, y, z, links]);
            numbers.push(number);
        }
        let tree = Tree::new(&boxes, TOP_LEVELS, 1);
        at_most("levels", tree.depth as usize, TOP_LEVELS)?;
        let (mut rows, _) = node::encode(&tree, &boxes, self.rows, INSTANCE_ROWS);
        let order = tree.order.iter().map(|&item| item as usize);
        let end_of_items = rows.len() + rows_of_items.as_flattened().len();
        row_number(self.rows as usize + end_of_items + spheres.len())?;
        for [.., links] in &mut rows_of_items {
            if links[2] & FLAG_SPHERE != 0 {
                links[3] += self.rows + end_of_items as u32;
            }
        }
        rows.extend(order.clone().flat_map(|item| rows_of_items[item]));
        rows.extend(spheres);
        let start = match numbers.len() {
            1 => [self.rows + NODE_ROWS, 1],
            _ => [self.rows, traverse::FIRST_NODE],
        };
        let mut items = vec![None; instances.len()];
        for (at, item) in (0..).zip(order.clone()) {
            items[numbers[item]] = Some(at);
        }
        let mut top = TopLevel {
            start,
            boxes: order.clone().map(|item| boxes[item]).collect(),
            links: order.map(|item| rows_of_items[item][3]).collect(),
            tree,
            items,
            spheres: instances.iter().map(|instance| instance.sphere).collect(),
            built_cost: 0.0,
            moves: 0,
        };
        top.built_cost = top.cost();
        Ok((top, rows))
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
        let is_placed = placed(
            &self.meshes[mesh],
            top.spheres[number].as_ref(),
            world_from_mesh,
        )
        .is_some();
        is_placed == top.items[number].is_some()
    }

    /// Moves an instance of `top`, given by its number, its mesh and its transform, for which
    /// [`BottomLevel::can_refit`] holds. Returns its leaf item, if it has one; nodes have to be refitted.
    pub fn place(
        &self,
        top: &mut TopLevel,
        number: usize,
        mesh: usize,
        world_from_mesh: &Mat4,
    ) -> Option<MovedItem> {
        let item = top.items[number]?;
        let (matrix, bounds) = placed(
            &self.meshes[mesh],
            top.spheres[number].as_ref(),
            world_from_mesh,
        )?;
        top.boxes[item as usize] = bounds;
        top.moves += 1;
        let [x, y, z] = matrix_rows(&matrix);
        Some(MovedItem {
            item,
            rows: [x, y, z, top.links[item as usize]],
            bounds,
        })
    }

    /// The triangles and spheres of all instances in `top`, for tests of each without the hierarchy. `mesh_of` gives the
    /// mesh of an instance. One entry per instance: its row, the row of its first triangle or of its sphere, and the
    /// number of triangles and spheres before; then one that holds the number of all.
    ///
    /// # Errors
    /// [`BvhError::TooLarge`].
    pub fn runs(
        &self,
        top: &TopLevel,
        mesh_of: impl Fn(usize) -> usize,
    ) -> Result<Vec<Row>, BvhError> {
        let first_item = self.rows + top.nodes() * NODE_ROWS;
        let mut runs = Vec::new();
        let mut before = 0_usize;
        for (instance, item) in top.items() {
            let mesh = &self.meshes[mesh_of(instance)];
            let row = first_item + item * INSTANCE_ROWS;
            let (first, count) = match top.sphere_row(item) {
                Some(row) => (row, 1),
                None => (mesh.first_triangle, mesh.triangles),
            };
            runs.push([row, first, at_most("triangles", before, u32::MAX)?, 0]);
            before += count as usize;
        }
        let all = at_most("triangles", before, u32::MAX)?;
        runs.push([0, 0, all, 0]);
        Ok(runs)
    }
}

impl TopLevel {
    /// Numbers of the instances that are not left out, each with its leaf item.
    fn items(&self) -> impl Iterator<Item = (usize, u32)> {
        let items = self.items.iter().enumerate();
        items.filter_map(|(instance, item)| item.map(|item| (instance, item)))
    }

    /// The row of a leaf item's sphere, if it is one.
    fn sphere_row(&self, item: u32) -> Option<u32> {
        let [.., flags, row] = self.links[item as usize];
        (flags & FLAG_SPHERE != 0).then_some(row)
    }

    /// Number of nodes.
    pub fn nodes(&self) -> u32 {
        self.tree.nodes.len() as u32
    }

    /// Nodes by level, the deepest level first: in that order they can be refitted.
    pub fn levels(&self) -> Vec<Vec<u32>> {
        let mut level_of = vec![0; self.tree.nodes.len()];
        let mut levels = vec![Vec::new(); self.tree.depth as usize];
        // Children follow their parents.
        for (index, node) in self.tree.nodes.iter().enumerate() {
            let level: usize = level_of[index];
            levels[level].push(index as u32);
            for slot in (0..8).filter(|&slot| !node.is_child_empty(slot) && !node.is_leaf(slot)) {
                level_of[node.child_node_index(slot) as usize] = level + 1;
            }
        }
        levels.reverse();
        levels
    }

    /// Whether instances have moved so far, relative to each other, that the tree should be built again: rays visit 1.5
    /// times as many nodes as when it was built. Looks only when as many moves as there are instances have come together
    /// since it last looked, so that a move costs little.
    pub fn has_become_bad(&mut self) -> bool {
        if self.moves < self.boxes.len() {
            return false;
        }
        self.moves = 0;
        self.cost() > WORST_COST * self.built_cost
    }

    /// [`Tree::cost`] now.
    fn cost(&self) -> f64 {
        let nodes = &self.tree.nodes;
        let mut bounds = vec![Bounds::EMPTY; nodes.len()];
        for (index, node) in nodes.iter().enumerate().rev() {
            let mut all = Bounds::EMPTY;
            for slot in (0..8).filter(|&slot| !node.is_child_empty(slot)) {
                if node.is_leaf(slot) {
                    let (first, count) = node.child_primitives(slot);
                    let items = &self.boxes[first as usize..(first + count) as usize];
                    all = items.iter().fold(all, |all, item| all.union(*item));
                } else {
                    all = all.union(bounds[node.child_node_index(slot) as usize]);
                }
            }
            bounds[index] = all;
        }
        Tree::cost(&bounds)
    }
}

/// The transform from world space to the mesh's units, and the world-space box of the instance (of its mesh or of the
/// sphere that stands for it), grown by the largest rounding error of a ray's transform. `None` if there is nothing to
/// hit.
fn placed(
    mesh: &MeshTree,
    sphere: Option<&Sphere>,
    world_from_mesh: &Mat4,
) -> Option<(Mat4, Bounds)> {
    if mesh.bounds.is_empty() {
        return None;
    }
    let bounds = sphere.map_or(mesh.bounds, Sphere::bounds);
    let world_from_mesh = world_from_mesh.as_dmat4();
    let determinant = glam::DMat3::from_mat4(world_from_mesh).determinant();
    if determinant == 0.0 || !determinant.is_finite() {
        return None;
    }
    let mesh_from_world = world_from_mesh.inverse();
    let matrix =
        (DMat4::from_scale(DVec3::splat(mesh.units_from_mesh)) * mesh_from_world).as_mat4();
    let corners = bounds
        .corners()
        .map(|corner| world_from_mesh.transform_point3(corner.as_dvec3()));
    let min = corners.into_iter().reduce(DVec3::min)?;
    let max = corners.into_iter().reduce(DVec3::max)?;
    // error(world) = |world from mesh| error(mesh), error(mesh) = rounding (|mesh from world| |world| + |translation|)
    let magnitude = |matrix: &DMat4, v: DVec3| {
        matrix.x_axis.truncate().abs() * v.x
            + matrix.y_axis.truncate().abs() * v.y
            + matrix.z_axis.truncate().abs() * v.z
    };
    let in_mesh = magnitude(&mesh_from_world, min.abs().max(max.abs()))
        + mesh_from_world.w_axis.truncate().abs();
    let grown = magnitude(&world_from_mesh, in_mesh) * ROUNDING;
    let bounds = Bounds {
        min: (min - grown).as_vec3(),
        max: (max + grown).as_vec3(),
    };
    (matrix.is_finite() && bounds.min.is_finite() && bounds.max.is_finite())
        .then_some((matrix, bounds))
}

/// Centre and radius in the mesh's units.
fn sphere_row(sphere: &Sphere, units_from_mesh: f64) -> Row {
    let row = sphere.center.extend(sphere.radius).as_dvec4() * units_from_mesh;
    row.as_vec4().to_array().map(f32::to_bits)
}

/// The three rows of an affine transform.
fn matrix_rows(matrix: &Mat4) -> [Row; 3] {
    [0, 1, 2].map(|row| matrix.row(row).to_array().map(f32::to_bits))
}
