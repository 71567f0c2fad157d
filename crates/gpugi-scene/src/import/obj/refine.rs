//! Cuts the edges of meshes in two until none is long. Triangles that share an edge by position cut it alike, so no
//! cracks open between them, whichever mesh they belong to.

use std::collections::{HashMap, HashSet};

use glam::{DVec2, Vec3};

use crate::Mesh;
use crate::tangents::unit_or;

/// Edges longer than this are cut (texels). The shortest pieces have half of it, so there is about one vertex per texel.
pub const LONGEST: f64 = 1.5;
/// Rounds of cuts, each of which halves the longest edge. Only edges across millions of texels need more.
const MOST_ROUNDS: usize = 24;
/// Edges whose lengths differ by less than this fraction are cut together or not at all.
const SAME_LENGTH: f64 = 1e-3;

/// A mesh whose edges are cut.
pub struct Surface<'a> {
    pub mesh: &'a mut Mesh,
    /// The place of each vertex: vertices at equal positions share one.
    pub places: Vec<u32>,
    /// Where each vertex lies in the image (texels).
    texels: Vec<DVec2>,
}

/// Positions of several meshes, each once.
#[derive(Default)]
pub struct Places {
    number_at: HashMap<[u32; 3], u32>,
    /// Those that stay where they are, because a mesh that is not displaced has them, too.
    pub pinned: HashSet<u32>,
    pinned_edges: HashSet<[u32; 2]>,
}

/// What edges of triangles at two places have in common.
#[derive(Default, Clone, Copy)]
struct Edge {
    /// The greatest in any of the meshes (texels).
    length: f64,
    /// Triangles that have it.
    triangles: u64,
}

impl Places {
    fn number(&mut self, position: Vec3) -> u32 {
        let next = self.number_at.len() as u32;
        *self.number_at.entry(key(position)).or_insert(next)
    }

    /// Number of places so far.
    pub fn count(&self) -> usize {
        self.number_at.len()
    }

    /// Pins what the surfaces so far share with `mesh`.
    pub fn pin(&mut self, mesh: &Mesh) {
        for triangle in mesh.indices.as_chunks::<3>().0 {
            let number = |&vertex: &u32| {
                let position = key(mesh.positions[vertex as usize]);
                self.number_at.get(&position).copied()
            };
            let corners = triangle.each_ref().map(number);
            self.pinned.extend(corners.iter().flatten());
            for at in 0..3 {
                if let (Some(a), Some(b)) = (corners[at], corners[(at + 1) % 3]) {
                    self.pinned_edges.insert(sorted(a, b));
                }
            }
        }
    }
}

fn key(position: Vec3) -> [u32; 3] {
    // Adding zero turns -0 into 0.
    (position + Vec3::ZERO).to_array().map(f32::to_bits)
}

fn sorted(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

impl<'a> Surface<'a> {
    /// `texel` converts texture coordinates of the mesh to texels of the image.
    pub fn new(mesh: &'a mut Mesh, places: &mut Places, texel: impl Fn(DVec2) -> DVec2) -> Self {
        let numbers = mesh.positions.iter().map(|&at| places.number(at));
        let places = numbers.collect();
        let texels = mesh.uvs[0].iter().map(|uv| texel(uv.as_dvec2())).collect();
        Self {
            mesh,
            places,
            texels,
        }
    }

    /// The length of the longest edge (texels); 0 without any.
    pub fn longest_edge(&self) -> f64 {
        let mut longest = 0.0_f64;
        self.edges(|_, length| longest = longest.max(length));
        longest
    }

    /// Calls `each` with the places and the length of each edge of each triangle.
    fn edges(&self, mut each: impl FnMut([u32; 2], f64)) {
        for triangle in self.mesh.indices.as_chunks::<3>().0 {
            for at in 0..3 {
                let ends = [triangle[at], triangle[(at + 1) % 3]].map(|vertex| vertex as usize);
                let [a, b] = ends.map(|vertex| self.texels[vertex]);
                let [from, to] = ends.map(|vertex| self.places[vertex]);
                if from != to {
                    each(sorted(from, to), a.distance(b));
                }
            }
        }
    }

    /// Cuts the edges between places that `cut` holds.
    fn cut(&mut self, cut: &HashMap<[u32; 2], Edge>, places: &mut Places) {
        let mut middles = HashMap::new();
        let old = std::mem::take(&mut self.mesh.indices);
        let mut indices = Vec::with_capacity(old.len());
        for &triangle in old.as_chunks::<3>().0 {
            let middle = [0, 1, 2].map(|at| {
                let [a, b] = [triangle[at], triangle[(at + 1) % 3]];
                let ends = [a, b].map(|vertex| self.places[vertex as usize]);
                let ends = sorted(ends[0], ends[1]);
                let add = || self.add_middle([a, b], ends, places);
                cut.contains_key(&ends)
                    .then(|| *middles.entry(sorted(a, b)).or_insert_with(add))
            });
            self.add_pieces(triangle, middle, &mut indices);
        }
        self.mesh.indices = indices;
    }

    /// Adds the vertex in the middle of two others, whose places are `ends`.
    fn add_middle(&mut self, [a, b]: [u32; 2], ends: [u32; 2], places: &mut Places) -> u32 {
        let [a, b] = [a, b].map(|vertex| vertex as usize);
        let mesh = &mut *self.mesh;
        let vertex = mesh.positions.len() as u32;
        // The same bits from either end.
        let position = mesh.positions[a] * 0.5 + mesh.positions[b] * 0.5;
        mesh.positions.push(position);
        let normal = unit_or(Vec3::Y, mesh.normals[a] + mesh.normals[b]);
        mesh.normals.push(normal);
        let uv = mesh.uvs[0][a] * 0.5 + mesh.uvs[0][b] * 0.5;
        mesh.uvs[0].push(uv);
        if !mesh.colors.is_empty() {
            let color = (mesh.colors[a] + mesh.colors[b]) * 0.5;
            mesh.colors.push(color);
        }
        self.texels.push((self.texels[a] + self.texels[b]) * 0.5);
        let place = places.number(position);
        self.places.push(place);
        if places.pinned_edges.contains(&ends) {
            places.pinned.insert(place);
            let halves = ends.map(|end| sorted(end, place));
            places.pinned_edges.extend(halves);
        }
        vertex
    }

    /// Adds what becomes of a triangle; `middle` holds the vertices on the edges from each corner to the next.
    fn add_pieces(&self, corners: [u32; 3], middle: [Option<u32>; 3], indices: &mut Vec<u32>) {
        // Turned so that cut edges come first, and one that is whole last.
        let count = middle.iter().flatten().count();
        let turn =
            (0..3).find(|&turn| (0..3).all(|at| middle[(turn + at) % 3].is_some() == (at < count)));
        let turned = |at: usize| (turn.unwrap_or(0) + at) % 3;
        let [a, b, c] = [0, 1, 2].map(|at| corners[turned(at)]);
        match [0, 1, 2].map(|at| middle[turned(at)]) {
            [Some(ab), Some(bc), Some(ca)] => {
                indices.extend([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca]);
            }
            [Some(ab), Some(bc), None] => {
                let distance =
                    |a: u32, b: u32| self.texels[a as usize].distance(self.texels[b as usize]);
                indices.extend([ab, b, bc]);
                if distance(a, bc) <= distance(ab, c) {
                    indices.extend([a, ab, bc, a, bc, c]);
                } else {
                    indices.extend([a, ab, c, ab, bc, c]);
                }
            }
            [Some(ab), ..] => indices.extend([a, ab, c, ab, b, c]),
            [None, ..] => indices.extend([a, b, c]),
        }
    }
}

/// Cuts edges, the longest first, until none spans more than about a texel, or until another round would make more than
/// `most` triangles of all surfaces. Returns whether `most` stopped it.
pub fn refine(surfaces: &mut [Surface], places: &mut Places, most: u64) -> bool {
    for _ in 0..MOST_ROUNDS {
        let mut edges: HashMap<[u32; 2], Edge> = HashMap::new();
        let mut triangles = 0;
        for surface in &*surfaces {
            triangles += (surface.mesh.indices.len() / 3) as u64;
            surface.edges(|ends, length| {
                let edge = edges.entry(ends).or_default();
                edge.length = edge.length.max(length);
                edge.triangles += 1;
            });
        }
        let longest = edges.values().fold(0.0, |most, edge| edge.length.max(most));
        let bound = LONGEST.max(longest / 2.0);
        edges.retain(|_, edge| edge.length > bound);
        if edges.is_empty() {
            return false;
        }
        let left = most.saturating_sub(triangles);
        let fitting = fitting(&edges, left);
        let is_limited = fitting > 0.0;
        edges.retain(|_, edge| edge.length > fitting);
        for surface in &mut *surfaces {
            surface.cut(&edges, places);
        }
        if is_limited {
            return true;
        }
    }
    true
}

/// The length (texels) above which edges may be cut, where each cut adds its triangles and there may be `left` more. 0
/// if all fit.
fn fitting(edges: &HashMap<[u32; 2], Edge>, left: u64) -> f64 {
    let added: u64 = edges.values().map(|edge| edge.triangles).sum();
    if added <= left {
        return 0.0;
    }
    let mut sorted: Vec<Edge> = edges.values().copied().collect();
    sorted.sort_by(|a, b| b.length.total_cmp(&a.length));
    let mut sum = 0;
    let first_that_exceeds = sorted.iter().find(|edge| {
        sum += edge.triangles;
        sum > left
    });
    first_that_exceeds.map_or(0.0, |edge| edge.length * (1.0 + SAME_LENGTH))
}
