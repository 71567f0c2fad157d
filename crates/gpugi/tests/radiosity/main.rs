//! radiosity: closed forms, the path tracer, walls that let nothing through, and what cannot work.

#[path = "../common/mod.rs"]
mod common;

use std::ops::ControlFlow;

use common::{gpu, place};
use glam::{Vec3, vec3};
use gpugi::gpu::{Gpu, read_buffer};
use gpugi::light_paths::{LightClass, LightPaths, overlap};
use gpugi::measure::{Options, Quality, measure};
use gpugi::{RenderError, Renderer};
use gpugi_scene::builtin::builtin;
use gpugi_scene::builtin::shapes::cuboid;
use gpugi_scene::image::metrics::Metric;
use gpugi_scene::{Camera, Light, LightKind, Material, Mesh, Scene};

/// A mesh seen from within.
fn inside_out(mesh: Mesh) -> Mesh {
    let mut mesh = mesh;
    for triangle in mesh.indices.chunks_exact_mut(3) {
        triangle.swap(1, 2);
    }
    for normal in &mut mesh.normals {
        *normal = -*normal;
    }
    mesh.tangents.clear();
    mesh
}

/// An empty room whose surfaces shine and reflect.
fn shining_room(emission: f32, albedo: Vec3) -> Scene {
    let mut scene = Scene::new("room");
    let room = inside_out(cuboid(vec3(-1.0, 0.0, -1.5), vec3(1.0, 1.5, 1.5), 1));
    let material = Material {
        emissive: Vec3::splat(emission),
        ..Material::matt("shining", albedo)
    };
    place(&mut scene, room, material);
    scene
}

fn renderer(
    gpu: &Gpu,
    scene: &Scene,
    techniques: &[&str],
    size: u32,
    settings: &[&str],
) -> Renderer {
    let names: Vec<String> = techniques.iter().map(|&name| name.to_owned()).collect();
    let mut renderer = Renderer::new(gpu, scene, [size, size], &names).expect("a renderer");
    for setting in settings {
        let (name, value) = setting.split_once('=').expect("name=value");
        renderer.set("radiosity", name, value).expect("a setting");
    }
    renderer
}

/// The picture after some frames, from maps that are as fine as they become.
fn picture(renderer: &mut Renderer, camera: &Camera, frames: u32) -> Vec<Vec3> {
    for _ in 0..frames {
        renderer.restart();
        let sample = renderer.render_sample(camera, 1, None, false);
        sample.expect("a picture");
    }
    let radiance = renderer.radiance().expect("radiance");
    radiance.chunks_exact(3).map(Vec3::from_slice).collect()
}

fn mean(picture: &[Vec3]) -> Vec3 {
    picture.iter().sum::<Vec3>() / picture.len() as f32
}

/// Radiosity of a closed room that shines and reflects the same everywhere: e / (1 - rho), every bounce as much as the one before times rho.
#[test]
fn a_closed_room_that_shines_everywhere_has_the_light_of_a_geometric_series() {
    let Some(gpu) = gpu() else { return };
    let albedo = vec3(0.8, 0.5, 0.2);
    let scene = shining_room(2.0, albedo);
    let settings = ["resolution=48", "rays=4", "burn-in=40", "iterations=4"];
    let mut renderer = renderer(&gpu, &scene, &["radiosity"], 32, &settings);
    let camera = Camera::look_at("", vec3(0.8, 0.2, 1.2), vec3(-0.5, 0.7, -1.0), 1.2);
    let expected = 2.0 / (1.0 - albedo);
    for (pixel, radiance) in picture(&mut renderer, &camera, 4).iter().enumerate() {
        let off = *radiance / expected - 1.0;
        assert!(
            off.abs().max_element() < 0.01,
            "pixel {pixel}: {radiance}, not {expected}"
        );
    }
}
