//! Obscurances hide the environment from what near surfaces cover.

use std::ops::ControlFlow;

use glam::{Mat4, Vec3, vec3};
use gpugi::gpu::Gpu;
use gpugi::light_paths::LightClass;
use gpugi::{LightingError, Renderer};
use gpugi_scene::builtin::shapes::cuboid;
use gpugi_scene::image::metrics::Metric;
use gpugi_scene::{Camera, Material, Scene};

use super::{SIZE, phong, sky};
use crate::common::{floor, gpu, measured, picture, place, renderer_of};

const BOTH: [&str; 2] = ["obscurances", "environment-map"];

/// A matt floor under a sky that is brighter on one side, with blocks that hide parts of it.
fn blocks() -> Scene {
    let mut scene = floor(1.5);
    let white = || Material::matt("white", Vec3::splat(0.7));
    for (low, high) in [
        (vec3(-0.7, 0.0, -0.7), vec3(-0.5, 0.8, 0.7)),
        (vec3(0.2, 0.0, -0.5), vec3(0.7, 0.4, 0.1)),
        (vec3(0.0, 0.3, 0.4), vec3(0.6, 0.4, 0.9)),
    ] {
        place(&mut scene, cuboid(low, high, 1), white());
    }
    scene.environment = Some(sky());
    scene
}

fn camera() -> Camera {
    Camera::look_at("", vec3(1.4, 2.2, 2.6), vec3(0.0, 0.1, 0.0), 0.8)
}

/// The environment, hidden by whatever is within reach of obscurances.
fn hidden(gpu: &Gpu, scene: &Scene, size: u32, reach: &str) -> Renderer {
    let settings = ["resolution=64", "samples=8", "occlusion=true"];
    let mut renderer = renderer_of(gpu, scene, &BOTH, size, "environment-map", &settings);
    for (name, value) in [
        ("distance", reach),
        ("resolution", "128"),
        ("directions", "256"),
        ("steps", "64"),
    ] {
        let set = renderer.set("obscurances", name, value);
        set.expect("a setting");
    }
    renderer
}

/// The sky's light with soft shadows, against the path tracer.
#[test]
fn near_surfaces_hide_the_sky() {
    let Some(gpu) = gpu() else { return };
    let scene = blocks();
    let error = |mut renderer: Renderer| {
        let found = measured(&gpu, &scene, &camera(), &mut renderer, [4, 256]);
        found.value(Metric::RelMse).expect("rel-mse")
    };
    let settings = ["resolution=64", "samples=8"];
    let plain = &BOTH[1..];
    let without = error(renderer_of(
        &gpu,
        &scene,
        plain,
        SIZE,
        "environment-map",
        &settings,
    ));
    let with = error(hidden(&gpu, &scene, SIZE, "10"));
    println!("rel-mse {without:.1e}, with occlusion {with:.1e}");
    assert!(with < 0.025, "{with}");
    assert!(with < without / 10.0, "{without}, with occlusion {with}");
}

/// Where nothing is within reach, nothing is lost; lobes other than the diffuse one, and the directions of normals that
/// differ from the triangles', stay as they are.
#[test]
fn open_surfaces_keep_their_light() {
    let Some(gpu) = gpu() else { return };
    let mut scene = super::ball(phong(40.0), sky());
    scene.instances[0].world_from_mesh = Mat4::from_scale(Vec3::new(1.0, 0.7, 1.0));
    let settings = ["resolution=64", "samples=8"];
    let names = &BOTH[1..];
    let mut plain = renderer_of(&gpu, &scene, names, SIZE, "environment-map", &settings);
    let plain = picture(&mut plain, &super::camera());
    let mut open = hidden(&gpu, &scene, SIZE, "0.001");
    open.converge(&super::camera(), false, |_, _| ControlFlow::Continue(()))
        .expect("maps");
    let open = picture(&mut open, &super::camera());
    let pairs = open.lit().zip(plain.lit());
    let away =
        pairs.map(|(point, other)| (point.radiance / other.radiance - 1.0).abs().max_element());
    let worst = away.fold(0.0, f32::max);
    println!("at most {worst:.3} apart");
    assert!(worst < 0.005, "{worst}");
    assert!(open.lit().count() > 300);
}

#[test]
fn hidden_light_is_declared_and_added_once() {
    let Some(gpu) = gpu() else { return };
    let scene = blocks();
    let mut renderer = renderer_of(&gpu, &scene, &BOTH[1..], 8, BOTH[1], &[]);
    let refused = renderer.set(BOTH[1], "occlusion", "true");
    assert!(matches!(refused, Err(LightingError::Needs { .. })));

    let paths = |renderer: &Renderer| -> Vec<String> {
        let paths = renderer.light_paths().into_iter();
        let paths = paths.filter(|paths| paths.class == LightClass::Environment);
        paths.map(|paths| paths.pattern.to_string()).collect()
    };
    assert_eq!(paths(&hidden(&gpu, &scene, 8, "1")), ["L[DGS]E"]);
    // Beside shadows of the sky, mirrors alone are left.
    let shadows = "image-based-lighting";
    let all = [shadows, BOTH[0], BOTH[1]];
    let mut all = renderer_of(&gpu, &scene, &all, 16, BOTH[1], &["occlusion=true"]);
    assert_eq!(paths(&all), ["L[DG]E", "LSE"]);
    let mut alone = renderer_of(&gpu, &scene, &[shadows], 16, shadows, &[]);
    assert_eq!(
        picture(&mut all, &camera()).radiance,
        picture(&mut alone, &camera()).radiance
    );
}
