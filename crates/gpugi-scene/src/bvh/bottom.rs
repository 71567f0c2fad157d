//! The hierarchies of meshes.

use std::sync::Arc;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::error::{BvhError, at_most, row_number};
use super::node;
use super::rows::{MESH_LEVELS, Row, TRIANGLE_ROWS};
use super::tree::{Tree, WORST_COST};
use crate::Bounds;

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
pub(super) struct MeshTree {
    pub root: u32,
    pub bounds: Bounds,
    /// Row of the first triangle, and the number of triangles.
    pub first_triangle: u32,
    pub triangles: u32,
    /// Power of two that scales the mesh's largest coordinate to about one. Without it, products of tiny or huge
    /// coordinates would leave the range of 32-bit floats.
    pub units_from_mesh: f64,
    pub tree: Arc<TriangleTree>,
}

/// The hierarchies of meshes, as far as building top levels over them requires.
#[derive(Debug, Clone, Default)]
pub struct BottomLevel {
    pub(super) meshes: Vec<MeshTree>,
    pub(super) rows: u32,
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

    /// The first row of the top level, which is the total number of rows of all meshes.
    pub fn end(&self) -> u32 {
        self.rows
    }
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
