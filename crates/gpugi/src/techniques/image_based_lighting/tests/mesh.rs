//! The Delaunay mesh of the domains.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use super::super::delaunay;
use super::{Decomposition, Settings, decompose, nearest, settings, sky};
use crate::scene::GpuScene;
use crate::testing::test_gpu;

#[test]
fn the_delaunay_mesh_of_known_directions() {
    let axes = [
        Vec3::X,
        Vec3::NEG_X,
        Vec3::Y,
        Vec3::NEG_Y,
        Vec3::Z,
        Vec3::NEG_Z,
    ];
    let edges = delaunay::edges(&nearest(&axes, [64, 32]), 64);
    // An octahedron: all pairs except opposite directions.
    let octahedron: Vec<_> = (0..6)
        .flat_map(|a| (a + 1..6).map(move |b| [a, b]))
        .filter(|&[a, b]| a / 2 != b / 2)
        .collect();
    assert_eq!(octahedron.len(), 12);
    assert_eq!(edges, octahedron);
    // A tetrahedron: all pairs. Three domains meet at one pole, because the fourth direction points away from it.
    let root = 8f32.sqrt() / 3.0;
    let tetrahedron = [0.0, TAU / 3.0, 2.0 * TAU / 3.0]
        .map(|turn| Vec3::new(root * turn.sin(), 1.0 / 3.0, root * turn.cos()));
    let [a, b, c] = tetrahedron;
    let edges = delaunay::edges(&nearest(&[a, b, c, Vec3::NEG_Y], [64, 32]), 64);
    assert_eq!(edges.len(), 6);
    // Four around each pole: neighbours only.
    let square = [0.5, 1.5, 2.5, 3.5].map(|at: f32| {
        let turn = at * TAU / 4.0;
        Vec3::new(turn.sin(), 0.0, turn.cos())
    });
    let edges = delaunay::edges(&nearest(&square, [64, 32]), 64);
    assert_eq!(edges, [[0, 1], [0, 3], [1, 2], [2, 3]]);
}

#[test]
fn the_delaunay_mesh_of_domains_is_one() {
    let Some(gpu) = test_gpu() else { return };
    let even = sky([128, 64], |_, _| Vec3::ONE);
    let scene = GpuScene::new(&gpu, &even).unwrap();
    let mut made = Decomposition::new(&gpu, &scene).unwrap();
    assert!(made.delaunay_edges(&gpu).unwrap().is_empty());
    let relaxed = Settings {
        iterations: 64,
        ..settings(40)
    };
    let domains = decompose(&gpu, &mut made, &scene, &relaxed);
    let edges = made.delaunay_edges(&gpu).unwrap();
    // Euler: a triangulation of the sphere has 3 V - 6 edges; each corner of the grid in which four domains meet costs
    // one.
    let whole = 3 * domains.len() - 6;
    println!("{} edges of {whole}", edges.len());
    assert!((whole - 4..=whole).contains(&edges.len()));
    let spacing = (4.0 * PI / 40.0).sqrt();
    for [a, b] in edges {
        let length = domains[a as usize]
            .toward
            .distance(domains[b as usize].toward);
        assert!(length < 2.0 * spacing, "{a}-{b}: {length}");
    }
}
