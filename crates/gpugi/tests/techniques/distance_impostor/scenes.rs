//! The rooms of the tests, and how far pictures of them are from the truth.

use std::sync::Arc;

use glam::{Mat4, Vec3, vec3};
use gpugi::Renderer;
use gpugi::gpu::Gpu;
use gpugi::measure::Measured;
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{Camera, Light, LightKind, Material, Mesh, Scene, Volume};

pub const SIZE: u32 = 32;
/// The technique's samples per pixel.
const SAMPLES: u32 = 8;

/// Half extents of the room (m), which is centred at the origin.
pub const HALF: Vec3 = vec3(2.0, 1.5, 2.0);

/// A closed room whose walls have two colours each, with a point light under the ceiling.
pub fn room() -> Scene {
    let mut scene = Scene::new("room");
    let walls = [
        (
            Vec3::X,
            Vec3::NEG_Z,
            vec3(0.7, 0.1, 0.1),
            vec3(0.6, 0.6, 0.5),
        ),
        (
            Vec3::NEG_X,
            Vec3::Z,
            vec3(0.1, 0.6, 0.1),
            vec3(0.5, 0.5, 0.6),
        ),
        (Vec3::Y, Vec3::X, vec3(0.8, 0.8, 0.7), vec3(0.5, 0.4, 0.3)),
        (
            Vec3::NEG_Y,
            Vec3::X,
            vec3(0.6, 0.5, 0.4),
            vec3(0.2, 0.2, 0.25),
        ),
        (Vec3::Z, Vec3::X, vec3(0.7, 0.6, 0.1), vec3(0.1, 0.5, 0.6)),
        (
            Vec3::NEG_Z,
            Vec3::NEG_X,
            vec3(0.2, 0.2, 0.7),
            vec3(0.6, 0.3, 0.5),
        ),
    ];
    for (outward, along, left, right) in walls {
        let up = (-outward).cross(along);
        let half = along * HALF;
        for (shift, albedo) in [(-half, left), (Vec3::ZERO, right)] {
            let corner = outward * HALF + shift - up * HALF;
            add(
                &mut scene,
                "wall",
                quad(corner, half, 2.0 * up * HALF, 1),
                Material::matt("wall", albedo),
                Vec3::ZERO,
            );
        }
    }
    let light = Light::new("light", LightKind::Point, Vec3::splat(8.0))
        .aimed(vec3(0.9, 1.2, 0.7), Vec3::ZERO);
    scene.lights.push(light);
    scene
}

/// The same room with emitting walls instead, so that the picture has no shadows of glass.
pub fn shining_room() -> Scene {
    let mut scene = room();
    scene.lights.clear();
    for material in &mut scene.materials {
        *material = Material::emitter("wall", material.base_color.truncate());
    }
    scene
}

/// Adds an object at a place.
pub fn add(
    scene: &mut Scene,
    name: &str,
    mesh: impl Into<Arc<Mesh>>,
    material: Material,
    at: Vec3,
) -> usize {
    let mesh = scene.add_mesh(mesh);
    let material = scene.add_material(material);
    scene.add_instance(name, mesh, material, Mat4::from_translation(at))
}

/// The room with a ball of radius 0.5 m added.
pub fn with_ball(mut scene: Scene, material: Material, at: Vec3) -> Scene {
    add(&mut scene, "ball", sphere(0.5, 64), material, at);
    scene
}

/// Looks at the ball, which fills most of the picture.
pub fn toward(at: Vec3) -> Camera {
    let back = (vec3(0.2, 0.1, 0.3) - at).normalize_or(vec3(0.6, 0.3, 1.0).normalize());
    Camera::look_at("", at + 1.4 * back, at, 0.75)
}

pub fn mirror() -> Material {
    Material::metal("mirror", Vec3::splat(0.95), 0.0)
}

pub fn glass(ior: f32) -> Material {
    Material {
        name: "glass".into(),
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

/// A renderer with shadow-map, so that the walls are lit, and distance-impostor with its settings.
pub fn renderer(gpu: &Gpu, scene: &Scene, settings: &[(&str, &str)]) -> Renderer {
    renderer_of(gpu, scene, &["shadow-map", "distance-impostor"], settings)
}

pub fn renderer_of(
    gpu: &Gpu,
    scene: &Scene,
    names: &[&str],
    settings: &[(&str, &str)],
) -> Renderer {
    let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
    let mut renderer = Renderer::new(gpu, scene, [SIZE, SIZE], &names).expect("a renderer");
    if names.iter().any(|name| name == "distance-impostor") {
        for (name, value) in [("resolution", "64"), ("shape-resolution", "64")]
            .iter()
            .chain(settings)
        {
            renderer
                .set("distance-impostor", name, value)
                .expect("a setting");
        }
    }
    renderer
}

pub fn set(renderer: &mut Renderer, (name, value): (&str, &str)) {
    renderer
        .set("distance-impostor", name, value)
        .expect("a setting");
}

/// A picture, and what the path tracer shows on the light paths that the renderer declares.
pub fn measured(gpu: &Gpu, scene: &Scene, camera: &Camera, renderer: &mut Renderer) -> Measured {
    crate::common::measured(gpu, scene, camera, renderer, [SAMPLES, 48])
}

/// Mean of (a - b)^2 / (b^2 + 0.01).
pub fn rel_mse(test: &[f32], truth: &[f32]) -> f64 {
    let pairs = test.iter().zip(truth);
    let sum: f64 = pairs
        .map(|(a, b)| f64::from((a - b) * (a - b) / (b * b + 0.01)))
        .sum();
    sum / truth.len() as f64
}

/// rel-mse with the technique and without it, against the same truth.
pub fn errors(gpu: &Gpu, scene: &Scene, camera: &Camera, settings: &[(&str, &str)]) -> [f64; 2] {
    let found = measured(gpu, scene, camera, &mut renderer(gpu, scene, settings));
    let mut off = renderer_of(gpu, scene, &["shadow-map"], &[]);
    off.render_sample(camera, 1, None, false)
        .expect("a picture");
    let off = off.radiance().expect("radiance");
    [&found.radiance, &off].map(|radiance| rel_mse(radiance, &found.truth.radiance))
}

/// rel-mse of several settings, each applied on top of the previous ones, against the truth of the first.
pub fn errors_of<const N: usize>(
    gpu: &Gpu,
    scene: &Scene,
    camera: &Camera,
    settings: [&[(&str, &str)]; N],
) -> [f64; N] {
    let mut renderer = renderer(gpu, scene, settings[0]);
    let found = measured(gpu, scene, camera, &mut renderer);
    std::array::from_fn(|at| {
        if at == 0 {
            return rel_mse(&found.radiance, &found.truth.radiance);
        }
        for (name, value) in settings[at] {
            set(&mut renderer, (name, value));
        }
        renderer.restart();
        for _ in 0..SAMPLES {
            let sample = renderer.render_sample(camera, SAMPLES, None, false);
            sample.expect("a picture");
        }
        let radiance = renderer.radiance().expect("radiance");
        rel_mse(&radiance, &found.truth.radiance)
    })
}
