//! The room of section 5.5 of the tutorial: a mirror sphere, a teapot and a ball of glass, and a box, lit so that
//! caustics fall on the floor in front of them.

use std::f32::consts::TAU;

use glam::{DVec3, Mat4, Quat, Vec3, vec3};

use super::room::{matt_box, mirror_ball, walls};
use super::shapes::{quad, sphere};
use super::solid_teapot::solid_teapot;
use crate::animation::{Animation, Channel, Interpolation, Node, Property, Rig, Transform};
use crate::{Camera, Light, LightKind, Material, Scene, Volume};

pub(super) fn build(detail: u32) -> Scene {
    let mut scene = Scene::new("glass-room");
    scene.cameras.push(Camera::look_at(
        "inside",
        vec3(0.25, 1.15, 1.75),
        vec3(-0.02, 0.36, -0.4),
        50.0_f32.to_radians(),
    ));
    walls(&mut scene, detail);
    let turned = Mat4::from_translation(vec3(1.2, 0.0, -1.2)) * Mat4::from_rotation_y(0.4);
    matt_box(&mut scene, vec3(0.35, 1.0, 0.35), turned, detail);
    mirror_ball(&mut scene, 0.5, vec3(-0.8, 0.5, -1.0), 16 * detail);

    let mesh = scene.add_mesh(solid_teapot((12 * detail).min(384)));
    let material = scene.add_material(glass("glass", vec3(0.75, 0.93, 0.85)));
    let place = Mat4::from_translation(vec3(0.3, 0.0, -0.15))
        * Mat4::from_rotation_y(-0.5)
        * Mat4::from_scale(Vec3::splat(2.0));
    scene.add_instance("teapot", mesh, material, place);

    let mesh = scene.add_mesh(sphere(0.22, 24 * detail));
    let material = scene.add_material(glass("ball", vec3(0.95, 0.85, 0.6)));
    let place = Mat4::from_translation(vec3(-0.55, 0.22, 0.35));
    scene.add_instance("ball", mesh, material, place);

    // The lamp hangs in front of the back wall and faces the glass.
    let (at, toward) = (vec3(0.9, 2.7, -1.6), vec3(0.0, 0.0, 0.2));
    let front = (toward - at).normalize();
    let right = front.cross(Vec3::Y).normalize();
    let up = right.cross(front);
    let (right, up) = (-right * LAMP, up * LAMP);
    let mut lamp = quad(at - (right + up) / 2.0, right, up, detail);
    lamp.name = "lamp".into();
    let mesh = scene.add_mesh(lamp);
    let material = scene.add_material(Material::emitter("lamp", vec3(500.0, 430.0, 330.0)));
    scene.add_instance("lamp", mesh, material, Mat4::IDENTITY);

    let cone = LightKind::Spot {
        inner_cone_angle: 18.0_f32.to_radians(),
        outer_cone_angle: 30.0_f32.to_radians(),
    };
    let mut spot = Light::new("spot", cone, vec3(26.0, 26.0, 25.0))
        .aimed(vec3(-1.5, 2.8, -1.0), vec3(0.0, 0.2, 0.1));
    spot.radius = 0.05;
    swing(&mut scene, spot);
    let fill = Light::new("fill", LightKind::Point, vec3(1.3, 1.4, 1.6))
        .aimed(vec3(1.4, 2.5, 1.4), Vec3::ZERO);
    scene.lights.push(fill);
    scene
}

/// Side of the lamp (m).
const LAMP: f32 = 0.25;

/// Solid glass that transmits `color` of the light over half a metre.
fn glass(name: &str, color: Vec3) -> Material {
    Material {
        name: name.to_owned(),
        roughness: 0.0,
        transmission: 1.0,
        ior: 1.5,
        volume: Some(Volume {
            attenuation_distance: 0.5,
            attenuation_color: color,
        }),
        ..Material::default()
    }
}

/// Adds a light that slowly swings about the vertical axis; at time 0 it has the given orientation.
fn swing(scene: &mut Scene, mut light: Light) {
    const PERIOD: f32 = 8.0;
    const KEYS: usize = 16;
    let widest = 12.0_f32.to_radians();
    let (_, rotation, translation) = light.world_from_light.to_scale_rotation_translation();
    let parts: Vec<f32> = (0..=KEYS).map(|key| key as f32 / KEYS as f32).collect();
    let rotations = parts.iter().flat_map(|part| {
        let turn = Quat::from_rotation_y(widest * (part * TAU).sin());
        (turn * rotation).to_array()
    });
    let channel = Channel {
        node: 0,
        property: Property::Rotation,
        interpolation: Interpolation::Linear,
        values: rotations.collect(),
        times: parts.iter().map(|part| part * PERIOD).collect(),
    };
    let rest = Transform::Parts {
        translation: translation.as_dvec3(),
        rotation: rotation.as_dquat(),
        scale: DVec3::ONE,
    };
    light.node = Some(0);
    scene.lights.push(light);
    scene.rig = Some(Rig {
        nodes: vec![Node {
            parent: None,
            rest,
            weights: Vec::new(),
        }],
        order: vec![0],
        animations: vec![Animation {
            name: "swing".to_owned(),
            duration: PERIOD,
            channels: vec![channel],
        }],
        ..Rig::default()
    });
}
