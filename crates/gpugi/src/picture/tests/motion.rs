//! Velocities of a film, against the transforms of what has moved.

use glam::{Mat4, Vec2, Vec3};
use gpugi_scene::builtin::builtin;
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{Camera, Material, Scene};
use half::f16;

use super::*;
use crate::capture::{Capture, CaptureKernels, View, VisiblePoint};
use crate::gpu::read_texture;
use crate::scene::Edit;

const SIZE: [u32; 2] = [64, 48];

/// Both words of 16-bit floats.
fn halves(word: u32) -> Vec2 {
    let half = |bits: u32| f16::from_bits(bits as u16).to_f32();
    Vec2::new(half(word & 0xffff), half(word >> 16))
}

/// The camera moves and turns, a box flies and turns, everything else rests.
#[test]
fn velocities_are_those_of_camera_and_objects() {
    let gpu = gpu!();
    let scene = builtin("room", 1).unwrap();
    let mut instances = scene.instances.iter();
    let index = instances
        .position(|one| one.name.as_str() == "box")
        .unwrap();
    let rest = scene.instances[index].world_from_mesh;
    let moved =
        Mat4::from_translation(Vec3::new(0.06, 0.04, -0.03)) * Mat4::from_rotation_y(0.05) * rest;
    let mut on_gpu = GpuScene::new(&gpu, &scene).unwrap();
    on_gpu.keep_vertices(&gpu).unwrap();
    let kernels = CaptureKernels::new(&gpu, &on_gpu).unwrap();
    let mut capture = Capture::of_camera(&gpu, &kernels, SIZE).unwrap();
    let target = Target::new(&gpu, capture.points.count).unwrap();
    let receiver = Receiver::new(&capture.points, &target);
    let strips = [Strip {
        receiver: &receiver,
        rows: 0..SIZE[1],
    }];
    let effects = Effects::of_live_view();
    let mut picture = Picture::new(&gpu, SIZE).unwrap();
    let mut camera = scene.cameras[0].clone();
    let mut shots = Vec::new();
    for (place, jitter) in [(rest, Vec2::ZERO), (moved, Vec2::new(0.3, -0.2))] {
        let edit = Edit::Instance {
            index,
            world_from_mesh: place,
        };
        on_gpu.edit(&gpu, &[edit]).unwrap();
        let view = View::new(&camera, SIZE, jitter, 0, 0, on_gpu.diagonal());
        let mut frame = Frame::new(&gpu, false);
        on_gpu.merge(&mut frame);
        capture
            .record(&mut frame, &on_gpu, &view, |draw| draw.seen)
            .unwrap();
        let shot = Shot::new(&view, SIZE, &on_gpu);
        shots.push(shot.film_from_world);
        let lit = Lit {
            shot,
            ..lit(&strips, 1)
        };
        picture.prepare(&gpu, &on_gpu, &effects).unwrap();
        picture.advance();
        picture
            .record(&mut frame, &on_gpu, lit, Shown::Picture, &effects)
            .unwrap();
        frame.submit().unwrap();
        camera.world_from_view = camera.world_from_view
            * Mat4::from_translation(Vec3::new(0.05, 0.0, -0.04))
            * Mat4::from_rotation_y(0.01);
    }
    let (film, _) = picture.live.as_ref().unwrap();
    let motion = film.motion.texture();
    let motion: Vec<[u32; 4]> = read_texture(&gpu, motion, wgpu::TextureAspect::All, 0, 0).unwrap();
    let bytes = motion.len() as u64 * crate::capture::SURFACE_POINT_BYTES;
    let points: Vec<u32> = read_buffer(&gpu, &capture.points.points, bytes).unwrap();
    let (mut of_box, mut fastest) = (0, 0.0_f32);
    for (point, motion) in points.chunks_exact(12).zip(motion) {
        let Some(point) = VisiblePoint::unpack(point) else {
            continue;
        };
        let is_box = point.instance as usize == index;
        of_box += u32::from(is_box);
        let before = match is_box {
            true => (rest * moved.inverse()).transform_point3(point.position),
            false => point.position,
        };
        let [then, now] = [(shots[0], before), (shots[1], point.position)].map(|(shot, at)| {
            let on_film = shot * at.extend(1.0);
            Vec2::new(on_film.x, on_film.y) / on_film.w
        });
        let (expected, found) = (now - then, halves(motion[0]));
        assert!(
            (found - expected).length() < 2e-3 * expected.length() + 4e-3,
            "{found}, not {expected}"
        );
        fastest = expected.length().max(fastest);
    }
    assert!(of_box > 100 && fastest > 1.0, "{of_box}, {fastest}");
}

/// How far away is what every mirror shows.
const MIRRORED: f32 = 3.0;

/// A ball of chrome, which flies, on a mirror, seen by a camera that moves and turns: images lie where paths by way of the
/// mirror are shortest, as in the mirrored space behind a plane.
#[test]
fn images_in_mirrors_move_as_light_is_reflected() {
    let gpu = gpu!();
    let mut scene = Scene::new("mirrors");
    let chrome = scene.add_material(Material::metal("chrome", Vec3::splat(0.9), 0.0));
    let around = Vec3::new(-0.7, 1.0, 0.0);
    let floor = quad(
        Vec3::new(-4.0, 0.0, 4.0),
        Vec3::X * 8.0,
        Vec3::NEG_Z * 8.0,
        1,
    );
    let places = [Mat4::IDENTITY, Mat4::from_translation(around)];
    for (mesh, place) in [floor, sphere(1.0, 64)].into_iter().zip(places) {
        let mesh = scene.add_mesh(mesh);
        scene.add_instance("", mesh, chrome, place);
    }
    let flight = Vec3::new(0.02, 0.03, -0.01);
    let mut on_gpu = GpuScene::new(&gpu, &scene).unwrap();
    on_gpu.keep_vertices(&gpu).unwrap();
    let kernels = CaptureKernels::new(&gpu, &on_gpu).unwrap();
    let mut capture = Capture::of_camera(&gpu, &kernels, SIZE).unwrap();
    let target = Target::of_pixels(&gpu, capture.points.count).unwrap();
    let pixels = (SIZE[0] * SIZE[1]) as usize;
    gpu.write(&target.mirrored, 0, &vec![MIRRORED; pixels]);
    let receiver = Receiver::new(&capture.points, &target);
    let strips = [Strip {
        receiver: &receiver,
        rows: 0..SIZE[1],
    }];
    let effects = Effects::of_live_view();
    let mut picture = Picture::new(&gpu, SIZE).unwrap();
    let mut camera = Camera::look_at("", Vec3::new(0.3, 1.6, 3.2), Vec3::new(-0.2, 0.6, 0.0), 0.9);
    let mut shots = Vec::new();
    for place in [around - flight, around] {
        let edit = Edit::Instance {
            index: 1,
            world_from_mesh: Mat4::from_translation(place),
        };
        on_gpu.edit(&gpu, &[edit]).unwrap();
        let view = View::new(&camera, SIZE, Vec2::ZERO, 0, 0, on_gpu.diagonal());
        let mut frame = Frame::new(&gpu, false);
        on_gpu.merge(&mut frame);
        capture
            .record(&mut frame, &on_gpu, &view, |draw| draw.seen)
            .unwrap();
        let shot = Shot::new(&view, SIZE, &on_gpu);
        shots.push(shot);
        let lit = Lit {
            shot,
            ..lit(&strips, 1)
        };
        picture.prepare(&gpu, &on_gpu, &effects).unwrap();
        picture.advance();
        picture
            .record(&mut frame, &on_gpu, lit, Shown::Picture, &effects)
            .unwrap();
        frame.submit().unwrap();
        camera.world_from_view = camera.world_from_view
            * Mat4::from_translation(Vec3::new(0.05, 0.02, -0.04))
            * Mat4::from_rotation_y(0.01);
    }
    let (film, _) = picture.live.as_ref().unwrap();
    let motion = film.motion.texture();
    let motion: Vec<[u32; 4]> = read_texture(&gpu, motion, wgpu::TextureAspect::All, 0, 0).unwrap();
    let bytes = motion.len() as u64 * crate::capture::SURFACE_POINT_BYTES;
    let points: Vec<u32> = read_buffer(&gpu, &capture.points.points, bytes).unwrap();
    let [eye_before, eye] = [shots[0].eye, shots[1].eye].map(|eye| eye.truncate());
    let on_film = |shot: &Shot, at: Vec3| {
        let place = shot.film_from_world * at.extend(1.0);
        Vec2::new(place.x, place.y) / place.w
    };
    let mut counts = [[0; 2]; 2];
    for (point, motion) in points.chunks_exact(12).zip(motion) {
        let Some(point) = VisiblePoint::unpack(point) else {
            continue;
        };
        let is_ball = point.instance == 1;
        let normal = match is_ball {
            true => (point.position - around).normalize(),
            false => Vec3::Y,
        };
        let ray = (point.position - eye).normalize();
        // Where rays graze the ball, the fixed point below is none.
        if ray.dot(normal) > -0.4 {
            continue;
        }
        let q = point.position + MIRRORED * (ray - 2.0 * ray.dot(normal) * normal);
        let before = if is_ball {
            // The normal halves the angle between the ways to the eye and to what is mirrored.
            let center = around - flight;
            (0..64).fold(normal, |n, _| {
                let at = center + n;
                let half = (eye_before - at).normalize() + (q - at).normalize();
                half.normalize()
            }) + center
        } else {
            let image = q * Vec3::new(1.0, -1.0, 1.0);
            eye_before.lerp(image, eye_before.y / (eye_before.y - image.y))
        };
        let expected = on_film(&shots[1], point.position) - on_film(&shots[0], before);
        let found = halves(motion[3]);
        let of = &mut counts[usize::from(is_ball)];
        of[0] += 1;
        let is_right = (found - expected).length() < 0.02 * expected.length() + 0.05;
        of[1] += usize::from(is_right);
    }
    let [floor, ball] = counts;
    println!("floor: {floor:?}, ball: {ball:?}");
    for [all, right] in counts {
        assert!(all > 300 && right * 100 >= all * 99, "{right} of {all}");
    }
}
