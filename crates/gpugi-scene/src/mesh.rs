//! Indexed triangle meshes.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3, Vec4};
use serde::{Deserialize, Serialize};

use crate::bounds::Bounds;
use crate::bvh::TriangleTree;
use crate::names::Name;
use crate::provoking::provoking_order;

/// An indexed triangle mesh. Counter-clockwise triangles face the viewer.
///
/// `positions` and `normals` have the same length. `tangents`, each set of `uvs` and `colors` either have that length
/// or are empty. The length of `indices` is a multiple of three, and every index is in range. [`Mesh::check`] verifies
/// these conditions.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Mesh {
    /// Name for reports.
    pub name: Name,
    /// What the importer subtracted from the file's positions (m), because they lie far from the origin of their node.
    /// Only [`Scene::pose`](crate::Scene::pose) needs it: [`Instance::world_from_mesh`](crate::Instance) includes it.
    pub origin: DVec3,
    /// Positions in mesh space (m).
    #[serde(with = "crate::plain")]
    pub positions: Vec<Vec3>,
    /// Unit normals in mesh space.
    #[serde(with = "crate::plain")]
    pub normals: Vec<Vec3>,
    /// Unit tangents (xyz) and the sign of the bitangent (w), as glTF defines them; empty if there are no normal maps.
    #[serde(with = "crate::plain")]
    pub tangents: Vec<Vec4>,
    /// Two sets of texture coordinates, v downward.
    pub uvs: [Vec<Vec2>; 2],
    /// Linear vertex colours with alpha; they multiply the base colour.
    #[serde(with = "crate::plain")]
    pub colors: Vec<Vec4>,
    /// Three vertex indices per triangle.
    #[serde(with = "crate::plain")]
    pub indices: Vec<u32>,
    /// The tree of its ray hierarchy, if it was built ahead ([`Mesh::build_tree`]): uploads then need not build one. It
    /// may be that of another shape of the mesh, or of another mesh: one that does not serve is ignored.
    pub tree: Option<Arc<TriangleTree>>,
}

/// See [`Mesh::weld_positions`].
pub(crate) fn weld(positions: &[Vec3]) -> Vec<u32> {
    let mut number_at = HashMap::with_capacity(positions.len());
    positions
        .iter()
        .map(|position| {
            let next = number_at.len() as u32;
            // Adding zero turns -0 into 0.
            let key = (*position + Vec3::ZERO).to_array().map(f32::to_bits);
            *number_at.entry(key).or_insert(next)
        })
        .collect()
}

impl Mesh {
    /// Bounding box of all positions, in mesh space.
    pub fn bounds(&self) -> Bounds {
        Bounds::of(self.positions.iter().copied())
    }

    /// Total area of the triangles, in mesh space (m^2).
    pub fn area(&self) -> f64 {
        let corner = |&index: &u32| self.positions[index as usize].as_dvec3();
        let triangles = self.indices.as_chunks::<3>().0.iter();
        let areas = triangles.map(|triangle| {
            let [a, b, c] = triangle.each_ref().map(corner);
            (b - a).cross(c - a).length() / 2.0
        });
        areas.sum()
    }

    /// Bytes in memory.
    pub fn byte_size(&self) -> usize {
        self.positions.len() * 12
            + self.normals.len() * 12
            + self.tangents.len() * 16
            + (self.uvs[0].len() + self.uvs[1].len()) * 8
            + self.colors.len() * 16
            + self.indices.len() * 4
    }

    /// Checks that the array lengths are consistent and that positions and normals are finite.
    ///
    /// # Errors
    /// The first violation found.
    pub fn check(&self) -> Result<(), String> {
        let count = self.positions.len();
        let lengths = [
            ("normals", self.normals.len(), false),
            ("tangents", self.tangents.len(), true),
            ("first texture coordinates", self.uvs[0].len(), true),
            ("second texture coordinates", self.uvs[1].len(), true),
            ("colours", self.colors.len(), true),
        ];
        for (what, length, may_be_empty) in lengths {
            if length != count && !(may_be_empty && length == 0) {
                return Err(format!("{length} {what} for {count} positions"));
            }
        }
        if !self.indices.len().is_multiple_of(3) {
            return Err(format!(
                "{} indices are no whole triangles",
                self.indices.len()
            ));
        }
        if let Some(at) = self
            .indices
            .iter()
            .position(|&index| index as usize >= count)
        {
            return Err(format!(
                "index {} at position {at} is out of range: there are {count} vertices",
                self.indices[at]
            ));
        }
        if let Some(at) = self
            .positions
            .iter()
            .position(|position| !position.is_finite())
        {
            return Err(format!("position of vertex {at} is not finite"));
        }
        if let Some(at) = self.normals.iter().position(|normal| !normal.is_finite()) {
            return Err(format!("normal of vertex {at} is not finite"));
        }
        Ok(())
    }

    /// Builds [`Mesh::tree`], unless the mesh has no hierarchy: its upload says why.
    pub fn build_tree(&mut self) {
        self.tree = self.check().ok().and_then(|()| {
            let order = provoking_order(&self.indices, self.positions.len());
            TriangleTree::of(&order.triangles(&self.positions)).ok()
        });
    }

    /// A new mesh that contains the listed vertices of this one, in that order and repeated as listed. The new
    /// `indices` refer to the new vertices.
    pub fn with_vertices(&self, vertices: &[u32], indices: Vec<u32>) -> Self {
        fn pick<T: Copy>(from: &[T], vertices: &[u32]) -> Vec<T> {
            if from.is_empty() {
                return Vec::new();
            }
            let item = |&vertex: &u32| from[vertex as usize];
            vertices.iter().map(item).collect()
        }
        Self {
            name: self.name.clone(),
            origin: self.origin,
            positions: pick(&self.positions, vertices),
            normals: pick(&self.normals, vertices),
            tangents: pick(&self.tangents, vertices),
            uvs: [pick(&self.uvs[0], vertices), pick(&self.uvs[1], vertices)],
            colors: pick(&self.colors, vertices),
            indices,
            tree: None,
        }
    }

    /// Assigns each vertex a number. Two vertices get the same number exactly if their positions are bitwise equal (-0
    /// counts as 0). This removes the seams that normals and texture coordinates require.
    pub fn weld_positions(&self) -> Vec<u32> {
        weld(&self.positions)
    }

    /// Pairs of vertices that have one position: each with the first of those that it is welded to.
    pub fn seams(&self) -> Vec<[u32; 2]> {
        let welded = self.weld_positions();
        let mut firsts = vec![u32::MAX; welded.len()];
        let pairs = welded.iter().zip(0..).filter_map(|(&number, vertex)| {
            let first = &mut firsts[number as usize];
            if *first == u32::MAX {
                *first = vertex;
            }
            (*first != vertex).then_some([*first, vertex])
        });
        pairs.collect()
    }

    /// Number of connected pieces: triangles that share a corner, after welding equal positions, are one piece.
    pub fn pieces(&self) -> usize {
        let welded = self.weld_positions();
        // A forest of corners: each points towards the root of its piece.
        let mut parents: Vec<u32> = (0..welded.len() as u32).collect();
        let root = |parents: &mut [u32], mut corner: u32| {
            while parents[corner as usize] != corner {
                parents[corner as usize] = parents[parents[corner as usize] as usize];
                corner = parents[corner as usize];
            }
            corner
        };
        let mut pieces = 0;
        let mut is_used = vec![false; welded.len()];
        for triangle in self.indices.as_chunks::<3>().0 {
            let corners = triangle.map(|index| welded[index as usize]);
            for corner in corners {
                pieces += usize::from(!std::mem::replace(&mut is_used[corner as usize], true));
            }
            for other in &corners[1..] {
                let [a, b] = [corners[0], *other].map(|corner| root(&mut parents, corner));
                pieces -= usize::from(a != b);
                parents[b as usize] = a;
            }
        }
        pieces
    }

    /// Whether the mesh bounds a solid: it has triangles, and after welding equal positions and dropping triangles that
    /// become degenerate, each edge joins exactly two triangles that traverse it in opposite directions. Second-depth
    /// shadow maps require this. Indices must be in range.
    pub fn is_closed(&self) -> bool {
        let welded = self.weld_positions();
        let mut edges = HashSet::with_capacity(self.indices.len());
        for triangle in self.indices.as_chunks::<3>().0 {
            let [a, b, c] = triangle.map(|index| welded[index as usize]);
            if a == b || b == c || c == a {
                continue;
            }
            for edge in [(a, b), (b, c), (c, a)] {
                if !edges.insert(edge) {
                    return false;
                }
            }
        }
        !edges.is_empty() && edges.iter().all(|&(a, b)| edges.contains(&(b, a)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin::builtin;

    #[test]
    fn pieces_are_joined_by_equal_positions() {
        let corners = |positions: &[f32], indices: &[u32]| Mesh {
            positions: positions.iter().map(|&x| Vec3::new(x, 0.0, 0.0)).collect(),
            indices: indices.to_vec(),
            ..Mesh::default()
        };
        assert_eq!(Mesh::default().pieces(), 0);
        let apart = corners(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0], &[0, 1, 2, 3, 4, 5]);
        assert_eq!(apart.pieces(), 2);
        let touching = corners(&[0.0, 1.0, 2.0, 2.0, 4.0, 5.0, 9.0], &[0, 1, 2, 3, 4, 5]);
        assert_eq!(touching.pieces(), 1);
        let joined_last = corners(
            &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0],
            &[0, 1, 2, 3, 4, 5, 5, 0, 0],
        );
        assert_eq!(joined_last.pieces(), 1);
        // Body, lid, knob, handle and spout of the teapot overlap without touching, or share rims.
        let teapot = builtin("teapot", 1).unwrap();
        let pieces: Vec<usize> = teapot.meshes.iter().map(|mesh| mesh.pieces()).collect();
        assert!(
            pieces.iter().all(|&pieces| (1..=6).contains(&pieces)),
            "{pieces:?}"
        );
    }
}
