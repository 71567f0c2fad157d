//! The building: floor, walls with windows and arch, the ribbed vault and the gallery.

use std::f32::consts::FRAC_PI_2;

use glam::{Mat4, Vec2, Vec3, vec2, vec3};

use super::basin;
use super::stage::Stage;
use super::{CROWN, EAVES, EDGE, GALLERY, HALF, LANDING, WALL};
use crate::Mesh;
use crate::builtin::shapes::{bow, cuboid, cylinder, hexahedron, pierced, transformed};

/// Middles of the windows along x; their half width, sill and top (m).
const WINDOWS: [f32; 4] = [-4.8, -1.6, 1.6, 4.8];
const WINDOW: f32 = 1.0;
const SILL: f32 = 1.05;
const HEAD: f32 = 4.6;
/// Pilasters and ribs along x (m).
const RIBS: [f32; 5] = [-6.75, -3.2, 0.0, 3.2, 6.75];
/// The arch: half its width, and the height at which it starts (m).
pub const ARCH: f32 = 1.5;
pub const SPRING: f32 = 2.3;
/// The doorway in the north wall: left and right along x, and the height of the door (m).
pub const DOORWAY: [f32; 2] = [2.1, 3.2];
pub const DOOR: f32 = 2.1;

pub fn add(stage: &mut Stage) {
    let palette = &stage.palette;
    let (stone, trim, plates) = (palette.stone, palette.trim, palette.plates);
    let (steel, plaster, wood) = (palette.steel, palette.plaster, palette.wood);
    let detail = stage.detail;
    stage.place("floor", plates, [floor()]);
    stage.place("walls", stone, walls(detail));
    stage.place("vault", plaster, [vault(0.0, 0.3, 14.2, 24 * detail)]);
    let ribs = RIBS.map(|x| transformed(vault(-0.22, 0.05, 0.26, 24 * detail), &shift(x)));
    stage.place("ribs", steel, ribs.into_iter().chain(ties(detail)));
    stage.place("trims", trim, trims(detail));
    stage.place("window frames", steel, WINDOWS.into_iter().flat_map(frame));
    stage.place("gallery", wood, [gallery()]);
    stage.place("gallery steel", steel, gallery_steel(detail));
    stage.place("chamber", plaster, chamber());
}

fn shift(x: f32) -> Mat4 {
    Mat4::from_translation(Vec3::X * x)
}

/// A bar along the vault, between two distances above its surface (m).
fn vault(below: f32, above: f32, length: f32, steps: u32) -> Mesh {
    let rise = CROWN - EAVES;
    let radius = (HALF.y * HALF.y + rise * rise) / (2.0 * rise);
    // A little wider than the hall, so that walls and vault meet without a gap.
    let half_angle = ((HALF.y + 0.06) / radius).asin();
    let bar = bow([radius + below, radius + above], half_angle, length, steps);
    transformed(bar, &Mat4::from_translation(Vec3::Y * (CROWN - radius)))
}

fn floor() -> Mesh {
    let (low, high) = (basin::LOW, basin::HIGH);
    let hole = [vec2(low.x, low.z), vec2(high.x, high.z)];
    pierced(
        vec3(-HALF.x - WALL, -0.3, -HALF.y - 3.0),
        vec3(HALF.x + WALL, 0.0, HALF.y + WALL),
        1,
        &[hole],
    )
}

fn walls(detail: u32) -> Vec<Mesh> {
    let top = EAVES + 0.35;
    let windows = WINDOWS.map(|x| [vec2(x - WINDOW, SILL), vec2(x + WINDOW, HEAD)]);
    let [left, right] = DOORWAY;
    let door = [vec2(left, 0.0), vec2(right, DOOR)];
    let arch_top = SPRING + ARCH;
    let arch = [vec2(-ARCH, 0.0), vec2(ARCH, arch_top)];
    let (x, z) = (HALF.x, HALF.y);
    let gable = CROWN + 0.6;
    let mut parts = vec![
        pierced(vec3(-x, 0.0, z), vec3(x, top, z + WALL), 2, &windows),
        pierced(vec3(-x, 0.0, -z - WALL), vec3(x, top, -z), 2, &[door]),
        pierced(
            vec3(-x - WALL, 0.0, -z - WALL),
            vec3(-x, gable, z + WALL),
            0,
            &[arch],
        ),
        cuboid(vec3(x, 0.0, -z - WALL), vec3(x + WALL, gable, z + WALL), 1),
    ];
    parts.extend(spandrels(detail));
    parts
}

/// Fills the opening of the arch above its curve.
fn spandrels(detail: u32) -> impl Iterator<Item = Mesh> {
    let steps = 16 * detail;
    let on_arch =
        move |step: u32| Vec2::from_angle(std::f32::consts::PI * step as f32 / steps as f32) * ARCH;
    (0..steps).map(move |step| {
        let [right, left] = [on_arch(step), on_arch(step + 1)];
        let x = [-HALF.x - WALL, -HALF.x];
        let level = |heights: [f32; 2]| {
            let at = |x: f32, p: Vec2, height: f32| vec3(x, SPRING + height, p.x);
            [
                at(x[0], right, heights[0]),
                at(x[1], right, heights[0]),
                at(x[1], left, heights[1]),
                at(x[0], left, heights[1]),
            ]
        };
        // Bedded in the wall above.
        hexahedron(level([right.y, left.y]), level([ARCH + 0.01; 2]), 1)
    })
}

/// Rods across the hall below the vault.
fn ties(detail: u32) -> Vec<Mesh> {
    let rod = |x: f32| {
        let place = Mat4::from_translation(vec3(x, EAVES - 0.1, -HALF.y))
            * Mat4::from_rotation_x(FRAC_PI_2);
        transformed(cylinder(0.025, 2.0 * HALF.y, 8 * detail), &place)
    };
    RIBS[1..4].iter().map(|x| rod(*x)).collect()
}

/// Pilasters, plinths, cornices, sills, lintels, and the ring of the arch.
fn trims(detail: u32) -> Vec<Mesh> {
    let (x, z) = (HALF.x, HALF.y);
    let block = |low: [f32; 3], high: [f32; 3]| cuboid(low.into(), high.into(), 1);
    let mut parts = Vec::new();
    for at in RIBS {
        for side in [-1.0, 1.0] {
            let depth = |from: f32, to: f32| {
                let ends = [side * (z - from), side * (z + to)];
                [ends[0].min(ends[1]), ends[0].max(ends[1])]
            };
            let post = |half: f32, [low, high]: [f32; 2], out: f32| {
                let [near, far] = depth(out, 0.02);
                block([at - half, low, near], [at + half, high, far])
            };
            parts.push(post(0.22, [0.0, EAVES + 0.12], 0.2));
            parts.push(post(0.28, [-0.01, 0.4], 0.26));
            parts.push(post(0.28, [EAVES - 0.3, EAVES - 0.12], 0.26));
        }
    }
    // Along the long walls, between the pilasters: plinth and cornice.
    for pair in RIBS.windows(2) {
        let [left, right] = [pair[0] + 0.21, pair[1] - 0.21];
        parts.push(block([left, -0.01, z - 0.05], [right, 0.22, z + 0.02]));
        parts.push(block(
            [left, EAVES - 0.25, z - 0.1],
            [right, EAVES - 0.1, z + 0.02],
        ));
        parts.push(block(
            [left, EAVES - 0.25, -z - 0.02],
            [right, EAVES - 0.1, 0.1 - z],
        ));
    }
    for at in WINDOWS {
        let (left, right) = (at - WINDOW - 0.12, at + WINDOW + 0.12);
        parts.push(block(
            [left, SILL - 0.07, z - 0.12],
            [right, SILL + 0.02, z + WALL + 0.08],
        ));
        parts.push(block(
            [left, HEAD - 0.02, z - 0.06],
            [right, HEAD + 0.16, z + 0.1],
        ));
        for jamb in [left, right - 0.14] {
            parts.push(block(
                [jamb, SILL + 0.02, z - 0.04],
                [jamb + 0.14, HEAD - 0.02, z + 0.1],
            ));
        }
    }
    let ring = bow(
        [ARCH - 0.02, ARCH + 0.24],
        FRAC_PI_2,
        WALL + 0.12,
        20 * detail,
    );
    let middle = vec3(-x - WALL / 2.0, SPRING, 0.0);
    parts.push(transformed(ring, &Mat4::from_translation(middle)));
    for side in [-1.0, 1.0] {
        let ends = [side * (ARCH - 0.02), side * (ARCH + 0.24)];
        let (near, far) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        parts.push(block(
            [-x - WALL - 0.06, -0.01, near],
            [0.06 - x, SPRING - 0.001, far],
        ));
    }
    // Steps of the west wall on either side of the arch: plinth.
    for side in [-1.0, 1.0] {
        let ends = [side * (ARCH + 0.24), side * z];
        let (near, far) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        parts.push(block([-x - 0.02, -0.01, near], [0.05 - x, 0.22, far]));
    }
    let [left, right] = DOORWAY;
    parts.push(block(
        [left - 0.14, -0.01, -z - 0.02],
        [left, DOOR, 0.06 - z],
    ));
    parts.push(block(
        [right, -0.01, -z - 0.02],
        [right + 0.14, DOOR, 0.06 - z],
    ));
    parts.push(block(
        [left - 0.14, DOOR, -z - 0.02],
        [right + 0.14, DOOR + 0.16, 0.06 - z],
    ));
    parts
}

/// Frame and bars of a window.
fn frame(x: f32) -> Vec<Mesh> {
    let z = HALF.y + WALL / 2.0;
    let bar = |low: Vec2, high: Vec2, depth: f32| {
        cuboid(low.extend(z - depth), high.extend(z + depth), 1)
    };
    let (left, right) = (x - WINDOW - 0.01, x + WINDOW + 0.01);
    let upright = |at: f32, half: f32, depth: f32| {
        bar(vec2(at - half, SILL), vec2(at + half, HEAD + 0.01), depth)
    };
    let across =
        |at: f32, half: f32, depth: f32| bar(vec2(left, at - half), vec2(right, at + half), depth);
    let third = (HEAD - SILL) / 4.0;
    let mut parts = vec![
        upright(left + 0.035, 0.035, 0.05),
        upright(right - 0.035, 0.035, 0.05),
        across(SILL + 0.05, 0.035, 0.048),
        across(HEAD - 0.03, 0.035, 0.048),
    ];
    parts.extend([-1.0, 1.0].map(|side| upright(x + side * WINDOW / 3.0, 0.018, 0.03)));
    parts.extend((1..4).map(|i| across(SILL + third * i as f32, 0.018, 0.028)));
    parts
}

fn gallery() -> Mesh {
    cuboid(
        vec3(LANDING, GALLERY - 0.1, -HALF.y - 0.01),
        vec3(HALF.x + 0.01, GALLERY, EDGE),
        1,
    )
}

/// Beams and columns below the gallery, and its railing.
fn gallery_steel(detail: u32) -> Vec<Mesh> {
    let under = GALLERY - 0.1;
    let block = |low: [f32; 3], high: [f32; 3]| cuboid(low.into(), high.into(), 1);
    let (x, z) = (HALF.x, HALF.y);
    let mut parts = vec![
        block(
            [LANDING, under - 0.24, EDGE - 0.1],
            [x + 0.01, under + 0.005, EDGE - 0.02],
        ),
        block(
            [LANDING - 0.02, under - 0.02, EDGE],
            [x, GALLERY + 0.05, EDGE + 0.025],
        ),
        block(
            [LANDING, under - 0.24, -z - 0.01],
            [x + 0.01, under + 0.005, 0.08 - z],
        ),
    ];
    let joists = (0..12).map(|i| {
        let at = LANDING + 0.02 + i as f32 * 1.05;
        block(
            [at, under - 0.16, 0.07 - z],
            [at + 0.08, under + 0.006, EDGE - 0.09],
        )
    });
    parts.extend(joists);
    for at in [LANDING + 0.1, -1.6, 1.6, 4.8] {
        let foot = Mat4::from_translation(vec3(at, 0.0, EDGE - 0.06));
        parts.push(transformed(
            cylinder(0.075, under - 0.23, 12 * detail),
            &foot,
        ));
        parts.push(block(
            [at - 0.15, 0.0, EDGE - 0.21],
            [at + 0.15, 0.02, EDGE + 0.09],
        ));
        parts.push(block(
            [at - 0.12, under - 0.27, EDGE - 0.18],
            [at + 0.12, under - 0.23, EDGE + 0.06],
        ));
    }
    parts.extend(railing(detail));
    parts
}

/// Posts, handrail and thin bars along the gallery's edge.
fn railing(detail: u32) -> Vec<Mesh> {
    let z = EDGE - 0.04;
    let length = HALF.x - LANDING;
    let along = |height: f32, radius: f32| {
        let place = Mat4::from_translation(vec3(HALF.x, GALLERY + height, z))
            * Mat4::from_rotation_z(FRAC_PI_2);
        transformed(cylinder(radius, length, 8 * detail), &place)
    };
    let mut parts: Vec<Mesh> = [(1.05, 0.028), (0.79, 0.01), (0.54, 0.01), (0.29, 0.01)]
        .map(|(height, radius)| along(height, radius))
        .into();
    parts.extend((0..11).map(|i| {
        let x = LANDING + 0.05 + i as f32 * length / 10.04;
        let foot = Mat4::from_translation(vec3(x, GALLERY - 0.01, z));
        transformed(cylinder(0.022, 1.05, 6 * detail), &foot)
    }));
    parts
}

/// The room behind the door: walls and ceiling around a space of 3 m x 2.4 m.
fn chamber() -> [Mesh; 4] {
    let [left, right] = [DOORWAY[0] - 0.8, DOORWAY[1] + 0.8];
    let (front, back) = (-HALF.y - WALL, -HALF.y - WALL - 2.4);
    let block = |low: [f32; 3], high: [f32; 3]| cuboid(low.into(), high.into(), 1);
    [
        block([left - 0.2, 0.0, back - 0.2], [left, 2.7, front]),
        block([right, 0.0, back - 0.2], [right + 0.2, 2.7, front]),
        block([left, 0.0, back - 0.2], [right, 2.7, back]),
        block(
            [left - 0.2, 2.5, back - 0.19],
            [right + 0.2, 2.8, front + 0.01],
        ),
    ]
}
