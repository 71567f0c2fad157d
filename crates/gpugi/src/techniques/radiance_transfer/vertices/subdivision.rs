//! Points on meshes that are too coarse for light at their vertices: longest edges are bisected until none is too long.
//!
//! Whether an edge is bisected depends on its own length alone, so both triangles at it have the same points on it.

use std::collections::HashMap;

use glam::{Mat3, Vec2, Vec3};
use gpugi_scene::{Mesh, provoking_order};

/// `BISECTED` of capture/atlas/lookup.wesl.
const BISECTED: u32 = 1 << 31;

/// A point on a triangle of a mesh, in the order that the GPU draws it in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OnTriangle {
    pub primitive: u32,
    /// Weights of the second and third corners.
    pub barycentrics: Vec2,
}

/// The points of a mesh, and how its triangles find them.
#[derive(Debug, Default)]
pub(super) struct Subdivision {
    /// First the vertices of the mesh, in their order, then midpoints of edges; `None` where no triangle has a vertex.
    pub points: Vec<Option<OnTriangle>>,
    /// First a node per triangle. A leaf: its three points. A bisected triangle: the number of its edge, from that corner
    /// to the next, with BISECTED, and the node of the half with the edge's first corner, which the other half follows.
    pub nodes: Vec<[u32; 3]>,
}

/// A corner of a part of a triangle.
#[derive(Debug, Clone, Copy)]
struct Corner {
    point: u32,
    /// In the world, but for the place of the instance.
    position: Vec3,
    barycentrics: Vec2,
}

impl Subdivision {
    /// The points of `mesh`, whose edges are no longer than `longest` (m) where `world_from_mesh` places it; 0: however
    /// long. `None` if there would be more than `most` points.
    pub fn new(mesh: &Mesh, world_from_mesh: Mat3, longest: f32, most: usize) -> Option<Self> {
        let vertices = mesh.positions.len();
        let order = provoking_order(&mesh.indices, vertices);
        let triangles = order.indices.as_chunks::<3>().0;
        let mut made = Self {
            points: vec![None; vertices],
            nodes: vec![[0; 3]; triangles.len()],
        };
        // The largest triangle at each vertex has the most reliable front.
        let mut largest = vec![f32::NEG_INFINITY; vertices];
        let mut midpoints = HashMap::new();
        let mut left = Vec::new();
        for (primitive, triangle) in triangles.iter().enumerate() {
            let corner = |(number, vertex): (usize, u32)| {
                let vertex = order.vertices[vertex as usize];
                Corner {
                    point: vertex,
                    position: world_from_mesh * mesh.positions[vertex as usize],
                    barycentrics: [Vec2::ZERO, Vec2::X, Vec2::Y][number],
                }
            };
            let [a, b, c] = [0, 1, 2].map(|number| corner((number, triangle[number])));
            let area = (b.position - a.position).cross(c.position - a.position);
            for corner in [a, b, c] {
                let vertex = corner.point as usize;
                if area.length() > largest[vertex] {
                    largest[vertex] = area.length();
                    made.points[vertex] = Some(OnTriangle {
                        primitive: primitive as u32,
                        barycentrics: corner.barycentrics,
                    });
                }
            }
            left.push((primitive, [a, b, c]));
            while let Some((node, corners)) = left.pop() {
                let Some(edge) = too_long(&corners, longest) else {
                    made.nodes[node] = corners.map(|corner| corner.point);
                    continue;
                };
                let [from, to, opposite] = [0, 1, 2].map(|step| corners[(edge + step) % 3]);
                let (first, second) = (from.point.min(to.point), from.point.max(to.point));
                let barycentrics = from.barycentrics.midpoint(to.barycentrics);
                let point = *midpoints.entry((first, second)).or_insert_with(|| {
                    made.points.push(Some(OnTriangle {
                        primitive: primitive as u32,
                        barycentrics,
                    }));
                    made.points.len() as u32 - 1
                });
                if made.points.len() > most {
                    return None;
                }
                let middle = Corner {
                    point,
                    position: from.position.midpoint(to.position),
                    barycentrics,
                };
                let half = made.nodes.len();
                made.nodes[node] = [BISECTED | edge as u32, half as u32, 0];
                made.nodes.resize(half + 2, [0; 3]);
                left.push((half, [from, middle, opposite]));
                left.push((half + 1, [middle, to, opposite]));
            }
        }
        (made.points.len() <= most).then_some(made)
    }
}

/// The longest edge, if it is too long.
fn too_long(corners: &[Corner; 3], longest: f32) -> Option<usize> {
    let length = |edge: usize| {
        let [from, to] = [edge, (edge + 1) % 3].map(|corner| corners[corner].position);
        from.distance(to)
    };
    let edge = (0..3).max_by(|&a, &b| length(a).total_cmp(&length(b)))?;
    (longest > 0.0 && length(edge) > longest).then_some(edge)
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use gpugi_scene::builtin::shapes::{quad, sphere};

    use super::*;

    /// Edges of leaves that no other leaf has the other way round: in a closed mesh with shared vertices, none.
    fn open_edges(made: &Subdivision) -> HashSet<(u32, u32)> {
        let mut open = HashSet::new();
        let leaves = made.nodes.iter().filter(|node| node[0] < BISECTED);
        for &[a, b, c] in leaves {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                if !open.remove(&(to, from)) {
                    open.insert((from, to));
                }
            }
        }
        open
    }

    /// Edges are as short as asked, and both triangles at each have the same points on it.
    #[test]
    fn bisected_triangles_have_no_gaps() {
        let corners = [
            Vec3::ZERO,
            Vec3::X * 3.0,
            Vec3::ONE,
            Vec3::new(0.2, -2.0, 0.5),
        ];
        // A tetrahedron of unequal edges.
        let mesh = Mesh {
            positions: corners.to_vec(),
            indices: vec![0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3],
            ..Mesh::default()
        };
        let whole = Subdivision::new(&mesh, Mat3::IDENTITY, 0.0, 4).expect("vertices");
        assert_eq!((whole.points.len(), whole.nodes.len()), (4, 4));
        let made = Subdivision::new(&mesh, Mat3::IDENTITY, 0.4, 10_000).expect("points");
        assert!(made.points.len() > 100 && open_edges(&made).is_empty());
        let order = provoking_order(&mesh.indices, 4);
        let at = |point: u32| {
            let on = made.points[point as usize].expect("a point");
            let triangle = order.indices.as_chunks::<3>().0[on.primitive as usize];
            let [a, b, c] =
                triangle.map(|vertex| corners[order.vertices[vertex as usize] as usize]);
            a + (b - a) * on.barycentrics.x + (c - a) * on.barycentrics.y
        };
        let leaves = made.nodes.iter().filter(|node| node[0] < BISECTED);
        for triangle in leaves {
            let [a, b, c] = triangle.map(at);
            let edges = [a.distance(b), b.distance(c), c.distance(a)];
            assert!(
                edges.into_iter().fold(0.0, f32::max) <= 0.4 + 1e-5,
                "{edges:?}"
            );
        }
        // Larger in the world, so more points.
        let scaled = Subdivision::new(&mesh, Mat3::from_diagonal(Vec3::splat(2.0)), 0.4, 10_000);
        assert!(scaled.expect("points").points.len() > 3 * made.points.len());
    }

    #[test]
    fn points_are_bounded() {
        let floor = quad(Vec3::ZERO, Vec3::X, Vec3::Z, 1);
        for longest in [1e-3, 1e-30, f32::MIN_POSITIVE] {
            assert!(Subdivision::new(&floor, Mat3::IDENTITY, longest, 5000).is_none());
        }
        assert!(Subdivision::new(&sphere(1.0, 8), Mat3::IDENTITY, 0.0, 10).is_none());
        let huge = Mat3::from_diagonal(Vec3::INFINITY);
        Subdivision::new(&floor, huge, 0.1, 5000);
    }
}
