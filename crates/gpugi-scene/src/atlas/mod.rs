//! Texture atlases: every triangle of a scene on texels of its own.

use glam::Vec2;

/// A texture atlas: where the triangles of every instance lie in its pages.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Atlas {
    /// Texels a side of a page.
    pub size: u32,
    /// Number of pages.
    pub pages: u32,
    /// By instance of the scene; none where it is not in the atlas.
    pub instances: Vec<Option<InstanceUvs>>,
}

/// Where the triangles of an instance lie.
#[derive(Debug, Clone, PartialEq)]
pub struct InstanceUvs {
    /// The page that holds all of them.
    pub page: u32,
    /// For each index of the mesh (three a triangle, in the order of [`crate::Mesh::indices`]): 0..1 over the page, v downward.
    pub corners: Vec<Vec2>,
    /// The chart of each triangle.
    pub charts: Vec<u32>,
}
