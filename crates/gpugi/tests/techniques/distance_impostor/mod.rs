//! distance-impostor compared with the path tracer, and in scenes where the result can only be plausible.

mod gloss;
mod hidden;
mod hostile;
mod layers;
mod renewal;
pub mod scenes;
mod shares;
mod sunlight;

use std::f32::consts::FRAC_PI_2;

use crate::common::gpu;
use glam::{Mat4, Vec3, vec3};
use gpugi_scene::builtin::shapes::{sphere, torus};
use gpugi_scene::{Camera, Material, MaterialModel, Volume};
use scenes::{add, errors, errors_of, glass, mirror, room, shining_room, toward, with_ball};

/// In the room, away from its centre.
const ASIDE: Vec3 = vec3(0.9, -0.4, -0.6);

/// The tutorial's figure 33: a mirror ball at three places in a room, with the reference point at the room's centre.
#[test]
fn mirror_balls_show_the_room_from_where_they_are() {
    let Some(gpu) = gpu() else { return };
    for at in [Vec3::ZERO, ASIDE, vec3(-1.3, -0.8, -1.2)] {
        let scene = with_ball(room(), mirror(), at);
        let settings: [&[_]; 4] = [
            &[("reference", "0,0,0")],
            &[("search", "secant"), ("iterations", "8")],
            &[("search", "false-position"), ("iterations", "16")],
            &[("search", "none")],
        ];
        let [walk, secant, position, classical] = errors_of(&gpu, &scene, &toward(at), settings);
        println!(
            "ball at {at}: rel-mse {walk:.1e}, secant {secant:.1e}, false position {position:.1e}, classical {classical:.1e}"
        );
        assert!(
            walk.max(secant).max(position) < 0.006,
            "{at}: {walk}, {secant}, {position}"
        );
        assert!(classical > 10.0 * walk, "{at}: {classical}");
    }
}

#[test]
fn glass_balls_refract_the_room() {
    let Some(gpu) = gpu() else { return };
    for (ior, at) in [(1.1, Vec3::ZERO), (1.5, ASIDE)] {
        let scene = with_ball(shining_room(), glass(ior), at);
        // With `bounces` 1, the only inner surface is the exit: light reflected there is missing.
        let settings: [&[_]; 4] = [
            &[("bounces", "4")],
            &[("bounces", "1")],
            &[("bounces", "0")],
            &[("search", "none")],
        ];
        let [all, one, none, classical] = errors_of(&gpu, &scene, &toward(at), settings);
        println!(
            "glass ball of index {ior}: rel-mse {all:.1e}, one surface inside {one:.1e}, none {none:.1e}, classical {classical:.1e}"
        );
        assert!(all < 0.01, "index {ior}: {all}");
        assert!(
            one < 0.02 && one > 1.2 * all,
            "index {ior}, one surface inside: {one}"
        );
        assert!(none > 3.0 * all, "index {ior}, no surface inside: {none}");
        assert!(classical > 4.0 * all, "index {ior}, classical: {classical}");
    }
}

/// The declared paths have as many inner surfaces as are followed, so that the error is measured against exactly those.
#[test]
fn declared_paths_are_those_that_are_followed() {
    let Some(gpu) = gpu() else { return };
    let scene = with_ball(shining_room(), glass(1.5), Vec3::ZERO);
    let camera = toward(Vec3::ZERO);
    for bounces in ["1", "2"] {
        let [found] = errors_of(&gpu, &scene, &camera, [&[("bounces", bounces)]]);
        println!("{bounces} surfaces inside: rel-mse {found:.1e}");
        assert!(found < 0.01, "{bounces} surfaces inside: {found}");
    }
}

/// Absorption along the path through the glass.
#[test]
fn coloured_glass_absorbs() {
    let Some(gpu) = gpu() else { return };
    let mut green = glass(1.3);
    green.volume = Some(Volume {
        attenuation_distance: 0.4,
        attenuation_color: vec3(0.2, 0.8, 0.3),
    });
    let scene = with_ball(shining_room(), green, ASIDE);
    let [found] = errors_of(&gpu, &scene, &toward(ASIDE), [&[]]);
    println!("green glass: rel-mse {found:.1e}");
    assert!(found < 0.01, "{found}");
}

/// A surface with no other surface behind it: light refracts once, which is exact, whether or not another surface is
/// searched for.
#[test]
fn an_open_surface_refracts_once() {
    let Some(gpu) = gpu() else { return };
    for ior in [1.1, 1.5] {
        let mut cap = sphere(0.5, 64);
        cap.indices.truncate(cap.indices.len() / 2);
        let mut scene = shining_room();
        let index = add(&mut scene, "cap", cap, glass(ior), Vec3::ZERO);
        scene.instances[index].world_from_mesh = Mat4::from_rotation_x(FRAC_PI_2);
        let camera = Camera::look_at("", Vec3::Z * 1.6, Vec3::ZERO, 0.75);
        let settings: [&[_]; 2] = [&[("bounces", "4")], &[("bounces", "0")]];
        let [searched, once] = errors_of(&gpu, &scene, &camera, settings);
        println!("cap of index {ior}: rel-mse {searched:.1e}, {once:.1e}");
        assert!(searched.max(once) < 0.01, "index {ior}: {searched}, {once}");
    }
}

#[test]
fn metals_reflect_by_their_lobes() {
    let Some(gpu) = gpu() else { return };
    let gold = Material {
        model: MaterialModel::Conductor {
            n: vec3(0.18, 0.42, 1.37),
            k: vec3(3.42, 2.35, 1.77),
        },
        ..mirror()
    };
    let rough = |roughness| Material {
        roughness,
        ..mirror()
    };
    for (name, material, bound) in [
        ("gold", gold, 0.006),
        ("metal of roughness 0.2", rough(0.2), 0.012),
        ("metal of roughness 0.5", rough(0.5), 0.04),
        ("metal of roughness 1", rough(1.0), 0.04),
    ] {
        let scene = with_ball(room(), material, ASIDE);
        let [with, without] = errors(&gpu, &scene, &toward(ASIDE), &[("objects", "ball")]);
        println!("{name}: rel-mse {with:.1e}, at most {bound:.1e}; switched off {without:.1e}");
        assert!(with < bound, "{name}: {with}");
        assert!(without > 3.0 * with, "{name}, switched off: {without}");
    }
}

/// A mirror in a mirror is seen as from the centre of the latter: roughly correct.
#[test]
fn objects_show_each_other() {
    let Some(gpu) = gpu() else { return };
    let camera = Camera::look_at("", vec3(0.0, 0.3, 1.7), vec3(0.0, 0.0, -0.5), 0.8);
    for (name, mut scene, material, bound) in [
        ("two mirrors", room(), mirror(), 0.06),
        ("glass beside a mirror", shining_room(), glass(1.5), 0.01),
    ] {
        for (material, x) in [(material, 0.55), (mirror(), -0.55)] {
            add(
                &mut scene,
                "ball",
                sphere(0.5, 64),
                material,
                vec3(x, 0.0, -0.5),
            );
        }
        let [with, without] = errors(&gpu, &scene, &camera, &[]);
        println!("{name}: rel-mse {with:.1e}, at most {bound:.1e}; switched off {without:.1e}");
        assert!(with < bound, "{name}: {with}");
        assert!(without > 4.0 * with, "{name}, switched off: {without}");
    }
}

/// Not star-shaped: even its centre lies outside it.
#[test]
fn a_glass_ring_is_nearer_the_truth_than_classical_mapping() {
    let Some(gpu) = gpu() else { return };
    let mut scene = shining_room();
    let ring = add(
        &mut scene,
        "ring",
        torus(0.5, 0.2, 48),
        glass(1.5),
        Vec3::ZERO,
    );
    scene.instances[ring].world_from_mesh = Mat4::from_rotation_x(1.2);
    let settings: [&[_]; 2] = [&[], &[("search", "none"), ("bounces", "0")]];
    let [found, classical] = errors_of(&gpu, &scene, &toward(Vec3::ZERO), settings);
    println!("ring: rel-mse {found:.1e}, classical {classical:.1e}");
    assert!(found < 0.12, "{found}");
    assert!(classical > 2.0 * found, "{classical}");
}
