//! The spherical Delaunay mesh of domains, the dual of their Voronoi cells (figure 15 of the tutorial), extracted from
//! the grid of cells.

use std::collections::BTreeSet;

use super::Decomposition;
use crate::gpu::{Gpu, GpuError, TextureAspect, read_texture};

impl Decomposition {
    /// Edges of the spherical Delaunay mesh: pairs of domain numbers whose Voronoi cells share a border on the grid of
    /// [`Decomposition::owners`]. Each pair appears once, the smaller number first, in sorted order. Where four domains
    /// meet in one corner of the grid, the mesh has a quadrilateral. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn delaunay_edges(&self, gpu: &Gpu) -> Result<Vec<[u32; 2]>, GpuError> {
        let Some(texture) = self.owners() else {
            return Ok(Vec::new());
        };
        let owners = read_texture(gpu, texture, TextureAspect::All, 0, 0)?;
        Ok(edges(&owners, texture.width() as usize))
    }
}

/// Pairs of owners whose cells share a border: tests the east neighbour of each cell, around the sphere, and the south
/// one. At a pole all cells of a row meet in a point, which is no border: only cells side by side share one.
pub(super) fn edges(owners: &[u32], width: usize) -> Vec<[u32; 2]> {
    let mut edges = BTreeSet::new();
    for (index, &here) in owners.iter().enumerate() {
        let column = index % width;
        let east = owners[index - column + (column + 1) % width];
        let south = owners.get(index + width).copied().unwrap_or(here);
        for there in [east, south] {
            if here != there {
                edges.insert([here.min(there), here.max(there)]);
            }
        }
    }
    edges.into_iter().collect()
}
