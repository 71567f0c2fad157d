//! caustics against the path tracer, its flux, and where it can only be sensible.

#[path = "../common/mod.rs"]
mod common;

use std::ops::ControlFlow;

use common::{floor, gpu};
use glam::{Mat4, Vec3, vec3};
use gpugi::Renderer;
use gpugi::gpu::Gpu;
use gpugi::measure::{Measured, Options, Quality, measure};
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{Camera, Material, Scene, Volume};

fn glass(ior: f32) -> Material {
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

/// A floor, a ball above it, and a lamp of half a metre above that.
fn ball_under_lamp(material: Material) -> Scene {
    let mut scene = floor(2.0);
    let lamp = quad(vec3(-0.05, 2.0, -0.25), Vec3::X * 0.5, Vec3::Z * 0.5, 1);
    assert!(lamp.normals[0].y < 0.0);
    common::place(
        &mut scene,
        lamp,
        Material::emitter("lamp", Vec3::splat(20.0)),
    );
    let mesh = scene.add_mesh(sphere(0.4, 64));
    let material = scene.add_material(material);
    scene.add_instance(
        "ball",
        mesh,
        material,
        Mat4::from_translation(vec3(0.0, 0.6, 0.0)),
    );
    scene
}

fn camera() -> Camera {
    Camera::look_at("", vec3(0.0, 1.8, 2.6), Vec3::ZERO, 0.8)
}

fn measured(
    gpu: &Gpu,
    scene: &Scene,
    camera: &Camera,
    settings: &[(&str, &str)],
    size: u32,
    samples: u32,
) -> Measured {
    let mut renderer =
        Renderer::new(gpu, scene, [size, size], &["caustics".to_owned()]).expect("a renderer");
    for (name, value) in settings {
        renderer.set("caustics", name, value).expect("a setting");
    }
    let options = Options {
        samples: 8,
        reference: Quality {
            samples,
            noise: 0.0,
        },
        ..Options::default()
    };
    let found = measure(gpu, scene, camera, &mut renderer, &options, &mut |_| {
        ControlFlow::Continue(())
    });
    found.expect("a measurement")
}

#[test]
fn glass_balls_focus_light() {
    let Some(gpu) = gpu() else { return };
    for (name, material) in [
        ("glass", glass(1.5)),
        ("mirror", Material::metal("m", Vec3::splat(0.9), 0.0)),
    ] {
        let scene = ball_under_lamp(material);
        let found = measured(
            &gpu,
            &scene,
            &camera(),
            &[("resolution", "256"), ("area-samples", "64")],
            128,
            1024,
        );
        let sum = |values: &[f32]| values.iter().map(|&v| f64::from(v)).sum::<f64>();
        println!(
            "{name}: flux {} of {}",
            sum(&found.radiance),
            sum(&found.truth.radiance)
        );
        for (which, values) in [("a", &found.radiance), ("b", &found.truth.radiance)] {
            std::fs::write(format!("/tmp/ca-{name}-{which}.raw")).unwrap();
        }
    }
}
