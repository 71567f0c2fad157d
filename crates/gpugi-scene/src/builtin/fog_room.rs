//! The coloured room full of fog, in which a narrow spot makes a shaft of light. A mirror ball reflects shaft and fog.

use glam::{Mat4, Vec3, vec3};

use super::room::{mirror_ball, walls};
use crate::{Camera, Light, LightKind, Medium, PhaseFunction, Scene};

pub(super) fn build(detail: u32) -> Scene {
    let mut scene = Scene::new("fog-room");
    scene.cameras.push(Camera::look_at(
        "inside",
        vec3(0.3, 1.6, 1.9),
        vec3(-0.05, 0.95, -1.0),
        65.0_f32.to_radians(),
    ));
    walls(&mut scene, detail);
    mirror_ball(&mut scene, 0.5, vec3(-0.7, 0.5, -0.7), 16 * detail);
    let cone = LightKind::Spot {
        inner_cone_angle: 8.0_f32.to_radians(),
        outer_cone_angle: 12.0_f32.to_radians(),
    };
    let spot = Light::new("spot", cone, vec3(200.0, 190.0, 170.0));
    scene.lights = vec![spot.aimed(vec3(1.7, 2.8, 0.3), vec3(-0.3, 0.3, -0.9))];
    let place = Mat4::from_translation(vec3(0.0, 1.5, 0.0));
    scene.media.push(Medium {
        name: "fog".into(),
        world_from_box: Some(place * Mat4::from_scale(vec3(4.0, 3.0, 4.0))),
        extinction: Vec3::splat(0.2),
        albedo: Vec3::splat(0.9),
        phase: PhaseFunction::HenyeyGreenstein(0.3),
        emission: Vec3::ZERO,
        density: None,
        node: None,
    });
    scene
}
