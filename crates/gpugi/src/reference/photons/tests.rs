//! The light tracer against closed forms and against the path tracer, where both can find the light.

use std::f64::consts::PI;
use std::ops::ControlFlow;

use glam::{Mat4, Vec3, vec3};
use gpugi_scene::builtin::shapes::{cuboid, quad, sphere};
use gpugi_scene::{Camera, Light, LightKind, Material, Mesh, Projection, Scene, Volume};

use crate::gpu::Gpu;
use crate::reference::{PathTracer, Settings, TILE_SIDE};
use crate::testing::test_gpu;

fn place(scene: &mut Scene, mesh: Mesh, material: Material, at: Vec3) {
    let mesh = scene.add_mesh(mesh);
    let material = scene.add_material(material);
    scene.add_instance("", mesh, material, Mat4::from_translation(at));
}

fn mirror(reflectance: f32) -> Material {
    Material::metal("mirror", Vec3::splat(reflectance), 0.0)
}

fn glass(ior: f32) -> Material {
    Material {
        transmission: 1.0,
        roughness: 0.0,
        ior,
        volume: Some(Volume {
            attenuation_distance: f32::INFINITY,
            attenuation_color: Vec3::ONE,
        }),
        ..Material::default()
    }
}

fn keeping(paths: &str) -> Settings {
    Settings {
        paths: paths.to_owned(),
        ..Settings::default()
    }
}

const BATCHES: u32 = 8;

/// The mean and the standard error of the mean radiance (all channels) over pictures with several seeds.
fn mean(
    gpu: &Gpu,
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    samples: u32,
    has_photons: bool,
) -> (f64, f64) {
    let tracer = PathTracer::with_tiles(gpu, scene, [16, 16], settings, TILE_SIDE, has_photons);
    let mut tracer = tracer.unwrap();
    assert_eq!(tracer.photons.is_some(), has_photons);
    let means: Vec<f64> = (1..=BATCHES)
        .map(|seed| {
            let radiance = picture(&mut tracer, camera, samples, seed);
            radiance.iter().copied().map(f64::from).sum::<f64>() / radiance.len() as f64
        })
        .collect();
    let count = f64::from(BATCHES);
    let mean = means.iter().sum::<f64>() / count;
    let squares: f64 = means.iter().map(|one| (one - mean).powi(2)).sum();
    (mean, (squares / (count * (count - 1.0))).sqrt())
}

fn picture(tracer: &mut PathTracer, camera: &Camera, samples: u32, seed: u32) -> Vec<f32> {
    tracer.restart(seed).unwrap();
    let mut on = |_: &_| ControlFlow::Continue(());
    tracer.render(camera, samples, &mut on).unwrap();
    tracer.radiance().unwrap()
}

fn from_above(side: f32, eye: f32) -> Camera {
    Camera {
        projection: Projection::Orthographic { height: side },
        ..Camera::look_at("", Vec3::Y * eye, Vec3::ZERO, 1.0)
    }
}

/// A floor of albedo 0.5 with an object.
fn on_floor(mesh: Mesh, material: Material, at: Vec3) -> Scene {
    let mut scene = Scene::new("floor");
    let floor = quad(vec3(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0, 1);
    let grey = Material::matt("grey", Vec3::splat(0.5));
    place(&mut scene, floor, grey, Vec3::ZERO);
    place(&mut scene, mesh, material, at);
    scene
}

/// A mirror stands at x = 1; by reflection, a point at x = 0 seems to shine from x = 2.
#[test]
fn a_plane_mirror_shows_a_second_light() {
    let Some(gpu) = test_gpu() else { return };
    let stands = quad(vec3(1.0, 0.0, -3.0), Vec3::Z * 6.0, Vec3::Y * 6.0, 1);
    let scene = |kind, from: Vec3| {
        let mut scene = on_floor(stands.clone(), mirror(0.8), Vec3::ZERO);
        let light = Light::new("", kind, Vec3::splat(3.0)).aimed(from, vec3(1.0, 1.0, 0.0));
        scene.lights.push(light);
        scene
    };
    let spot = LightKind::Spot {
        inner_cone_angle: 1.4,
        outer_cone_angle: 1.5,
    };
    let point_of_floor = |i: u32, j: u32| {
        let along = |k: u32| (f64::from(k) + 0.5) / 64.0 - 0.5;
        (along(i), along(j))
    };
    // Irradiance of the square of 1 m around the origin, by the light at (2, 1, 0) or from the direction (1, 1, 0).
    let mut of_point = 0.0;
    for (x, z) in (0..64 * 64).map(|at| point_of_floor(at % 64, at / 64)) {
        let d2 = (2.0 - x).powi(2) + 1.0 + z * z;
        of_point += 3.0 / (d2 * d2.sqrt()) / 4096.0;
    }
    for (kind, from, irradiance) in [
        (LightKind::Point, vec3(0.0, 1.0, 0.0), of_point),
        (spot, vec3(0.0, 1.0, 0.0), of_point),
        (LightKind::Directional, vec3(0.0, 2.0, 0.0), 3.0 * 0.5_f64.sqrt()),
    ] {
        let scene = scene(kind, from);
        for camera in [from_above(1.0, 5.0), {
            let tangent = 0.1_f32;
            Camera::look_at("", Vec3::Y * 5.0, Vec3::ZERO, 2.0 * tangent.atan())
        }] {
            let expected = 0.8 * irradiance * 0.5 / PI;
            let (value, error) = mean(&gpu, &scene, &camera, &keeping("LSDE"), 32, true);
            println!("{kind:?}: {value}, expected {expected}, error {error}");
            assert!(error < 0.005 * expected, "{kind:?}: error {error}");
            assert!((value / expected - 1.0).abs() < 0.02, "{kind:?}: {value}, not {expected}");
        }
    }
}
