//! What a cube's faces see, against rays in a box.

use glam::{DVec3, Mat4, Vec3};
use gpugi_scene::builtin::shapes;
use gpugi_scene::{AlphaMode, Material, Scene};

use crate::capture::{Behind, Capture, CaptureKernels, CubeView, SurfacePoints};
use crate::gpu::{Frame, Gpu, Kernel, read_buffer};
use crate::scene::{Draw, DrawClass, GpuScene};
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

/// Instance and position of every point.
fn read_points(gpu: &Gpu, scene: &GpuScene, points: &SurfacePoints) -> Vec<(u32, DVec3)> {
    let kernel = Kernel::new(gpu, &shader!("testing.points"), "main", Some(&scene.layout)).unwrap();
    let size = u64::from(points.count) * 64;
    let output = gpu
        .buffer("output", size, wgpu::BufferUsages::STORAGE)
        .unwrap();
    let resources = [
        ("points", points.points.as_entire_binding()),
        ("output", output.as_entire_binding()),
    ];
    let group = kernel.bind(gpu, 1, &resources).unwrap();
    let mut frame = Frame::new(gpu, false);
    frame.compute("points", |pass| {
        let groups = [(0, &scene.bind_group), (1, &group)];
        kernel.dispatch(pass, &groups, [points.count, 1, 1]);
    });
    frame.submit().unwrap();
    let rows: Vec<[[u32; 4]; 4]> = read_buffer(gpu, &output, size).unwrap();
    rows.iter()
        .map(|[[x, y, z, instance], ..]| {
            let position = Vec3::from_array([*x, *y, *z].map(f32::from_bits));
            (*instance, position.as_dvec3())
        })
        .collect()
}

/// Behind a crate, a pane and a flush plate in a room is the wall; behind the wall, nothing, and it stays.
#[test]
fn what_is_behind_is_seen_behind() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("box");
    let grey = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
    let see_through = scene.add_material(Material {
        alpha_mode: AlphaMode::Mask { cutoff: 0.5 },
        double_sided: true,
        ..Material::matt("pane", Vec3::splat(0.5))
    });
    let wall = scene.add_mesh(shapes::cuboid(HIGH, LOW, 1));
    scene.add_instance("room", wall, grey, Mat4::IDENTITY);
    let low = EYE + Vec3::new(0.4, -0.3, -0.3);
    let high = EYE + Vec3::new(0.7, 0.2, 0.3);
    let crate_mesh = scene.add_mesh(shapes::cuboid(low, high, 1));
    scene.add_instance("crate", crate_mesh, grey, Mat4::IDENTITY);
    let corner = EYE + Vec3::new(-0.5, -0.5, -0.5);
    let pane = scene.add_mesh(shapes::quad(corner, Vec3::Z, Vec3::Y, 1));
    scene.add_instance("pane", pane, see_through, Mat4::IDENTITY);
    // As good as in the wall's plane.
    let corner = Vec3::new(-0.5, -0.5, LOW.z + 1e-4);
    let plate = scene.add_mesh(shapes::quad(corner, Vec3::X, Vec3::Y, 1));
    scene.add_instance("plate", plate, grey, Mat4::IDENTITY);
    let mut on_gpu = GpuScene::new(&gpu, &scene).unwrap();
    let kernels = CaptureKernels::new(&gpu, &on_gpu).unwrap();
    let mut capture = Capture::of_cube(&gpu, &kernels, SIDE as u32).unwrap();
    let behind = Behind::new(&gpu, &on_gpu, &capture).unwrap();
    let view = CubeView::new(EYE, SIDE as u32, 1e-3, 0, 1);
    let mut frame = Frame::new(&gpu, false);
    on_gpu.merge(&mut frame);
    let class_of = |draw: &Draw| Some(draw.seen);
    let all = capture.all_faces();
    capture
        .record_cube(&mut frame, &on_gpu, &view, class_of)
        .unwrap();
    behind
        .record(&mut frame, &on_gpu, &capture, &view, &all, class_of)
        .unwrap();
    frame.submit().unwrap();
    let first = read_points(&gpu, &on_gpu, &capture.points);
    let second = read_points(&gpu, &on_gpu, &behind.points(&capture.points));
    let mut counts = [0; 4];
    for (index, ((nearer, at), (further, behind))) in first.iter().zip(&second).enumerate() {
        counts[*nearer as usize] += 1;
        let is_wall = *nearer == 0 || *nearer == 3;
        if is_wall {
            assert_eq!((nearer, at), (further, behind), "texel {index}");
            continue;
        }
        assert!(*further == 0 || *further == 3, "texel {index}: {further}");
        let (at, behind) = (*at - EYE.as_dvec3(), *behind - EYE.as_dvec3());
        assert!(
            behind.normalize().distance(at.normalize()) < 1e-4 && behind.length() > at.length(),
            "texel {index}: {behind} behind {at}"
        );
    }
    assert!(counts.iter().all(|&count| count > 50), "{counts:?}");
}
