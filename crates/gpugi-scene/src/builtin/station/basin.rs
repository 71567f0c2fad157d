//! The basin: a tiled pit with a stone rim, water with waves, a fish of glass, and the chrome ball above.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{Mat4, Quat, Vec2, Vec3, vec2, vec3};

use super::LOOP;
use super::motion::sampled;
use super::stage::Stage;
use crate::Mesh;
use crate::animation::{Deformer, MorphTarget};
use crate::builtin::shapes::{Vertex, cuboid, grid, join, lofted, pierced, sphere, transformed};

/// Inner corners of the pit; the upper one lies on the rim (m).
pub const LOW: Vec3 = vec3(-3.4, -0.5, -0.3);
pub const HIGH: Vec3 = vec3(1.2, 0.46, 2.1);
/// Height of the water (m).
const LEVEL: f32 = 0.3;
/// Thickness of the rim (m).
const RIM: f32 = 0.28;

pub fn add(stage: &mut Stage) {
    let palette = &stage.palette;
    let (tiles, trim, water) = (palette.tiles, palette.trim, palette.water);
    let (jade, mirror) = (palette.jade, palette.mirror);
    let detail = stage.detail;
    stage.place("basin", tiles, [pit()]);
    stage.place("basin rim", trim, rim());

    let node = stage.motion.node(None, Mat4::IDENTITY);
    let instance = stage.carry("water", node, water, [water_body(20 * detail)]);
    stage.motion.weigh(node, (4.0, 32), |phase| {
        let (sine, cosine) = (phase * TAU).sin_cos();
        [cosine, sine]
    });
    let mesh = &stage.scene.meshes[stage.scene.instances[instance].mesh];
    let deformer = Deformer {
        instance,
        node,
        positions: mesh.positions.clone(),
        normals: mesh.normals.clone(),
        tangents: Vec::new(),
        flat: false,
        targets: [0.0, FRAC_PI_2].map(|phase| waves(mesh, phase)).into(),
        skin: None,
    };
    stage.motion.rig.deformers.push(deformer);

    let middle = (LOW + HIGH) / 2.0;
    let node = stage.motion.node(None, Mat4::IDENTITY);
    stage.motion.slide(node, (LOOP, 100), |phase| {
        let (sine, cosine) = (phase * TAU).sin_cos();
        let height = -0.08 + 0.1 * (2.0 * phase * TAU).sin();
        vec3(middle.x + 1.5 * sine, height, middle.z + 0.68 * cosine)
    });
    stage.motion.turn(node, (LOOP, 100), |phase| {
        let (sine, cosine) = (phase * TAU).sin_cos();
        let wag = 0.12 * (16.0 * phase * TAU).sin();
        Quat::from_rotation_y((1.5 * cosine).atan2(-0.68 * sine) + wag)
    });
    stage.carry("fish", node, jade, [fish(detail)]);

    let node = stage.motion.node(None, Mat4::IDENTITY);
    stage.motion.slide(node, (LOOP, 100), |phase| {
        let (sine, cosine) = (phase * TAU).sin_cos();
        let height = 1.45 + 0.12 * (3.0 * phase * TAU).sin();
        vec3(
            middle.x + 0.2 + 0.5 * cosine,
            height,
            middle.z + 0.35 * sine,
        )
    });
    stage.carry("ball", node, mirror, [sphere(0.34, 20 * detail)]);
}

/// Floor and walls of the pit, below the rim.
fn pit() -> Mesh {
    let out = Vec3::splat(0.2);
    let hole = [vec2(LOW.x, LOW.z), vec2(HIGH.x, HIGH.z)];
    let (low, high) = (LOW - out, HIGH.with_y(LOW.y) + out.with_y(0.0));
    let walls = pierced(low.with_y(LOW.y - 0.2), high.with_y(0.4), 1, &[hole]);
    join("pit", [walls, cuboid(low, high, 1)])
}

/// The rim's sides around the pit's walls, and its cover, which juts out.
fn rim() -> [Mesh; 2] {
    let ring = |inner: f32, outer: f32, low: f32, high: f32| {
        let hole = [
            vec2(LOW.x - inner, LOW.z - inner),
            vec2(HIGH.x + inner, HIGH.z + inner),
        ];
        pierced(
            vec3(LOW.x - outer, low, LOW.z - outer),
            vec3(HIGH.x + outer, high, HIGH.z + outer),
            1,
            &[hole],
        )
    };
    [
        ring(0.1, RIM - 0.04, -0.01, 0.41),
        ring(-0.02, RIM, 0.39, HIGH.y),
    ]
}

/// Water that fills the pit and reaches a little into its walls: a grid of `columns` along its top and its bottom.
fn water_body(columns: u32) -> Mesh {
    let rows = columns * 3 / 5;
    let bed = Vec3::splat(0.01);
    let (low, high) = (LOW - bed, (HIGH + bed).with_y(LEVEL));
    let at = |column: u32, y: f32, row: u32| {
        let part = vec2(column as f32 / columns as f32, row as f32 / rows as f32);
        let (from, to) = (vec2(low.x, low.z), vec2(high.x, high.z));
        let place = from * (1.0 - part) + to * part;
        vec3(place.x, y, place.y)
    };
    let vertex = |position: Vec3, normal: Vec3| Vertex {
        position,
        normal,
        uv: vec2(position.x, position.z),
    };
    let height = |row: u32| if row == 0 { high.y } else { low.y };
    join(
        "water",
        [
            grid(columns, rows, |column, row| {
                vertex(at(column, high.y, row), Vec3::Y)
            }),
            grid(columns, rows, |column, row| {
                vertex(at(column, low.y, rows - row), Vec3::NEG_Y)
            }),
            grid(columns, 1, |column, row| {
                vertex(at(column, height(row), rows), Vec3::Z)
            }),
            grid(columns, 1, |column, row| {
                vertex(at(columns - column, height(row), 0), Vec3::NEG_Z)
            }),
            grid(rows, 1, |column, row| {
                vertex(at(columns, height(row), rows - column), Vec3::X)
            }),
            grid(rows, 1, |column, row| {
                vertex(at(0, height(row), column), Vec3::NEG_X)
            }),
        ],
    )
}

/// Offsets of the water's top at one phase (rad) of its waves, which run in three directions.
fn waves(mesh: &Mesh, phase: f32) -> MorphTarget {
    // Wave vectors (rad/m) and heights (m).
    let trains = [
        (vec2(5.1, 2.3), 0.006),
        (vec2(-3.4, 5.8), 0.005),
        (vec2(8.2, -4.7), 0.0025),
    ];
    let offset = |position: &Vec3| {
        let (mut height, mut slope) = (0.0, Vec2::ZERO);
        if position.y == LEVEL {
            for (vector, amplitude) in trains {
                let angle = vector.dot(vec2(position.x, position.z)) - phase;
                height += amplitude * angle.cos();
                slope -= vector * amplitude * angle.sin();
            }
        }
        (Vec3::Y * height, slope)
    };
    let vertices = mesh.positions.iter().zip(&mesh.normals);
    let (positions, normals) = vertices
        .map(|(position, normal)| {
            let (moved, slope) = offset(position);
            (moved, vec3(-slope.x, 0.0, -slope.y) * normal.y.max(0.0))
        })
        .unzip();
    MorphTarget {
        positions,
        normals,
        tangents: Vec::new(),
    }
}

/// A fish that swims along +X, 0.55 m long, with its middle at the origin.
fn fish(detail: u32) -> Mesh {
    /// Half height and half width along the body, from mouth to tail (m).
    const BODY: [Vec2; 9] = [
        vec2(0.02, 0.016),
        vec2(0.07, 0.045),
        vec2(0.1, 0.06),
        vec2(0.1, 0.055),
        vec2(0.08, 0.042),
        vec2(0.045, 0.024),
        vec2(0.03, 0.014),
        vec2(0.085, 0.012),
        vec2(0.12, 0.008),
    ];
    let body = lofted(16 * detail, 20 * detail, |down, turn| {
        let half = sampled(&BODY, down);
        let open = (down * (1.0 - down) * 30.0).min(1.0).sqrt();
        let (sine, cosine) = (turn * TAU).sin_cos();
        vec3(
            half.y * sine * open,
            0.275 - 0.55 * down,
            half.x * cosine * open,
        )
    });
    transformed(
        body,
        &(Mat4::from_rotation_y(FRAC_PI_2) * Mat4::from_rotation_x(FRAC_PI_2)),
    )
}
