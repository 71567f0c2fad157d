//! Every mesh's vertices and indices on the GPU, in provoking-vertex order.

use std::sync::{Arc, OnceLock};

use glam::{Vec3, Vec4};
use gpugi_scene::provoking::{ProvokingMesh, provoking_order};
use gpugi_scene::{Bounds, Mesh};

use super::gpu;
use crate::gpu::{Gpu, GpuError};

/// The place of a mesh in the geometry buffer, and its properties that captures need.
#[derive(Debug, Clone)]
pub(super) struct PlacedMesh {
    pub first_vertex_word: u32,
    pub first_index_word: u32,
    pub order: ProvokingMesh,
    pub closed: bool,
    /// Pairs of vertices with one position, found when the mesh first deforms.
    seams: OnceLock<Vec<[u32; 2]>>,
    /// In the mesh's own space.
    pub bounds: Bounds,
}

/// The geometry buffer.
#[derive(Debug, Clone)]
pub(super) struct Geometry {
    pub buffer: wgpu::Buffer,
    pub meshes: Vec<PlacedMesh>,
}

impl Geometry {
    /// Checks the meshes and uploads them.
    pub fn new(gpu: &Gpu, meshes: &[Arc<Mesh>]) -> Result<Self, GpuError> {
        for mesh in meshes {
            mesh.check().map_err(|reason| GpuError::Input {
                what: format!("mesh {:?}: {reason}", mesh.name),
            })?;
        }
        let mut words: Vec<u32> = Vec::new();
        let place = |mesh: &Arc<Mesh>| PlacedMesh::new(mesh, &mut words);
        let meshes = meshes.iter().map(place).collect();
        Ok(Self {
            buffer: gpu.storage("scene geometry [bytes]", &words)?,
            meshes,
        })
    }

    /// Replaces the mesh of this index by a deformed one with the same triangles and number of vertices, closed if the
    /// old one is.
    pub fn bend(&mut self, gpu: &Gpu, index: usize, mesh: &Mesh) {
        let placed = &mut self.meshes[index];
        placed.bounds = mesh.bounds();
        let at = u64::from(placed.first_vertex_word) * 4;
        gpu.write(&self.buffer, at, &vertices(mesh, &placed.order));
    }
}

impl PlacedMesh {
    fn new(mesh: &Mesh, words: &mut Vec<u32>) -> Self {
        let order = provoking_order(&mesh.indices, mesh.positions.len());
        let first_vertex_word = words.len() as u32;
        words.extend_from_slice(bytemuck::cast_slice(&vertices(mesh, &order)));
        let first_index_word = words.len() as u32;
        words.extend_from_slice(&order.indices);
        Self {
            first_vertex_word,
            first_index_word,
            order,
            closed: mesh.is_closed(),
            seams: OnceLock::new(),
            bounds: mesh.bounds(),
        }
    }

    /// Whether the mesh is closed once it has deformed from `before` to `after`, with the same triangles. As long as no
    /// seam parts, that takes no hash table of all edges, which would be made anew in every frame of an animation.
    pub fn is_closed_after(&self, before: &Mesh, after: &Mesh) -> bool {
        let seams = self.seams.get_or_init(|| before.seams());
        let position = |vertex: u32| after.positions[vertex as usize];
        let are_whole = seams
            .iter()
            .all(|pair| position(pair[0]) == position(pair[1]));
        if are_whole {
            self.closed
        } else {
            after.is_closed()
        }
    }

    pub fn vertex_count(&self) -> u32 {
        self.order.vertices.len() as u32
    }

    /// The corners of its triangles, in mesh space.
    pub fn triangles(&self, mesh: &Mesh) -> Vec<[Vec3; 3]> {
        self.order.triangles(&mesh.positions)
    }
}

fn vertices(mesh: &Mesh, order: &ProvokingMesh) -> Vec<gpu::Vertex> {
    let unorm = |value: f32| (value.clamp(0.0, 1.0) * 65535.0).round() as u32;
    let vertex = |&source: &u32| {
        let source = source as usize;
        let uv = |set: usize| {
            mesh.uvs[set]
                .get(source)
                .map_or([0.0; 2], |uv| uv.to_array())
        };
        let color = mesh.colors.get(source).copied().unwrap_or(Vec4::ONE);
        // The lowest bit holds the sign of the bitangent.
        let tangent = mesh.tangents.get(source).map_or(0, |tangent| {
            gpu::octahedral(tangent.truncate()) & !1 | u32::from(tangent.w < 0.0)
        });
        gpu::Vertex {
            position: mesh.positions[source].to_array(),
            normal: gpu::octahedral(mesh.normals[source]),
            tangent,
            uv_0: uv(0),
            uv_1: uv(1),
            color: [
                unorm(color.x) | unorm(color.y) << 16,
                unorm(color.z) | unorm(color.w) << 16,
            ],
            padding: 0,
        }
    };
    order.vertices.iter().map(vertex).collect()
}

#[cfg(test)]
mod tests {
    use gpugi_scene::builtin::shapes::cuboid;

    use super::*;

    #[test]
    fn a_mesh_is_closed_until_a_seam_parts() {
        let rest = cuboid(Vec3::ZERO, Vec3::ONE, 2);
        assert!(rest.is_closed() && rest.positions.len() > 26);
        let placed = PlacedMesh::new(&rest, &mut Vec::new());
        let mut bent = rest.clone();
        for position in &mut bent.positions {
            position.x += 0.3 * position.y * position.y;
        }
        assert!(placed.is_closed_after(&rest, &bent));
        bent.positions[0].z -= 0.1;
        assert!(!placed.is_closed_after(&rest, &bent));
        assert!(!bent.is_closed());
    }
}
