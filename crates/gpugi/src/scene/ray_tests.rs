//! Rays in the shader against the CPU twin and against every triangle of the scene.

use glam::{DMat4, Mat4, Quat, Vec3};
use gpugi_scene::bvh::traverse::Ray;
use gpugi_scene::{Material, Mesh, Scene};

use super::GpuScene;
use crate::gpu::{Frame, Gpu, Kernel, KernelOptions, read_buffer};
use crate::shader;
use crate::testing::{Random, test_gpu};

/// What testing/rays.wesl writes for a ray.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Found {
    t: f32,
    instance: u32,
    primitive: u32,
    padding_0: u32,
    barycentrics: [f32; 2],
    any: u32,
    padding_1: u32,
}

/// Traces rays on the GPU.
fn trace(gpu: &Gpu, scene: &GpuScene, rays: &[Ray]) -> Vec<Found> {
    let packed: Vec<[f32; 8]> = rays
        .iter()
        .map(|ray| {
            let [o, d] = [ray.origin, ray.direction];
            [o.x, o.y, o.z, ray.t_min, d.x, d.y, d.z, ray.t_max]
        })
        .collect();
    let kernel = Kernel::with_options(
        gpu,
        &shader!("testing.rays"),
        "main",
        Some(&scene.layout),
        &KernelOptions {
            constants: &scene.ray_constants(),
            unchecked: false,
        },
    )
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
            &[(0, &scene.bind_group), (1, &group)],
            [rays.len() as u32, 1, 1],
        );
    });
    frame.submit().unwrap();
    read_buffer(gpu, &output, size).unwrap()
}

/// The closest hit by trying every triangle in 64-bit floats: t, instance, primitive.
fn brute_force(scene: &Scene, ray: &Ray) -> Option<(f64, u32, u32)> {
    let mut best: Option<(f64, u32, u32)> = None;
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    for (number, instance) in scene.instances.iter().enumerate() {
        let mesh = &scene.meshes[instance.mesh];
        let matrix: DMat4 = instance.world_from_mesh.as_dmat4();
        for (primitive, triangle) in mesh.indices.chunks_exact(3).enumerate() {
            let [a, b, c] = [0, 1, 2].map(|corner| {
                matrix.transform_point3(mesh.positions[triangle[corner] as usize].as_dvec3())
            });
            let (e1, e2) = (b - a, c - a);
            let p = d.cross(e2);
            let determinant = e1.dot(p);
            if determinant == 0.0 {
                continue;
            }
            let s = (o - a) / determinant;
            let (u, v) = (s.dot(p), d.dot(s.cross(e1)));
            let t = e2.dot(s.cross(e1));
            if u >= 0.0
                && v >= 0.0
                && u + v <= 1.0
                && t > f64::from(ray.t_min)
                && t < f64::from(ray.t_max)
                && best.is_none_or(|(best, ..)| t < best)
            {
                best = Some((t, number as u32, primitive as u32));
            }
        }
    }
    best
}

#[test]
fn a_sphere_is_hit_as_by_brute_force() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("spheres");
    let mut random = Random(1);
    let material = scene.add_material(Material::default());
    let mut positions = Vec::new();
    let mut indices = Vec::new();
    for index in 0..300 {
        let at = random.direction() * random.next() as f32;
        for _ in 0..3 {
            positions.push(at + random.direction() * 0.2);
        }
        indices.extend([3 * index, 3 * index + 1, 3 * index + 2]);
    }
    let mesh = scene.add_mesh(Mesh {
        normals: vec![Vec3::Z; positions.len()],
        positions,
        indices,
        ..Mesh::default()
    });
    for index in 0..20 {
        let turn = Quat::from_axis_angle(random.direction(), index as f32);
        let scale = Vec3::new(
            1.0,
            0.5 + random.next() as f32,
            if index % 2 == 0 { 1.0 } else { -2.0 },
        );
        let place = Mat4::from_scale_rotation_translation(scale, turn, random.direction() * 3.0);
        scene.add_instance("", mesh, material, place);
    }
    let rays: Vec<Ray> = (0..2000)
        .map(|_| {
            let origin = random.direction() * 5.0;
            Ray {
                origin,
                t_min: 0.0,
                direction: random.direction() * 3.0 - origin,
                t_max: 1e30,
            }
        })
        .collect();
    let uploaded = GpuScene::with_rays(&gpu, &scene).unwrap();
    let found = trace(&gpu, &uploaded, &rays);
    let mut hits = 0;
    for (ray, found) in rays.iter().zip(found) {
        match brute_force(&scene, ray) {
            None => assert_eq!(found.instance, u32::MAX, "{ray:?}"),
            Some((t, instance, primitive)) => {
                hits += 1;
                assert_eq!((found.instance, found.primitive), (instance, primitive));
                assert!((f64::from(found.t) - t).abs() < 1e-5 * t, "{found:?} {t}");
                assert_eq!(found.any, 1);
            }
        }
    }
    assert!(hits > 500, "{hits}");
}
