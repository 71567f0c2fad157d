//! Indexed triangle meshes.

use glam::{Vec2, Vec3, Vec4};

use crate::scene::Bounds;

/// An indexed triangle mesh. Counter-clockwise triangles face the viewer.
///
/// `positions` and `normals` have the same length; `tangents`, each set of `uvs` and `colors` have that length or are
/// empty; `indices` is a multiple of three and every index is in range: [`Mesh::check`] says whether that holds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Name for reports.
    pub name: String,
    /// Positions in mesh space [m].
    pub positions: Vec<Vec3>,
    /// Unit normals in mesh space.
    pub normals: Vec<Vec3>,
    /// Unit tangents (xyz) and the bitangent's sign (w), as glTF defines them; empty without normal maps.
    pub tangents: Vec<Vec4>,
    /// Two sets of texture coordinates, v downward.
    pub uvs: [Vec<Vec2>; 2],
    /// Linear vertex colours with alpha; they multiply the base colour.
    pub colors: Vec<Vec4>,
    /// Three vertex indices a triangle.
    pub indices: Vec<u32>,
}

impl Mesh {
    /// The box around all positions, mesh space.
    pub fn bounds(&self) -> Bounds {
        Bounds::of(self.positions.iter().copied())
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

    /// Whether the arrays fit together and hold finite numbers; the reason if not.
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
}
