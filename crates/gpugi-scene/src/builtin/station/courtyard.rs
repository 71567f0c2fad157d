//! The courtyard behind the arch: paved, walled with brick, with a tree, benches and leaves that drift.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{EulerRot, Mat4, Quat, Vec3, vec2, vec3};

use super::hall::ARCH;
use super::stage::Stage;
use super::{HALF, LOOP, WALL};
use crate::Mesh;
use crate::builtin::shapes::{bow, cuboid, cylinder, pierced, quad, rod, transformed};
use crate::builtin::textures::lattice;

/// Corners of the courtyard's ground, and the height of its walls (m).
const LOW: Vec3 = vec3(-17.0, 0.0, -5.5);
const HIGH: Vec3 = vec3(-HALF.x - WALL, 4.2, 5.5);
/// Foot of the tree (m).
const TREE: Vec3 = vec3(-13.2, 0.0, -1.6);

pub fn add(stage: &mut Stage) {
    let palette = &stage.palette;
    let (brick, trim, paving) = (palette.brick, palette.trim, palette.paving);
    let (wood, rust, leaf) = (palette.wood, palette.rust, palette.leaf);
    let detail = stage.detail;
    stage.place(
        "paving",
        paving,
        [cuboid(
            LOW - vec3(0.3, 0.3, 0.3),
            HIGH.with_y(0.0) + vec3(0.0, 0.0, 0.3),
            1,
        )],
    );
    stage.place("courtyard walls", brick, walls());
    stage.place("courtyard trims", trim, trims(detail));
    stage.place("tree", wood, tree(detail));
    stage.place("crown", leaf, (0..1600).map(foliage));
    stage.place("courtyard gate", rust, gate(detail));
    for (number, at) in [
        vec3(-11.5, 1.4, 0.6),
        vec3(-14.4, 1.7, 1.6),
        vec3(-9.4, 1.0, -0.9),
    ]
    .into_iter()
    .enumerate()
    {
        let node = stage.motion.node(None, Mat4::from_translation(at));
        let start = number as f32 / 3.0;
        stage.motion.slide(node, (LOOP, 80), |phase| {
            let (sine, cosine) = ((phase + start) * TAU).sin_cos();
            at + vec3(1.1 * cosine, 0.35 * (2.0 * phase * TAU).sin(), 1.3 * sine)
        });
        stage.motion.turn(node, (LOOP, 80), |phase| {
            let turn = phase * TAU;
            Quat::from_euler(
                EulerRot::YXZ,
                turn,
                0.4 * turn.sin(),
                0.3 * (3.0 * turn).sin(),
            )
        });
        let drifting = (0..24).map(|i| loose(i + 40 * number as u32));
        stage.carry(&format!("leaves {}", number + 1), node, leaf, drifting);
    }
}

/// Three walls, and the returns that join them to the hall.
fn walls() -> Vec<Mesh> {
    let thick = 0.3;
    let gate = [vec2(-1.1, 0.0), vec2(1.1, 2.4)];
    let joint = |z: f32| {
        cuboid(
            vec3(HIGH.x - 0.1, 0.0, z - 0.5),
            vec3(HIGH.x + WALL - 0.1, HIGH.y - 0.01, z + 0.5),
            1,
        )
    };
    vec![
        joint(LOW.z + 0.2),
        joint(HIGH.z - 0.2),
        pierced(
            vec3(LOW.x - thick, 0.0, LOW.z - thick),
            vec3(LOW.x, HIGH.y, HIGH.z + thick),
            0,
            &[gate],
        ),
        cuboid(
            vec3(LOW.x, 0.0, LOW.z - thick),
            vec3(HIGH.x, HIGH.y, LOW.z),
            1,
        ),
        cuboid(
            vec3(LOW.x, 0.0, HIGH.z),
            vec3(HIGH.x, HIGH.y, HIGH.z + thick),
            1,
        ),
    ]
}

/// Copings, plinths, the kerb around the tree, benches and bollards.
fn trims(detail: u32) -> Vec<Mesh> {
    let block = |low: [f32; 3], high: [f32; 3]| cuboid(low.into(), high.into(), 1);
    let (top, x) = (HIGH.y, HIGH.x);
    let mut parts = vec![
        block(
            [LOW.x - 0.36, top, LOW.z - 0.36],
            [x, top + 0.1, LOW.z + 0.06],
        ),
        block(
            [LOW.x - 0.36, top, HIGH.z - 0.06],
            [x, top + 0.1, HIGH.z + 0.36],
        ),
        block(
            [LOW.x - 0.36, top, LOW.z + 0.06],
            [LOW.x + 0.06, top + 0.1, HIGH.z - 0.06],
        ),
        block([LOW.x, -0.01, LOW.z - 0.01], [x, 0.3, LOW.z + 0.05]),
        block([LOW.x, -0.01, HIGH.z - 0.05], [x, 0.3, HIGH.z + 0.01]),
    ];
    for side in [-1.0, 1.0] {
        let z = side * 4.6;
        for at in [-15.2, -11.8, -9.6] {
            parts.push(block([at - 0.8, 0.4, z - 0.25], [at + 0.8, 0.5, z + 0.25]));
            for leg in [at - 0.6, at + 0.4] {
                parts.push(block([leg, -0.01, z - 0.2], [leg + 0.2, 0.405, z + 0.2]));
            }
        }
        let bollard = Mat4::from_translation(vec3(-8.3, 0.0, side * (ARCH + 0.6)));
        parts.push(transformed(cylinder(0.14, 0.75, 16 * detail), &bollard));
    }
    let kerb = bow([1.0, 1.25], std::f32::consts::PI * 0.9999, 0.4, 40 * detail);
    let upright = Mat4::from_translation(TREE + Vec3::Y * 0.15) * Mat4::from_rotation_z(FRAC_PI_2);
    parts.push(transformed(kerb, &upright));
    parts
}

/// Trunk and boughs.
fn tree(detail: u32) -> Vec<Mesh> {
    let fork = TREE + vec3(0.1, 2.0, 0.05);
    let mut parts = vec![rod(TREE - Vec3::Y * 0.1, fork, 0.16, 10 * detail)];
    parts.extend((0..6).map(|i| {
        let angle = i as f32 / 6.0 * TAU;
        let reach = vec3(
            1.1 * angle.cos(),
            1.1 + 0.5 * lattice(i, 3),
            1.1 * angle.sin(),
        );
        rod(
            fork - Vec3::Y * 0.1 * lattice(i, 5),
            fork + reach,
            0.07,
            10 * detail,
        )
    }));
    parts
}

/// A random point of the cube from -1 to 1, and a number from 0 to 1.
fn random(index: u32, seed: u32) -> (Vec3, f32) {
    let part = |salt: u32| lattice(index, seed + salt) * 2.0 - 1.0;
    (vec3(part(0), part(1), part(2)), lattice(index, seed + 3))
}

fn leaf_quad(at: Vec3, side: f32, turn: Quat) -> Mesh {
    let corner = vec3(-side / 2.0, -side / 2.0, 0.0);
    let flat = quad(corner, Vec3::X * side, Vec3::Y * side, 1);
    transformed(flat, &Mat4::from_rotation_translation(turn, at))
}

/// A leaf of the tree's crown.
fn foliage(index: u32) -> Mesh {
    let (direction, part) = random(index, 31);
    let reach = vec3(1.7, 1.1, 1.7) * part.sqrt();
    let at = TREE + Vec3::Y * 3.3 + direction.normalize_or(Vec3::Y) * reach;
    let (turn, size) = random(index, 47);
    let turn = Quat::from_euler(EulerRot::YXZ, 3.0 * turn.x, 1.4 * turn.y, 3.0 * turn.z);
    leaf_quad(at, 0.1 + 0.1 * size, turn)
}

/// A leaf in the air, about its node.
fn loose(index: u32) -> Mesh {
    let (place, size) = random(index, 61);
    let (turn, _) = random(index, 73);
    let turn = Quat::from_euler(EulerRot::YXZ, 3.0 * turn.x, 1.5 * turn.y, 0.0);
    leaf_quad(place * vec3(1.0, 0.7, 1.0), 0.07 + 0.05 * size, turn)
}

/// The gate in the far wall, shut.
fn gate(detail: u32) -> Vec<Mesh> {
    let x = LOW.x - 0.15;
    let mut parts = vec![cuboid(
        vec3(x - 0.03, 0.0, -1.11),
        vec3(x + 0.03, 2.41, 1.11),
        1,
    )];
    for z in [-1.05, -0.03, 0.97] {
        parts.push(cuboid(
            vec3(x - 0.05, 0.02, z),
            vec3(x + 0.05, 2.39, z + 0.08),
            1,
        ));
    }
    for y in [0.1, 1.1, 2.2] {
        parts.push(cuboid(
            vec3(x - 0.045, y, -1.0),
            vec3(x + 0.045, y + 0.1, 1.0),
            1,
        ));
    }
    let handle = Mat4::from_translation(vec3(x + 0.09, 0.95, 0.12));
    parts.push(transformed(cylinder(0.02, 0.3, 8 * detail), &handle));
    parts
}
