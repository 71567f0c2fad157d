//! What moves by itself: the lift, the sliding door, a swinging lamp, the fan before its light, a turntable, and the sun.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{Mat4, Quat, Vec2, Vec3, vec2, vec3};

use super::hall::{DOOR, DOORWAY};
use super::motion::eased;
use super::stage::Stage;
use super::{GALLERY, HALF, LANDING, LOOP, WALL};
use crate::builtin::shapes::{
    bow, cone, cuboid, cylinder, hexahedron, revolution, sharp_profile, sphere, transformed,
};
use crate::normals::{CREASE_ANGLE, smooth_normals};
use crate::{Camera, Light, LightKind, Mesh};

pub fn add(stage: &mut Stage) {
    sun(stage);
    lift(stage);
    door(stage);
    lamp(stage);
    fan(stage);
    turntable(stage);
}

/// A light that a node carries and that shines toward the node's -Z.
fn carried(name: &str, kind: LightKind, intensity: Vec3, radius: f32, node: usize) -> Light {
    Light {
        radius,
        node: Some(node),
        ..Light::new(name, kind, intensity)
    }
}

fn spot(inner_degrees: f32, outer_degrees: f32) -> LightKind {
    LightKind::Spot {
        inner_cone_angle: inner_degrees.to_radians(),
        outer_cone_angle: outer_degrees.to_radians(),
    }
}

/// The sun goes to and fro in the south, as if days were seconds.
fn sun(stage: &mut Stage) {
    let node = stage.motion.node(None, Mat4::IDENTITY);
    stage.motion.turn(node, (LOOP, 80), |phase| {
        let (sine, cosine) = (phase * TAU).sin_cos();
        let from = vec3(-0.12 + 0.5 * sine, 0.8 - 0.1 * cosine, 1.0);
        let sun = Camera::look_at("", from, Vec3::ZERO, 1.0);
        Quat::from_mat4(&sun.world_from_view)
    });
    let light = carried(
        "sun",
        LightKind::Directional,
        vec3(11.0, 9.9, 8.3),
        0.0047,
        node,
    );
    stage.scene.lights.push(light);
}

/// The lift in the north-west corner: a shaft of four posts and a platform between floor and gallery.
fn lift(stage: &mut Stage) {
    let (left, right) = (-HALF.x + 0.62, LANDING - 0.06);
    let (back, front) = (-HALF.y + 0.15, -HALF.y + 1.75);
    let palette = &stage.palette;
    let (steel, paint) = (palette.steel, palette.paint);
    let top = GALLERY + 2.0;
    let post = |x: f32, z: f32| {
        cuboid(
            vec3(x - 0.05, 0.0, z - 0.05),
            vec3(x + 0.05, top, z + 0.05),
            1,
        )
    };
    let corners = [(left, back), (right, back), (left, front), (right, front)];
    let mut shaft: Vec<Mesh> = corners.into_iter().map(|(x, z)| post(x, z)).collect();
    let beam =
        |low: Vec2, high: Vec2| cuboid(vec3(low.x, top, low.y), vec3(high.x, top + 0.1, high.y), 1);
    shaft.extend([
        beam(
            vec2(left - 0.06, back - 0.06),
            vec2(right + 0.06, back + 0.06),
        ),
        beam(
            vec2(left - 0.06, front - 0.06),
            vec2(right + 0.06, front + 0.06),
        ),
        beam(
            vec2(left - 0.06, back + 0.06),
            vec2(left + 0.06, front - 0.06),
        ),
        beam(
            vec2(right - 0.06, back + 0.06),
            vec2(right + 0.06, front - 0.06),
        ),
    ]);
    stage.place("lift shaft", steel, shaft);

    let node = stage.motion.node(None, Mat4::IDENTITY);
    stage.motion.slide(node, (LOOP, 100), |phase| {
        let height = eased(phase, 0.05, 0.35) - eased(phase, 0.55, 0.85);
        Vec3::Y * (0.02 + (GALLERY - 0.02 - 0.08) * height)
    });
    let (low, high) = (
        vec2(left + 0.07, back + 0.07),
        vec2(right - 0.07, front - 0.07),
    );
    let block = |low: [f32; 3], high: [f32; 3]| cuboid(low.into(), high.into(), 1);
    let mut platform = vec![block([low.x, 0.0, low.y], [high.x, 0.08, high.y])];
    for (x, z) in [
        (low.x, low.y),
        (high.x - 0.05, low.y),
        (low.x, high.y - 0.05),
    ] {
        platform.push(block([x, 0.08, z], [x + 0.05, 1.05, z + 0.05]));
    }
    for y in [0.55, 1.05] {
        platform.push(block([low.x, y, low.y], [high.x, y + 0.05, low.y + 0.05]));
        platform.push(block(
            [low.x, y, low.y + 0.05],
            [low.x + 0.05, y + 0.05, high.y],
        ));
    }
    stage.carry("lift", node, paint, platform);
}

/// A door that slides into the wall's east, and the lamp in the room behind it.
fn door(stage: &mut Stage) {
    let [left, right] = DOORWAY;
    let (rust, glow, steel) = (stage.palette.rust, stage.palette.glow, stage.palette.steel);
    let z = -HALF.y - 0.6 * WALL;
    let node = stage.motion.node(None, Mat4::IDENTITY);
    stage.motion.slide(node, (LOOP, 100), |phase| {
        let open = 0.55 + 0.45 * (eased(phase, 0.6, 0.75) - eased(phase, 0.1, 0.25));
        Vec3::X * 1.08 * (open - 0.02)
    });
    let leaf = cuboid(
        vec3(left - 0.02, 0.01, z - 0.03),
        vec3(right + 0.02, DOOR - 0.01, z + 0.03),
        1,
    );
    let rail = |y: f32| {
        cuboid(
            vec3(left + 0.08, y, z - 0.05),
            vec3(right - 0.08, y + 0.06, z + 0.05),
            1,
        )
    };
    stage.carry(
        "door",
        node,
        rust,
        [leaf, rail(0.3), rail(1.05), rail(1.75)],
    );
    let middle = (left + right) / 2.0;
    let at = vec3(middle, 2.44, -HALF.y - WALL - 1.3);
    let lamp = cuboid(at - vec3(0.5, 0.0, 0.12), at + vec3(0.5, 0.03, 0.12), 1);
    stage.place("chamber lamp", glow, [lamp]);
    let case = cuboid(
        at + vec3(-0.54, 0.02, -0.16),
        at + vec3(0.54, 0.07, 0.16),
        1,
    );
    stage.place("chamber lamp case", steel, [case]);
}

/// A lamp on a rod that swings from the crown of the vault.
fn lamp(stage: &mut Stage) {
    let rod = 2.7;
    let pivot = Mat4::from_translation(vec3(1.9, super::CROWN - 0.25, -0.6));
    let node = stage.motion.node(None, pivot);
    stage.motion.turn(node, (4.0, 32), |phase| {
        let (sine, cosine) = (phase * TAU).sin_cos();
        Quat::from_rotation_z(0.2 * cosine) * Quat::from_rotation_x(0.08 * sine)
    });
    let detail = stage.detail;
    let (steel, paint, glow) = (stage.palette.steel, stage.palette.paint, stage.palette.glow);
    let hang = |mesh: Mesh, y: f32| transformed(mesh, &Mat4::from_translation(Vec3::NEG_Y * y));
    let bar = hang(cylinder(0.015, rod, 8 * detail), rod);
    stage.carry(
        "lamp rod",
        node,
        steel,
        [bar, hang(sphere(0.06, 8 * detail), 0.0)],
    );
    // Outside and inside of the shade.
    let shade = [
        vec2(0.0, 0.2),
        vec2(0.07, 0.2),
        vec2(0.1, 0.1),
        vec2(0.34, -0.08),
        vec2(0.32, -0.08),
        vec2(0.09, 0.08),
        vec2(0.0, 0.16),
    ];
    let shade = revolution(&sharp_profile(&shade), 32 * detail);
    stage.carry("lamp", node, paint, [hang(shade, rod)]);
    stage.carry("lamp bulb", node, glow, [hang(sphere(0.07, 4), rod - 0.03)]);
    let down =
        Mat4::from_translation(Vec3::NEG_Y * (rod + 0.06)) * Mat4::from_rotation_x(-FRAC_PI_2);
    let child = stage.motion.node(Some(node), down);
    let light = carried(
        "lamp",
        spot(40.0, 62.0),
        vec3(30.0, 22.0, 13.0),
        0.07,
        child,
    );
    stage.scene.lights.push(light);
}

/// A fan in a ring above the arch, and the spot behind it.
fn fan(stage: &mut Stage) {
    let at = vec3(-HALF.x + 0.75, 5.05, 0.0);
    let toward = vec3(1.0, 0.0, 0.2);
    let aim = Camera::look_at("", at, toward, 1.0).world_from_view;
    let (steel, paint) = (stage.palette.steel, stage.palette.paint);
    let detail = stage.detail;
    let ring = bow([0.5, 0.56], PI * 0.9999, 0.24, 40 * detail);
    // The ring's axis is X; the light's is -Z.
    let turned = aim * Mat4::from_rotation_y(FRAC_PI_2);
    let back = cylinder(0.09, 0.1, 16 * detail);
    let back = transformed(
        back,
        &(aim * Mat4::from_translation(Vec3::Z * 0.2) * Mat4::from_rotation_x(FRAC_PI_2)),
    );
    let arm = |x: f32| {
        let wall = vec3(-HALF.x - 0.02, at.y + 0.35, at.z + x);
        cuboid(
            wall - vec3(0.0, 0.025, 0.025),
            wall + vec3(0.85, 0.025, 0.025),
            1,
        )
    };
    stage.place(
        "fan ring",
        steel,
        [transformed(ring, &turned), back, arm(-0.42), arm(0.42)],
    );

    let hub = stage.motion.node(None, aim);
    let node = stage.motion.node(Some(hub), Mat4::IDENTITY);
    stage
        .motion
        .turn(node, (4.0, 16), |phase| Quat::from_rotation_z(phase * TAU));
    let blade = |i: u32| {
        let corner = |radius: f32, across: f32, z: f32| vec3(across, radius, z);
        let level = |z: f32| {
            [
                corner(0.06, -0.04, z - 0.02),
                corner(0.06, 0.04, z + 0.02),
                corner(0.46, 0.15, z + 0.05),
                corner(0.46, -0.1, z - 0.05),
            ]
        };
        let blade = hexahedron(level(-0.006), level(0.006), 1);
        transformed(blade, &Mat4::from_rotation_z(TAU * i as f32 / 5.0))
    };
    let boss = transformed(
        cylinder(0.08, 0.1, 20 * detail),
        &(Mat4::from_rotation_x(FRAC_PI_2) * Mat4::from_translation(Vec3::NEG_Y * 0.05)),
    );
    let tip = transformed(
        cone(0.08, 0.1, 20 * detail),
        &(Mat4::from_rotation_x(-FRAC_PI_2) * Mat4::from_translation(Vec3::Y * 0.05)),
    );
    stage.carry("fan", node, paint, (0..5).map(blade).chain([boss, tip]));

    let behind = stage
        .motion
        .node(Some(hub), Mat4::from_translation(Vec3::Z * 0.18));
    let light = carried(
        "fan spot",
        spot(48.0, 62.0),
        vec3(34.0, 42.0, 52.0),
        0.03,
        behind,
    );
    stage.scene.lights.push(light);
}

/// A glass vase on a turntable, on a stand of steel.
fn turntable(stage: &mut Stage) {
    let at = vec3(3.3, 0.0, -1.5);
    let detail = stage.detail;
    let (steel, brushed, glass, wood) = (
        stage.palette.steel,
        stage.palette.brushed,
        stage.palette.glass,
        stage.palette.wood,
    );
    let block =
        |low: [f32; 3], high: [f32; 3]| cuboid(at + Vec3::from(low), at + Vec3::from(high), 1);
    stage.place(
        "stand",
        wood,
        [block([-0.45, 0.78, -0.45], [0.45, 0.84, 0.45])],
    );
    let legs = [(-0.4, -0.4), (0.34, -0.4), (-0.4, 0.34), (0.34, 0.34)];
    let mut frame: Vec<Mesh> = legs
        .into_iter()
        .map(|(x, z)| block([x, 0.0, z], [x + 0.06, 0.781, z + 0.06]))
        .collect();
    frame.push(block([-0.39, 0.2, -0.39], [0.39, 0.23, 0.39]));
    stage.place("stand frame", steel, frame);
    let node = stage
        .motion
        .node(None, Mat4::from_translation(at + Vec3::Y * 0.84));
    stage.motion.turn(node, (LOOP, 40), |phase| {
        Quat::from_rotation_y(2.0 * phase * TAU)
    });
    let disc = cylinder(0.27, 0.03, 40 * detail);
    let grip = |i: u32| {
        let turn = Mat4::from_rotation_y(TAU * i as f32 / 8.0);
        transformed(
            cuboid(vec3(-0.02, 0.004, 0.262), vec3(0.02, 0.026, 0.285), 1),
            &turn,
        )
    };
    stage.carry("turntable", node, brushed, (0..8).map(grip).chain([disc]));
    let stand = Mat4::from_translation(Vec3::Y * 0.031);
    stage.carry(
        "vase",
        node,
        glass,
        [transformed(vase(48 * detail, detail), &stand)],
    );
}

/// A vase with nine soft ribs, 0.42 m high, with walls of 8 mm.
fn vase(columns: u32, detail: u32) -> Mesh {
    let radius = |height: f32| {
        // At equal heights from the foot to the lip (m).
        const SHAPE: [f32; 8] = [0.075, 0.11, 0.15, 0.165, 0.14, 0.09, 0.07, 0.1];
        let along = height * (SHAPE.len() - 1) as f32;
        let before = (along as usize).clamp(1, SHAPE.len() - 2) - 1;
        // A parabola through three points, so that the outline is smooth enough.
        let t = along - before as f32;
        let [a, b, c] = [0, 1, 2].map(|i| SHAPE[before + i]);
        a + (b - a) * t + (c - 2.0 * b + a) * t * (t - 1.0) / 2.0
    };
    let steps = 20 * detail;
    let height = |step: u32| step as f32 / steps as f32;
    let (tall, wall) = (0.42, 0.008);
    let mut profile = vec![vec2(0.0, 0.02)];
    profile.extend((0..=steps).map(|step| {
        vec2(
            radius(height(step)) - wall,
            0.02 + (tall - 0.02) * height(step),
        )
    }));
    profile.extend(
        (0..=steps)
            .rev()
            .map(|step| vec2(radius(height(step)), tall * height(step))),
    );
    profile.push(Vec2::ZERO);
    let mut mesh = revolution(&sharp_profile(&profile), columns);
    for position in &mut mesh.positions {
        let around = position.x.atan2(position.z);
        let from_axis = 1.0 + 0.05 * (9.0 * around).cos();
        position.x *= from_axis;
        position.z *= from_axis;
    }
    smooth_normals(&mut mesh, CREASE_ANGLE);
    mesh
}
