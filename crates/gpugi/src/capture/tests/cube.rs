//! What a cube's faces see, compared with rays in a box.

use glam::{DVec3, Mat4, Vec3};
use gpugi_scene::builtin::shapes;
use gpugi_scene::{AlphaMode, Material, Scene};

use crate::capture::{Capture, CaptureKernels, CubeView, PeeledLayer};
use crate::gpu::Frame;
use crate::scene::{Draw, DrawClass, GpuScene};
use crate::testing::{Point, on_face, read_points, test_gpu};

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
    // Not drawn, so it must not be seen.
    scene.add_instance("hidden", mesh, material, Mat4::from_scale(Vec3::splat(0.5)));
    let mut on_gpu = GpuScene::new(&gpu, &scene).unwrap();
    let kernels = CaptureKernels::new(&gpu, &on_gpu).unwrap();
    let mut capture = Capture::of_cube(&gpu, &kernels, SIDE as u32).unwrap();
    let view = CubeView::new(EYE, SIDE as u32, 1e-3, 0, 1);
    let mut frame = Frame::new(&gpu, false);
    on_gpu.merge(&mut frame);
    capture
        .record_cube(&mut frame, &on_gpu, &view, |draw| {
            (draw.instance == 0).then_some(DrawClass::DoubleSided)
        })
        .unwrap();
    frame.submit().unwrap();
    let points = read_points(&gpu, &on_gpu, &capture.points);
    for (index, point) in points.iter().enumerate() {
        let (x, y, face) = (index % SIDE, index / SIDE % SIDE, index / (SIDE * SIDE));
        let at = |texel: usize| (texel as f64 + 0.5) * 2.0 / SIDE as f64 - 1.0;
        // As a camera sees it: mirrored relative to its layer in a cube map.
        let ray = on_face(face, -at(x), at(y));
        let (a, b) = ((LOW - EYE).as_dvec3() / ray, (HIGH - EYE).as_dvec3() / ray);
        let far = a.max(b).to_array();
        let along = far.into_iter().fold(f64::INFINITY, f64::min);
        let axis = (0..3).find(|&axis| far[axis] == along).unwrap();
        // On an edge of the box, either wall is correct.
        if (0..3).any(|other| other != axis && far[other] < along * (1.0 + 1e-5)) {
            continue;
        }
        assert_eq!(
            point.instance, 0,
            "texel {x}, {y} of face {face}: the instance"
        );
        let position = point.position.as_dvec3();
        let exact = EYE.as_dvec3() + ray * along;
        assert!(
            position.distance(exact) < 1e-4,
            "texel {x}, {y} of face {face}: {position}, not {exact}"
        );
        let mut inward = DVec3::ZERO;
        inward[axis] = -ray[axis].signum();
        let normal = point.normal.as_dvec3();
        assert!(
            normal.distance(inward) < 1e-3,
            "texel {x}, {y} of face {face}: normal {normal}"
        );
        // Solid angle times squared distance over the cosine, at the borders of faces as elsewhere.
        let z = ray.abs().max_element() * along;
        let width = 2.0 / SIDE as f64;
        let cosine = -ray.dot(inward);
        let expected = width * width * z * z / cosine;
        let area = f64::from(point.area);
        assert!(
            (area / expected - 1.0).abs() < 0.15,
            "texel {x}, {y} of face {face}: area {area}, not {expected}"
        );
    }
}

/// In a room, the wall lies behind a crate, a pane and a flush plate. Nothing lies behind the wall, so the second layer
/// repeats it.
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
    // Almost in the wall's plane.
    let corner = Vec3::new(-0.5, -0.5, LOW.z + 1e-4);
    let plate = scene.add_mesh(shapes::quad(corner, Vec3::X, Vec3::Y, 1));
    scene.add_instance("plate", plate, grey, Mat4::IDENTITY);
    let mut on_gpu = GpuScene::new(&gpu, &scene).unwrap();
    let kernels = CaptureKernels::new(&gpu, &on_gpu).unwrap();
    let mut capture = Capture::of_cube(&gpu, &kernels, SIDE as u32).unwrap();
    let behind = PeeledLayer::new(&gpu, &on_gpu, &capture).unwrap();
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
    let is_wall = |point: &Point| point.instance == 0 || point.instance == 3;
    for (index, (nearer, further)) in first.iter().zip(&second).enumerate() {
        counts[nearer.instance as usize] += 1;
        if is_wall(nearer) {
            assert_eq!(nearer.instance, further.instance, "texel {index}");
            assert_eq!(nearer.position, further.position, "texel {index}");
            continue;
        }
        assert!(is_wall(further), "texel {index}: {further:?}");
        let from_eye = |point: &Point| (point.position - EYE).as_dvec3();
        let (at, behind) = (from_eye(nearer), from_eye(further));
        assert!(
            behind.normalize().distance(at.normalize()) < 1e-4 && behind.length() > at.length(),
            "texel {index}: {behind} behind {at}"
        );
    }
    assert!(counts.iter().all(|&count| count > 50), "{counts:?}");
}
