//! What a cube's faces see, against rays in a box.

use glam::{DVec3, Mat4, Vec3};
use gpugi_scene::builtin::shapes;
use gpugi_scene::{Material, Scene};

use crate::capture::{Capture, CaptureKernels, CubeView};
use crate::gpu::{Frame, Kernel, read_buffer};
use crate::scene::{DrawClass, GpuScene};
use crate::shader;
use crate::testing::{on_face, test_gpu};

const SIDE: usize = 64;
const EYE: Vec3 = Vec3::new(0.3, -0.2, 0.5);
/// Corners of the box (m).
const LOW: Vec3 = Vec3::new(-1.0, -1.5, -2.0);
const HIGH: Vec3 = Vec3::new(2.0, 1.0, 1.5);

#[test]
fn points_of_a_cube_lie_on_their_rays() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("box");
    let mesh = scene.add_mesh(shapes::cuboid(LOW, HIGH, 1));
    let material = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
    scene.add_instance("box", mesh, material, Mat4::IDENTITY);
    // What is not drawn must not be seen.
    scene.add_instance("hidden", mesh, material, Mat4::from_scale(Vec3::splat(0.5)));
    let mut on_gpu = GpuScene::new(&gpu, &scene).unwrap();
    let kernels = CaptureKernels::new(&gpu, &on_gpu).unwrap();
    let mut capture = Capture::of_cube(&gpu, &kernels, SIDE as u32).unwrap();
    let view = CubeView::new(EYE, SIDE as u32, 1e-3, 0, 1);
    let points = shader!("testing.points");
    let kernel = Kernel::new(&gpu, &points, "main", Some(&on_gpu.layout)).unwrap();
    let count = (6 * SIDE * SIDE) as u32;
    let size = u64::from(count) * 64;
    let output = gpu
        .buffer("output", size, wgpu::BufferUsages::STORAGE)
        .unwrap();
    let resources = [
        ("points", capture.points.points.as_entire_binding()),
        ("output", output.as_entire_binding()),
    ];
    let group = kernel.bind(&gpu, 1, &resources).unwrap();
    let mut frame = Frame::new(&gpu, false);
    on_gpu.merge(&mut frame);
    capture
        .record_cube(&mut frame, &on_gpu, &view, |draw| {
            (draw.instance == 0).then_some(DrawClass::DoubleSided)
        })
        .unwrap();
    frame.compute("points", |pass| {
        kernel.dispatch(pass, &[(0, &on_gpu.bind_group), (1, &group)], [count, 1, 1]);
    });
    frame.submit().unwrap();
    let rows: Vec<[[u32; 4]; 4]> = read_buffer(&gpu, &output, size).unwrap();
    for (index, rows) in rows.iter().enumerate() {
        let (x, y, face) = (index % SIDE, index / SIDE % SIDE, index / (SIDE * SIDE));
        let at = |texel: usize| (texel as f64 + 0.5) * 2.0 / SIDE as f64 - 1.0;
        // Seen as a camera sees it, against its layer in a cube map mirrored.
        let ray = on_face(face, -at(x), at(y));
        let (a, b) = ((LOW - EYE).as_dvec3() / ray, (HIGH - EYE).as_dvec3() / ray);
        let far = a.max(b).to_array();
        let along = far.into_iter().fold(f64::INFINITY, f64::min);
        let axis = (0..3).find(|&axis| far[axis] == along).unwrap();
        // In an edge of the box either wall is right.
        if (0..3).any(|other| other != axis && far[other] < along * (1.0 + 1e-5)) {
            continue;
        }
        let vector = |row: [u32; 4]| {
            let [x, y, z, _] = row.map(f32::from_bits);
            Vec3::new(x, y, z).as_dvec3()
        };
        assert_eq!(rows[0][3], 0, "texel {x}, {y} of face {face}: the instance");
        let position = vector(rows[0]);
        let exact = EYE.as_dvec3() + ray * along;
        assert!(
            position.distance(exact) < 1e-4,
            "texel {x}, {y} of face {face}: {position}, not {exact}"
        );
        let mut inward = DVec3::ZERO;
        inward[axis] = -ray[axis].signum();
        let normal = vector(rows[1]);
        assert!(
            normal.distance(inward) < 1e-3,
            "texel {x}, {y} of face {face}: normal {normal}"
        );
        // Solid angle times squared distance over the cosine, at borders of faces as elsewhere.
        let z = ray.abs().max_element() * along;
        let width = 2.0 / SIDE as f64;
        let cosine = -ray.dot(inward);
        let expected = width * width * z * z / cosine;
        let area = f64::from(f32::from_bits(rows[1][3]));
        assert!(
            (area / expected - 1.0).abs() < 0.15,
            "texel {x}, {y} of face {face}: area {area}, not {expected}"
        );
    }
}
