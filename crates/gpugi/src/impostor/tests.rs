//! When maps are captured, and which ones.

use std::sync::Arc;

use glam::{Mat4, Quat, Vec3, vec3};
use gpugi_scene::builtin::shapes::{cuboid, sphere};
use gpugi_scene::{Material, Scene, Volume};

use super::{ImpostorRequest, Impostors, Maps, Renew, Renewal};
use crate::capture::CaptureKernels;
use crate::gpu::{Frame, Gpu, TextureAspect, read_texture};
use crate::scene::GpuScene;
use crate::testing::test_gpu;

const SIDE: u32 = 16;
const ROOM: usize = 0;
const PILLAR: usize = 1;
const GLASS: usize = 2;

/// A pillar and an off-centre glass ball in a room.
fn scene() -> Scene {
    let mut scene = Scene::new("room");
    let glass = Material {
        transmission: 1.0,
        roughness: 0.0,
        volume: Some(Volume {
            attenuation_distance: f32::INFINITY,
            attenuation_color: Vec3::ONE,
        }),
        ..Material::default()
    };
    let grey = Material {
        double_sided: true,
        ..Material::matt("grey", Vec3::splat(0.5))
    };
    for (name, mesh, material) in [
        (
            "room",
            cuboid(Vec3::splat(-2.0), Vec3::splat(2.0), 1),
            grey.clone(),
        ),
        (
            "pillar",
            cuboid(vec3(1.0, -2.0, 0.1), vec3(1.4, 2.0, 0.5), 1),
            grey,
        ),
        ("glass", sphere(0.3, 24), glass),
    ] {
        let mesh = scene.add_mesh(mesh);
        let material = scene.add_material(material);
        scene.add_instance(name, mesh, material, Mat4::IDENTITY);
    }
    scene
}

/// A scene that changes from frame to frame, and the maps around its glass ball.
struct Watched<'a> {
    gpu: &'a Gpu,
    scene: Scene,
    on_gpu: GpuScene,
    impostors: Impostors,
    wanted: ImpostorRequest,
}

/// What one frame did.
struct Done {
    maps: Maps,
    /// Number of faces to relight.
    renewed: u32,
    /// Number of captures; `None` if the adapter cannot tell.
    captures: Option<usize>,
}

impl<'a> Watched<'a> {
    fn new(gpu: &'a Gpu, scene: Scene, renewal: Renewal) -> Self {
        let on_gpu = GpuScene::new(gpu, &scene).unwrap();
        let kernels = CaptureKernels::new(gpu, &on_gpu).unwrap();
        let wanted = ImpostorRequest {
            instances: [GLASS as u32].into(),
            side: SIDE,
            shape_side: Some(SIDE),
            reference: None,
            layers: 1,
            renewal,
        };
        Self {
            gpu,
            impostors: Impostors::new(gpu, &on_gpu, &kernels).unwrap(),
            scene,
            on_gpu,
            wanted,
        }
    }

    fn frame(&mut self) -> Done {
        let mut frame = Frame::new(self.gpu, true);
        self.on_gpu.merge(&mut frame);
        self.impostors.begin_frame();
        let (scene, wanted) = (&self.on_gpu, &self.wanted);
        let maps = self
            .impostors
            .renew(&mut frame, scene, wanted, 0, 0)
            .unwrap();
        let maps = maps.0.clone();
        let timings = frame.submit().unwrap().wait().unwrap();
        let captures = timings
            .iter()
            .filter(|timing| timing.pass == "capture.hits");
        let count = maps.renewed.as_ref().map_or(0, |points| points.count);
        Done {
            renewed: count / (SIDE * SIDE),
            captures: self.gpu.has_timestamps.then(|| captures.count()),
            maps,
        }
    }

    fn after(&mut self, change: impl FnOnce(&mut Scene)) -> Done {
        change(&mut self.scene);
        self.on_gpu.update(self.gpu, &self.scene).unwrap();
        self.frame()
    }

    /// One frame, after an instance moved by `way`.
    fn after_step(&mut self, instance: usize, way: Vec3) -> Done {
        self.after(|scene| {
            let matrix = &mut scene.instances[instance].world_from_mesh;
            *matrix = Mat4::from_translation(way) * *matrix;
        })
    }

    fn distances(&self, maps: &Maps) -> [Vec<f32>; 6] {
        let texture = &maps.distances;
        [0, 1, 2, 3, 4, 5]
            .map(|face| read_texture(self.gpu, texture, TextureAspect::All, face, 0).unwrap())
    }
}

impl Done {
    #[track_caller]
    fn expect(&self, what: &str, renewed: u32, captures: usize) {
        assert_eq!(self.renewed, renewed, "{what}: faces to light");
        assert_eq!(
            self.captures.unwrap_or(captures),
            captures,
            "{what}: captures"
        );
    }
}

fn renewal(frames: u32, threshold: f32, faces: u32) -> Renewal {
    Renewal {
        renew: Renew::Changed(frames),
        threshold,
        faces,
    }
}

#[test]
fn maps_are_captured_when_what_they_show_changes() {
    let Some(gpu) = test_gpu() else { return };
    let mut world = Watched::new(&gpu, scene(), Renewal::default());
    let step = Vec3::X * 0.1;
    world.frame().expect("the first frame", 6, 2);
    world.frame().expect("nothing", 0, 0);
    let brighter = |scene: &mut Scene| {
        scene.lights.push(gpugi_scene::Light::new(
            "light",
            gpugi_scene::LightKind::Point,
            Vec3::ONE,
        ))
    };
    world.after(brighter).expect("a light", 6, 0);
    world
        .after_step(PILLAR, step)
        .expect("the pillar moved", 6, 1);
    world
        .after_step(GLASS, step)
        .expect("the glass moved", 6, 1);
    let turn = |scene: &mut Scene| {
        let matrix = &mut scene.instances[GLASS].world_from_mesh;
        *matrix *= Mat4::from_quat(Quat::from_rotation_z(0.4));
    };
    let turned = world.after(turn);
    turned.expect("the glass turned", 6, 0);
    let angle = turned.maps.world_from_shape.to_scaled_axis().z;
    assert!((angle - 0.4).abs() < 1e-5, "{angle}");
    let widen = |scene: &mut Scene| {
        scene.instances[GLASS].world_from_mesh *= Mat4::from_scale(vec3(1.0, 1.2, 1.0));
    };
    let widened = world.after(widen);
    widened.expect("the glass is another shape", 6, 1);
    assert_eq!(widened.maps.world_from_shape, Quat::IDENTITY);
    let bend = |instance: usize| {
        move |scene: &mut Scene| {
            let mesh = scene.instances[instance].mesh;
            for position in &mut Arc::make_mut(&mut scene.meshes[mesh]).positions {
                position.y *= 0.9;
            }
        }
    };
    world.after(bend(PILLAR)).expect("the pillar bent", 6, 1);
    world.after(bend(GLASS)).expect("the glass bent", 6, 1);
    let thinner = |scene: &mut Scene| scene.materials[GLASS].ior = 1.3;
    world.after(thinner).expect("a material changed", 6, 2);
    world.on_gpu.invalidate_geometry();
    world.frame().expect("as if all moved", 6, 1);
    world.on_gpu.invalidate();
    world.frame().expect("as if all were others", 6, 2);
    world.frame().expect("nothing more", 0, 0);
}

#[test]
fn short_ways_leave_the_surroundings_as_they_are() {
    let Some(gpu) = test_gpu() else { return };
    let mut world = Watched::new(&gpu, scene(), renewal(1, 0.25, 6));
    let first = world.frame().maps;
    let step = Vec3::X * 0.1;
    for _ in 0..2 {
        let near = world.after_step(GLASS, step);
        near.expect("a short way", 0, 0);
        assert_eq!(near.maps.reference, first.reference);
        assert_ne!(near.maps.center, first.center);
    }
    let other = world.after_step(PILLAR, step);
    other.expect("another object", 6, 1);
    assert_eq!(other.maps.reference, first.reference);
    let far = world.after_step(GLASS, step);
    far.expect("a long way", 6, 1);
    assert_eq!(far.maps.reference, far.maps.center);
    // With a given reference point, the object's own motion counts all the same; what is seen from the point stays.
    world.wanted.reference = Some(Vec3::ZERO);
    world.frame().expect("another point", 6, 2);
    for faces in [0, 0, 6, 0] {
        world
            .after_step(GLASS, step)
            .expect("a given point", faces, 0);
    }
}

#[test]
fn renewals_wait_for_their_frame() {
    let Some(gpu) = test_gpu() else { return };
    let mut world = Watched::new(&gpu, scene(), renewal(3, 0.0, 6));
    world.frame().expect("the first frame", 6, 2);
    for number in 1..8 {
        let due = if number % 3 == 0 { [6, 1] } else { [0, 0] };
        let done = world.after_step(PILLAR, Vec3::X * 0.05);
        done.expect(&format!("frame {number}"), due[0], due[1] as usize);
    }
    world.frame().expect("what was left", 0, 0);
    world.frame().expect("what was left", 6, 1);
    for _ in 0..6 {
        world.frame().expect("nothing", 0, 0);
    }
    // Changed objects are renewed at once.
    let darker = |scene: &mut Scene| scene.materials[ROOM].base_color.x = 0.1;
    world.after(darker).expect("a material", 6, 2);
    let leave = |scene: &mut Scene| scene.instances[PILLAR].mesh = 2;
    world.after(leave).expect("another mesh", 6, 2);
    // `EveryFrame` renews in every frame.
    world.wanted.renewal.renew = Renew::EveryFrame;
    for captures in [2, 0, 0] {
        world.frame().expect("every frame", 6, captures);
    }
}

#[test]
fn faces_in_turn_end_as_all_at_once() {
    let Some(gpu) = test_gpu() else { return };
    for (at_once, turns) in [(1, [1; 6].as_slice()), (2, &[2; 3]), (4, &[4, 2])] {
        let mut world = Watched::new(&gpu, scene(), renewal(1, 0.0, at_once));
        let first = world.frame();
        first.expect("the first frame", 6, 2);
        let before = world.distances(&first.maps);
        let step = vec3(-0.2, 0.0, -0.3);
        let mut done = world.after_step(PILLAR, step);
        let mut renewed = 0;
        let mut fresh = Watched::new(&gpu, world.scene.clone(), Renewal::default());
        let maps = fresh.frame().maps;
        let expected = fresh.distances(&maps);
        assert_ne!(before, expected);
        for (number, &count) in turns.iter().enumerate() {
            if number > 0 {
                done = world.frame();
            }
            done.expect(&format!("turn {number} of {at_once}"), count, 1);
            renewed += count as usize;
            let found = world.distances(&done.maps);
            for face in 0..6 {
                let of = if face < renewed { &expected } else { &before };
                assert!(found[face] == of[face], "face {face} after {renewed}");
            }
        }
        world.frame().expect("after all turns", 0, 0);
        // From another point, all faces change.
        let moved = world.after_step(GLASS, step);
        moved.expect("the glass moved", 6, 1);
        let brighter = |scene: &mut Scene| {
            scene.lights.push(gpugi_scene::Light::new(
                "light",
                gpugi_scene::LightKind::Point,
                Vec3::ONE,
            ))
        };
        world.after(brighter).expect("a light", at_once, 0);
    }
}

/// All writes to buffers precede the frame's passes, so the shapes of one frame must not share their view.
#[test]
fn shapes_of_one_frame_are_those_of_frames_of_their_own() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = scene();
    let glass = scene.instances[GLASS].clone();
    let other =
        Mat4::from_translation(vec3(-1.0, 0.4, 0.7)) * Mat4::from_scale(vec3(2.0, 1.0, 1.5));
    scene.add_instance("other", glass.mesh, glass.material, other);
    let on_gpu = |scene| GpuScene::new(&gpu, scene).unwrap();
    let shapes = |per_frame: &[&[u32]]| -> Vec<Vec<f32>> {
        let mut on_gpu = on_gpu(&scene);
        let kernels = CaptureKernels::new(&gpu, &on_gpu).unwrap();
        let mut impostors = Impostors::new(&gpu, &on_gpu, &kernels).unwrap();
        let mut maps = Vec::new();
        for &instances in per_frame {
            let mut frame = Frame::new(&gpu, false);
            on_gpu.merge(&mut frame);
            impostors.begin_frame();
            for &instance in instances {
                let wanted = ImpostorRequest {
                    instances: [instance].into(),
                    side: SIDE,
                    shape_side: Some(SIDE),
                    reference: None,
                    layers: 1,
                    renewal: Renewal::default(),
                };
                let (of, _) = impostors.renew(&mut frame, &on_gpu, &wanted, 0, 0).unwrap();
                maps.push(of.shape.clone());
            }
            frame.submit().unwrap();
        }
        let faces = |texture| (0..6).map(move |face| (texture, face));
        let read = |(texture, face)| -> Vec<f32> {
            read_texture(&gpu, texture, TextureAspect::All, face, 0).unwrap()
        };
        let all = |texture| faces(texture).flat_map(read).collect();
        maps.iter().map(all).collect()
    };
    let (ball, other) = (GLASS as u32, scene.instances.len() as u32 - 1);
    let together = shapes(&[&[ball, other]]);
    assert_eq!(together, shapes(&[&[ball], &[other]]));
    assert_ne!(together[0], together[1]);
}
