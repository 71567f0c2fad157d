//! Two robots that walk: skinned meshes on skeletons of 13 joints, one round the basin, one on the gallery.

use std::f32::consts::TAU;

use glam::{Mat4, Quat, Vec3, vec3};

use super::stage::Stage;
use super::walk::{ANKLE, Gait, HIPS, Path, SHIN, THIGH, Walk};
use super::{GALLERY, LOOP};
use crate::Mesh;
use crate::animation::{Deformer, Influences, Skin};
use crate::builtin::shapes::{cuboid, cylinder, hexahedron, join, lofted, sphere, transformed};

/// Height of the hips at rest (m).
const HIP: f32 = THIGH + SHIN + ANKLE;

/// Parent and place of each joint at rest (m). The body faces +Z; its left is +X.
const JOINTS: [(usize, Vec3); 13] = [
    (PELVIS, vec3(0.0, HIP, 0.0)),
    (PELVIS, vec3(0.0, HIP + 0.12, 0.0)),
    (TORSO, vec3(0.0, HIP + 0.6, 0.0)),
    (TORSO, vec3(0.25, HIP + 0.5, 0.0)),
    (TORSO, vec3(-0.25, HIP + 0.5, 0.0)),
    (3, vec3(0.27, HIP + 0.22, 0.0)),
    (4, vec3(-0.27, HIP + 0.22, 0.0)),
    (PELVIS, vec3(HIPS, HIP, 0.0)),
    (PELVIS, vec3(-HIPS, HIP, 0.0)),
    (7, vec3(HIPS, HIP - THIGH, 0.0)),
    (8, vec3(-HIPS, HIP - THIGH, 0.0)),
    (9, vec3(HIPS, ANKLE, 0.0)),
    (10, vec3(-HIPS, ANKLE, 0.0)),
];
const PELVIS: usize = 0;
const TORSO: usize = 1;
const HEAD: usize = 2;
/// The left one; the right one follows.
const UPPER_ARM: usize = 3;
const FOREARM: usize = 5;
const LEG: usize = 7;

pub fn add(stage: &mut Stage) {
    let around_basin = Walk {
        path: Path {
            middle: vec3(-1.1, 0.0, 0.9),
            half: 2.3,
            radius: 2.1,
        },
        cycles: 20,
        period: LOOP,
    };
    let on_gallery = Walk {
        path: Path {
            middle: vec3(-2.3, GALLERY, -3.4),
            half: 1.6,
            radius: 0.42,
        },
        cycles: 10,
        period: LOOP / 2.0,
    };
    robot(stage, "robot", &around_basin, vec3(0.72, 0.7, 0.66), 0.86);
    robot(
        stage,
        "gallery robot",
        &on_gallery,
        vec3(0.65, 0.3, 0.07),
        0.1,
    );
}

/// A robot whose plates have the given colour. `start`: the part of its path at which it is at time 0.
fn robot(stage: &mut Stage, name: &str, walk: &Walk, plates: Vec3, start: f32) {
    let motion = &mut stage.motion;
    let mut nodes = Vec::new();
    for (joint, (parent, at)) in JOINTS.into_iter().enumerate() {
        let (parent, from) = match joint {
            PELVIS => (None, Vec3::ZERO),
            _ => (Some(nodes[parent]), JOINTS[parent].1),
        };
        nodes.push(motion.node(parent, Mat4::from_translation(at - from)));
    }
    let pace = (walk.period, 16 * walk.cycles as usize);
    let gait = |phase: f32| walk.gait(phase + start);
    motion.slide(nodes[PELVIS], pace, |phase| gait(phase).pelvis);
    for (joint, node) in nodes.iter().enumerate() {
        motion.turn(*node, pace, |phase| {
            let gait = gait(phase);
            let own = rotation(&gait, joint);
            match joint {
                PELVIS => own,
                _ => rotation(&gait, JOINTS[joint].0).inverse() * own,
            }
        });
    }
    let parts = body(stage.detail);
    let mut joints = Vec::new();
    let mut colors = Vec::new();
    for (joint, color, mesh) in &parts {
        let color = if *color {
            plates
        } else {
            vec3(0.06, 0.065, 0.075)
        };
        joints.extend(mesh.positions.iter().map(|_| (*joint as u32, 1.0)));
        colors.extend(mesh.positions.iter().map(|_| color.extend(1.0)));
    }
    let meshes = parts.into_iter().map(|(_, _, mesh)| mesh);
    let mesh = Mesh {
        colors,
        ..join(name, meshes)
    };
    let rig = &mut stage.motion.rig;
    rig.skins.push(Skin {
        joints: nodes.clone(),
        joint_from_mesh: JOINTS.map(|(_, at)| Mat4::from_translation(-at)).into(),
    });
    let influences = Influences {
        per_vertex: 1,
        joints,
    };
    let (positions, normals) = (mesh.positions.clone(), mesh.normals.clone());
    let mesh = stage.scene.add_mesh(mesh);
    let shell = stage.palette.shell.material;
    let instance = stage.scene.add_instance(name, mesh, shell, Mat4::IDENTITY);
    stage.scene.instances[instance].node = Some(nodes[PELVIS]);
    rig.deformers.push(Deformer {
        instance,
        node: nodes[PELVIS],
        positions,
        normals,
        tangents: Vec::new(),
        flat: false,
        targets: Vec::new(),
        skin: Some((rig.skins.len() - 1, influences)),
    });
}

/// Rotation of a joint in the world.
fn rotation(gait: &Gait, joint: usize) -> Quat {
    let heading = gait.heading;
    // Arms swing against the legs.
    let swing = (TAU * (gait.cycle + 0.2)).cos();
    let twist = heading * Quat::from_rotation_y(0.1 * swing);
    let side = |first: usize| if joint == first { 1.0 } else { -1.0 };
    match joint {
        PELVIS => heading * Quat::from_rotation_y(-0.08 * swing),
        TORSO => twist * Quat::from_rotation_x(0.04),
        HEAD => heading,
        UPPER_ARM | 4 => {
            let out = Quat::from_rotation_z(0.08 * side(UPPER_ARM));
            twist * Quat::from_rotation_x(0.5 * swing * side(UPPER_ARM)) * out
        }
        FOREARM | 6 => {
            let bend = -0.35 + 0.5 * swing * side(FOREARM) - 0.12;
            twist * Quat::from_rotation_x(bend)
        }
        _ => {
            let number = joint - LEG;
            gait.legs[number % 2][number / 2]
        }
    }
}

/// The parts: joint, whether it is a plate, and mesh at rest.
fn body(detail: u32) -> Vec<(usize, bool, Mesh)> {
    let segments = 10 * detail;
    let mut parts = Vec::new();
    let at = |joint: usize| JOINTS[joint].1;
    let moved = |mesh: Mesh, place: Vec3| transformed(mesh, &Mat4::from_translation(place));
    let block = |low: Vec3, high: Vec3| cuboid(low, high, 1);
    // A plate that narrows downward: half sizes of its top and bottom (x, z), between two heights.
    let plate = |middle: Vec3, top: [f32; 2], bottom: [f32; 2], low: f32, high: f32| {
        let level = |[x, z]: [f32; 2], y: f32| {
            [(-x, z), (x, z), (x, -z), (-x, -z)].map(|(x, z)| middle + vec3(x, y, z))
        };
        hexahedron(level(bottom, low), level(top, high), 1)
    };
    // A rounded shell around a bone.
    let shell = |from: Vec3, length: f32, half: [f32; 2]| {
        let hull = lofted(2 * segments, segments, |down, turn| {
            let (sine, cosine) = (turn * TAU).sin_cos();
            let open =
                (1.0 - (2.0 * down - 1.0).abs().powi(4)).max(0.0).sqrt() * (1.15 - 0.35 * down);
            vec3(
                half[0] * sine * open,
                -length * down,
                half[1] * cosine * open,
            )
        });
        moved(hull, from)
    };
    let ball = |place: Vec3, radius: f32| moved(sphere(radius, segments), place);
    let hips = at(PELVIS);
    parts.push((PELVIS, false, ball(hips + vec3(0.0, 0.03, 0.0), 0.12)));
    parts.push((
        PELVIS,
        true,
        plate(hips, [0.15, 0.1], [0.08, 0.07], -0.1, 0.07),
    ));
    let chest = at(TORSO);
    parts.push((
        TORSO,
        false,
        moved(cylinder(0.09, 0.2, 2 * segments), chest - Vec3::Y * 0.05),
    ));
    parts.push((
        TORSO,
        true,
        plate(chest, [0.21, 0.13], [0.14, 0.1], 0.1, 0.42),
    ));
    parts.push((
        TORSO,
        true,
        plate(
            chest + vec3(0.0, 0.0, -0.16),
            [0.12, 0.06],
            [0.12, 0.05],
            0.12,
            0.4,
        ),
    ));
    parts.push((
        TORSO,
        false,
        block(
            chest + vec3(-0.07, 0.24, 0.1),
            chest + vec3(0.07, 0.34, 0.135),
        ),
    ));
    let neck = at(HEAD);
    parts.push((
        HEAD,
        false,
        moved(cylinder(0.05, 0.2, 2 * segments), neck - Vec3::Y * 0.1),
    ));
    parts.push((HEAD, true, shell(neck + Vec3::Y * 0.3, 0.26, [0.11, 0.12])));
    parts.push((
        HEAD,
        false,
        block(
            neck + vec3(-0.085, 0.14, 0.02),
            neck + vec3(0.085, 0.2, 0.125),
        ),
    ));
    for (number, side) in [1.0, -1.0].into_iter().enumerate() {
        let [upper, fore, thigh] = [UPPER_ARM, FOREARM, LEG].map(|first| first + number);
        let (shin, foot) = (thigh + 2, thigh + 4);
        parts.push((upper, false, ball(at(upper), 0.075)));
        parts.push((
            upper,
            true,
            shell(
                at(upper) + vec3(0.02 * side, 0.06, 0.0),
                0.3,
                [0.065, 0.075],
            ),
        ));
        parts.push((fore, false, ball(at(fore), 0.05)));
        parts.push((
            fore,
            true,
            shell(at(fore) - Vec3::Y * 0.02, 0.27, [0.05, 0.055]),
        ));
        parts.push((fore, false, ball(at(fore) - Vec3::Y * 0.3, 0.048)));
        parts.push((thigh, false, ball(at(thigh), 0.09)));
        parts.push((
            thigh,
            true,
            shell(at(thigh) - Vec3::Y * 0.03, THIGH - 0.07, [0.08, 0.09]),
        ));
        parts.push((shin, false, ball(at(shin), 0.062)));
        parts.push((
            shin,
            true,
            shell(at(shin) - Vec3::Y * 0.02, SHIN - 0.05, [0.062, 0.075]),
        ));
        let sole = at(foot) - Vec3::Y * ANKLE;
        parts.push((foot, false, ball(at(foot), 0.05)));
        parts.push((
            foot,
            true,
            plate(
                sole + Vec3::Z * 0.05,
                [0.045, 0.08],
                [0.06, 0.14],
                0.0,
                0.09,
            ),
        ));
    }
    parts
}
