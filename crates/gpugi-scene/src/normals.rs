//! Smooth normals for meshes that have none.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use crate::Mesh;

/// Crease angle that importers use (rad): 40 degrees.
pub const CREASE_ANGLE: f32 = 40.0 * std::f32::consts::PI / 180.0;

/// If more corners than this share a position, all are smoothed together: comparing every pair would take too long.
const CORNERS_COMPARED: usize = 512;

/// Replaces the normals of `mesh` with smooth ones. The normal of a corner is the mean of the face normals around its
/// position, weighted by area and by the angle at that corner. Only faces whose normals differ from that of the
/// corner's own face by at most `crease_angle` (rad) contribute. Equal positions count as one; a vertex whose corners
/// get different normals is split.
///
/// The normals are always unit and finite: triangles without area take the mean of their neighbours, or +Y if there are
/// none. Indices must be in range and positions finite.
pub fn smooth_normals(mesh: &mut Mesh, crease_angle: f32) {
    smooth_normals_within(mesh, crease_angle, usize::MAX);
}

/// Like [`smooth_normals`]. Returns false, and leaves `mesh` as it is, if that would take more than `most` vertices.
pub(crate) fn smooth_normals_within(mesh: &mut Mesh, crease_angle: f32, most: usize) -> bool {
    let triangles = mesh.indices.as_chunks::<3>().0;
    // Double precision prevents overflow and underflow for huge and tiny triangles.
    let position = |vertex: u32| mesh.positions[vertex as usize].as_dvec3();
    let faces: Vec<Face> = triangles
        .iter()
        .map(|triangle| Face::new(triangle.map(position)))
        .collect();
    let welded = mesh.weld_positions();
    let corners = CornersByPosition::new(&mesh.indices, &welded);

    let crease_cosine = f64::from(crease_angle).cos() - 1e-9;
    let mut splits = HashMap::with_capacity(mesh.positions.len().min(most));
    let mut vertices = Vec::with_capacity(mesh.positions.len());
    let mut normals = Vec::with_capacity(mesh.positions.len());
    let mut indices = Vec::with_capacity(mesh.indices.len());
    let mut crowded = HashMap::new();
    for (corner, &vertex) in mesh.indices.iter().enumerate() {
        let around = corners.at(welded[vertex as usize]);
        let own = faces[corner / 3].normal;
        let sum_where = |smooth: &dyn Fn(&Face) -> bool| -> DVec3 {
            around
                .iter()
                .map(|&other| (&faces[other as usize / 3], other as usize % 3))
                .filter(|(face, _)| smooth(face))
                .map(|(face, at)| face.normal * face.weights[at])
                .sum()
        };
        let sum = if around.len() > CORNERS_COMPARED {
            *crowded
                .entry(welded[vertex as usize])
                .or_insert_with(|| sum_where(&|_| true))
        } else if own == DVec3::ZERO {
            sum_where(&|_| true)
        } else {
            sum_where(&|face| own.dot(face.normal) >= crease_cosine)
        };
        let fallback = if own == DVec3::ZERO { DVec3::Y } else { own };
        let normal = sum.normalize_or(fallback).as_vec3();
        let key = (vertex, normal.to_array().map(f32::to_bits));
        let new_vertex = *splits.entry(key).or_insert_with(|| {
            vertices.push(vertex);
            normals.push(normal);
            vertices.len() as u32 - 1
        });
        indices.push(new_vertex);
        if vertices.len() > most {
            return false;
        }
    }
    *mesh = mesh.with_vertices(&vertices, indices);
    mesh.normals = normals;
    true
}

/// Gives each vertex whose normal is zero the mean normal of its triangles, weighted by area; +Y if they have none.
/// Returns how many there were.
pub(crate) fn replace_zero_normals(mesh: &mut Mesh) -> usize {
    let is_zero = |normal: &&Vec3| **normal == Vec3::ZERO;
    let count = mesh.normals.iter().filter(is_zero).count();
    if count == 0 {
        return 0;
    }
    let mut sums = vec![DVec3::ZERO; mesh.positions.len()];
    for triangle in mesh.indices.as_chunks::<3>().0 {
        let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize].as_dvec3());
        let normal = (b - a).cross(c - a);
        triangle
            .iter()
            .for_each(|&vertex| sums[vertex as usize] += normal);
    }
    for (normal, sum) in mesh.normals.iter_mut().zip(sums) {
        if *normal == Vec3::ZERO {
            *normal = sum.normalize_or(DVec3::Y).as_vec3();
        }
    }
    count
}

/// What a triangle adds to the normals of its corners.
pub(crate) struct Face {
    /// Unit vector; zero if the face has no area.
    pub normal: DVec3,
    /// Area times the angle at each corner, up to a common factor.
    pub weights: [f64; 3],
}

impl Face {
    pub fn new([a, b, c]: [DVec3; 3]) -> Self {
        let cross = (b - a).cross(c - a);
        let angle = |from: DVec3, to: DVec3| {
            let (from, to) = (from.normalize_or_zero(), to.normalize_or_zero());
            from.dot(to).clamp(-1.0, 1.0).acos()
        };
        let angles = [
            angle(b - a, c - a),
            angle(c - b, a - b),
            angle(a - c, b - c),
        ];
        Self {
            normal: cross.normalize_or_zero(),
            weights: angles.map(|angle| angle * cross.length()),
        }
    }
}

/// The corners (positions in the index list) at each welded position.
struct CornersByPosition {
    /// Start of each position's range in `corners`; the last entry is the end of the last range.
    starts: Vec<u32>,
    corners: Vec<u32>,
}

impl CornersByPosition {
    fn new(indices: &[u32], welded: &[u32]) -> Self {
        let count = welded.iter().max().map_or(0, |&last| last as usize + 1);
        let mut starts = vec![0; count + 1];
        for &vertex in indices {
            starts[welded[vertex as usize] as usize + 1] += 1;
        }
        for position in 0..count {
            starts[position + 1] += starts[position];
        }
        let mut next = starts.clone();
        let mut corners = vec![0; indices.len()];
        for (corner, &vertex) in indices.iter().enumerate() {
            let slot = &mut next[welded[vertex as usize] as usize];
            corners[*slot as usize] = corner as u32;
            *slot += 1;
        }
        Self { starts, corners }
    }

    fn at(&self, position: u32) -> &[u32] {
        let range = self.starts[position as usize]..self.starts[position as usize + 1];
        &self.corners[range.start as usize..range.end as usize]
    }
}
