//! Meshes: closedness, provoking-vertex order, smooth normals, polygons.

use std::time::{Duration, Instant};

use glam::{EulerRot, Quat, Vec3, vec3};
use gpugi_scene::builtin::shapes;
use gpugi_scene::normals::{CREASE_ANGLE, smooth_normals};
use gpugi_scene::polygon::triangulate;
use gpugi_scene::{Mesh, provoking_order};

use crate::random::Random;

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
        let vertex_count = 1 + random.below(60);
        let triangles = random.below(100);
        let indices: Vec<u32> = (0..triangles * 3)
            .map(|_| random.below(vertex_count) as u32)
            .collect();
        check_order(&indices, vertex_count);
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

#[test]
fn creases_stay_sharp_and_curves_become_smooth() {
    let mut cube = shapes::cuboid(Vec3::NEG_ONE, Vec3::ONE, 3);
    let flat = cube.normals.clone();
    cube.normals.clear();
    smooth_normals(&mut cube, CREASE_ANGLE);
    assert!(cube.check().is_ok() && cube.is_closed());
    for (normal, position) in cube.normals.iter().zip(&cube.positions) {
        assert!(
            normal.abs().max_element() > 0.9999,
            "{normal} at {position}"
        );
    }
    assert_eq!(cube.normals.len(), flat.len());

    let mut sphere = shapes::sphere(2.0, 24);
    smooth_normals(&mut sphere, CREASE_ANGLE);
    for (normal, position) in sphere.normals.iter().zip(&sphere.positions) {
        assert!(
            normal.dot(*position) / 2.0 > 0.999,
            "{normal} at {position}"
        );
    }
    // A whole turn smooths even a cube's corners: by symmetry along the diagonal, however its faces are cut.
    let mut cube = shapes::cuboid(Vec3::NEG_ONE, Vec3::ONE, 1);
    smooth_normals(&mut cube, 6.0_f32.min(std::f32::consts::PI));
    for (normal, position) in cube.normals.iter().zip(&cube.positions) {
        assert!(
            normal.dot(position.normalize()) > 0.9999,
            "{normal} at {position}"
        );
    }
}

#[test]
fn smooth_normals_are_always_unit() {
    let mut random = Random(0x1234_5678_9ABC_DEF1);
    let scales = [1e-38, 1e-20, 1.0, 1e19, 3e38];
    for case in 0..300 {
        let count = 1 + random.below(20);
        let scale = scales[case % scales.len()];
        let mut coordinate = || (random.below(5) as f32 / 2.0 - 1.0) * scale;
        let positions: Vec<Vec3> = (0..count)
            .map(|_| vec3(coordinate(), coordinate(), coordinate()))
            .collect();
        let indices: Vec<u32> = (0..90).map(|_| random.below(count) as u32).collect();
        let mut mesh = mesh(&positions, &indices);
        smooth_normals(&mut mesh, CREASE_ANGLE);
        assert!(mesh.check().is_ok());
        assert_eq!(mesh.indices.len(), indices.len());
        for (new, old) in mesh.indices.iter().zip(&indices) {
            assert_eq!(mesh.positions[*new as usize], positions[*old as usize]);
        }
        assert!(
            mesh.normals
                .iter()
                .all(|normal| (normal.length() - 1.0).abs() < 1e-5)
        );
    }
}

#[test]
fn many_triangles_at_one_vertex_stay_fast() {
    let count = 100_000;
    let rim = (0..count).map(|i| {
        let angle = i as f32 / count as f32 * std::f32::consts::TAU;
        vec3(angle.sin(), 0.0, angle.cos())
    });
    let positions: Vec<Vec3> = std::iter::once(Vec3::Y).chain(rim).collect();
    let indices: Vec<u32> = (0..count)
        .flat_map(|i| [0, 1 + i, 1 + (i + 1) % count])
        .collect();
    let mut cone = mesh(&positions, &indices);
    smooth_normals(&mut cone, CREASE_ANGLE);
    assert!(cone.normals[0].y > 0.999);
}

/// Checks that a polygon in the plane z = 0 is cut into triangles that face +Z and cover its area.
fn check_polygon(corners: &[Vec3], area: f32) {
    let triangles = triangulate(corners);
    assert_eq!(triangles.len(), corners.len() - 2);
    let areas = triangles.iter().map(|triangle| {
        let [a, b, c] = triangle.map(|corner| corners[corner as usize]);
        (b - a).cross(c - a).z / 2.0
    });
    let mut sum = 0.0;
    for part in areas {
        assert!(part > 0.0, "a triangle is turned over");
        sum += part;
    }
    assert!((sum - area).abs() < 1e-4, "{sum} is not {area}");
}

#[test]
fn polygons_are_covered() {
    let square = [Vec3::ZERO, Vec3::X, vec3(1.0, 1.0, 0.0), Vec3::Y];
    check_polygon(&square, 1.0);
    // An arrow head, whose fan from the first corner would turn a triangle over; at each starting corner.
    let mut arrow = [
        vec3(0.0, 0.0, 0.0),
        vec3(2.0, -1.0, 0.0),
        vec3(0.0, 2.0, 0.0),
        vec3(-2.0, -1.0, 0.0),
    ];
    for _ in 0..4 {
        check_polygon(&arrow, 4.0);
        arrow.rotate_left(1);
    }
    let star: Vec<Vec3> = (0..40)
        .map(|i| {
            let radius = if i % 2 == 0 { 1.0 } else { 0.3 };
            let angle = i as f32 / 40.0 * std::f32::consts::TAU;
            vec3(angle.cos(), angle.sin(), 0.0) * radius
        })
        .collect();
    check_polygon(
        &star,
        40.0 * 0.5 * 0.3 * (std::f32::consts::TAU / 40.0).sin(),
    );
    for few in 0..3 {
        assert!(triangulate(&square[..few]).is_empty());
    }
    assert_eq!(triangulate(&[Vec3::ONE; 7]).len(), 5, "no area at all");
}

/// A square of 8 x 8 with a hole of 4 x 4 that a bridge joins to its edge, as exporters write it.
const WINDOW: [Vec3; 10] = [
    vec3(-4.0, -4.0, 0.0),
    vec3(4.0, -4.0, 0.0),
    vec3(4.0, 4.0, 0.0),
    vec3(-4.0, 4.0, 0.0),
    vec3(-4.0, -4.0, 0.0),
    vec3(-2.0, -2.0, 0.0),
    vec3(-2.0, 2.0, 0.0),
    vec3(2.0, 2.0, 0.0),
    vec3(2.0, -2.0, 0.0),
    vec3(-2.0, -2.0, 0.0),
];

#[test]
fn holes_stay_open() {
    let mut window = WINDOW;
    for _ in 0..window.len() {
        check_polygon(&window, 64.0 - 16.0);
        window.rotate_left(1);
    }
    let ring = (0_i32..33)
        .map(|i| (3.0, i))
        .chain((0..33).map(|i| (2.6, -i)));
    let ring: Vec<Vec3> = ring
        .map(|(radius, i)| {
            let angle = i.rem_euclid(32) as f32 / 32.0 * std::f32::consts::TAU;
            vec3(angle.cos(), angle.sin(), 0.0) * radius
        })
        .collect();
    let sector = (std::f32::consts::TAU / 32.0).sin() / 2.0;
    check_polygon(&ring, 32.0 * sector * (9.0 - 2.6 * 2.6));
}

#[test]
fn concave_polygons_keep_their_winding_in_every_plane() {
    for turn in [
        Quat::IDENTITY,
        Quat::from_rotation_x(1.5),
        Quat::from_rotation_x(-1.5),
        Quat::from_rotation_x(3.0),
        Quat::from_rotation_y(1.5),
        Quat::from_rotation_y(-1.5),
        Quat::from_euler(EulerRot::XYZ, 0.6, 0.8, 2.0),
    ] {
        let corners = WINDOW.map(|corner| turn * corner);
        let areas = triangulate(&corners).into_iter().map(|triangle| {
            let [a, b, c] = triangle.map(|corner| corners[corner as usize]);
            (b - a).cross(c - a).dot(turn * Vec3::Z) / 2.0
        });
        let areas: Vec<f32> = areas.collect();
        assert!(areas.iter().all(|area| *area > 0.0), "{turn}: {areas:?}");
        assert!((areas.iter().sum::<f32>() - 48.0).abs() < 1e-3, "{turn}");
    }
}

#[test]
fn a_convex_polygon_stays_a_fan() {
    let rim = (0..2000).map(|i| {
        let angle = i as f32 / 2000.0 * std::f32::consts::TAU;
        vec3(angle.cos(), angle.sin(), 0.0)
    });
    for corners in [4, 5, 7, 40] {
        let rim: Vec<Vec3> = rim.clone().step_by(2000 / corners).take(corners).collect();
        let fan = (2..corners as u32).map(|i| [0, i - 1, i]);
        assert_eq!(triangulate(&rim), fan.collect::<Vec<_>>());
    }
}

#[test]
fn polygons_that_intersect_themselves_take_no_time() {
    let mut random = Random(7);
    for corners in [5, 40, 90, 120, 200, 300, 300, 300, 30_000] {
        let scale = [1e-45, 1e-3, 1.0, 3e35][random.below(4)];
        let tangle: Vec<Vec3> = (0..corners)
            .map(|_| {
                let mut side = || random.below(1000) as f32 * scale;
                vec3(side(), side(), side() * 1e-3)
            })
            .collect();
        let begun = Instant::now();
        assert!(triangulate(&tangle).len() <= corners - 2);
        assert!(begun.elapsed() < Duration::from_millis(200), "{corners}");
    }
}
