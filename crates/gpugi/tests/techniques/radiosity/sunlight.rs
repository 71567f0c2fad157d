//! Sunlight on what the camera does not see.

use std::sync::Arc;

use glam::{Vec3, vec3};
use gpugi_scene::builtin::shapes::cuboid;
use gpugi_scene::{Camera, Light, LightKind, Material, Scene};

use super::picture;
use crate::common::{gpu, inside_out, place, renderer_of};

/// A closed room with walls of 10 cm, and the sun outside.
fn closed_room() -> Scene {
    let mut scene = Scene::new("closed room");
    let (min, max) = (vec3(-2.0, 0.0, -3.0), vec3(2.0, 2.5, 3.0));
    let white = || Material::matt("white", Vec3::splat(0.8));
    place(&mut scene, inside_out(cuboid(min, max, 1)), white());
    place(&mut scene, cuboid(min - 0.1, max + 0.1, 1), white());
    let sun = Light::new("sun", LightKind::Directional, Vec3::splat(3.0));
    let sun = sun.aimed(vec3(1.0, 2.0, 0.7), Vec3::ZERO);
    scene.lights.push(sun);
    scene
}

/// The camera looks at the middle of one wall, so that the sun's cascades leave out most of the room.
fn turned_away() -> Camera {
    Camera::look_at("", vec3(0.0, 1.2, -2.0), vec3(0.0, 1.2, -3.0), 0.6)
}

/// What the camera sees is lit by the room behind it, into which no sunlight goes.
#[test]
fn the_sun_does_not_shine_into_a_closed_room_behind_the_camera() {
    let Some(gpu) = gpu() else { return };
    let settings = ["resolution=128", "rays=16", "iterations=8", "steps=8"];
    let scene = closed_room();
    let mut renderer = renderer_of(
        &gpu,
        &scene,
        &["shadow-map", "radiosity"],
        16,
        "radiosity",
        &settings,
    );
    let dark = picture(&mut renderer, &turned_away(), 2);
    for (pixel, radiance) in dark.iter().enumerate() {
        assert_eq!(*radiance, Vec3::ZERO, "pixel {pixel}");
    }
    // Without a ceiling it does.
    let mut open = scene.clone();
    for mesh in &mut open.meshes {
        let all = mesh.indices.clone();
        let top = |vertex: u32| mesh.positions[vertex as usize].y > 2.4;
        let kept = all
            .chunks_exact(3)
            .filter(|triangle| !triangle.iter().all(|&vertex| top(vertex)));
        Arc::make_mut(mesh).indices = kept.flatten().copied().collect();
    }
    renderer.update(&open).expect("an update");
    let lit = picture(&mut renderer, &turned_away(), 2);
    assert!(lit.iter().all(|radiance| radiance.min_element() > 0.01));
}
