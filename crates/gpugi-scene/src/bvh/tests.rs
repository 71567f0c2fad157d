//! Tests that each triangle lies in boxes that contain it, that depth limits hold for any input, and that no ray slips
//! through an edge.

use std::sync::Arc;
use std::time::Instant;

use glam::{DVec3, Mat4, Quat, Vec3};

use super::rows::MESH_LEVELS;
use super::traverse::{Ray, Traversal, any_hit, closest_hit};
use super::tree::Tree;
use super::*;
use crate::Bounds;

/// Numbers in [0, 1) from a PCG generator: the same on every machine.
struct Random(u32);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let word = ((self.0 >> ((self.0 >> 28) + 4)) ^ self.0).wrapping_mul(277_803_737);
        ((word >> 22 ^ word) >> 8) as f32 / (1 << 24) as f32
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::from_array([0; 3].map(|_| self.next() * 2.0 - 1.0))
    }
}

struct Built {
    rows: Vec<Row>,
    start: [u32; 2],
    bottom: BottomLevel,
}

fn build(meshes: &[Vec<[Vec3; 3]>], instances: &[(usize, Mat4)]) -> Built {
    let (bottom, mut rows) = BottomLevel::new(meshes.iter().cloned()).unwrap();
    let instances: Vec<BvhInstance> = instances
        .iter()
        .map(|&(mesh, world_from_mesh)| BvhInstance {
            mesh,
            world_from_mesh,
            flags: 0,
            sphere: None,
        })
        .collect();
    let (top, top_rows) = bottom.top_level(&instances).unwrap();
    rows.extend(top_rows);
    Built {
        rows,
        start: top.start,
        bottom,
    }
}

impl Built {
    fn closest(&self, origin: Vec3, direction: Vec3) -> Traversal {
        let ray = Ray {
            origin,
            t_min: 0.0,
            direction,
            t_max: f32::MAX,
        };
        let found = closest_hit(&self.rows, self.start, &ray, |_, _, _| true);
        let any = any_hit(&self.rows, self.start, &ray, |_, _, _| true);
        assert_eq!(found.hit.is_some(), any.hit.is_some(), "{ray:?}");
        found
    }

    /// Checks the boxes of a mesh's nodes and returns its number of levels. Every triangle must occur exactly once.
    fn check_mesh(&self, mesh: usize, triangles: usize) -> u32 {
        let mut seen = vec![false; triangles];
        let levels = self.check_node(self.bottom.meshes[mesh].root, None, &mut seen);
        assert!(seen.into_iter().all(|seen| seen));
        levels
    }

    /// `within`: the box that the parent stores for this node.
    fn check_node(&self, row: u32, within: Option<[DVec3; 2]>, seen: &mut [bool]) -> u32 {
        let node = &self.rows[row as usize..(row + NODE_ROWS) as usize];
        let origin = DVec3::from_array([0, 1, 2].map(|axis| f32::from_bits(node[0][axis]).into()));
        let exponent = |axis: usize| (node[0][3] >> (8 * axis)) & 255;
        let step =
            DVec3::from_array([0, 1, 2].map(|axis| f32::from_bits(exponent(axis) << 23).into()));
        let byte = |words: &[u32], slot: usize| words[slot / 4] >> (slot % 4 * 8) & 255;
        let mut levels = 1;
        let mut inner = 0;
        for slot in 0..8 {
            let meta = byte(&node[1][2..], slot);
            let corner = |first: usize| {
                let cells = [2, 3, 4].map(|axis| byte(&node[axis][first..], slot).into());
                origin + DVec3::from_array(cells) * step
            };
            let bounds = [corner(0), corner(2)];
            let inside =
                |point: DVec3| point.cmpge(bounds[0]).all() && point.cmple(bounds[1]).all();
            if meta & 0x18 == 0x18 {
                let child = node[1][0] + inner * NODE_ROWS;
                inner += 1;
                levels = levels.max(1 + self.check_node(child, Some(bounds), seen));
            } else {
                for item in meta & 31..(meta & 31) + (meta >> 5).count_ones() {
                    let row = (node[1][1] + item * TRIANGLE_ROWS) as usize;
                    let number = self.rows[row][3] as usize;
                    assert!(!std::mem::replace(&mut seen[number], true));
                    for corner in &self.rows[row..row + 3] {
                        let corner = [0, 1, 2].map(|axis| f32::from_bits(corner[axis]).into());
                        let corner = DVec3::from_array(corner);
                        assert!(inside(corner), "{corner} outside {bounds:?}");
                        let [min, max] = within.unwrap_or(bounds);
                        assert!(corner.cmpge(min).all() && corner.cmple(max).all());
                    }
                }
            }
        }
        assert_eq!(inner, (node[0][3] >> 24).count_ones());
        levels
    }
}

fn soup(count: usize, size: f32, random: &mut Random) -> Vec<[Vec3; 3]> {
    (0..count)
        .map(|_| {
            let at = random.vector();
            [0; 3].map(|_| at + random.vector() * size)
        })
        .collect()
}

#[test]
fn boxes_hold_their_triangles_at_every_scale() {
    let mut random = Random(1);
    for scale in [1e-18, 1e-6, 1.0, 1e6, 1e18] {
        for offset in [Vec3::ZERO, Vec3::new(100.0, -5.0, 0.0)] {
            let mut triangles = soup(1500, 0.1, &mut random);
            // Flat triangles, thin ones, single points and duplicates.
            for index in 0..100 {
                triangles[index]
                    .iter_mut()
                    .for_each(|corner| corner.y = 0.25);
                triangles[index + 100][1] = triangles[index + 100][0];
                triangles[index + 200] = [triangles[index][0]; 3];
                triangles[index + 300] = triangles[299];
            }
            for corner in triangles.as_flattened_mut() {
                *corner = (*corner + offset) * scale;
            }
            let built = build(&[triangles], &[(0, Mat4::IDENTITY)]);
            let levels = built.check_mesh(0, 1500);
            assert!(levels < 8, "{levels} levels");
        }
    }
}

#[test]
fn no_input_is_slow_or_deep() {
    const COUNT: usize = 100_000;
    let triangle = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let point = |x: f32| [Vec3::X * x; 3];
    let inputs: [(&str, Vec<[Vec3; 3]>); 5] = [
        ("equal", vec![triangle; COUNT]),
        (
            "nested",
            (0..COUNT)
                .map(|i| triangle.map(|corner| corner * 1.0002_f32.powi(i as i32)))
                .collect(),
        ),
        (
            "a row of points",
            (0..COUNT).map(|i| point(i as f32)).collect(),
        ),
        (
            "ever farther",
            (0..COUNT)
                .map(|i| point(1.001_f32.powi(i as i32 % 80_000)))
                .collect(),
        ),
        (
            "a fan",
            (0..COUNT)
                .map(|i| {
                    [
                        Vec3::ZERO,
                        Vec3::new(i as f32, 1.0, 0.0),
                        Vec3::new(i as f32 + 1.0, 1.0, 0.0),
                    ]
                })
                .collect(),
        ),
    ];
    for (name, triangles) in inputs {
        let started = Instant::now();
        let built = build(
            &[triangles],
            &[(0, Mat4::IDENTITY), (0, Mat4::from_scale(Vec3::splat(2.0)))],
        );
        assert!(
            started.elapsed().as_secs() < 20,
            "{name}: {:?}",
            started.elapsed()
        );
        let levels = built.check_mesh(0, COUNT);
        assert!(levels <= MESH_LEVELS, "{name}: {levels} levels");
        let mut random = Random(5);
        for _ in 0..20 {
            let found = built.closest(random.vector() * 3.0, random.vector());
            assert!(
                found.stack <= STACK_SIZE as usize,
                "{name}: {}",
                found.stack
            );
        }
    }
}

#[test]
fn a_balanced_tree_is_as_deep_as_it_says() {
    let mut random = Random(2);
    for (count, most_items) in [(1, 1), (2, 3), (24, 3), (25, 3), (193, 3), (5000, 1)] {
        let boxes: Vec<Bounds> = (0..count).map(|_| Bounds::of([random.vector()])).collect();
        // A limit of zero levels always forces the balanced tree.
        let tree = Tree::new(&boxes, 0, most_items);
        let mut order = tree.order.clone();
        order.sort_unstable();
        assert!(order.iter().copied().eq(0..count), "{count}");
        let leaves = f64::from(count) / f64::from(most_items);
        let levels = (leaves.log2() / 3.0).ceil().max(1.0) as u32;
        assert!(tree.depth <= levels + 1, "{count}: {} levels", tree.depth);
        let items: u32 = tree
            .nodes
            .iter()
            .flat_map(|node| node.child_meta)
            .filter(|meta| meta & 0x18 != 0x18)
            .map(|meta| (meta >> 5).count_ones())
            .sum();
        assert_eq!(items, count);
    }
}

/// The surface of a cube with corners at integer coordinates from -n to n, so that rays along integers meet edges and
/// corners exactly.
fn lattice_cube(n: i32) -> Vec<[Vec3; 3]> {
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for side in [-n, n] {
            for i in -n..n {
                for j in -n..n {
                    let corner = |a: i32, b: i32| {
                        let mut p = [0.0; 3];
                        p[axis] = side as f32;
                        p[(axis + 1) % 3] = a as f32;
                        p[(axis + 2) % 3] = b as f32;
                        Vec3::from_array(p)
                    };
                    let [p, q, r, s] = [
                        corner(i, j),
                        corner(i + 1, j),
                        corner(i + 1, j + 1),
                        corner(i, j + 1),
                    ];
                    triangles.push([p, q, r]);
                    triangles.push([r, s, p]);
                }
            }
        }
    }
    triangles
}

#[test]
fn no_ray_slips_through_an_edge_or_a_corner() {
    const N: i32 = 8;
    let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -0.7);
    let places = [
        Mat4::IDENTITY,
        Mat4::from_scale_rotation_translation(
            Vec3::new(0.3, 2.0, -1.0),
            turn,
            Vec3::new(40.0, -3.0, 7.0),
        ),
        Mat4::from_scale_rotation_translation(Vec3::splat(1e-9), turn, Vec3::ZERO),
        Mat4::from_scale(Vec3::splat(1e12)),
    ];
    let cube = lattice_cube(N);
    // The same with the corners on a ball, where no product is exact.
    let ball = cube
        .iter()
        .map(|corners| corners.map(|corner| corner.normalize() * 8.1))
        .collect();
    for (place, mesh) in places
        .into_iter()
        .flat_map(|place| [(place, &cube), (place, &ball)])
    {
        let built = build(std::slice::from_ref(mesh), &[(0, place)]);
        let mut random = Random(3);
        for from in [
            Vec3::ZERO,
            Vec3::new(0.5, 0.0, -3.0),
            random.vector() * 4.0,
            random.vector() * 0.1,
        ] {
            let origin = place.transform_point3(from);
            for corners in mesh {
                for (u, v) in [
                    (0.0, 0.0),
                    (0.5, 0.0),
                    (0.5, 0.5),
                    (0.25, 0.75),
                    (random.next(), 0.0),
                ] {
                    let target =
                        corners[0] + (corners[1] - corners[0]) * u + (corners[2] - corners[0]) * v;
                    let direction = place.transform_vector3(target - from);
                    let found = built.closest(origin, direction);
                    assert!(
                        found.hit.is_some(),
                        "{origin} toward {direction} in {place}"
                    );
                }
            }
        }
    }
}

#[test]
fn nothing_to_hit_is_nothing_hit() {
    let triangle = vec![[Vec3::ZERO, Vec3::X, Vec3::Y]];
    let toward = (Vec3::new(0.25, 0.25, 1.0), Vec3::NEG_Z);
    let hit = |built: Built| built.closest(toward.0, toward.1).hit;
    assert_eq!(hit(build(&[], &[])), None);
    assert_eq!(hit(build(&[Vec::new()], &[(0, Mat4::IDENTITY)])), None);
    let found = hit(build(
        std::slice::from_ref(&triangle),
        &[(0, Mat4::IDENTITY)],
    ))
    .unwrap();
    assert_eq!((found.t, found.instance, found.primitive), (1.0, 0, 0));
    assert_eq!(found.barycentrics.to_array(), [0.25, 0.25]);
    // Instances without an inverse are left out; the others keep their numbers.
    let flat = Mat4::from_scale(Vec3::new(1.0, 0.0, 1.0));
    let endless = Mat4::from_translation(Vec3::new(f32::INFINITY, 0.0, 0.0));
    let undefined = Mat4::from_scale(Vec3::splat(f32::NAN));
    let tiny = Mat4::from_scale(Vec3::splat(1e-30));
    let places =
        [flat, endless, undefined, tiny, Mat4::ZERO, Mat4::IDENTITY].map(|place| (0, place));
    let found = hit(build(std::slice::from_ref(&triangle), &places)).unwrap();
    assert_eq!(found.instance, 5);
    // Invalid rays.
    let built = build(&[triangle], &[(0, Mat4::IDENTITY)]);
    for direction in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY] {
        assert_eq!(built.closest(toward.0, direction).hit, None);
        assert_eq!(built.closest(direction * f32::NAN, toward.1).hit, None);
    }
}

/// `count` instances of a soup in a cube of side 2 `reach`.
fn scattered(count: usize, reach: f32, random: &mut Random) -> Vec<BvhInstance> {
    let place = |_| BvhInstance {
        mesh: 0,
        world_from_mesh: Mat4::from_translation(random.vector() * reach)
            * Mat4::from_scale(Vec3::splat(0.1)),
        flags: 0,
        sphere: None,
    };
    (0..count).map(place).collect()
}

#[test]
fn moved_instances_keep_their_items() {
    let mut random = Random(7);
    let (bottom, _) = BottomLevel::new([soup(20, 0.5, &mut random)]).unwrap();
    let mut instances = scattered(300, 1.0, &mut random);
    instances[5].world_from_mesh = Mat4::from_scale(Vec3::ZERO);
    let (mut top, rows) = bottom.top_level(&instances).unwrap();
    let levels = top.levels();
    let mut nodes = levels.concat();
    nodes.sort_unstable();
    assert!(nodes.into_iter().eq(0..top.nodes()));
    assert_eq!(levels.last(), Some(&vec![0]));
    assert_eq!(top.boxes.len(), 299);
    let gone = Mat4::from_scale(Vec3::new(1.0, 0.0, 1.0));
    assert!(!bottom.can_refit(&top, 0, 0, &gone), "no inverse now");
    let back = Mat4::IDENTITY;
    assert!(!bottom.can_refit(&top, 5, 0, &back), "an inverse now");
    assert_eq!(bottom.place(&mut top, 5, 0, &gone), None);
    // What stays in its place keeps its rows and its box.
    for (number, instance) in instances
        .iter()
        .enumerate()
        .filter(|(number, _)| *number != 5)
    {
        let boxes = top.boxes.clone();
        let place = &instance.world_from_mesh;
        let item = bottom.place(&mut top, number, 0, place).unwrap();
        let row = (top.nodes() * NODE_ROWS + item.item * INSTANCE_ROWS) as usize;
        assert_eq!(rows[row..row + INSTANCE_ROWS as usize], item.rows);
        assert_eq!(boxes[item.item as usize], item.bounds);
    }
}

#[test]
fn corners_that_are_not_finite_are_an_error() {
    let whole = [Vec3::ZERO, Vec3::X, Vec3::Y];
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let broken = [Vec3::ZERO, Vec3::new(0.0, value, 0.0), Vec3::Y];
        let error = BottomLevel::new([vec![whole], vec![whole, broken]]).unwrap_err();
        let expected = BvhError::NotFinite {
            mesh: 1,
            triangle: 1,
        };
        assert_eq!(error, expected);
    }
    // An instance that is not finite is left out.
    let (bottom, _) = BottomLevel::new([vec![whole]]).unwrap();
    let instance = BvhInstance {
        mesh: 0,
        world_from_mesh: Mat4::from_scale(Vec3::splat(f32::NAN)),
        flags: 0,
        sphere: None,
    };
    let (_, rows) = bottom.top_level(&[instance]).unwrap();
    assert_eq!(rows.len(), NODE_ROWS as usize);
}

#[test]
fn a_tree_is_built_again_when_it_has_become_bad() {
    let mut random = Random(3);
    let (bottom, _) = BottomLevel::new([soup(20, 0.5, &mut random)]).unwrap();
    let instances = scattered(500, 10.0, &mut random);
    let (built, _) = bottom.top_level(&instances).unwrap();
    let after = |moved: &dyn Fn(usize, Mat4) -> Mat4| {
        let mut top = built.clone();
        for (number, instance) in instances.iter().enumerate() {
            assert!(!top.has_become_bad(), "not looked at yet");
            let place = moved(number, instance.world_from_mesh);
            bottom.place(&mut top, number, 0, &place).unwrap();
        }
        top.has_become_bad()
    };
    assert!(!after(&|_, place| place));
    // All together, each a little, one far away.
    let by = |x: f32| Mat4::from_translation(Vec3::X * x);
    assert!(!after(&|_, place| by(300.0) * place));
    assert!(!after(
        &|number, place| by(0.1 * (number % 3) as f32) * place
    ));
    assert!(!after(&|number, place| by(if number == 7 {
        100.0
    } else {
        0.0
    }) * place));
    // They change places.
    assert!(after(
        &|number, _| instances[(number * 211) % 500].world_from_mesh
    ));
}

/// A sheet of 2 n^2 triangles with waves of a height.
fn sheet(n: u32, height: f32) -> Vec<[Vec3; 3]> {
    let corner = |x: u32, y: u32| {
        let [x, y] = [x, y].map(|at| at as f32 / n as f32);
        Vec3::new(x, y, height * (9.0 * x).sin() * (7.0 * y).cos())
    };
    let cells = (0..n * n).map(|cell| (cell % n, cell / n));
    cells
        .flat_map(|(x, y)| {
            let corners = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, j)| corner(x + i, y + j));
            [
                [corners[0], corners[1], corners[2]],
                [corners[0], corners[2], corners[3]],
            ]
        })
        .collect()
}

#[test]
fn a_mesh_that_deforms_keeps_its_tree() {
    let mut random = Random(11);
    let before = [sheet(30, 0.1), soup(50, 0.5, &mut random)];
    let after = [sheet(30, 0.3), before[1].clone()];
    let instances = [(0, Mat4::IDENTITY), (1, Mat4::from_translation(Vec3::X))];
    let fresh = build(&after, &instances);
    let (built, _) = BottomLevel::new(before.iter().cloned()).unwrap();
    let (bottom, mut rows) = built.following(after.iter().cloned()).unwrap();
    for (a, b) in bottom.meshes.iter().zip(&built.meshes) {
        assert!(Arc::ptr_eq(&a.tree, &b.tree));
    }
    // One mesh alone gets the same rows.
    for (mesh, triangles) in after.iter().enumerate() {
        let mut bent = built.clone();
        let (first, of_mesh) = bent.bend(mesh, triangles).unwrap().unwrap();
        let end = first as usize + of_mesh.len();
        assert!(of_mesh == rows[first as usize..end]);
        assert_eq!(bent.meshes[mesh].bounds, bottom.meshes[mesh].bounds);
        assert_eq!(bent.end(), built.end());
    }
    let instances = instances.map(|(mesh, world_from_mesh)| BvhInstance {
        mesh,
        world_from_mesh,
        flags: 0,
        sphere: None,
    });
    let (top, top_rows) = bottom.top_level(&instances).unwrap();
    rows.extend(top_rows);
    let followed = Built {
        rows,
        start: top.start,
        bottom,
    };
    followed.check_mesh(0, after[0].len());
    followed.check_mesh(1, after[1].len());
    let mut hits = 0;
    for _ in 0..2000 {
        let (origin, direction) = (random.vector() * 2.0, random.vector());
        let [a, b] = [&followed, &fresh].map(|built| built.closest(origin, direction).hit);
        let hit = |found: Option<_>| found.map(|hit: super::traverse::Hit| (hit.t, hit.primitive));
        assert_eq!(hit(a), hit(b));
        hits += u32::from(hit(a).is_some());
    }
    assert!(hits > 100, "{hits}");
}

#[test]
fn what_overlaps_a_box_is_found() {
    let mut random = Random(11);
    let meshes = [sheet(20, 0.3), sheet(3, 0.2)];
    let places = [
        (0, Mat4::IDENTITY),
        (1, Mat4::from_translation(Vec3::new(0.3, 0.2, -0.4))),
        (
            1,
            Mat4::from_scale_rotation_translation(
                Vec3::new(0.5, -2.0, 1e-2),
                Quat::from_rotation_y(0.7),
                Vec3::new(-0.5, 0.1, 0.2),
            ),
        ),
        (0, Mat4::ZERO),
    ];
    // A single instance has no nodes above it.
    for count in [1, places.len()] {
        let instances = &places[..count];
        let built = build(&meshes, instances);
        let (mut all, mut needed) = (0, 0);
        for _ in 0..200 {
            let center = random.vector();
            let half = random.vector().abs() * 0.2;
            let near = Bounds {
                min: center - half,
                max: center + half,
            };
            let mut found = Vec::new();
            overlapping(&built.rows, built.start, &near, |instance, triangle| {
                found.push((instance, triangle));
                true
            });
            for (instance, (mesh, place)) in instances.iter().enumerate() {
                for (triangle, corners) in meshes[*mesh].iter().enumerate() {
                    let corners = corners.map(|corner| place.transform_point3(corner));
                    let bounds = Bounds::of(corners);
                    let is_near =
                        bounds.min.cmple(near.max).all() && bounds.max.cmpge(near.min).all();
                    let key = (instance as u32, triangle as u32);
                    let is_found = found.contains(&key);
                    // What lies in a turned box of its mesh may lie outside of the box.
                    assert!(is_found || !is_near || *place == Mat4::ZERO, "{key:?}");
                    needed += usize::from(is_near && *place != Mat4::ZERO);
                }
            }
            all += found.len();
            let mut first = 0;
            overlapping(&built.rows, built.start, &near, |_, _| {
                first += 1;
                false
            });
            assert_eq!(first, found.len().min(1));
        }
        assert!(needed > 100 && all < 8 * needed, "{all} for {needed}");
    }
}

#[test]
fn a_tree_that_was_built_ahead_is_taken_where_it_serves() {
    let scene = crate::builtin::builtin("spheres", 1).unwrap();
    let mut mesh = crate::Mesh::clone(&scene.meshes[0]);
    mesh.build_tree();
    let tree = mesh.tree.clone();
    let order = crate::provoking::provoking_order(&mesh.indices, mesh.positions.len());
    let corners = order.triangles(&mesh.positions);
    let with_tree = |corners: &[[Vec3; 3]], tree: &Option<Arc<TriangleTree>>| {
        let corners = corners.to_vec();
        let tree = tree.clone();
        BottomLevel::new([MeshTriangles { corners, tree }]).unwrap()
    };
    let (bottom, rows) = with_tree(&corners, &tree);
    assert!(Arc::ptr_eq(&bottom.meshes[0].tree, tree.as_ref().unwrap()));
    assert_eq!(rows, BottomLevel::new([corners.clone()]).unwrap().1);
    // What deforms is fitted to the tree before, if there is one.
    let before = BottomLevel::new([corners.clone()]).unwrap().0;
    let triangles = MeshTriangles {
        corners: corners.clone(),
        tree: tree.clone(),
    };
    let (followed, _) = before.following([triangles]).unwrap();
    assert!(Arc::ptr_eq(
        &followed.meshes[0].tree,
        &before.meshes[0].tree
    ));
    // Another mesh; one with fewer triangles.
    let mut shuffled = corners.clone();
    for index in 0..shuffled.len() {
        shuffled.swap(index, (index * 7919) % corners.len());
    }
    for other in [&shuffled[..], &corners[1..]] {
        let (_, rows) = with_tree(other, &tree);
        assert_eq!(rows, BottomLevel::new([other.to_vec()]).unwrap().1);
    }
    // A mesh without a hierarchy has no tree.
    mesh.positions[0].x = f32::NAN;
    mesh.build_tree();
    assert!(mesh.tree.is_none());
    mesh.positions[0].x = 0.0;
    mesh.indices[0] = u32::MAX;
    mesh.build_tree();
    assert!(mesh.tree.is_none());
    mesh.indices[0] = 0;
    mesh.build_tree();
    assert!(mesh.tree.is_some());
}

#[test]
fn a_mesh_that_changes_too_much_gets_another_tree() {
    let before = sheet(30, 0.1);
    let (bottom, _) = BottomLevel::new([before.clone()]).unwrap();
    let mut shuffled = before.clone();
    for index in 0..shuffled.len() {
        shuffled.swap(index, (index * 7919) % before.len());
    }
    let (fewer, _) = before.split_at(before.len() - 1);
    for after in [shuffled, fewer.to_vec()] {
        let (followed, rows) = bottom.following([after.clone()]).unwrap();
        assert!(!Arc::ptr_eq(
            &followed.meshes[0].tree,
            &bottom.meshes[0].tree
        ));
        assert_eq!(rows, BottomLevel::new([after.clone()]).unwrap().1);
        let mut bent = bottom.clone();
        assert!(bent.bend(0, &after).unwrap().is_none());
        assert_eq!(bent.meshes[0].bounds, bottom.meshes[0].bounds);
    }
    let mut broken = before;
    broken[3][1].x = f32::NAN;
    assert!(bottom.clone().bend(0, &broken).is_err());
}
