//! Flat normals, and tangents for meshes that lack them.

use std::collections::HashMap;

use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use glam::{Vec3, Vec4};

use crate::Mesh;

/// Gives every triangle its own vertices and its own normal. Returns the old vertex of each new one.
pub fn make_flat(mesh: &mut Mesh) -> Vec<u32> {
    let sources = mesh.indices.clone();
    select_vertices(mesh, &sources);
    mesh.indices = (0..sources.len() as u32).collect();
    flatten_normals(mesh);
    sources
}

/// Sets flat normals on a mesh in which each triangle has three vertices of its own, in order; +Y for triangles without
/// area.
pub(crate) fn flatten_normals(mesh: &mut Mesh) {
    let (triangles, _) = mesh.positions.as_chunks::<3>();
    mesh.normals = triangles
        .iter()
        .flat_map(|[a, b, c]| [unit_or(Vec3::Y, (b - a).cross(c - a)); 3])
        .collect();
}

/// `vector` normalized, even if its squared length would overflow or underflow; `otherwise` if it has no direction.
pub(crate) fn unit_or(otherwise: Vec3, vector: Vec3) -> Vec3 {
    let largest = vector.abs().max_element();
    if largest > 0.0 && largest.is_finite() {
        (vector / largest).normalize_or(otherwise)
    } else {
        otherwise
    }
}

/// Generates MikkTSpace tangents, as glTF demands, for normal maps that use the given UV set. A vertex whose corners
/// get different tangents is split. Returns the old vertex of each new one. Without that UV set, returns `None` and
/// changes nothing. The mesh must pass [`Mesh::check`].
///
/// Mikkelsen, "Simulation of Wrinkled Surfaces Revisited", 2008.
pub fn generate(mesh: &mut Mesh, uv_set: usize) -> Option<Vec<u32>> {
    if mesh.uvs.get(uv_set).is_none_or(Vec::is_empty) {
        return None;
    }
    let mut corners = Corners {
        mesh,
        uv_set,
        tangents: vec![None; mesh.indices.len()],
    };
    let Ok(()) = generate_tangents(&mut corners) else {
        return None;
    };
    let tangents = corners.tangents;
    let mut vertices = HashMap::new();
    let (mut sources, mut new_tangents) = (Vec::new(), Vec::new());
    let mut indices = Vec::with_capacity(mesh.indices.len());
    for (&index, tangent) in mesh.indices.iter().zip(tangents) {
        let tangent = tangent
            .filter(|tangent| tangent.is_finite())
            .unwrap_or_else(|| any_tangent(mesh.normals[index as usize]));
        let key = (index, tangent.to_array().map(f32::to_bits));
        let vertex = *vertices.entry(key).or_insert_with(|| {
            sources.push(index);
            new_tangents.push(tangent);
            sources.len() as u32 - 1
        });
        indices.push(vertex);
    }
    select_vertices(mesh, &sources);
    mesh.tangents = new_tangents;
    mesh.indices = indices;
    Some(sources)
}

/// An arbitrary unit tangent for a triangle whose texture coordinates define none.
pub(crate) fn any_tangent(normal: Vec3) -> Vec4 {
    normal
        .try_normalize()
        .map_or(Vec3::X, Vec3::any_orthonormal_vector)
        .extend(1.0)
}

/// Rearranges every vertex list so that old vertex `sources[i]` becomes vertex i.
fn select_vertices(mesh: &mut Mesh, sources: &[u32]) {
    select(&mut mesh.positions, sources);
    select(&mut mesh.normals, sources);
    select(&mut mesh.tangents, sources);
    select(&mut mesh.uvs[0], sources);
    select(&mut mesh.uvs[1], sources);
    select(&mut mesh.colors, sources);
}

/// Rearranges `values` so that old entry `sources[i]` becomes entry i; an empty list stays empty.
pub(crate) fn select<T: Copy>(values: &mut Vec<T>, sources: &[u32]) {
    if !values.is_empty() {
        *values = sources
            .iter()
            .map(|&source| values[source as usize])
            .collect();
    }
}

/// Presents a mesh to MikkTSpace, with one tangent per corner of each triangle.
struct Corners<'a> {
    mesh: &'a Mesh,
    uv_set: usize,
    tangents: Vec<Option<Vec4>>,
}

impl Corners<'_> {
    fn vertex(&self, face: usize, corner: usize) -> usize {
        self.mesh.indices[face * 3 + corner] as usize
    }
}

impl Geometry for Corners<'_> {
    fn num_faces(&self) -> usize {
        self.mesh.indices.len() / 3
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.positions[self.vertex(face, corner)].into()
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.normals[self.vertex(face, corner)].into()
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        self.mesh.uvs[self.uv_set][self.vertex(face, corner)].into()
    }

    fn set_tangent(&mut self, tangent: Option<TangentSpace>, face: usize, corner: usize) {
        // MikkTSpace's bitangent follows v. In glTF v points down but the bitangent points up, hence the opposite sign.
        self.tangents[face * 3 + corner] = tangent.map(|tangent| {
            let [x, y, z, sign] = tangent.tangent_encoded();
            Vec4::new(x, y, z, -sign)
        });
    }
}
