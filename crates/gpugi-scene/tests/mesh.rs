//! Meshes: closedness and provoking-vertex order.

use glam::{Vec3, vec3};
use gpugi_scene::builtin::shapes;
use gpugi_scene::{Mesh, provoking_order};

/// Marsaglia's 64-bit xorshift: the same numbers everywhere.
struct Random(u64);

impl Random {
    fn next(&mut self, bound: u32) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        ((self.0 >> 33) % u64::from(bound)) as u32
    }
}

/// Checks every property of a provoking order; returns the number of new vertices.
fn check_order(indices: &[u32], vertex_count: usize) -> usize {
    let order = provoking_order(indices, vertex_count);
    assert_eq!(order.indices.len(), indices.len());
    let mut seen = vec![false; vertex_count];
    for &vertex in &order.vertices {
        seen[vertex as usize] = true;
    }
    assert!(seen.iter().all(|&seen| seen), "a vertex is lost");
    for (number, triangle) in order.indices.chunks(3).enumerate() {
        assert_eq!(triangle[0] as usize, number);
        let original: Vec<u32> = triangle
            .iter()
            .map(|&new| order.vertices[new as usize])
            .collect();
        let wanted = &indices[number * 3..number * 3 + 3];
        let same = (0..3).any(|turn| (0..3).all(|i| original[i] == wanted[(i + turn) % 3]));
        assert!(
            same,
            "triangle {number}: {original:?} is no rotation of {wanted:?}"
        );
    }
    assert!(order.vertices.len() <= indices.len() / 3 + vertex_count);
    order.vertices.len()
}

#[test]
fn provoking_order_holds_for_random_triangles() {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    for _ in 0..300 {
        let vertex_count = 1 + random.next(60);
        let triangles = random.next(100);
        let indices: Vec<u32> = (0..triangles * 3)
            .map(|_| random.next(vertex_count))
            .collect();
        check_order(&indices, vertex_count as usize);
    }
    assert_eq!(check_order(&[], 0), 0);
    assert_eq!(check_order(&[], 4), 4);
}

#[test]
fn provoking_order_duplicates_few_vertices() {
    // A closed mesh has about twice as many triangles as vertices, so that the triangles alone need that many.
    let sphere = shapes::sphere(1.0, 64);
    let triangles = sphere.indices.len() / 3;
    let count = check_order(&sphere.indices, sphere.positions.len());
    assert!(
        count as f64 <= triangles as f64 * 1.02,
        "{count} for {triangles} triangles"
    );
    // Separate triangles need no duplicate at all.
    let separate: Vec<u32> = (0..300).collect();
    assert_eq!(check_order(&separate, 300), 300);
}

fn mesh(positions: &[Vec3], indices: &[u32]) -> Mesh {
    Mesh {
        positions: positions.to_vec(),
        normals: vec![Vec3::Y; positions.len()],
        indices: indices.to_vec(),
        ..Mesh::default()
    }
}

#[test]
fn closed_means_each_edge_once_in_either_direction() {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
    let tetrahedron = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3];
    assert!(mesh(&corners, &tetrahedron).is_closed());
    assert!(!mesh(&corners, &tetrahedron[3..]).is_closed(), "a hole");
    let mut flipped = tetrahedron;
    flipped.swap(0, 1);
    assert!(
        !mesh(&corners, &flipped).is_closed(),
        "one triangle the wrong way round"
    );
    let twice = [tetrahedron, tetrahedron].concat();
    assert!(!mesh(&corners, &twice).is_closed(), "two coincident shells");
    assert!(!mesh(&corners, &[]).is_closed(), "nothing");
    let degenerate = [&tetrahedron[..], &[1, 1, 2]].concat();
    assert!(
        mesh(&corners, &degenerate).is_closed(),
        "triangles without area do not count"
    );
}

#[test]
fn closedness_ignores_seams() {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
    let tetrahedron: [usize; 12] = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3];
    let mut soup: Vec<Vec3> = tetrahedron.iter().map(|&corner| corners[corner]).collect();
    soup[0] = vec3(-0.0, 0.0, -0.0);
    let indices: Vec<u32> = (0..12).collect();
    assert!(mesh(&soup, &indices).is_closed());
    soup[0].x = 1e-7;
    assert!(!mesh(&soup, &indices).is_closed());
}
