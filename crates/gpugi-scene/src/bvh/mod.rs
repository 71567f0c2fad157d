//! Bounding volume hierarchies for rays: one a mesh, and one over instances, packed in rows of four words as shaders read them.
//!
//! ```text
//! mesh 0: nodes, triangles | mesh 1: nodes, triangles | ... | top: nodes, instances
//! ```
//! The top lies last, so that moving an instance writes that part alone. Row numbers in nodes are absolute.

mod binary;
mod node;
#[cfg(test)]
mod tests;
mod top;
pub mod traverse;
mod tree;

use glam::{DMat4, DVec3, Mat4, Vec3};

pub use node::NODE_ROWS;
pub use top::TopLevel;
use tree::Tree;

use crate::Bounds;

/// Four words of the packed hierarchy.
pub type Row = [u32; 4];

/// Rows of a triangle in a leaf: three corners in the mesh's units, the first followed by its number.
pub const TRIANGLE_ROWS: u32 = 3;

/// Rows of an instance in a leaf: three of the affine transform from world space to the mesh's units, then the row of the mesh's
/// root, the instance's number, flags and zero.
pub const INSTANCE_ROWS: u32 = 4;

/// Flag of an instance whose material has alpha: its hits are candidates.
pub const FLAG_ALPHA: u32 = 1;

/// Levels of a mesh's hierarchy at most: beyond, a balanced one replaces it, which holds 10^11 triangles.
const MESH_LEVELS: u32 = 12;

/// Levels of a top level at most, likewise: 10^7 instances.
const TOP_LEVELS: u32 = 8;

/// Entries of a traversal's stack. A level leaves one entry at most (the siblings still to visit), the first none; entering an instance
/// leaves one more. So the levels of the top and of the deepest mesh together, less one, are what a ray needs at most.
pub const STACK_SIZE: u32 = MESH_LEVELS + TOP_LEVELS - 1;

/// Rounding of slab tests, of projected corners and of a ray's transform: boxes are grown by this fraction of the distances and
/// extents that went into them. 2^-24 is one rounding; a chain has about ten.
const ROUNDING: f64 = 1.0 / (1 << 20) as f64;

/// A scene for which there is no hierarchy.
#[derive(Debug, Clone, Copy, thiserror::Error, PartialEq, Eq)]
#[error("{what} of the ray hierarchy: {needed} needed, {limit} is the most")]
pub struct BvhTooLarge {
    /// Rows (of 16 bytes) or levels.
    pub what: &'static str,
    /// How many it would have.
    pub needed: u64,
    /// How many it may have.
    pub limit: u64,
}

/// Where a mesh's hierarchy lies.
#[derive(Debug, Clone, Copy)]
struct MeshTree {
    root: u32,
    bounds: Bounds,
    /// Power of two that brings the mesh's largest coordinate to about one: products of tiny or huge ones would leave the range of
    /// 32-bit floats.
    units_from_mesh: f64,
}

/// An instance to place in the top level.
#[derive(Debug, Clone, Copy)]
pub struct BvhInstance {
    /// Which mesh.
    pub mesh: usize,
    /// World space (m) from mesh space.
    pub world_from_mesh: Mat4,
    /// [`FLAG_ALPHA`] or 0.
    pub flags: u32,
}

/// The hierarchies of meshes: what is needed to build top levels over them.
#[derive(Debug, Clone, Default)]
pub struct BottomLevel {
    meshes: Vec<MeshTree>,
    rows: u32,
}

impl BottomLevel {
    /// Builds the hierarchies of meshes given as triangles of finite corners in mesh space, in the numbering that hits shall have,
    /// and returns them with their rows.
    ///
    /// # Errors
    /// [`BvhTooLarge`].
    pub fn new(
        meshes: impl IntoIterator<Item = Vec<[Vec3; 3]>>,
    ) -> Result<(Self, Vec<Row>), BvhTooLarge> {
        let mut rows = Vec::new();
        let mut trees = Vec::new();
        for triangles in meshes {
            trees.push(append_mesh(&triangles, &mut rows)?);
        }
        let bottom = Self {
            meshes: trees,
            rows: row_number(rows.len())?,
        };
        Ok((bottom, rows))
    }

    /// The first row of the top level: the number of rows of all meshes.
    pub fn end(&self) -> u32 {
        self.rows
    }
}

fn at_most(what: &'static str, needed: usize, limit: u32) -> Result<u32, BvhTooLarge> {
    match u32::try_from(needed) {
        Ok(number) if number <= limit => Ok(number),
        _ => Err(BvhTooLarge {
            what,
            needed: needed as u64,
            limit: limit.into(),
        }),
    }
}

fn row_number(rows: usize) -> Result<u32, BvhTooLarge> {
    at_most("rows", rows, u32::MAX)
}

fn append_mesh(triangles: &[[Vec3; 3]], rows: &mut Vec<Row>) -> Result<MeshTree, BvhTooLarge> {
    let root = row_number(rows.len())?;
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
    // Exact but for denormal results.
    let scaled = |corner: Vec3| (corner.as_dvec3() * units_from_mesh).as_vec3();
    let boxes: Vec<Bounds> = triangles
        .iter()
        .map(|corners| Bounds::of(corners.map(scaled)))
        .collect();
    let tree = Tree::new(&boxes, MESH_LEVELS, 3);
    at_most("levels", tree.depth as usize, MESH_LEVELS)?;
    rows.extend(node::encode(&tree, &boxes, root, TRIANGLE_ROWS).0);
    for &number in &tree.order {
        let corners = triangles[number as usize].map(|corner| scaled(corner).to_array());
        for (corner, last) in corners.into_iter().zip([number, 0, 0]) {
            let [x, y, z] = corner.map(f32::to_bits);
            rows.push([x, y, z, last]);
        }
    }
    row_number(rows.len())?;
    Ok(MeshTree {
        root,
        bounds,
        units_from_mesh,
    })
}

/// The transform from world space to the mesh's units, and the box of the instance in world space, grown by what rounding of a ray's
/// transform may come to. None where there is nothing to hit.
fn placed(mesh: &MeshTree, world_from_mesh: &Mat4) -> Option<(Mat4, Bounds)> {
    if mesh.bounds.is_empty() {
        return None;
    }
    let world_from_mesh = world_from_mesh.as_dmat4();
    let determinant = glam::DMat3::from_mat4(world_from_mesh).determinant();
    if determinant == 0.0 || !determinant.is_finite() {
        return None;
    }
    let mesh_from_world = world_from_mesh.inverse();
    let matrix =
        (DMat4::from_scale(DVec3::splat(mesh.units_from_mesh)) * mesh_from_world).as_mat4();
    let corners = mesh
        .bounds
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
