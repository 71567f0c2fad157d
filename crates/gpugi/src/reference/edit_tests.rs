//! A path tracer that follows edits shows what one that was made for the edited scene shows.

use std::ops::ControlFlow;

use glam::{Mat4, Quat, Vec3, vec3};
use gpugi_scene::builtin::builtin;
use gpugi_scene::{Camera, Document, Edit, Environment, Scene};

use super::{PathTracer, Settings};
use crate::gpu::Gpu;
use crate::testing::test_gpu;

const SIZE: [u32; 2] = [24, 18];
/// So few that each makes a pass of its own: then sums are rounded alike.
const SAMPLES: u32 = 4;

/// A room with a lamp, a spot and a point, a mirror and glass, and photons. The sky shines in where a wall is missing.
fn room() -> Scene {
    let mut scene = builtin("glass-room", 1).unwrap();
    let wall = index(&scene, "front wall");
    scene.instances.remove(wall);
    scene.environment = Some(Environment::default_sky());
    scene
}

fn index(scene: &Scene, name: &str) -> usize {
    let mut instances = scene.instances.iter();
    instances
        .position(|instance| instance.name == *name)
        .unwrap()
}

fn shift(scene: &mut Scene, name: &str, by: Vec3) {
    let index = index(scene, name);
    let place = &mut scene.instances[index].world_from_mesh;
    *place = Mat4::from_translation(by) * *place;
}

/// Scales the mesh of an instance, which nobody else has.
fn deform(scene: &mut Scene, name: &str, by: Vec3) {
    let instance = index(scene, name);
    let mesh = scene.instances[instance].mesh;
    let deformed = std::sync::Arc::make_mut(&mut scene.meshes[mesh]);
    let center = deformed.bounds().center();
    for position in &mut deformed.positions {
        *position = center + (*position - center) * by;
    }
}

fn picture(tracer: &mut PathTracer, camera: &Camera) -> Vec<f32> {
    let go_on = &mut |_: &super::Progress| ControlFlow::Continue(());
    let progress = tracer.render(camera, SAMPLES, go_on).unwrap();
    assert_eq!(progress.samples, SAMPLES);
    tracer.radiance().unwrap()
}

fn new(gpu: &Gpu, scene: &Scene) -> PathTracer {
    PathTracer::new(gpu, scene, SIZE, &Settings::default()).unwrap()
}

/// Mean of (a - b)^2 / (b^2 + 0.01).
fn rel_mse(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let pairs = a.iter().zip(b);
    let squares = pairs.map(|(a, b)| (a - b).powi(2) / (b * b + 0.01));
    squares.sum::<f32>() / b.len() as f32
}

/// An edit, and what it is called.
type Step = (&'static str, fn(&mut Scene));

#[test]
fn edits_show_what_a_new_path_tracer_shows() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = room();
    let mut tracer = new(&gpu, &scene);
    let bound = tracer.scene().ray_bind_group.clone();
    let steps: [Step; 9] = [
        ("a light that moves and becomes brighter", |scene| {
            scene.lights[1].world_from_light.w_axis.x -= 0.8;
            scene.lights[1].intensity *= 3.0;
        }),
        ("a light that goes out", |scene| {
            scene.lights[0].intensity = Vec3::ZERO;
        }),
        ("a lamp that moves", |scene| {
            shift(scene, "lamp", vec3(-0.5, -0.3, 0.4));
        }),
        ("a lamp that deforms", |scene| {
            deform(scene, "lamp", vec3(0.6, 1.0, 1.5));
        }),
        ("glass that deforms", |scene| {
            deform(scene, "ball", vec3(1.3, 0.8, 1.1));
        }),
        ("glass that moves, around the eye", |scene| {
            let eye = scene.cameras[0].world_from_view.w_axis.truncate();
            let index = index(scene, "ball");
            let turned = Mat4::from_quat(Quat::from_rotation_z(0.3));
            scene.instances[index].world_from_mesh = Mat4::from_translation(eye) * turned;
        }),
        ("a matt material that mirrors", |scene| {
            let material = scene.instances[0].material;
            scene.materials[material].base_color = vec3(0.9, 0.3, 0.2).extend(1.0);
            scene.materials[material].roughness = 0.0;
            scene.materials[material].metallic = 1.0;
        }),
        ("a box that lights", |scene| {
            let material = scene.instances[index(scene, "ball")].material;
            scene.materials[material].volume = None;
            let material = scene.instances[0].material;
            scene.materials[material].emissive = Vec3::splat(0.3);
        }),
        ("a sky that turns and fades", |scene| {
            let sky = scene.environment.as_mut().unwrap();
            (sky.rotation, sky.intensity) = (glam::Quat::from_rotation_y(1.3), 0.4);
        }),
    ];
    let camera = scene.cameras[0].clone();
    let mut before = picture(&mut tracer, &camera);
    for (what, edit) in steps {
        edit(&mut scene);
        // Work for the scene before is still on its way.
        tracer.try_render(&camera, SAMPLES, 1 << 14).unwrap();
        assert!(tracer.update(&scene).unwrap(), "{what}");
        assert_eq!(tracer.scene().ray_bind_group, bound, "{what}: an upload");
        let found = picture(&mut tracer, &camera);
        let error = rel_mse(&found, &picture(&mut new(&gpu, &scene), &camera));
        let change = rel_mse(&found, &before);
        println!("{what}: rel-mse {error:.1e}, changes {change:.1e}");
        assert!(error == 0.0 && change > 1e-4, "{what}");
        before = found;
    }
}

#[test]
fn other_sizes_show_what_a_new_path_tracer_shows() {
    let Some(gpu) = test_gpu() else { return };
    let scene = room();
    let camera = &scene.cameras[0];
    let mut tracer = new(&gpu, &scene);
    for size in [[9, 5], [70, 40], SIZE] {
        tracer.try_render(camera, SAMPLES, 1 << 14).unwrap();
        tracer.resize(size).unwrap();
        let mut expected = PathTracer::new(&gpu, &scene, size, &Settings::default()).unwrap();
        let expected = picture(&mut expected, camera);
        assert_eq!(expected.len(), (size[0] * size[1] * 3) as usize);
        assert!(picture(&mut tracer, camera) == expected, "{size:?}");
    }
    assert!(tracer.resize([0, 5]).is_err());
}

#[test]
fn what_takes_an_upload_or_other_kernels_is_not_followed() {
    let Some(gpu) = test_gpu() else { return };
    let edits: [Step; 4] = [
        ("fewer triangles", |scene| {
            let mut mesh = scene.meshes[0].as_ref().clone();
            mesh.indices.truncate(3);
            scene.meshes[0] = mesh.into();
        }),
        ("another sky", |scene| {
            scene.environment = Some(Environment::default_sky());
        }),
        ("glass", |scene| scene.materials[0].transmission = 1.0),
        ("the first lights", |scene| {
            scene.lights[0].intensity = Vec3::ONE;
        }),
    ];
    let mut scene = room();
    scene
        .lights
        .iter_mut()
        .for_each(|light| light.intensity = Vec3::ZERO);
    let lamp = scene.instances[index(&scene, "lamp")].material;
    scene.materials[lamp].emissive = Vec3::ZERO;
    for (what, edit) in edits {
        let mut tracer = new(&gpu, &scene);
        let mut edited = scene.clone();
        edit(&mut edited);
        assert!(!tracer.update(&edited).unwrap(), "{what}");
    }
    let mut broken = scene.clone();
    broken.lights[0].intensity.x = f32::NAN;
    assert!(new(&gpu, &scene).update(&broken).is_err());
}

/// Who could not follow one edit follows later ones, if the scene is one to be followed again.
#[test]
fn what_was_not_followed_is_made_up_for() {
    let Some(gpu) = test_gpu() else { return };
    let scene = room();
    let mut tracer = new(&gpu, &scene);
    let plain = Box::new(scene.materials[0].clone());
    let mut glass = plain.clone();
    glass.transmission = 1.0;
    let mut light = scene.lights[1].clone();
    light.intensity *= 3.0;
    let camera = scene.cameras[0].clone();
    let mut document = Document::new(scene);
    let material = |material| Edit::Material { index: 0, material };
    document.edit(&[material(glass), Edit::Light { index: 1, light }]);
    assert!(!tracer.edit(&document.since(0)).unwrap());
    document.edit(&[material(plain)]);
    assert!(tracer.edit(&document.since(0)).unwrap());
    let expected = picture(&mut new(&gpu, document.scene()), &camera);
    assert!(picture(&mut tracer, &camera) == expected);
}
