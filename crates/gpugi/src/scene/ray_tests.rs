//! Rays traced by the shader, compared with the CPU twin and with every triangle of the scene.

use std::sync::Arc;

use glam::{DVec2, Mat4, Quat, Vec2, Vec3};
use gpugi_scene::builtin::shapes::{sphere, transformed};
use gpugi_scene::bvh::traverse::{Ray, closest_hit};
use gpugi_scene::bvh::{FLAG_ALPHA, INSTANCE_ROWS, NODE_ROWS, Row, STACK_SIZE, TRIANGLE_ROWS};
use gpugi_scene::{
    AlphaMode, Image, Material, Mesh, Pixels, Scene, Texture, TextureRef, Wrap, provoking_order,
};

use super::GpuScene;
use crate::gpu::{Frame, Gpu, read_buffer};
use crate::shader;
use crate::testing::{Random, constant, test_gpu};

/// What testing/rays.wesl writes per ray.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct Found {
    pub t: f32,
    pub instance: u32,
    pub primitive: u32,
    padding_0: u32,
    barycentrics: [f32; 2],
    any: u32,
    padding_1: u32,
}

/// Traces rays on the GPU.
pub(super) fn trace(gpu: &Gpu, scene: &GpuScene, rays: &[Ray]) -> Vec<Found> {
    let packed: Vec<[f32; 8]> = rays
        .iter()
        .map(|ray| {
            let [o, d] = [ray.origin, ray.direction];
            [o.x, o.y, o.z, ray.t_min, d.x, d.y, d.z, ray.t_max]
        })
        .collect();
    let kernel = scene
        .ray_kernel(gpu, &shader!("testing.rays"), &[])
        .unwrap();
    let input = gpu.storage("rays", &packed).unwrap();
    let size = (rays.len() * std::mem::size_of::<Found>()) as u64;
    let output = gpu
        .buffer("found", size, wgpu::BufferUsages::STORAGE)
        .unwrap();
    let group = kernel
        .bind(
            gpu,
            1,
            &[
                ("rays", input.as_entire_binding()),
                ("output", output.as_entire_binding()),
            ],
        )
        .unwrap();
    let mut frame = Frame::new(gpu, false);
    frame.compute("rays", |pass| {
        kernel.dispatch(
            pass,
            &[(0, &scene.ray_bind_group), (1, &group)],
            [rays.len() as u32, 1, 1],
        );
    });
    frame.submit().unwrap();
    read_buffer(gpu, &output, size).unwrap()
}

/// How a ray meets a triangle of the scene, in 64-bit floats: t, the weights of the second and third corners, and the
/// cosine of the angle to the normal.
fn meet(
    scene: &Scene,
    ray: &Ray,
    instance: usize,
    vertices: [u32; 3],
) -> Option<(f64, DVec2, f64)> {
    let instance = &scene.instances[instance];
    let positions = &scene.meshes[instance.mesh].positions;
    let matrix = instance.world_from_mesh.as_dmat4();
    let [a, b, c] =
        vertices.map(|vertex| matrix.transform_point3(positions[vertex as usize].as_dvec3()));
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let (e1, e2) = (b - a, c - a);
    let p = d.cross(e2);
    let determinant = e1.dot(p);
    let s = (o - a) / determinant;
    let q = s.cross(e1);
    let cosine = e1.cross(e2).normalize().dot(d.normalize()).abs();
    (cosine > 1e-9).then(|| (e2.dot(q), DVec2::new(s.dot(p), d.dot(q)), cosine))
}

/// The least t over all triangles, enlarged by `margin` of their size.
fn brute_force(scene: &Scene, ray: &Ray, margin: f64) -> f64 {
    let mut best = f64::INFINITY;
    for (number, instance) in scene.instances.iter().enumerate() {
        for vertices in scene.meshes[instance.mesh].indices.as_chunks().0 {
            if let Some((t, weights, cosine)) = meet(scene, ray, number, *vertices)
                && weights.min_element() >= -margin
                && weights.element_sum() <= 1.0 + margin
                && (cosine > 1e-3 || margin > 0.0)
                && t > f64::from(ray.t_min)
                && t < f64::from(ray.t_max)
            {
                best = best.min(t);
            }
        }
    }
    best
}

/// Compares the results of the shader and of its CPU twin with those of trying every triangle. Near a triangle's
/// border, and where several triangles lie at the same distance, either result is correct. Returns the number of hits.
fn check(gpu: &Gpu, scene: &Scene, rays: &[Ray]) -> usize {
    let uploaded = GpuScene::with_rays(gpu, scene).unwrap();
    let found = trace(gpu, &uploaded, rays);
    let hierarchy = uploaded.rays.as_ref().unwrap();
    let rows: Vec<Row> = read_buffer(gpu, &hierarchy.buffer, hierarchy.buffer.size()).unwrap();
    let mut hits = 0;
    for (ray, found) in rays.iter().zip(found) {
        let twin = closest_hit(&rows, hierarchy.start(), ray, |_, _, _| true);
        assert!(twin.stack <= STACK_SIZE as usize);
        let t = f64::from(found.t);
        match twin.hit {
            None => assert_eq!(found.instance, u32::MAX, "{ray:?}"),
            Some(twin) => {
                assert!(
                    (t - f64::from(twin.t)).abs() <= 1e-5 * t,
                    "{found:?} {twin:?}"
                );
            }
        }
        assert_eq!(found.any, u32::from(twin.hit.is_some()));
        let (inner, outer) = (
            brute_force(scene, ray, -1e-3),
            brute_force(scene, ray, 1e-3),
        );
        if found.instance == u32::MAX {
            assert_eq!(inner, f64::INFINITY, "{ray:?} misses");
            continue;
        }
        hits += 1;
        // The renderer rotates triangles so that their first corner identifies them.
        let mesh = &scene.meshes[scene.instances[found.instance as usize].mesh];
        let order = provoking_order(&mesh.indices, mesh.positions.len());
        let corners = order.indices.as_chunks().0[found.primitive as usize];
        let vertices = corners.map(|corner: u32| order.vertices[corner as usize]);
        let triangle = meet(scene, ray, found.instance as usize, vertices);
        let (exact, weights, cosine) = triangle.unwrap();
        let slack = 1e-5 * t / cosine.max(1e-3);
        assert!(
            (t - exact).abs() < slack,
            "{found:?}: t is {exact} in {ray:?}"
        );
        assert!(
            t > outer - slack && t < inner + slack,
            "{found:?} {inner} {outer} {ray:?}"
        );
        let given = DVec2::from_array(found.barycentrics.map(f64::from));
        assert!(
            (given - weights).length() < 1e-3 / cosine,
            "{found:?} {weights}"
        );
    }
    hits
}

fn soup(random: &mut Random, triangles: u32) -> Mesh {
    let mut positions = Vec::new();
    for _ in 0..triangles {
        let at = random.direction() * random.next() as f32;
        positions.extend([0; 3].map(|_| at + random.direction() * 0.4));
    }
    Mesh {
        normals: vec![Vec3::Z; positions.len()],
        indices: (0..positions.len() as u32).collect(),
        positions,
        ..Mesh::default()
    }
}

/// Rays between random points around the origin.
fn rays(random: &mut Random, count: usize, far: f32, near: f32) -> Vec<Ray> {
    (0..count)
        .map(|_| {
            let origin = random.direction() * far;
            Ray {
                origin,
                t_min: 0.0,
                direction: random.direction() * near - origin,
                t_max: 1e30,
            }
        })
        .collect()
}

#[test]
fn rays_hit_what_trying_every_triangle_hits() {
    let Some(gpu) = test_gpu() else { return };
    let mut random = Random(1);
    for scale in [1e-12, 1.0, 1e12] {
        let mut scene = Scene::new("soup");
        let material = scene.add_material(Material::default());
        let mut mesh = soup(&mut random, 60);
        // Of the last triangles, some are degenerate (corners coincide), some are coplanar, and some share corners with
        // others.
        for vertex in 120..150 {
            mesh.positions[vertex].y = 0.1;
        }
        for vertex in (150..165).step_by(3) {
            mesh.positions[vertex + 1] = mesh.positions[vertex];
        }
        for index in 165..180 {
            mesh.indices[index] = index as u32 - 60;
        }
        // Include tiny meshes in large instances.
        for position in &mut mesh.positions {
            *position *= 1e-7;
        }
        let mesh = scene.add_mesh(mesh);
        for index in 0..12 {
            let turn = Quat::from_axis_angle(random.direction(), index as f32);
            let mirror = if index % 2 == 0 { 1.0 } else { -2.0 };
            let sides = Vec3::new(1.0, 0.3 + random.next() as f32, mirror) * 1e7 * scale;
            let at = random.direction() * 3.0 * scale;
            let place = Mat4::from_scale_rotation_translation(sides, turn, at);
            scene.add_instance("", mesh, material, place);
        }
        let mut rays = rays(&mut random, 400, 5.0 * scale, 3.0 * scale);
        for (index, ray) in rays.iter_mut().enumerate().take(60) {
            // Include rays along axes and rays with bounds.
            match index % 3 {
                0 => ray.direction = Vec3::AXES[index / 3 % 3] * -ray.origin,
                1 => ray.t_max = 0.7,
                _ => ray.t_min = 0.9,
            }
        }
        let hits = check(&gpu, &scene, &rays);
        assert!(hits > 100, "{hits} hits at scale {scale}");
    }
}

#[test]
fn thousands_of_instances_are_hit() {
    let Some(gpu) = test_gpu() else { return };
    let mut random = Random(2);
    let mut scene = Scene::new("instances");
    let material = scene.add_material(Material::default());
    let meshes = [1, 2, 4].map(|triangles| scene.add_mesh(soup(&mut random, triangles)));
    scene.add_mesh(Mesh::default());
    for index in 0..3000 {
        let turn = Quat::from_axis_angle(random.direction(), index as f32);
        let sides = Vec3::splat(0.5) * (1.0 + random.next() as f32);
        let at = random.direction() * 5.0 * random.next().cbrt() as f32;
        let place = Mat4::from_scale_rotation_translation(sides, turn, at);
        // One in a hundred has an empty mesh or a zero transform.
        let (mesh, place) = match index % 200 {
            0 => (3, place),
            100 => (meshes[0], Mat4::ZERO),
            _ => (meshes[index % 3], place),
        };
        scene.add_instance("", mesh, material, place);
    }
    let rays = rays(&mut random, 100, 8.0, 4.0);
    let hits = check(&gpu, &scene, &rays);
    assert!(hits > 40, "{hits}");
}

/// A closed mesh around the origin with integer corners.
fn lattice_cube(n: i32) -> Mesh {
    let mut positions = Vec::new();
    for axis in 0..3 {
        for side in [-n, n] {
            for (i, j) in (-n..n).flat_map(|i| (-n..n).map(move |j| (i, j))) {
                let corner = |a: i32, b: i32| {
                    let mut p = Vec3::splat(side as f32);
                    p[(axis + 1) % 3] = a as f32;
                    p[(axis + 2) % 3] = b as f32;
                    p
                };
                let [p, q] = [corner(i, j), corner(i + 1, j)];
                let [r, s] = [corner(i + 1, j + 1), corner(i, j + 1)];
                positions.extend([p, q, r, r, s, p]);
            }
        }
    }
    Mesh {
        normals: vec![Vec3::Z; positions.len()],
        indices: (0..positions.len() as u32).collect(),
        positions,
        ..Mesh::default()
    }
}

#[test]
fn no_ray_slips_through_an_edge_or_a_corner() {
    let Some(gpu) = test_gpu() else { return };
    let mut random = Random(3);
    let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -0.7);
    let (sides, at) = (Vec3::new(0.3, 2.0, -1.0), Vec3::new(40.0, -3.0, 7.0));
    let turned = Mat4::from_scale_rotation_translation(sides, turn, at);
    // Integers, where rays meet edges and corners exactly; and a sphere, where nothing is exact.
    for (place, is_ball) in [
        (Mat4::IDENTITY, false),
        (turned, false),
        (Mat4::IDENTITY, true),
    ] {
        let mut scene = Scene::new("closed");
        let material = scene.add_material(Material::default());
        let mut mesh = lattice_cube(6);
        if is_ball {
            for position in &mut mesh.positions {
                *position = position.normalize() * 6.1;
            }
        }
        let corners = mesh.positions.clone();
        let mesh = scene.add_mesh(mesh);
        scene.add_instance("", mesh, material, place);
        let mut rays = Vec::new();
        for origin in [
            Vec3::ZERO,
            Vec3::new(0.5, 0.0, -3.0),
            random.direction() * 5.0,
        ] {
            for corners in corners.chunks(3) {
                let mut somewhere = || random.next() as f32;
                let on_edges = [0.0, 0.5, somewhere(), somewhere(), somewhere()];
                for target in on_edges.map(|u| corners[0].lerp(corners[1], u)) {
                    rays.push(Ray {
                        origin: place.transform_point3(origin),
                        t_min: 0.0,
                        direction: place.transform_vector3(target - origin),
                        t_max: 1e30,
                    });
                }
            }
        }
        let uploaded = GpuScene::with_rays(&gpu, &scene).unwrap();
        for (ray, found) in rays.iter().zip(trace(&gpu, &uploaded, &rays)) {
            assert_eq!((found.instance, found.any), (0, 1), "{ray:?}");
        }
    }
}

/// A square of two triangles facing +Z, with texture coordinates.
fn square() -> Mesh {
    let corner = |x: f32, y: f32| Vec3::new(x, y, 0.0);
    Mesh {
        positions: vec![
            corner(0.0, 0.0),
            corner(1.0, 0.0),
            corner(1.0, 1.0),
            corner(0.0, 1.0),
        ],
        normals: vec![Vec3::Z; 4],
        uvs: [
            vec![
                Vec2::new(0.0, 1.0),
                Vec2::ONE,
                Vec2::new(1.0, 0.0),
                Vec2::ZERO,
            ],
            Vec::new(),
        ],
        indices: vec![0, 1, 2, 2, 3, 0],
        ..Mesh::default()
    }
}

/// Rays along -Z through the square, at the centres of an 8 x 8 grid.
fn rays_through_square() -> Vec<Ray> {
    (0..64)
        .map(|index| Ray {
            origin: Vec3::new((index % 8) as f32 + 0.5, (index / 8) as f32 + 0.5, 8.0) / 8.0,
            t_min: 0.0,
            direction: Vec3::NEG_Z,
            t_max: 1e30,
        })
        .collect()
}

#[test]
fn alpha_decides_what_rays_hit() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("alpha");
    // Alpha: 0.25 in the left half, 0.75 in the right half.
    scene.images.push(Arc::new(Image {
        name: String::new(),
        width: 2,
        height: 1,
        pixels: Pixels::Rgba8(vec![255, 255, 255, 64, 255, 255, 255, 191]),
    }));
    scene.textures.push(Texture {
        image: 0,
        wrap: [Wrap::ClampToEdge; 2],
        nearest: true,
        has_levels: true,
    });
    let sheet = scene.add_material(Material {
        base_color_texture: Some(TextureRef::new(0)),
        alpha_mode: AlphaMode::Mask { cutoff: 0.5 },
        ..Material::default()
    });
    let wall = scene.add_material(Material::default());
    let mesh = scene.add_mesh(square());
    scene.add_instance("sheet", mesh, sheet, Mat4::IDENTITY);
    scene.add_instance("wall", mesh, wall, Mat4::from_translation(Vec3::NEG_Z));
    let rays = rays_through_square();
    let left = |index: usize| index % 8 < 4;
    let trace_scene =
        |scene: &Scene| trace(&gpu, &GpuScene::with_rays(&gpu, scene).unwrap(), &rays);

    for (index, found) in trace_scene(&scene).iter().enumerate() {
        assert_eq!(
            found.instance,
            u32::from(left(index)),
            "masked, ray {index}"
        );
        assert_eq!(found.any, 1);
    }
    scene.materials[sheet].alpha_mode = AlphaMode::Blend;
    let found = trace_scene(&scene);
    let sheets = |side: bool| {
        let on_side = found
            .iter()
            .enumerate()
            .filter(|(index, _)| left(*index) == side);
        on_side.filter(|(_, found)| found.instance == 0).count()
    };
    // Each ray has its own seed: of 32 rays, about 8 and 24 hit.
    assert!((2..=14).contains(&sheets(true)), "{}", sheets(true));
    assert!((18..=30).contains(&sheets(false)), "{}", sheets(false));
    // Transmission is not alpha, and opaque materials ignore alpha.
    scene.materials[sheet].alpha_mode = AlphaMode::Opaque;
    scene.materials[sheet].transmission = 1.0;
    assert!(trace_scene(&scene).iter().all(|found| found.instance == 0));
    // Without the wall, shadow rays pass where the surface does not exist.
    scene.materials[sheet].alpha_mode = AlphaMode::Mask { cutoff: 0.5 };
    scene.instances.truncate(1);
    for (index, found) in trace_scene(&scene).iter().enumerate() {
        assert_eq!(found.any, u32::from(!left(index)), "shadow ray {index}");
    }
}

#[test]
fn a_cutoff_of_one_keeps_what_is_opaque() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("leaf");
    let material = scene.add_material(Material {
        alpha_mode: AlphaMode::Mask { cutoff: 1.0 },
        ..Material::default()
    });
    let mesh = scene.add_mesh(square());
    scene.add_instance("leaf", mesh, material, Mat4::IDENTITY);
    let mut random = Random(5);
    let mut place = || (0.01 + 0.98 * random.next()) as f32;
    let rays: Vec<Ray> = (0..10_000)
        .map(|_| Ray {
            origin: Vec3::new(place(), place(), 1.0),
            direction: Vec3::NEG_Z,
            t_min: 0.0,
            t_max: 10.0,
        })
        .collect();
    let found = trace(&gpu, &GpuScene::with_rays(&gpu, &scene).unwrap(), &rays);
    let passing = found
        .iter()
        .filter(|found| found.instance != 0 || found.any == 0);
    assert_eq!(passing.count(), 0);
}

#[test]
fn instances_move_come_and_go_under_the_same_meshes() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("moving");
    let material = scene.add_material(Material::default());
    let mesh = scene.add_mesh(square());
    scene.add_instance("", mesh, material, Mat4::IDENTITY);
    let rays = rays_through_square();
    let mut uploaded = GpuScene::with_rays(&gpu, &scene).unwrap();
    let buffer = |scene: &GpuScene| scene.rays.as_ref().unwrap().buffer.clone();
    let first = buffer(&uploaded);

    scene.instances[0].world_from_mesh = Mat4::from_translation(Vec3::new(0.0, 0.0, 0.5));
    uploaded.update(&gpu, &scene).unwrap();
    assert_eq!(buffer(&uploaded), first, "meshes were built again");
    assert!(
        trace(&gpu, &uploaded, &rays)
            .iter()
            .all(|found| found.t == 0.5)
    );

    // More instances than the buffer had room for.
    for index in 0..40 {
        let place = Mat4::from_translation(Vec3::new(0.0, 0.0, 0.75 - index as f32));
        scene.add_instance("", mesh, material, place);
    }
    uploaded.update(&gpu, &scene).unwrap();
    let found = trace(&gpu, &uploaded, &rays);
    assert!(
        found
            .iter()
            .all(|found| (found.t, found.instance) == (0.25, 1))
    );

    scene.instances.clear();
    uploaded.update(&gpu, &scene).unwrap();
    assert!(
        trace(&gpu, &uploaded, &rays)
            .iter()
            .all(|found| found.instance == u32::MAX)
    );

    // A changed mesh: everything is rebuilt.
    scene.add_instance("", mesh, material, Mat4::IDENTITY);
    for position in &mut Arc::make_mut(&mut scene.meshes[mesh]).positions {
        position.z = -1.0;
    }
    uploaded.update(&gpu, &scene).unwrap();
    assert!(
        trace(&gpu, &uploaded, &rays)
            .iter()
            .all(|found| found.t == 2.0)
    );

    // Uploaded without rays: there is nothing that rays could hit.
    let plain = GpuScene::new(&gpu, &scene).unwrap();
    assert!(plain.rays.is_none());
    assert!(
        trace(&gpu, &plain, &rays)
            .iter()
            .all(|found| found.instance == u32::MAX)
    );
}

#[test]
fn shader_and_host_agree_on_the_layout() {
    let rays = shader!("testing.rays");
    let constant = |name: &str| constant(&rays, "scene_bvh", name);
    assert_eq!(constant("STACK_SIZE"), STACK_SIZE);
    assert_eq!(constant("NODE_ROWS"), NODE_ROWS);
    assert_eq!(constant("TRIANGLE_ROWS"), TRIANGLE_ROWS);
    assert_eq!(constant("INSTANCE_ROWS"), INSTANCE_ROWS);
    assert_eq!(constant("FLAG_ALPHA"), FLAG_ALPHA);
}

/// Balls as spheres among triangles: flattened, turned, mirrored, far from their mesh's origin, tiny and huge.
#[test]
fn rays_hit_exact_spheres() {
    let Some(gpu) = test_gpu() else { return };
    let mut random = Random(5);
    for scale in [1e-6_f32, 1.0, 1e6] {
        let mut scene = Scene::new("spheres");
        let material = scene.add_material(Material::default());
        let off_center = Vec3::new(0.3, -0.2, 0.1);
        let ball = transformed(sphere(0.5, 16), &Mat4::from_translation(off_center));
        let mesh = scene.add_mesh(ball);
        for index in 0..12 {
            let turn = Quat::from_axis_angle(random.direction(), index as f32);
            let mirror = if index % 2 == 0 { 1.0 } else { -2.0 };
            let sides = Vec3::new(1.0, 0.5 + random.next() as f32, mirror) * scale;
            let at = random.direction() * 3.0 * scale;
            let place = Mat4::from_scale_rotation_translation(sides, turn, at);
            let instance = scene.add_instance("", mesh, material, place);
            scene.instances[instance].is_sphere = index < 10;
        }
        let rays = rays(&mut random, 2000, 5.0 * scale, 3.0 * scale);
        let uploaded = GpuScene::with_rays(&gpu, &scene).unwrap();
        assert!(uploaded.has_spheres);
        let hierarchy = uploaded.rays.as_ref().unwrap();
        let rows: Vec<Row> = read_buffer(&gpu, &hierarchy.buffer, hierarchy.buffer.size()).unwrap();
        let spheres = scene.spheres().unwrap();
        let mut hits = 0;
        for (ray, found) in rays.iter().zip(trace(&gpu, &uploaded, &rays)) {
            let twin = closest_hit(&rows, hierarchy.start(), ray, |_, _, _| true).hit;
            assert_eq!(found.any, u32::from(twin.is_some()));
            let Some(twin) = twin else {
                assert_eq!(found.instance, u32::MAX, "{ray:?}");
                continue;
            };
            assert_eq!(found.instance, twin.instance, "{ray:?}");
            assert!((found.t - twin.t).abs() <= 1e-5, "{found:?} {twin:?}");
            let Some(sphere) = spheres[found.instance as usize] else {
                continue;
            };
            hits += 1;
            // In 64-bit floats, in the sphere's own space.
            let mesh_from_world = scene.instances[found.instance as usize]
                .world_from_mesh
                .as_dmat4()
                .inverse();
            let center = sphere.center.as_dvec3();
            let o = mesh_from_world.transform_point3(ray.origin.as_dvec3()) - center;
            let d = mesh_from_world.transform_vector3(ray.direction.as_dvec3());
            let b = o.dot(d) / d.length_squared();
            let nearest = o - d * b;
            let under = f64::from(sphere.radius).powi(2) - nearest.length_squared();
            let t = -b - (under.max(0.0) / d.length_squared()).sqrt();
            // Where a ray grazes the sphere, t depends on the root of what is rounded.
            let slack = 1e-5 / (under.max(1e-4)).sqrt();
            assert!(
                (f64::from(found.t) - t).abs() < slack,
                "{found:?}: t is {t} in {ray:?}"
            );
            // The point of the mesh lies below the hit.
            let mesh = &scene.meshes[scene.instances[found.instance as usize].mesh];
            let order = provoking_order(&mesh.indices, mesh.positions.len());
            let corners = order.indices.as_chunks().0[found.primitive as usize];
            let [a, b, c] = corners
                .map(|corner: u32| mesh.positions[order.vertices[corner as usize] as usize])
                .map(|corner| corner.as_dvec3() - center);
            let [v, w] = found.barycentrics.map(f64::from);
            let below = a * (1.0 - v - w) + b * v + c * w;
            let above = o + d * f64::from(found.t);
            let apart = below.normalize().distance(above.normalize());
            assert!(apart < 1e-4, "{found:?}: {below} below {above}");
            assert!(v.min(w).min(1.0 - v - w) > -1e-4, "{found:?}");
        }
        assert!(hits > 400, "{hits}");
    }
}
