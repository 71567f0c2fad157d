//! Velocities of a film, against the transforms of what has moved.

use glam::{Mat4, Vec2, Vec3, Vec4};
use gpugi_scene::builtin::builtin;
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{Camera, Instance, Material, Projection, Scene};
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

/// How far away is what every mirror shows [m].
const MIRRORED: f32 = 3.0;

/// What the second of two frames knows of each pixel that sees a surface.
struct Seen {
    shots: [Shot; 2],
    pixels: Vec<(VisiblePoint, [u32; 4])>,
}

impl Seen {
    /// The instance `index` is at one of `places` in each frame; the camera moves and turns between them.
    fn new(
        gpu: &Gpu,
        scene: &Scene,
        mut camera: Camera,
        index: usize,
        places: [Mat4; 2],
        jitters: [Vec2; 2],
    ) -> Self {
        let mut on_gpu = GpuScene::new(gpu, scene).unwrap();
        on_gpu.keep_vertices(gpu).unwrap();
        let kernels = CaptureKernels::new(gpu, &on_gpu).unwrap();
        let mut capture = Capture::of_camera(gpu, &kernels, SIZE).unwrap();
        let target = Target::of_pixels(gpu, capture.points.count).unwrap();
        let count = (SIZE[0] * SIZE[1]) as usize;
        gpu.write(&target.mirrored, 0, &vec![MIRRORED; count]);
        let receiver = Receiver::new(&capture.points, &target);
        let strips = [Strip {
            receiver: &receiver,
            rows: 0..SIZE[1],
            samples: 1,
        }];
        let effects = Effects::of_live_view();
        let mut picture = Picture::new(gpu, SIZE).unwrap();
        let shots = [0, 1].map(|time| {
            let edit = Edit::Instance {
                index,
                world_from_mesh: places[time],
            };
            on_gpu.edit(gpu, &[edit]).unwrap();
            let view = View::new(&camera, SIZE, jitters[time], 0, 0, on_gpu.diagonal());
            let mut frame = Frame::new(gpu, false);
            on_gpu.merge(&mut frame);
            capture
                .record(&mut frame, &on_gpu, &view, |draw| draw.seen)
                .unwrap();
            let shot = Shot::new(&view, &camera, SIZE, &on_gpu);
            let lit = Lit {
                shot,
                ..lit(&strips, 1)
            };
            picture
                .prepare(gpu, &on_gpu, (&camera, false), &effects)
                .unwrap();
            picture.advance();
            picture
                .record(&mut frame, &on_gpu, lit, Shown::Picture, &effects)
                .unwrap();
            frame.submit().unwrap();
            camera.world_from_view = camera.world_from_view
                * Mat4::from_translation(Vec3::new(0.05, 0.02, -0.04))
                * Mat4::from_rotation_y(0.01);
            shot
        });
        let (film, _) = picture.live.as_ref().unwrap();
        let motion = film.motion.texture();
        let motion: Vec<[u32; 4]> =
            read_texture(gpu, motion, wgpu::TextureAspect::All, 0, 0).unwrap();
        let bytes = motion.len() as u64 * crate::capture::SURFACE_POINT_BYTES;
        let points: Vec<u32> = read_buffer(gpu, &capture.points.points, bytes).unwrap();
        let points = points.chunks_exact(12).map(VisiblePoint::unpack);
        let pixels = points.zip(motion);
        let pixels = pixels.filter_map(|(point, motion)| Some((point?, motion)));
        Self {
            shots,
            pixels: pixels.collect(),
        }
    }

    /// Velocity of what is `now` at one place and was `before` at another.
    fn velocity(&self, before: Vec3, now: Vec3) -> Vec2 {
        let [then, now] = [(self.shots[0], before), (self.shots[1], now)].map(|(shot, at)| {
            let on_film = shot.film_from_world * at.extend(1.0);
            Vec2::new(on_film.x, on_film.y) / on_film.w
        });
        now - then
    }
}

/// The camera moves and turns, a box flies and turns, everything else rests.
#[test]
fn velocities_are_those_of_camera_and_objects() {
    let gpu = gpu!();
    let scene = builtin("room", 1).unwrap();
    let is_box = |instance: &Instance| instance.name.as_str() == "box";
    let index = scene.instances.iter().position(is_box).unwrap();
    let rest = scene.instances[index].world_from_mesh;
    let moved =
        Mat4::from_translation(Vec3::new(0.06, 0.04, -0.03)) * Mat4::from_rotation_y(0.05) * rest;
    let camera = scene.cameras[0].clone();
    let jitters = [Vec2::ZERO, Vec2::new(0.3, -0.2)];
    let seen = Seen::new(&gpu, &scene, camera, index, [rest, moved], jitters);
    let (mut of_box, mut fastest) = (0, 0.0_f32);
    for (point, motion) in &seen.pixels {
        let is_box = point.instance as usize == index;
        of_box += u32::from(is_box);
        let before = match is_box {
            true => (rest * moved.inverse()).transform_point3(point.position),
            false => point.position,
        };
        let expected = seen.velocity(before, point.position);
        let found = halves(motion[0]);
        assert!(
            (found - expected).length() < 2e-3 * expected.length() + 4e-3,
            "{found}, not {expected}"
        );
        fastest = expected.length().max(fastest);
    }
    assert!(of_box > 100 && fastest > 1.0, "{of_box}, {fastest}");
}

/// Centre of the ball of radius 1 in `mirrors`.
const CENTER: Vec3 = Vec3::new(-0.7, 1.0, 0.0);

/// A ball of chrome on a mirror.
fn mirrors() -> Scene {
    let mut scene = Scene::new("mirrors");
    let chrome = scene.add_material(Material::metal("chrome", Vec3::splat(0.9), 0.0));
    let corner = Vec3::new(-4.0, 0.0, 4.0);
    let floor = quad(corner, Vec3::X * 8.0, Vec3::NEG_Z * 8.0, 1);
    let places = [Mat4::IDENTITY, Mat4::from_translation(CENTER)];
    for (mesh, place) in [floor, sphere(1.0, 64)].into_iter().zip(places) {
        let mesh = scene.add_mesh(mesh);
        scene.add_instance("", mesh, chrome, place);
    }
    scene
}

fn above() -> Camera {
    Camera::look_at("", Vec3::new(0.3, 1.6, 3.2), Vec3::new(-0.2, 0.6, 0.0), 0.9)
}

/// The ball flies, the camera moves and turns: images lie where paths by way of the mirror are shortest, as in the mirrored
/// space behind a plane.
#[test]
fn images_in_mirrors_move_as_light_is_reflected() {
    let gpu = gpu!();
    let flight = Vec3::new(0.02, 0.03, -0.01);
    let places = [CENTER - flight, CENTER].map(Mat4::from_translation);
    let parallel = Camera {
        projection: Projection::Orthographic { height: 3.0 },
        ..above()
    };
    for camera in [above(), parallel] {
        let seen = Seen::new(&gpu, &mirrors(), camera, 1, places, [Vec2::ZERO; 2]);
        let [eye_before, eye] = seen.shots.map(|shot| shot.eye);
        let toward = |eye: Vec4, at: Vec3| (eye.truncate() - at * eye.w).normalize();
        let mut counts = [[0; 2]; 2];
        for (point, motion) in &seen.pixels {
            let is_ball = point.instance == 1;
            let normal = match is_ball {
                true => (point.position - CENTER).normalize(),
                false => Vec3::Y,
            };
            let ray = -toward(eye, point.position);
            // Where rays graze the ball, the iteration below does not converge.
            if is_ball && ray.dot(normal) > -0.4 {
                continue;
            }
            let q = point.position + MIRRORED * (ray - 2.0 * ray.dot(normal) * normal);
            let before = if is_ball {
                // The normal halves the angle between the ways to the eye and to what is mirrored.
                let center = CENTER - flight;
                (0..64).fold(normal, |n, _| {
                    let at = center + n;
                    (toward(eye_before, at) + (q - at).normalize()).normalize()
                }) + center
            } else {
                let image = q * Vec3::new(1.0, -1.0, 1.0);
                let way = toward(eye_before, image);
                image - way * (image.y / way.y)
            };
            let expected = seen.velocity(before, point.position);
            let error = (halves(motion[3]) - expected).length();
            let [all, right] = &mut counts[usize::from(is_ball)];
            *all += 1;
            *right += usize::from(error < 0.02 * expected.length() + 0.05);
        }
        println!("floor, ball: {counts:?}");
        for [all, right] in counts {
            assert!(all > 300 && right * 100 >= all * 99, "{right} of {all}");
        }
    }
}

/// Where a mirror that turns showed the same is not known.
#[test]
fn mirrors_that_turn_have_no_images() {
    let gpu = gpu!();
    let places =
        [0.0, 0.01].map(|angle| Mat4::from_translation(CENTER) * Mat4::from_rotation_y(angle));
    let seen = Seen::new(&gpu, &mirrors(), above(), 1, places, [Vec2::ZERO; 2]);
    for (point, motion) in seen.pixels {
        assert!(point.instance != 1 || motion[3] == u32::MAX);
    }
}
