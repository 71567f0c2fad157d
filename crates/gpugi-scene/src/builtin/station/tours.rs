//! A fixed view of the hall, and four tours: cameras on closed curves, as long as the loop.

use glam::{Mat4, Quat, Vec3, vec3};

use super::LOOP;
use super::stage::Stage;
use crate::Camera;

/// Vertical field of view (rad).
const VIEW: f32 = 1.08;

/// Where a camera is and what it looks at (m).
type Stop = (Vec3, Vec3);

const HALL: [Stop; 6] = [
    (vec3(6.2, 1.75, 2.3), vec3(-1.5, 1.9, -0.8)),
    (vec3(4.2, 1.7, 3.0), vec3(-2.0, 1.5, -1.0)),
    (vec3(2.4, 2.2, 1.8), vec3(-4.5, 2.0, -2.0)),
    (vec3(1.9, 1.9, -2.05), vec3(-6.5, 2.6, 0.6)),
    (vec3(4.4, 1.7, -1.95), vec3(2.7, 1.2, -5.0)),
    (vec3(5.4, 1.7, 0.4), vec3(4.0, 1.0, -1.6)),
];

const GALLERY: [Stop; 6] = [
    (vec3(6.3, 4.75, -2.6), vec3(-2.0, 2.6, 0.6)),
    (vec3(4.2, 4.8, -2.75), vec3(-1.0, 1.6, 1.8)),
    (vec3(1.6, 4.8, -2.75), vec3(-2.5, 0.8, 1.4)),
    (vec3(1.2, 4.75, -3.2), vec3(-5.0, 3.9, -2.6)),
    (vec3(2.6, 4.9, -2.9), vec3(2.0, 3.4, 4.0)),
    (vec3(4.6, 4.85, -2.7), vec3(0.0, 3.2, 2.0)),
];

/// Half a round before the robot that walks there.
const BASIN: [Stop; 6] = [
    (vec3(2.4, 1.15, 2.7), vec3(-1.0, 0.5, 0.8)),
    (vec3(1.4, 1.3, -0.9), vec3(-1.1, 0.4, 1.0)),
    (vec3(-2.0, 1.9, -1.4), vec3(-1.1, 0.2, 1.2)),
    (vec3(-4.6, 1.6, 1.4), vec3(-0.8, 0.6, 0.7)),
    (vec3(-2.4, 1.3, 3.1), vec3(-1.0, 0.7, 0.4)),
    (vec3(0.4, 1.5, 3.0), vec3(-1.2, 0.3, 0.8)),
];

const COURTYARD: [Stop; 6] = [
    (vec3(-6.6, 1.7, -0.4), vec3(-12.0, 2.2, -0.6)),
    (vec3(-8.6, 1.8, 0.3), vec3(-13.5, 2.4, -1.0)),
    (vec3(-11.6, 1.6, 2.4), vec3(-13.2, 2.3, -1.6)),
    (vec3(-15.4, 1.7, 2.0), vec3(-10.0, 2.3, -1.2)),
    (vec3(-15.6, 1.8, -3.4), vec3(-7.0, 2.2, 0.2)),
    (vec3(-10.2, 1.7, -2.6), vec3(-8.0, 2.3, 1.2)),
];

pub fn add(stage: &mut Stage) {
    let (eye, target) = (vec3(6.35, 1.85, 2.5), vec3(-2.2, 2.05, -1.0));
    stage
        .scene
        .cameras
        .push(Camera::look_at("view", eye, target, VIEW));
    for (name, stops) in [
        ("hall", HALL),
        ("gallery", GALLERY),
        ("basin", BASIN),
        ("courtyard", COURTYARD),
    ] {
        let looking = |phase: f32| {
            let [eye, target] = [0, 1].map(|part| {
                curve(
                    &stops.map(|(eye, target)| if part == 0 { eye } else { target }),
                    phase,
                )
            });
            Camera::look_at(name, eye, target, VIEW)
        };
        let first = looking(0.0);
        let node = stage.motion.node(None, first.world_from_view);
        stage.motion.slide(node, (LOOP, 160), |phase| {
            looking(phase).world_from_view.w_axis.truncate()
        });
        stage.motion.turn(node, (LOOP, 160), |phase| {
            Quat::from_mat4(&Mat4::from_mat3(glam::Mat3::from_mat4(
                looking(phase).world_from_view,
            )))
        });
        stage.scene.cameras.push(Camera {
            node: Some(node),
            ..first
        });
    }
}

/// A closed Catmull-Rom curve through `points`, all after the same time.
fn curve(points: &[Vec3], phase: f32) -> Vec3 {
    let along = phase * points.len() as f32;
    let first = along as usize;
    let t = along - first as f32;
    let [a, b, c, d] = [0, 1, 2, 3].map(|i| points[(first + i + points.len() - 1) % points.len()]);
    let (t2, t3) = (t * t, t * t * t);
    0.5 * (2.0 * b
        + (c - a) * t
        + (2.0 * a - 5.0 * b + 4.0 * c - d) * t2
        + (3.0 * (b - c) + d - a) * t3)
}
