//! Indirect light by way of mirrors, glass and gloss: rays are followed over these surfaces to the next diffuse one.
//! Where they are not followed, this room has 15 % (glass) to 64 % (Phong) of its light.

use glam::{Vec3, Vec4, vec3};
use gpugi::light_paths::{LightClass, LightPaths, overlap};
use gpugi_scene::builtin::shapes::{cuboid, quad, sphere};
use gpugi_scene::{Camera, Light, LightKind, Material, MaterialModel, Mesh, Scene, Volume};

use super::against_the_path_tracer;
use crate::common::{gpu, inside_out, place, renderer_of};

/// A closed bright room with a ball of `radius` (m) in its middle, and a camera that looks away from it into a corner.
fn room_with(ball: Material, radius: f32) -> (Scene, Camera) {
    let mut scene = Scene::new("room");
    let room = inside_out(cuboid(vec3(-1.0, 0.0, -1.0), vec3(1.0, 1.6, 1.0), 1));
    place(&mut scene, room, Material::matt("walls", Vec3::splat(0.7)));
    let mut mesh: Mesh = sphere(radius, 24);
    for position in &mut mesh.positions {
        *position += vec3(0.0, 0.7, 0.0);
    }
    place(&mut scene, mesh, ball);
    // The lamp shines past the ball: light straight through glass belongs to other techniques.
    let spot = LightKind::Spot {
        inner_cone_angle: 0.3,
        outer_cone_angle: 0.35,
    };
    let light = Light::new("", spot, Vec3::splat(10.0));
    let light = light.aimed(vec3(0.8, 1.5, 0.8), vec3(0.8, 0.0, 0.8));
    scene.lights.push(light);
    let camera = Camera::look_at("", vec3(-0.75, 0.8, -0.75), vec3(-1.0, 1.2, -1.0), 1.1);
    (scene, camera)
}

#[test]
fn light_by_way_of_mirrors_glass_and_gloss_is_the_path_tracers() {
    let Some(gpu) = gpu() else { return };
    let metal = |roughness| Material {
        base_color: Vec4::new(0.95, 0.7, 0.4, 1.0),
        metallic: 1.0,
        roughness,
        ..Material::default()
    };
    let glass = |volume| Material {
        transmission: 1.0,
        roughness: 0.0,
        volume,
        ..Material::default()
    };
    let solid = Volume {
        attenuation_distance: 0.5,
        attenuation_color: vec3(0.9, 0.5, 0.8),
    };
    let phong = MaterialModel::Phong {
        kd: Vec3::splat(0.2),
        ks: Vec3::splat(0.7),
        shininess: 20.0,
    };
    for (name, ball) in [
        ("matt", Material::matt("ball", Vec3::splat(0.8))),
        ("mirror", metal(0.0)),
        ("rough metal", metal(0.4)),
        ("solid glass", glass(Some(solid))),
        ("thin glass", glass(None)),
        (
            "Phong",
            Material {
                model: phong,
                ..Material::default()
            },
        ),
    ] {
        let (scene, camera) = room_with(ball, 0.6);
        let settings = ["resolution=128", "rays=16", "iterations=32", "steps=8"];
        let techniques = ["shadow-map", "radiosity"];
        let mut renderer = renderer_of(&gpu, &scene, &techniques, 24, "radiosity", &settings);
        let (error, ratio) = against_the_path_tracer(&gpu, &scene, &camera, &mut renderer);
        println!("{name}: rel-mse {error:.1e}, {ratio:.4} of the light");
        assert!(error < 1e-3, "{name}: {error}");
        assert!((ratio - 1.0).abs() < 0.02, "{name}: {ratio}");
    }
}

/// A mirror ball throws the light of a lamp onto the walls, and the walls reflect it onto each other: 12 % of the light
/// that radiosity adds here.
#[test]
fn light_that_caustics_bring_is_reflected_on() {
    let Some(gpu) = gpu() else { return };
    let mirror = Material {
        base_color: Vec4::ONE,
        metallic: 1.0,
        roughness: 0.0,
        ..Material::default()
    };
    let (mut scene, camera) = room_with(mirror, 0.35);
    scene.lights.clear();
    let lamp = quad(vec3(-0.3, 1.55, -0.3), 0.6 * Vec3::X, 0.6 * Vec3::Z, 1);
    let shining = Material {
        emissive: Vec3::splat(5.0),
        ..Material::matt("lamp", Vec3::ZERO)
    };
    place(&mut scene, lamp, shining);
    let settings = ["resolution=128", "rays=16", "iterations=64", "steps=16"];
    let error = |techniques: &[&str]| {
        let mut renderer = renderer_of(&gpu, &scene, techniques, 24, "radiosity", &settings);
        let (error, ratio) = against_the_path_tracer(&gpu, &scene, &camera, &mut renderer);
        println!("{techniques:?}: rel-mse {error:.1e}, {ratio:.4} of the light");
        assert!(error < 1e-3, "{techniques:?}: {error}");
        assert!((ratio - 1.0).abs() < 0.02, "{techniques:?}: {ratio}");
        renderer
    };
    error(&["shadow-map", "radiosity"]);
    let renderer = error(&["shadow-map", "caustics", "radiosity"]);
    let bounced = LightPaths::new(LightClass::Area, "LSDDE");
    assert!(overlap(renderer.light_paths_of("radiosity"), &[bounced]).is_some());
}

/// Diffuse scenes keep their paths and their speed.
#[test]
fn paths_over_other_surfaces_are_declared_where_there_are_any() {
    let Some(gpu) = gpu() else { return };
    let declared = |ball: Material, settings: &[&str]| {
        let (scene, _) = room_with(ball, 0.6);
        let renderer = renderer_of(
            &gpu,
            &scene,
            &["shadow-map", "radiosity"],
            8,
            "radiosity",
            settings,
        );
        let paths = renderer.light_paths();
        let is_indirect = |paths: &&LightPaths| {
            paths.class == LightClass::Punctual && paths.pattern.starts_with("LD")
        };
        let found = paths.iter().find(is_indirect).expect("paths");
        found.pattern.to_string()
    };
    let matt = || Material::matt("ball", Vec3::splat(0.5));
    assert_eq!(declared(matt(), &[]), "LDD+E");
    assert_eq!(declared(Material::default(), &[]), "LD[DGS]*DE");
    let shooting = declared(Material::default(), &["mode=shooting"]);
    assert_eq!(shooting, "LDD+E");
}
