//! Each point gets its light from exactly one of the techniques that could add it: nothing is added twice, and nothing
//! is left out.

use std::sync::Arc;

use glam::{Vec3, vec3};
use gpugi::Renderer;
use gpugi::gpu::Gpu;
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{
    Camera, Environment, Image, Light, LightKind, Material, MaterialModel, Mesh, Pixels, Scene,
};

use super::scenes::glass;
use crate::common::{gpu, picture, place};

const SIZE: u32 = 32;

/// An environment of radiance 1 everywhere.
fn white() -> Environment {
    Environment {
        image: Arc::new(Image {
            name: "white".into(),
            width: 1,
            height: 1,
            pixels: Pixels::Rgba32Float(vec![1.0; 4]),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    }
}

/// One object named `thing` in a white furnace.
fn furnace(mesh: Mesh, material: Material) -> Scene {
    let mut scene = Scene::new("furnace");
    let thing = place(&mut scene, mesh, material);
    scene.instances[thing].name = "thing".into();
    scene.environment = Some(white());
    scene
}

/// Mean radiance of the middle of the picture, with techniques and settings (technique, name, value).
fn middle(gpu: &Gpu, scene: &Scene, techniques: &[&str], settings: &[(&str, &str, &str)]) -> f32 {
    let names: Vec<String> = techniques.iter().map(|name| (*name).to_owned()).collect();
    let mut renderer = Renderer::new(gpu, scene, [SIZE, SIZE], &names).expect("a renderer");
    let small = ["resolution", "shape-resolution"].map(|name| ("distance-impostor", name, "64"));
    let small = small
        .iter()
        .filter(|(technique, ..)| techniques.contains(technique));
    for (technique, name, value) in small.chain(settings) {
        renderer.set(technique, name, value).expect("a setting");
    }
    let camera = Camera::look_at("", vec3(0.0, 0.0, 4.0), Vec3::ZERO, 0.5);
    let samples = 16;
    for _ in 0..samples {
        renderer
            .render_sample(&camera, samples, None, false)
            .expect("a sample");
    }
    let radiance = renderer.radiance().expect("radiance");
    let quarter = SIZE / 4;
    let pixels = (quarter * 3 / 2..quarter * 5 / 2)
        .flat_map(|y| (quarter * 3 / 2..quarter * 5 / 2).map(move |x| y * SIZE + x));
    let values: Vec<f32> = pixels.map(|at| radiance[at as usize * 3 + 1]).collect();
    values.iter().sum::<f32>() / values.len() as f32
}

const WITHOUT: [&str; 2] = ["image-based-lighting", "environment-map"];
const WITH: [&str; 3] = [
    "image-based-lighting",
    "environment-map",
    "distance-impostor",
];

#[test]
fn panes_and_phong_lobes_are_left_to_others() {
    let Some(gpu) = gpu() else { return };
    let sheet = || quad(vec3(-2.0, -2.0, 0.0), Vec3::X * 4.0, Vec3::Y * 4.0, 1);
    let pane = Material {
        transmission: 0.5,
        roughness: 0.0,
        ..Material::default()
    };
    let phong = Material {
        model: MaterialModel::Phong {
            kd: Vec3::splat(0.3),
            ks: Vec3::splat(0.5),
            shininess: 20.0,
        },
        roughness: 0.0,
        ..Material::default()
    };
    for (name, material) in [("pane", pane), ("Phong", phong)] {
        let scene = furnace(sheet(), material);
        let [without, with] = [&WITHOUT[..], &WITH[..]].map(|set| middle(&gpu, &scene, set, &[]));
        println!("{name}: {with}, without impostors {without}");
        assert!((with - without).abs() < 0.02, "{name}: {with}, {without}");
    }
}

#[test]
fn rough_glass_keeps_what_passes_through_it() {
    let Some(gpu) = gpu() else { return };
    let frosted = Material {
        roughness: 0.5,
        ..glass(1.5)
    };
    let scene = furnace(sphere(1.0, 32), frosted);
    let named = [("distance-impostor", "objects", "thing")];
    let without = middle(&gpu, &scene, &["environment-map"], &[]);
    let with = middle(&gpu, &scene, &WITH[1..], &named);
    println!("frosted: {with}, without impostors {without}");
    // The impostor's reflection holds no sky, which environment-map adds.
    assert!(
        without > 0.9 && (with - without).abs() < 0.08,
        "{with}, {without}"
    );
}

#[test]
fn glass_without_an_environment_is_seen_through() {
    let Some(gpu) = gpu() else { return };
    let mut scene = furnace(sphere(0.5, 32), glass(1.5));
    scene.environment = None;
    let wall = quad(vec3(-3.0, -3.0, -2.0), Vec3::X * 6.0, Vec3::Y * 6.0, 1);
    place(&mut scene, wall, Material::matt("wall", Vec3::splat(0.5)));
    let point = Light::new("", LightKind::Point, Vec3::splat(20.0));
    scene
        .lights
        .push(point.aimed(vec3(0.0, 2.0, 2.0), Vec3::ZERO));
    let alone = middle(&gpu, &scene, &["shadow-map"], &[]);
    let both = middle(&gpu, &scene, &["shadow-map", "environment-map"], &[]);
    assert!(
        alone > 0.01 && (alone - both).abs() < 1e-4,
        "{alone}, {both}"
    );
}

#[test]
fn mirrors_follow_the_settings_of_others() {
    let Some(gpu) = gpu() else { return };
    let mut scene = furnace(sphere(1.0, 32), Material::metal("mirror", Vec3::ONE, 0.0));
    let mesh = sphere(0.7, 32);
    let beside = place(&mut scene, mesh, Material::metal("rough", Vec3::ONE, 0.6));
    scene.instances[beside].name = "rough".into();
    // PeeledLayer the eye, so that only the mirror shows it.
    scene.instances[beside].world_from_mesh = glam::Mat4::from_translation(vec3(0.0, 0.0, 6.0));
    let techniques = ["environment-map", "distance-impostor"].map(str::to_owned);
    let camera = Camera::look_at("", vec3(0.0, 0.0, 4.0), Vec3::ZERO, 0.5);
    let mut renderer = Renderer::new(&gpu, &scene, [SIZE, SIZE], &techniques).expect("a renderer");
    let before = picture(&mut renderer, &camera).radiance;
    renderer
        .set("environment-map", "objects", "thing")
        .expect("a setting");
    let after = picture(&mut renderer, &camera).radiance;
    let change = before
        .iter()
        .zip(&after)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f32::max);
    assert!(
        change > 0.3,
        "the mirror still shows the ball lit: {change}"
    );
    let refused = renderer.set("environment-map", "objects", "nobody");
    assert!(refused.is_err());
    renderer
        .set("environment-map", "samples", "64")
        .expect("what was refused is not kept");
}
