//! Scenes whose obscurances are known.

use glam::{DVec3, Mat4, Vec3};
use gpugi_scene::builtin::shapes;
use gpugi_scene::{Material, Mesh, Scene};

use super::{Falloff, Found, Mode, Settings, found, rms};
use crate::testing::test_gpu;

/// A scene of meshes, each in one matt colour.
pub fn matt(parts: impl IntoIterator<Item = (Mesh, Vec3)>) -> Scene {
    let mut scene = Scene::new("matt");
    for (mesh, albedo) in parts {
        let mesh = scene.add_mesh(mesh);
        let material = scene.add_material(Material::matt("matt", albedo));
        scene.add_instance("part", mesh, material, Mat4::IDENTITY);
    }
    scene
}

pub const FLOOR: Vec3 = Vec3::splat(0.5);
pub const WALL: Vec3 = Vec3::new(0.8, 0.2, 0.1);

/// A floor, and a wall at its edge x = 0.
pub fn floor_and_wall() -> Scene {
    let floor = shapes::quad(Vec3::new(0.0, 0.0, -3.0), Vec3::Z * 6.0, Vec3::X * 4.0, 4);
    let wall = shapes::quad(Vec3::new(0.0, 0.0, -3.0), Vec3::Y * 2.0, Vec3::Z * 6.0, 4);
    matt([(floor, FLOOR), (wall, WALL)])
}

/// A floor between two walls, and a box in the corner, turned against the walls.
pub fn corner() -> Scene {
    let at = Vec3::splat(-1.0);
    let turned = Mat4::from_rotation_y(0.5) * Mat4::from_translation(Vec3::new(0.1, 0.05, 0.2));
    let block = shapes::cuboid(Vec3::new(-0.4, -0.9, -0.4), Vec3::new(0.3, -0.2, 0.2), 1);
    matt([
        (
            shapes::quad(at, Vec3::Z * 2.0, Vec3::X * 2.0, 1),
            Vec3::splat(0.7),
        ),
        (shapes::quad(at, Vec3::X * 2.0, Vec3::Y * 2.0, 1), WALL),
        (
            shapes::quad(at, Vec3::Y * 2.0, Vec3::Z * 2.0, 1),
            Vec3::new(0.1, 0.6, 0.2),
        ),
        (
            shapes::transformed(block, &turned),
            Vec3::new(0.2, 0.3, 0.9),
        ),
    ])
}

pub fn settings(mode: Mode, distance: f32, falloff: Falloff) -> Settings {
    Settings {
        directions: if mode == Mode::Rays { 256 } else { 512 },
        mode,
        distance,
        falloff,
        ..Default::default()
    }
}

/// For a point at distance `x` from an endless wall, with reach 1: the share of cosine-distributed directions that hit
/// the wall, and the mean of rho over all directions, which is 0 for those that miss. On the unit disc onto which the
/// directions project, with p the component toward the wall, d = x / p: those with p above x hit.
fn before_wall(x: f64, falloff: Falloff) -> (f64, f64) {
    if x >= 1.0 {
        return (0.0, 0.0);
    }
    let met = (x.acos() - x * (1.0 - x * x).sqrt()) / std::f64::consts::PI;
    let rho = |d: f64| match falloff {
        Falloff::Sqrt => d.sqrt(),
        Falloff::Linear => d,
        Falloff::Step => 0.0,
    };
    const STEPS: usize = 4000;
    // The substitution p = cos a removes the root from the integral.
    let end = x.acos();
    let sum: f64 = (0..STEPS)
        .map(|step| {
            let a = end * (step as f64 + 0.5) / STEPS as f64;
            rho(x / a.cos()) * a.sin().powi(2)
        })
        .sum();
    (met, sum * end / STEPS as f64 * 2.0 / std::f64::consts::PI)
}

/// Compares the floor in front of a wall with the closed form.
pub fn check_floor_and_wall(all: &[Found], falloff: Falloff, most: f64) {
    let areas = [24.0, 12.0];
    let mean = (FLOOR.as_dvec3() * areas[0] + WALL.as_dvec3() * areas[1]) / (areas[0] + areas[1]);
    let floor = all.iter().filter(|texel| texel.instance == 0);
    // The wall ends at z = 3: closer to its end it does not count as endless.
    let floor: Vec<_> = floor.filter(|texel| texel.position.z.abs() < 1.9).collect();
    assert!(floor.len() > 100, "{}", floor.len());
    let known = |texel: &Found| {
        let (met, rho) = before_wall(texel.position.x, falloff);
        (1.0 - met + rho, WALL.as_dvec3() * rho + mean * (1.0 - met))
    };
    let plain = rms(floor.iter().map(|texel| texel.plain - known(texel).0));
    let colored = rms(floor
        .iter()
        .map(|texel| (texel.colored - known(texel).1).length()));
    println!("{falloff:?}: RMSE {plain:.4}, colours {colored:.4}");
    assert!(
        plain < most && colored < most,
        "{falloff:?}: {plain}, {colored}"
    );
    // The mean error shows bias.
    let bias: f64 = floor.iter().map(|texel| texel.plain - known(texel).0).sum();
    let bias = bias / floor.len() as f64;
    assert!(bias.abs() < most / 5.0, "{falloff:?}: bias {bias}");
}

#[test]
fn a_floor_before_an_endless_wall() {
    let Some(gpu) = test_gpu() else { return };
    let scene = floor_and_wall();
    for falloff in [Falloff::Sqrt, Falloff::Linear, Falloff::Step] {
        let all = found(&gpu, &scene, 48, &settings(Mode::Rays, 1.0, falloff));
        check_floor_and_wall(&all, falloff, 0.01);
    }
}

/// A sphere seen from inside.
pub fn hollow_sphere(radius: f32, segments: u32) -> Mesh {
    let mut mesh = shapes::sphere(radius, segments);
    for normal in &mut mesh.normals {
        *normal = -*normal;
    }
    for triangle in mesh.indices.as_chunks_mut::<3>().0 {
        triangle.swap(1, 2);
    }
    mesh
}

/// Inside a sphere, d = 2 r cos: W = int sqrt(2 r mu / d_max) 2 mu dmu = 4/5 sqrt(2 r / d_max).
pub fn check_sphere(all: &[Found], albedo: DVec3, most: f64) {
    let known = 0.8 * (2.0_f64 / 2.5).sqrt();
    let plain = rms(all.iter().map(|texel| texel.plain - known));
    let colored = rms(all
        .iter()
        .map(|texel| (texel.colored - albedo * known).length()));
    let bias = all.iter().map(|texel| texel.plain - known).sum::<f64>() / all.len() as f64;
    println!("sphere: RMSE {plain:.4}, colours {colored:.4}, bias {bias:.5}");
    assert!(plain < most && colored < most, "{plain}, {colored}");
}

#[test]
fn inside_a_sphere_every_distance_is_known() {
    let Some(gpu) = test_gpu() else { return };
    let albedo = Vec3::new(0.9, 0.5, 0.25);
    let scene = matt([(hollow_sphere(1.0, 48), albedo)]);
    let all = found(&gpu, &scene, 32, &settings(Mode::Rays, 2.5, Falloff::Sqrt));
    check_sphere(&all, albedo.as_dvec3(), 0.01);
}

/// A triangle: first corner, edges, albedo.
pub struct Face {
    corner: DVec3,
    edges: [DVec3; 2],
    albedo: DVec3,
}

pub fn faces(scene: &Scene) -> Vec<Face> {
    let of_instance = |instance: &gpugi_scene::Instance| {
        let mesh = &scene.meshes[instance.mesh];
        let world = instance.world_from_mesh.as_dmat4();
        let albedo = scene.materials[instance.material].base_color.truncate();
        let at = |&index: &u32| world.transform_point3(mesh.positions[index as usize].as_dvec3());
        let triangles = mesh.indices.as_chunks::<3>().0.iter();
        let face = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.each_ref().map(at);
            Face {
                corner: a,
                edges: [b - a, c - a],
                albedo: albedo.as_dvec3(),
            }
        };
        triangles.map(face).collect::<Vec<_>>()
    };
    scene.instances.iter().flat_map(of_instance).collect()
}

/// Distance from a point to the nearest edge of any triangle.
pub fn to_edge(faces: &[Face], at: DVec3) -> f64 {
    let edges = faces.iter().flat_map(|face| {
        let [b, c] = face.edges;
        let a = face.corner;
        [(a, b), (a, c), (a + b, c - b)]
    });
    let distances = edges.map(|(from, along)| {
        let share = (at - from).dot(along) / along.length_squared();
        at.distance(from + along * share.clamp(0.0, 1.0))
    });
    distances.fold(f64::INFINITY, f64::min)
}

/// Distance along a ray (Moeller and Trumbore 1997).
fn distance(face: &Face, origin: DVec3, direction: DVec3) -> Option<f64> {
    let p = direction.cross(face.edges[1]);
    let determinant = face.edges[0].dot(p);
    let s = origin - face.corner;
    let u = s.dot(p) / determinant;
    let q = s.cross(face.edges[0]);
    let v = direction.dot(q) / determinant;
    let t = face.edges[1].dot(q) / determinant;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 1e-6).then_some(t)
}

/// W and colored W at a point: the integral over the hemisphere by midpoints of cosine-distributed cells.
fn evaluated(faces: &[Face], mean: DVec3, reach: f64, at: &Found) -> (f64, DVec3) {
    const CELLS: [usize; 2] = [48, 96];
    let tangent = at.normal.any_orthonormal_vector();
    let bitangent = at.normal.cross(tangent);
    let mut sums = (0.0, DVec3::ZERO);
    for cell in 0..CELLS[0] * CELLS[1] {
        let u = ((cell / CELLS[1]) as f64 + 0.5) / CELLS[0] as f64;
        let phi = std::f64::consts::TAU * ((cell % CELLS[1]) as f64 + 0.5) / CELLS[1] as f64;
        let direction =
            (tangent * phi.cos() + bitangent * phi.sin()) * u.sqrt() + at.normal * (1.0 - u).sqrt();
        let hits = faces.iter().filter_map(|face| {
            let t = distance(face, at.position, direction)?;
            (t < reach).then_some((t, face.albedo))
        });
        let nearest = hits.reduce(|nearest, hit| if hit.0 < nearest.0 { hit } else { nearest });
        let (rho, albedo) = nearest.map_or((1.0, mean), |(t, albedo)| ((t / reach).sqrt(), albedo));
        sums.0 += rho;
        sums.1 += albedo * rho;
    }
    let count = (CELLS[0] * CELLS[1]) as f64;
    (sums.0 / count, sums.1 / count)
}

/// Compares every `every`-th texel with the integral.
pub fn check_integral(scene: &Scene, all: &[Found], reach: f64, every: usize, most: f64) {
    let faces = faces(scene);
    let area = |face: &Face| face.edges[0].cross(face.edges[1]).length();
    let whole: f64 = faces.iter().map(area).sum();
    let mean: DVec3 = faces.iter().map(|face| face.albedo * area(face)).sum();
    let mean = mean / whole;
    let errors = all.iter().step_by(every).map(|texel| {
        let (plain, colored) = evaluated(&faces, mean, reach, texel);
        (texel.plain - plain, (texel.colored - colored).length())
    });
    let errors: Vec<_> = errors.collect();
    let plain = rms(errors.iter().map(|error| error.0));
    let colored = rms(errors.iter().map(|error| error.1));
    println!(
        "{} points: RMSE {plain:.4}, colours {colored:.4}",
        errors.len()
    );
    assert!(plain < most && colored < most, "{plain}, {colored}");
}

#[test]
fn a_corner_against_the_integral_in_double_precision() {
    let Some(gpu) = test_gpu() else { return };
    let scene = corner();
    let all = found(&gpu, &scene, 64, &settings(Mode::Rays, 1.5, Falloff::Sqrt));
    check_integral(&scene, &all, 1.5, all.len() / 150, 0.01);
}

#[test]
fn an_open_plane_receives_all_and_reflects_its_own_color() {
    let Some(gpu) = test_gpu() else { return };
    let plane = |albedo| matt([(shapes::quad(Vec3::ZERO, Vec3::Z, Vec3::X, 1), albedo)]);
    for albedo in [Vec3::ONE, Vec3::new(0.25, 0.5, 0.75)] {
        let settings = settings(Mode::Rays, 100.0, Falloff::Sqrt);
        for texel in found(&gpu, &plane(albedo), 16, &settings) {
            assert_eq!(texel.plain, 1.0);
            assert!(
                texel.colored.distance(albedo.as_dvec3()) < 2e-3,
                "{texel:?}"
            );
        }
    }
}

/// Checks colour bleeding: ratio of the floor's colours near the wall to those far from it.
pub fn check_bleeding(all: &[Found]) {
    let mean = |near: fn(f64) -> bool| {
        let some = all
            .iter()
            .filter(|texel| texel.instance == 0 && near(texel.position.x));
        let some: Vec<_> = some.map(|texel| texel.colored).collect();
        some.iter().sum::<DVec3>() / some.len() as f64
    };
    let (near, far) = (mean(|x| x < 0.3), mean(|x| x > 2.0));
    let ratio = near / far;
    // The wall is red: every channel is darker near it, red the least.
    assert!(ratio.max_element() < 1.0, "{ratio}");
    assert!(ratio.x > ratio.y + 0.1 && ratio.y > ratio.z, "{ratio}");
}

#[test]
fn colors_bleed_from_the_wall() {
    let Some(gpu) = test_gpu() else { return };
    let settings = settings(Mode::Rays, 1.0, Falloff::Sqrt);
    check_bleeding(&found(&gpu, &floor_and_wall(), 64, &settings));
}
