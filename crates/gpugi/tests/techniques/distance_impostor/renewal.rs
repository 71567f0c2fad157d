//! Maps that are kept while objects move, and maps renewed face by face: pictures match those of a new renderer.

use std::sync::Arc;

use glam::{EulerRot, Mat4, Quat, Vec3, vec3};
use gpugi::Renderer;
use gpugi_scene::builtin::shapes::{cuboid, sphere};
use gpugi_scene::{Camera, Environment, Image, Pixels, Scene};

use super::scenes::{
    add, glass, mirror, rel_mse, renderer, renderer_of, room, shining_room, with_ball,
};
use crate::common::{Picture, gpu, picture};

fn camera() -> Camera {
    Camera::look_at("", vec3(0.1, 0.4, 1.7), Vec3::ZERO, 0.9)
}

/// An environment of uniform radiance.
fn sky(radiance: f32) -> Environment {
    Environment {
        image: Arc::new(Image {
            name: "sky".into(),
            width: 1,
            height: 1,
            pixels: Pixels::Rgba32Float(vec![radiance; 4]),
        }),
        rotation: Quat::IDENTITY,
        intensity: 1.0,
    }
}

/// The picture after a change.
fn after(renderer: &mut Renderer, scene: &Scene) -> Picture {
    renderer.update(scene).expect("an update");
    picture(renderer, &camera())
}

#[test]
fn glass_that_turns_is_as_if_captured_anew() {
    let Some(gpu) = gpu() else { return };
    let mut scene = with_ball(shining_room(), glass(1.3), Vec3::ZERO);
    let index = scene.instances.len() - 1;
    let flat = Mat4::from_scale(vec3(1.0, 0.6, 1.3));
    scene.instances[index].world_from_mesh = flat;
    let mut kept = renderer(&gpu, &scene, &[]);
    let mut before = picture(&mut kept, &camera());
    let quarter = std::f32::consts::FRAC_PI_2;
    // Rotated by quarter turns, cubes have the same texels; otherwise they differ.
    for (name, x, y, z, error) in [
        ("moved", 0.0, 0.0, 0.0, 1e-5),
        ("a quarter about x", quarter, 0.0, 0.0, 1e-5),
        ("a quarter about y", 0.0, quarter, 0.0, 1e-5),
        ("a quarter about z", 0.0, 0.0, quarter, 1e-5),
        ("turned", 0.4, -0.9, 0.3, 1e-4),
    ] {
        let turn = Quat::from_euler(EulerRot::XYZ, x, y, z);
        scene.instances[index].world_from_mesh =
            Mat4::from_rotation_translation(turn, vec3(0.2, -0.1, 0.1)) * flat;
        let found = after(&mut kept, &scene);
        let fresh = picture(&mut renderer(&gpu, &scene, &[]), &camera());
        let mse = rel_mse(&found.radiance, &fresh.radiance);
        let change = rel_mse(&before.radiance, &fresh.radiance);
        println!("{name}: rel-mse {mse:.1e}, of the picture before {change:.1e}");
        assert!(mse < error, "{name}: {mse}");
        assert!(change > 5.0 * error, "{name} changes nothing: {change}");
        before = found;
    }
}

#[test]
fn faces_in_turn_end_in_the_same_picture() {
    let Some(gpu) = gpu() else { return };
    let mut several = with_ball(room(), mirror(), vec3(0.5, 0.0, 0.0));
    let alone = several.clone();
    let at = vec3(-0.7, 0.1, 0.0);
    add(&mut several, "other", sphere(0.4, 32), mirror(), at);
    let two_layers = alone.clone();
    for (name, mut scene, layers, same) in [
        ("a mirror", alone, "1", 0.0),
        ("a mirror with two layers", two_layers, "2", 0.0),
        ("two mirrors", several, "1", 1e-3),
    ] {
        let layers = ("layers", layers);
        let block = cuboid(Vec3::splat(-0.2), Vec3::splat(0.2), 1);
        let matt = scene.materials.len();
        let block = add(
            &mut scene,
            "block",
            block,
            gpugi_scene::Material::matt("block", Vec3::ONE),
            vec3(0.0, 0.6, 0.7),
        );
        assert_eq!(scene.instances[block].material, matt);
        let mut in_turn = renderer(&gpu, &scene, &[("faces-per-frame", "2"), layers]);
        let before = picture(&mut in_turn, &camera());
        scene.instances[block].world_from_mesh = Mat4::from_translation(vec3(0.6, -0.5, 1.0));
        scene.lights[0].intensity *= 0.7;
        let fresh = picture(&mut renderer(&gpu, &scene, &[layers]), &camera());
        let off = |picture: &Picture| rel_mse(&picture.radiance, &fresh.radiance);
        let mut found = after(&mut in_turn, &scene);
        let [start, first] = [&before, &found].map(off);
        // All turns twice, because the mirrors show each other.
        for _ in 1..6 {
            found = picture(&mut in_turn, &camera());
        }
        let end = off(&found);
        println!(
            "{name}: rel-mse {start:.1e}, after the first turn {first:.1e}, at last {end:.1e}"
        );
        assert!(start > 0.01 && first > 0.01, "{name}: {start}, {first}");
        assert!(end <= same, "{name}: {end}");
    }
}

/// Every technique finds the points of a subset of the faces, and its own sums for them.
#[test]
fn faces_in_turn_are_lit_by_all_techniques() {
    let Some(gpu) = gpu() else { return };
    let mut scene = with_ball(room(), mirror(), Vec3::ZERO);
    // Without the ceiling, the third of six walls with two halves each.
    scene.instances.drain(4..6);
    let names = [
        "shadow-map",
        "image-based-lighting",
        "environment-map",
        "distance-impostor",
    ];
    let settings = [
        ("image-based-lighting", "samples", "16"),
        ("image-based-lighting", "reflectivity", "ratio"),
    ];
    let make = |scene: &Scene, faces: &str| {
        let mut renderer = renderer_of(&gpu, scene, &names, &[("faces-per-frame", faces)]);
        for (technique, name, value) in settings {
            renderer.set(technique, name, value).expect("a setting");
        }
        renderer
    };
    scene.environment = Some(sky(1.0));
    let [mut in_turn, mut at_once] = ["4", "6"].map(|faces| make(&scene, faces));
    for renderer in [&mut in_turn, &mut at_once] {
        picture(renderer, &camera());
    }
    scene.environment = Some(sky(0.3));
    let expected = after(&mut at_once, &scene);
    let off = |picture: &Picture| rel_mse(&picture.radiance, &expected.radiance);
    let first = off(&after(&mut in_turn, &scene));
    let end = off(&picture(&mut in_turn, &camera()));
    println!("after the first turn rel-mse {first:.1e}, at last {end:.1e}");
    assert!(first > 1e-3 && end < 1e-9, "{first}, {end}");
}
