//! What the reference point does not see: reported, and found in a second layer.

use glam::{Vec3, vec3};
use gpugi_scene::builtin::shapes::cuboid;
use gpugi_scene::{Material, Scene};

use super::scenes::{
    add, errors_of, glass, mirror, renderer, room, shining_room, toward, with_ball,
};
use crate::common::{gpu, picture};

/// Away from the reference point, which is the centre of the room.
const BALL: Vec3 = vec3(0.9, -0.4, -0.6);
const MIDDLE: (&str, &str) = ("reference", "0,0,0");

/// The tutorial's figure 34: a crate hides from the reference point part of the room that the ball mirrors, 7 % of it.
fn with_crate(scene: Scene) -> Scene {
    let mut scene = with_ball(scene, mirror(), BALL);
    let mesh = cuboid(vec3(-0.9, -1.5, -0.3), vec3(-0.4, 0.6, 0.3), 1);
    // Double-sided, as many programs export it: its own back still does not count as what lies behind it.
    let material = Material {
        double_sided: true,
        ..Material::matt("crate", vec3(0.1, 0.5, 0.2))
    };
    add(&mut scene, "crate", mesh, material, Vec3::ZERO);
    scene
}

#[test]
fn a_second_layer_shows_what_a_crate_hides() {
    let Some(gpu) = gpu() else { return };
    let scene = with_crate(room());
    let settings: [&[_]; 2] = [&[MIDDLE, ("layers", "1")], &[("layers", "2")]];
    let [one, two] = errors_of(&gpu, &scene, &toward(BALL), settings);
    println!("mirror ball beside a crate: rel-mse {one:.1e}, with two layers {two:.1e}");
    assert!(two < 0.01 && one > 2.0 * two, "{one}, {two}");
}

/// Shares of the ball's points whose hits are seen, passed behind, unseen, or in the second layer, and of those whose
/// rays leave.
fn shares(scene: &Scene, settings: &[(&str, &str)]) -> Option<[f64; 5]> {
    let gpu = gpu()?;
    let mut renderer = renderer(&gpu, scene, settings);
    renderer
        .set("distance-impostor", "show", "certainty")
        .expect("a setting");
    let found = picture(&mut renderer, &toward(BALL));
    let ball = scene
        .instances
        .iter()
        .position(|instance| instance.name == "ball")?;
    let colors = [
        vec3(0.1, 0.6, 0.1),
        vec3(0.8, 0.7, 0.05),
        vec3(0.8, 0.05, 0.05),
        vec3(0.05, 0.2, 0.9),
        vec3(0.3, 0.3, 0.3),
    ];
    let mut counts = [0.0; 5];
    let mut all = 0.0;
    for point in found.lit().filter(|point| point.instance as usize == ball) {
        let kind = colors
            .iter()
            .position(|color| color.distance(point.radiance) < 1e-3);
        counts[kind.unwrap_or_else(|| panic!("{} means nothing", point.radiance))] += 1.0;
        all += 1.0;
    }
    assert!(all > 300.0, "{all} points of the ball");
    Some(counts.map(|count| count / all))
}

#[test]
fn hits_that_are_not_seen_are_reported() {
    let alone = with_ball(room(), mirror(), BALL);
    let Some(seen) = shares(&alone, &[MIDDLE]) else {
        return;
    };
    assert_eq!(seen, [1.0, 0.0, 0.0, 0.0, 0.0], "nothing hides anything");
    let beside = with_crate(room());
    let Some([_, _, unseen, second, _]) = shares(&beside, &[MIDDLE]) else {
        return;
    };
    assert!(
        (unseen - 0.07).abs() < 0.02 && second == 0.0,
        "behind the crate: {unseen}, {second}"
    );
    let Some([_, _, left, second, _]) = shares(&beside, &[MIDDLE, ("layers", "2")]) else {
        return;
    };
    assert!(
        left < 0.2 * unseen && second > 0.8 * unseen,
        "of {unseen} unseen, {second} in the second layer, {left} are left"
    );
    let mut open = alone;
    open.instances.retain(|instance| instance.name == "ball");
    let Some(leaving) = shares(&open, &[]) else {
        return;
    };
    assert_eq!(leaving, [0.0, 0.0, 0.0, 0.0, 1.0], "nothing is around");
}

/// For glass, it is the ray leaving on the other side that counts.
#[test]
fn hits_through_glass_are_reported() {
    let mut scene = with_ball(shining_room(), glass(1.5), BALL);
    let mesh = cuboid(vec3(0.1, -1.5, -1.9), vec3(0.3, 0.2, -1.4), 1);
    let material = Material::emitter("crate", vec3(0.1, 0.5, 0.2));
    add(&mut scene, "crate", mesh, material, Vec3::ZERO);
    let reference = ("reference", "-0.5,-0.5,-1.7");
    let Some(found) = shares(&scene, &[reference]) else {
        return;
    };
    let mirrored = scene.materials.len();
    scene.materials.push(mirror());
    let ball = scene
        .instances
        .iter_mut()
        .find(|instance| instance.name == "ball");
    ball.expect("a ball").material = mirrored;
    let Some(reflected) = shares(&scene, &[reference]) else {
        return;
    };
    assert!(
        found[2] > 0.005 && found[2] > 2.0 * reflected[2],
        "through the ball {found:?}, mirrored {reflected:?}"
    );
}
