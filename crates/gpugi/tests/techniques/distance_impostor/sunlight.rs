//! Lights outside of a closed room, and a mirror that shows what the camera does not see.

use glam::{Mat4, Vec3, vec3};
use gpugi::gpu::Gpu;
use gpugi_scene::builtin::shapes::cuboid;
use gpugi_scene::{Light, LightKind, Material};

use super::scenes::{HALF, add, mirror, renderer, room, toward, with_ball};
use crate::common::gpu;

/// The sun, and a spot light that shines onto all of the roof.
fn lights() -> [Light; 2] {
    let cone = LightKind::Spot {
        inner_cone_angle: 0.6,
        outer_cone_angle: 0.8,
    };
    [
        Light::new("sun", LightKind::Directional, Vec3::splat(3.0))
            .aimed(vec3(1.0, 2.0, 0.7), Vec3::ZERO),
        Light::new("spot", cone, Vec3::splat(100.0)).aimed(vec3(0.5, 6.0, 1.0), Vec3::ZERO),
    ]
}

/// Radiance of the ball in a room with walls of 10 cm.
fn of_ball(gpu: &Gpu, light: &Light, is_closed: bool) -> Vec<f32> {
    let at = vec3(0.0, 0.0, -0.8);
    let mut scene = with_ball(room(), mirror(), at);
    if is_closed {
        let shell = cuboid(-HALF - 0.1, HALF + 0.1, 1);
        let white = Material::matt("shell", Vec3::splat(0.8));
        add(&mut scene, "shell", shell, white, Vec3::ZERO);
    } else {
        // The ceiling, out of the way.
        for ceiling in &mut scene.instances[4..6] {
            ceiling.world_from_mesh = Mat4::from_translation(Vec3::NEG_Y * 4.0);
        }
    }
    scene.lights = vec![light.clone()];
    let mut renderer = renderer(gpu, &scene, &[]);
    let set = renderer.set("shadow-map", "warp", "true");
    set.expect("a setting");
    let sample = renderer.render_sample(&toward(at), 1, None, false);
    sample.expect("a picture");
    renderer.radiance().expect("radiance")
}

/// The ball, which fills most of the picture, shows the room behind the camera.
#[test]
fn a_mirror_shows_no_light_from_outside_of_a_closed_room() {
    let Some(gpu) = gpu() else { return };
    for light in lights() {
        let [closed, open] = [true, false].map(|is_closed| of_ball(&gpu, &light, is_closed));
        let name = &light.name;
        assert!(
            closed.iter().all(|value| *value == 0.0),
            "{name}: {closed:?}"
        );
        let lit = open.iter().filter(|value| **value > 0.01).count();
        assert!(lit > open.len() / 10, "{name}: {lit} of {}", open.len());
    }
}
