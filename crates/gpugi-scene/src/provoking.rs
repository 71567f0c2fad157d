//! Provoking-vertex order: makes the vertex index identify the triangle.
//!
//! A fragment shader needs to know its triangle, and WebGPU's `primitive-index` is optional. A flat-interpolated value
//! comes from the first vertex of the triangle. So if triangle t starts with vertex t, the vertex index is the
//! triangle's number.

use glam::Vec3;

/// The triangles of a mesh in provoking-vertex order.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ProvokingMesh {
    /// The original vertex of each new vertex. Entry t is the first vertex of triangle t. Vertices that start no
    /// triangle follow. Every original vertex occurs at least once.
    pub vertices: Vec<u32>,
    /// Three new vertex indices per triangle: the original triangles in their original order and winding, some of them
    /// rotated.
    pub indices: Vec<u32>,
}

impl ProvokingMesh {
    /// The corners of the triangles, where the original vertices have these positions.
    pub fn triangles(&self, positions: &[Vec3]) -> Vec<[Vec3; 3]> {
        let position = |&index: &u32| positions[self.vertices[index as usize] as usize];
        let corners = |triangle: &[u32; 3]| triangle.each_ref().map(position);
        self.indices.as_chunks().0.iter().map(corners).collect()
    }
}

/// Rotates triangles and duplicates vertices until the first vertex of triangle t is new vertex t.
///
/// The result has one new vertex per triangle, plus one for each original vertex that starts no triangle. To keep the
/// latter few, a greedy pass starts each triangle with an unused corner: of those, the one with the fewest triangles
/// still to come, because it has the fewest chances left (the idea of meshoptimizer's `generateProvokingIndexBuffer`).
/// Indices after the last whole triangle are ignored.
///
/// # Panics
/// If an index is not below `vertex_count`.
pub fn provoking_order(indices: &[u32], vertex_count: usize) -> ProvokingMesh {
    let triangles = indices.as_chunks::<3>().0;
    let mut triangles_to_come = vec![0_u32; vertex_count];
    for &vertex in triangles.as_flattened() {
        triangles_to_come[vertex as usize] += 1;
    }

    const UNUSED: u32 = u32::MAX;
    let mut new_vertex = vec![UNUSED; vertex_count];
    let mut vertices = Vec::with_capacity(triangles.len().max(vertex_count));
    let mut rotated = Vec::with_capacity(triangles.len());
    for (number, triangle) in triangles.iter().enumerate() {
        let first = (0..3)
            .filter(|&corner| new_vertex[triangle[corner] as usize] == UNUSED)
            .min_by_key(|&corner| triangles_to_come[triangle[corner] as usize])
            .unwrap_or(0);
        let [a, b, c] = [0, 1, 2].map(|step| triangle[(first + step) % 3]);
        vertices.push(a);
        if new_vertex[a as usize] == UNUSED {
            new_vertex[a as usize] = number as u32;
        }
        rotated.push([a, b, c]);
        for vertex in triangle {
            triangles_to_come[*vertex as usize] -= 1;
        }
    }

    for (vertex, new) in new_vertex.iter_mut().enumerate() {
        if *new == UNUSED {
            *new = vertices.len() as u32;
            vertices.push(vertex as u32);
        }
    }
    let indices = rotated
        .iter()
        .enumerate()
        .flat_map(|(number, [_, b, c])| {
            [
                number as u32,
                new_vertex[*b as usize],
                new_vertex[*c as usize],
            ]
        })
        .collect();
    ProvokingMesh { vertices, indices }
}
