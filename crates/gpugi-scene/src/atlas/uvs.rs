//! Where triangles lie in an atlas.

use glam::Vec2;
use serde::{Deserialize, Serialize};

/// In [`InstanceUvs::charts`]: a triangle with almost no area, whose corners lie on a point of a neighbouring triangle.
pub const NO_CHART: u32 = u32::MAX;

/// Maximum side of a page in texels: WebGPU's default limit.
pub const LARGEST_PAGE: u32 = 8192;

/// A texture atlas: where the triangles of every instance lie in its pages.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Atlas {
    /// Side of a page (texels).
    pub size: u32,
    /// Number of pages.
    pub pages: u32,
    /// Per scene instance; `None` if the instance has no area, or nothing but slivers, and so is not in the atlas.
    pub instances: Vec<Option<InstanceUvs>>,
    /// The same for the backs of surfaces, with the charts of their fronts; `None` where a back has no texels. Empty if
    /// none has.
    pub backs: Vec<Option<InstanceUvs>>,
}

/// A side of an instance's surfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Where the corners of triangles run counter-clockwise in mesh space.
    Front,
    /// The other.
    Back,
}

/// Where one instance lies. All of it is in one page. No two triangles overlap, and none is mirrored: the corners run
/// counter-clockwise when a triangle is seen from its front, and clockwise in the page, where v points down.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct InstanceUvs {
    /// Page number.
    pub page: u32,
    /// One entry per index of the mesh (three per triangle, in the order of [`Mesh::indices`](crate::Mesh::indices)): 0
    /// to 1, v downward.
    pub corners: Vec<Vec2>,
    /// Chart of each triangle, numbered from 0 in each instance, or [`NO_CHART`].
    pub charts: Vec<u32>,
}

impl Atlas {
    /// Everything that lies in the atlas: the number of its instance, which side of it, and where it lies.
    pub fn sides(&self) -> impl Iterator<Item = (usize, Side, &InstanceUvs)> {
        let fronts = self.instances.iter().zip(std::iter::repeat(Side::Front));
        let backs = self.backs.iter().zip(std::iter::repeat(Side::Back));
        let numbered = fronts.enumerate().chain(backs.enumerate());
        numbered.filter_map(|(index, (uvs, side))| Some((index, side, uvs.as_ref()?)))
    }

    /// The same atlas for a scene in which the triangles of these instances have their second and third corners swapped,
    /// as between a scene and its [`Scene::with_lit_fronts`](crate::Scene::with_lit_fronts).
    pub fn turned(mut self, instances: &[usize]) -> Self {
        for &index in instances {
            if let Some(uvs) = &mut self.instances[index] {
                for triangle in uvs.corners.as_chunks_mut::<3>().0 {
                    triangle.swap(1, 2);
                }
            }
        }
        self
    }
}
