//! Bounding volume hierarchies for ray tracing: one per mesh and one over all instances, packed in rows of four words
//! for shaders.
//!
//! ```text
//! mesh 0: nodes, triangles | mesh 1: nodes, triangles | ... | top: nodes, instances
//! ```
//! The top level comes last, so that moving an instance rewrites only that part. Row numbers in nodes are absolute.

mod binary;
mod node;
#[cfg(test)]
mod tests;
mod top;
pub mod traverse;
mod tree;

use std::sync::Arc;

use glam::{DMat4, DVec3, Mat4, Vec3};
use serde::{Deserialize, Serialize};

pub use node::NODE_ROWS;
pub use top::{MovedItem, TopLevel};
use tree::{Tree, WORST_COST};

use crate::{Bounds, Sphere};

/// Four words of the packed hierarchies.
pub type Row = [u32; 4];

/// Rows per triangle in a leaf: one per corner, in the mesh's units. The fourth word of the first row is the triangle's
/// number.
pub const TRIANGLE_ROWS: u32 = 3;

/// Rows per instance in a leaf: three rows of the affine transform from world space to the mesh's units, then one row
/// with the row of the mesh's root, the instance's number, flags and, of a sphere, the row that holds its centre and
/// radius in the mesh's units.
pub const INSTANCE_ROWS: u32 = 4;

/// Flag of an instance whose material uses alpha: its hits are only candidates.
pub const FLAG_ALPHA: u32 = 1;

/// Flag of an instance that is a sphere: its triangles tell only which of them lies below a hit.
pub const FLAG_SPHERE: u32 = 2;

/// Flag of an instance whose back faces nobody sees and no light leaves: a front face in the same place hides them.
pub const FLAG_BLACK_BACK: u32 = 4;

/// Maximum number of levels of a mesh's hierarchy. A deeper one is replaced by a balanced one, which holds 10^11
/// triangles in this many levels.
const MESH_LEVELS: u32 = 12;

/// Maximum number of levels of a top level, likewise: 10^7 instances.
const TOP_LEVELS: u32 = 8;

/// Size of the traversal stack. Each level leaves at most one entry (the siblings still to visit), the first level
/// none; entering an instance leaves one more. So a ray needs at most the levels of the top plus those of the deepest
/// mesh, minus one.
pub const STACK_SIZE: u32 = MESH_LEVELS + TOP_LEVELS - 1;

/// Bound on the rounding errors of slab tests, projected corners and the ray's transform: boxes grow by this fraction
/// of the distances and extents involved. One rounding is 2^-24; a chain has about ten.
const ROUNDING: f64 = 1.0 / (1 << 20) as f64;

/// Why a scene has no hierarchy.
#[derive(Debug, Clone, Copy, thiserror::Error, PartialEq, Eq)]
pub enum BvhError {
    /// It would exceed a limit.
    #[error("{what} of the ray hierarchy: {needed} needed, {limit} is the most")]
    TooLarge {
        /// What exceeds the limit: rows (of 16 bytes) or levels.
        what: &'static str,
        /// The number that the hierarchy would need.
        needed: u64,
        /// The maximum.
        limit: u64,
    },
    /// A corner is infinite or NaN.
    #[error("triangle {triangle} of mesh {mesh} has a corner that is not finite")]
    NotFinite {
        /// Mesh number.
        mesh: usize,
        /// Triangle number.
        triangle: usize,
    },
}

/// Which triangles of a mesh lie below which node of its hierarchy. The boxes of the nodes are not part of it, so it
/// serves every shape of the mesh; how well depends on how the shapes differ.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TriangleTree {
    tree: Tree,
    /// [`Tree::cost`] when it was built.
    cost: f64,
}

impl TriangleTree {
    /// Builds the tree of a mesh's triangles, in mesh space.
    ///
    /// # Errors
    /// [`BvhError`].
    pub fn of(triangles: &[[Vec3; 3]]) -> Result<Arc<Self>, BvhError> {
        check_finite(0, triangles)?;
        mesh_tree(triangles, [], 0).map(|(built, _)| built.tree)
    }
}

/// The triangles of a mesh, of which a hierarchy is to be built.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshTriangles {
    /// The corners of each, in mesh space (m).
    pub corners: Vec<[Vec3; 3]>,
    /// A tree that was built of as many triangles in the same order, if there is one.
    pub tree: Option<Arc<TriangleTree>>,
}

impl From<Vec<[Vec3; 3]>> for MeshTriangles {
    fn from(corners: Vec<[Vec3; 3]>) -> Self {
        let tree = None;
        Self { corners, tree }
    }
}

/// A mesh's hierarchy within the rows.
#[derive(Debug, Clone)]
struct MeshTree {
    root: u32,
    bounds: Bounds,
    /// Row of the first triangle, and the number of triangles.
    first_triangle: u32,
    triangles: u32,
    /// Power of two that scales the mesh's largest coordinate to about one. Without it, products of tiny or huge
    /// coordinates would leave the range of 32-bit floats.
    units_from_mesh: f64,
    tree: Arc<TriangleTree>,
}

/// An instance to place in the top level.
#[derive(Debug, Clone, Copy)]
pub struct BvhInstance {
    /// Mesh number.
    pub mesh: usize,
    /// World space (m) from mesh space.
    pub world_from_mesh: Mat4,
    /// [`FLAG_ALPHA`], [`FLAG_BLACK_BACK`], both or neither.
    pub flags: u32,
    /// The sphere that stands for the mesh's triangles, in mesh space.
    pub sphere: Option<Sphere>,
}

/// The hierarchies of meshes, as far as building top levels over them requires.
#[derive(Debug, Clone, Default)]
pub struct BottomLevel {
    meshes: Vec<MeshTree>,
    rows: u32,
}

impl BottomLevel {
    /// Builds the hierarchies and returns them with their rows. Hits report triangles by their position in the lists. A
    /// tree that comes with the triangles is taken unless it is bad for them (docs/bvh.md).
    ///
    /// # Errors
    /// [`BvhError`].
    pub fn new(
        meshes: impl IntoIterator<Item = impl Into<MeshTriangles>>,
    ) -> Result<(Self, Vec<Row>), BvhError> {
        Self::default().following(meshes)
    }

    /// The same for meshes that may have deformed since `self` was built. A mesh keeps the tree of its number, with boxes
    /// fitted anew, if it has as many triangles as before and the tree has not become bad (docs/bvh.md).
    ///
    /// # Errors
    /// [`BvhError`].
    pub fn following(
        &self,
        meshes: impl IntoIterator<Item = impl Into<MeshTriangles>>,
    ) -> Result<(Self, Vec<Row>), BvhError> {
        let mut rows = Vec::new();
        let mut trees = Vec::new();
        for (mesh, triangles) in meshes.into_iter().enumerate() {
            let MeshTriangles { corners, tree } = triangles.into();
            check_finite(mesh, &corners)?;
            let root = row_number(rows.len())?;
            let before = self.meshes.get(mesh).map(|before| before.tree.clone());
            let (tree, of_mesh) = mesh_tree(&corners, before.into_iter().chain(tree), root)?;
            trees.push(tree);
            rows.extend(of_mesh);
        }
        let bottom = Self {
            meshes: trees,
            rows: row_number(rows.len())?,
        };
        Ok((bottom, rows))
    }

    /// Fits the tree of one mesh to its triangles after it has deformed. Returns the rows of the mesh and the number of
    /// the first one; or `None`, if [`BottomLevel::following`] would build another tree: then nothing has changed.
    ///
    /// # Errors
    /// [`BvhError`].
    pub fn bend(
        &mut self,
        mesh: usize,
        triangles: &[[Vec3; 3]],
    ) -> Result<Option<(u32, Vec<Row>)>, BvhError> {
        check_finite(mesh, triangles)?;
        let before = &mut self.meshes[mesh];
        let (after, rows) = mesh_tree(triangles, [before.tree.clone()], before.root)?;
        if !Arc::ptr_eq(&before.tree, &after.tree) {
            return Ok(None);
        }
        *before = after;
        Ok(Some((before.root, rows)))
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

    /// The first row of the top level, which is the total number of rows of all meshes.
    pub fn end(&self) -> u32 {
        self.rows
    }
}

fn at_most(what: &'static str, needed: usize, limit: u32) -> Result<u32, BvhError> {
    match u32::try_from(needed) {
        Ok(number) if number <= limit => Ok(number),
        _ => Err(BvhError::TooLarge {
            what,
            needed: needed as u64,
            limit: limit.into(),
        }),
    }
}

fn row_number(rows: usize) -> Result<u32, BvhError> {
    at_most("rows", rows, u32::MAX)
}

fn check_finite(mesh: usize, triangles: &[[Vec3; 3]]) -> Result<(), BvhError> {
    let is_broken = |corners: &[Vec3; 3]| corners.iter().any(|corner| !corner.is_finite());
    match triangles.iter().position(is_broken) {
        Some(triangle) => Err(BvhError::NotFinite { mesh, triangle }),
        None => Ok(()),
    }
}

/// The hierarchy of a mesh whose rows begin at `root`, and these rows. It has the first of the `known` trees that is
/// good for the triangles.
fn mesh_tree(
    triangles: &[[Vec3; 3]],
    known: impl IntoIterator<Item = Arc<TriangleTree>>,
    root: u32,
) -> Result<(MeshTree, Vec<Row>), BvhError> {
    let bounds = Bounds::of(triangles.as_flattened().iter().copied());
    let largest = if bounds.is_empty() {
        0.0
    } else {
        bounds.min.abs().max(bounds.max.abs()).max_element()
    };
    let units_from_mesh = if largest > 0.0 {
        (-f64::from(largest).log2().ceil()).exp2()
    } else {
        1.0
    };
    // Exact except for denormal results.
    let scaled = |corner: Vec3| (corner.as_dvec3() * units_from_mesh).as_vec3();
    let boxes: Vec<Bounds> = triangles
        .iter()
        .map(|corners| Bounds::of(corners.map(scaled)))
        .collect();
    let fitted = |tree: &Tree| {
        let (encoded, bounds) = node::encode(tree, &boxes, root, TRIANGLE_ROWS);
        (encoded, Tree::cost(&bounds))
    };
    let kept = known
        .into_iter()
        .filter(|known| known.tree.order.len() == triangles.len())
        .find_map(|known| {
            let (encoded, cost_now) = fitted(&known.tree);
            (cost_now <= WORST_COST * known.cost).then_some((known, encoded))
        });
    let (tree, mut rows) = match kept {
        Some(kept) => kept,
        None => {
            let tree = Tree::new(&boxes, MESH_LEVELS, 3);
            at_most("levels", tree.depth as usize, MESH_LEVELS)?;
            let (encoded, cost) = fitted(&tree);
            (Arc::new(TriangleTree { tree, cost }), encoded)
        }
    };
    let first_triangle = row_number(root as usize + rows.len())?;
    for &number in &tree.tree.order {
        let corners = triangles[number as usize].map(|corner| scaled(corner).to_array());
        for (corner, last) in corners.into_iter().zip([number, 0, 0]) {
            let [x, y, z] = corner.map(f32::to_bits);
            rows.push([x, y, z, last]);
        }
    }
    row_number(root as usize + rows.len())?;
    let tree = MeshTree {
        root,
        bounds,
        first_triangle,
        triangles: triangles.len() as u32,
        units_from_mesh,
        tree,
    };
    Ok((tree, rows))
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
