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
    // It ends inside the walls of the basin.
    let (low, high) = (basin::LOW - 0.1, basin::HIGH + 0.1);
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
        let place = Mat4::from_translation(vec3(x, EAVES + 0.3, -HALF.y))
            * Mat4::from_rotation_x(FRAC_PI_2);
        transformed(cylinder(0.025, 2.0 * HALF.y, 8 * detail), &place)
    };
    RIBS[1..4].iter().map(|x| rod(*x)).collect()
}

/// Pilasters, mouldings, cases of windows and door, and the ring of the arch.
fn trims(detail: u32) -> Vec<Mesh> {
    let mut parts = mouldings();
    parts.extend(RIBS.into_iter().flat_map(pilasters));
    parts.extend(WINDOWS.into_iter().flat_map(window_case));
    parts.extend(door_case());
    parts.extend(arch_ring(detail));
    parts
}

fn block(low: [f32; 3], high: [f32; 3]) -> Mesh {
    cuboid(low.into(), high.into(), 1)
}

/// `from` and `to` in ascending order, on the positive or the negative side of an axis.
fn on_side(side: f32, from: f32, to: f32) -> [f32; 2] {
    if side > 0.0 { [from, to] } else { [-to, -from] }
}

/// The pilasters of both long walls that carry a rib.
fn pilasters(x: f32) -> Vec<Mesh> {
    let post = |side: f32, half: f32, [low, high]: [f32; 2], depth: f32| {
        let [near, far] = on_side(side, HALF.y - depth, HALF.y + 0.02);
        block([x - half, low, near], [x + half, high, far])
    };
    let of_side = |side: f32| {
        [
            post(side, 0.22, [0.0, EAVES + 0.12], 0.2),
            post(side, 0.28, [-0.01, 0.4], 0.26),
            post(side, 0.28, [EAVES - 0.3, EAVES - 0.12], 0.26),
        ]
    };
    [-1.0, 1.0].into_iter().flat_map(of_side).collect()
}

/// Plinths and cornices between the pilasters, the plinths beside the arch, and the coping toward the courtyard.
fn mouldings() -> Vec<Mesh> {
    let (x, z) = (HALF.x, HALF.y);
    let cornice = [EAVES - 0.25, EAVES - 0.1];
    let mut parts = Vec::new();
    for pair in RIBS.windows(2) {
        let [left, right] = [pair[0] + 0.21, pair[1] - 0.21];
        parts.push(block([left, -0.01, z - 0.05], [right, 0.22, z + 0.02]));
        for side in [-1.0, 1.0] {
            let [near, far] = on_side(side, z - 0.1, z + 0.02);
            parts.push(block([left, cornice[0], near], [right, cornice[1], far]));
        }
    }
    for side in [-1.0, 1.0] {
        let [near, far] = on_side(side, ARCH + 0.24, z);
        parts.push(block([-x - 0.02, -0.01, near], [0.05 - x, 0.22, far]));
    }
    let (top, end) = (CROWN + 0.6, z + WALL + 0.1);
    parts.push(block(
        [-x - WALL - 0.15, top - 0.12, -end],
        [-x + 0.01, top + 0.12, end],
    ));
    parts
}

/// Sill, lintel and jambs of a window.
fn window_case(x: f32) -> [Mesh; 4] {
    let z = HALF.y;
    let (left, right) = (x - WINDOW - 0.12, x + WINDOW + 0.12);
    let jamb = |at: f32| {
        block(
            [at, SILL + 0.02, z - 0.04],
            [at + 0.14, HEAD - 0.02, z + 0.1],
        )
    };
    [
        block(
            [left, SILL - 0.07, z - 0.12],
            [right, SILL + 0.02, z + WALL + 0.08],
        ),
        block([left, HEAD - 0.02, z - 0.06], [right, HEAD + 0.16, z + 0.1]),
        jamb(left),
        jamb(right - 0.14),
    ]
}

fn door_case() -> [Mesh; 3] {
    let [left, right] = DOORWAY;
    let (far, near) = (-HALF.y - 0.02, 0.06 - HALF.y);
    [
        block([left - 0.14, -0.01, far], [left, DOOR, near]),
        block([right, -0.01, far], [right + 0.14, DOOR, near]),
        block([left - 0.14, DOOR, far], [right + 0.14, DOOR + 0.16, near]),
    ]
}

/// The ring of the arch and its posts, on both faces of the wall.
fn arch_ring(detail: u32) -> [Mesh; 3] {
    let (inner, outer) = (ARCH - 0.02, ARCH + 0.24);
    let ring = bow([inner, outer], FRAC_PI_2, WALL + 0.12, 20 * detail);
    let middle = vec3(-HALF.x - WALL / 2.0, SPRING, 0.0);
    let post = |side: f32| {
        let [near, far] = on_side(side, inner, outer);
        block(
            [-HALF.x - WALL - 0.06, -0.01, near],
            [0.06 - HALF.x, SPRING - 0.001, far],
        )
    };
    let ring = transformed(ring, &Mat4::from_translation(middle));
    [ring, post(-1.0), post(1.0)]
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
    let quarter = (HEAD - SILL) / 4.0;
    let mut parts = vec![
        upright(left + 0.035, 0.035, 0.05),
        upright(right - 0.035, 0.035, 0.05),
        across(SILL + 0.05, 0.035, 0.048),
        across(HEAD - 0.03, 0.035, 0.048),
    ];
    parts.extend([-1.0, 1.0].map(|side| upright(x + side * WINDOW / 3.0, 0.018, 0.03)));
    parts.extend((1..4).map(|i| across(SILL + quarter * i as f32, 0.018, 0.028)));
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
