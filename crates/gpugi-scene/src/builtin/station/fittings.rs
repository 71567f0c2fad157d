//! What stands about in the hall: benches, crates, pipes, consoles with screens, a mirror, and the statue in its corner.

use std::f32::consts::{PI, TAU};

use glam::{Mat4, Vec2, Vec3, vec2, vec3};

use super::motion::sampled;
use super::stage::Stage;
use super::{GALLERY, HALF};
use crate::builtin::shapes::{
    cuboid, cylinder, join, lofted, quad, rod, sphere, torus, transformed,
};
use crate::{Light, LightKind, Mesh};

/// Foot of the statue's plinth (m).
const STATUE: Vec3 = vec3(-6.1, 0.0, 3.45);

pub fn add(stage: &mut Stage) {
    let palette = &stage.palette;
    let (wood, steel, rust, brushed) = (palette.wood, palette.steel, palette.rust, palette.brushed);
    let (paint, screen, mirror) = (palette.paint, palette.screen, palette.mirror);
    let (marble, trim, glow) = (palette.marble, palette.trim, palette.glow);
    let detail = stage.detail;
    stage.place("benches", wood, BENCHES.into_iter().flat_map(bench_top));
    stage.place(
        "bench legs",
        steel,
        BENCHES.into_iter().flat_map(bench_legs),
    );
    stage.place(
        "crates",
        wood,
        CRATES.into_iter().map(|(at, size)| crate_core(at, size)),
    );
    stage.place(
        "crate bands",
        rust,
        CRATES.into_iter().flat_map(|(at, size)| bands(at, size)),
    );
    stage.place(
        "barrels",
        rust,
        BARRELS.into_iter().map(|at| barrel(at, detail)),
    );
    stage.place("pipes", rust, pipes(detail));
    stage.place("ducts", brushed, ducts(detail));
    stage.place("wall panels", paint, panels());
    stage.place("consoles", steel, CONSOLES.into_iter().flat_map(console));
    stage.place("screens", screen, CONSOLES.into_iter().map(display));
    stage.place("mirror", mirror, [pane()]);
    stage.place("mirror frame", wood, mirror_frame());
    stage.place("lamps", glow, SCONCES.into_iter().map(lit));
    stage.place("lamp holders", steel, SCONCES.into_iter().flat_map(holder));
    stage.place("statue", marble, statue(detail));
    stage.place("plinth", trim, plinth());

    let cone = LightKind::Spot {
        inner_cone_angle: 14.0_f32.to_radians(),
        outer_cone_angle: 24.0_f32.to_radians(),
    };
    let mut spot = Light::new("statue spot", cone, vec3(55.0, 46.0, 34.0))
        .aimed(vec3(-4.2, 4.6, 1.2), STATUE + Vec3::Y * 1.6);
    spot.radius = 0.04;
    stage.scene.lights.push(spot);
}

/// Middles of benches along the south wall (m).
const BENCHES: [f32; 3] = [-1.6, 1.6, 4.8];

fn bench_top(x: f32) -> Vec<Mesh> {
    let z = HALF.y - 0.5;
    (0..3)
        .map(|i| {
            let front = z - 0.24 + 0.16 * i as f32;
            cuboid(
                vec3(x - 1.0, 0.42, front),
                vec3(x + 1.0, 0.47, front + 0.14),
                1,
            )
        })
        .collect()
}

fn bench_legs(x: f32) -> Vec<Mesh> {
    let z = HALF.y - 0.5;
    let mut parts = Vec::new();
    for at in [x - 0.8, x + 0.74] {
        parts.push(cuboid(
            vec3(at, 0.38, z - 0.2),
            vec3(at + 0.06, 0.421, z + 0.2),
            1,
        ));
        for side in [-0.18, 0.12] {
            parts.push(cuboid(
                vec3(at, 0.0, z + side),
                vec3(at + 0.06, 0.381, z + side + 0.06),
                1,
            ));
        }
    }
    parts
}

/// Corners and sizes of crates (m).
const CRATES: [(Vec3, f32); 5] = [
    (vec3(5.75, 0.0, -4.25), 0.9),
    (vec3(4.75, 0.0, -4.3), 0.8),
    (vec3(5.85, 0.9, -4.2), 0.65),
    (vec3(5.9, GALLERY, -4.3), 0.8),
    (vec3(5.9, 0.0, -3.2), 0.6),
];

fn crate_core(at: Vec3, size: f32) -> Mesh {
    let inset = Vec3::splat(0.02);
    cuboid(at + inset.with_y(0.0), at + size - inset, 1)
}

/// Iron along the edges of a crate.
fn bands(at: Vec3, size: f32) -> Vec<Mesh> {
    let width = 0.07;
    let far = size - width;
    let mut parts = Vec::new();
    for axis in 0..3 {
        for corner in [
            vec2(0.0, 0.0),
            vec2(far, 0.0),
            vec2(0.0, far),
            vec2(far, far),
        ] {
            let mut low = Vec3::ZERO;
            let mut length = Vec3::splat(width);
            (low[(axis + 1) % 3], low[(axis + 2) % 3]) = (corner.x, corner.y);
            // Uprights stand between the others.
            let gap = if axis == 1 { width } else { 0.0 };
            let side = if axis == 2 { width } else { 0.0 };
            low[axis] = gap + side;
            length[axis] = size - 2.0 * (gap + side);
            parts.push(cuboid(at + low, at + low + length, 1));
        }
    }
    parts
}

const BARRELS: [Vec3; 3] = [
    vec3(6.4, 0.0, 3.9),
    vec3(6.5, 0.0, 3.15),
    vec3(3.9, 0.0, -4.05),
];

fn barrel(at: Vec3, detail: u32) -> Mesh {
    let columns = 20 * detail;
    let hoop = |y: f32| {
        let ring = torus(0.29, 0.02, 8 * detail);
        transformed(ring, &Mat4::from_translation(Vec3::Y * y))
    };
    let parts = [
        cylinder(0.29, 0.86, columns),
        hoop(0.04),
        hoop(0.3),
        hoop(0.58),
        hoop(0.84),
    ];
    transformed(join("barrel", parts), &Mat4::from_translation(at))
}

/// Pipes along the walls, with elbows that are balls, and flanges.
fn pipes(detail: u32) -> Vec<Mesh> {
    let columns = 14 * detail;
    let mut parts = Vec::new();
    let mut run = |points: &[Vec3], radius: f32| {
        for pair in points.windows(2) {
            parts.push(rod(pair[0], pair[1], radius, columns));
            let along = (pair[1] - pair[0]).normalize();
            for end in [pair[0] + along * 0.12, pair[1] - along * 0.16] {
                parts.push(rod(end, end + along * 0.04, radius * 1.45, columns));
            }
        }
        for point in &points[1..points.len() - 1] {
            let elbow = sphere(radius * 1.12, 8 * detail);
            parts.push(transformed(elbow, &Mat4::from_translation(*point)));
        }
    };
    let (x, z) = (HALF.x, HALF.y);
    for (offset, radius) in [(0.16, 0.07), (0.36, 0.05)] {
        let height = PIPES - offset;
        run(
            &[
                vec3(x - offset, -0.05, z - 0.75 - offset),
                vec3(x - offset, height, z - 0.75 - offset),
                vec3(x - offset, height, -z + 0.3),
            ],
            radius,
        );
        run(
            &[
                vec3(-x + offset, -0.05, -2.1 - offset),
                vec3(-x + offset, height, -2.1 - offset),
                vec3(-x + offset, height, z + 0.1),
            ],
            radius * 0.9,
        );
    }
    parts
}

/// Height of the highest pipe (m).
const PIPES: f32 = 4.9;

/// A ventilation duct under the gallery, with outlets, and the vent that smokes.
fn ducts(detail: u32) -> Vec<Mesh> {
    let y = GALLERY - 0.5;
    let z = -HALF.y + 0.45;
    let mut parts = vec![rod(
        vec3(-4.4, y, z),
        vec3(HALF.x + 0.05, y, z),
        0.17,
        24 * detail,
    )];
    parts.extend((0..6).map(|i| {
        let at = vec3(-3.6 + 2.0 * i as f32, y, z);
        rod(at, at + Vec3::X * 0.05, 0.19, 24 * detail)
    }));
    parts.extend([-2.6, 1.4, 5.4].map(|x| {
        cuboid(
            vec3(x - 0.15, y - 0.26, z - 0.1),
            vec3(x + 0.15, y - 0.1, z + 0.1),
            1,
        )
    }));
    let vent = super::air::VENT;
    let slat = |i: u32| {
        let at = vent.x - 0.3 + 0.1 * i as f32;
        cuboid(
            vec3(at, 0.015, vent.z - 0.3),
            vec3(at + 0.04, 0.05, vent.z + 0.3),
            1,
        )
    };
    parts.extend((0..7).map(slat));
    for side in [-0.34, 0.3] {
        parts.push(cuboid(
            vec3(vent.x - 0.34, -0.01, vent.z + side),
            vec3(vent.x + 0.34, 0.06, vent.z + side + 0.04),
            1,
        ));
    }
    parts
}

/// Painted panels along the north wall and the east wall.
fn panels() -> Vec<Mesh> {
    let z = -HALF.y;
    let mut parts: Vec<Mesh> = [-6.4, -5.4, -4.4, -2.9, 0.32, 4.2, 5.1, 5.9]
        .map(|x| cuboid(vec3(x, 0.15, z - 0.01), vec3(x + 0.8, 1.25, z + 0.035), 1))
        .into();
    parts.extend((0..5).map(|i| {
        let left = -3.9 + 1.4 * i as f32;
        cuboid(
            vec3(HALF.x - 0.035, 0.15, left),
            vec3(HALF.x + 0.01, 1.25, left + 1.2),
            1,
        )
    }));
    parts
}

/// Places of consoles under the gallery: the middle of their backs on the floor (m).
const CONSOLES: [Vec3; 3] = [
    vec3(-2.3, 0.0, -4.25),
    vec3(-0.9, 0.0, -4.25),
    vec3(0.9, GALLERY, -4.25),
];

/// A desk with a slanted board and a cabinet for a screen.
fn console(at: Vec3) -> Vec<Mesh> {
    let block =
        |low: [f32; 3], high: [f32; 3]| cuboid(at + Vec3::from(low), at + Vec3::from(high), 1);
    vec![
        block([-0.6, 0.0, 0.0], [0.6, 0.1, 0.5]),
        block([-0.55, 0.1, 0.0], [0.55, 0.78, 0.45]),
        block([-0.6, 0.78, -0.02], [0.6, 0.84, 0.62]),
        block([-0.55, 0.9, 0.05], [0.55, 1.6, 0.16]),
        block([-0.06, 0.84, 0.06], [0.06, 0.92, 0.14]),
    ]
}

fn display(at: Vec3) -> Mesh {
    quad(at + vec3(-0.5, 0.95, 0.162), Vec3::X, Vec3::Y * 0.6, 1)
}

/// The mirror on the east wall.
fn pane() -> Mesh {
    let x = HALF.x - 0.06;
    cuboid(vec3(x, 0.5, -1.6), vec3(x + 0.02, 2.5, -0.2), 1)
}

fn mirror_frame() -> [Mesh; 5] {
    let (near, far) = (HALF.x - 0.09, HALF.x + 0.01);
    let block = |low: Vec2, high: Vec2, near: f32| {
        cuboid(vec3(near, low.y, low.x), vec3(far, high.y, high.x), 1)
    };
    [
        block(vec2(-1.7, 0.4), vec2(-1.59, 2.6), near),
        block(vec2(-0.21, 0.4), vec2(-0.1, 2.6), near),
        block(vec2(-1.59, 0.4), vec2(-0.21, 0.51), near),
        block(vec2(-1.59, 2.49), vec2(-0.21, 2.6), near),
        block(vec2(-1.6, 0.5), vec2(-0.2, 2.5), HALF.x - 0.041),
    ]
}

/// Places of wall lamps on the north wall (m).
const SCONCES: [Vec3; 4] = [
    vec3(-4.0, 4.75, -HALF.y),
    vec3(1.6, 4.75, -HALF.y),
    vec3(4.9, 4.75, -HALF.y),
    vec3(-1.6, 1.95, -HALF.y),
];

fn lit(at: Vec3) -> Mesh {
    cuboid(
        at + vec3(-0.06, -0.16, 0.07),
        at + vec3(0.06, 0.16, 0.13),
        1,
    )
}

fn holder(at: Vec3) -> [Mesh; 3] {
    [
        cuboid(at + vec3(-0.1, -0.24, -0.01), at + vec3(0.1, 0.24, 0.04), 1),
        cuboid(at + vec3(-0.08, 0.16, 0.03), at + vec3(0.08, 0.19, 0.15), 1),
        cuboid(
            at + vec3(-0.08, -0.19, 0.03),
            at + vec3(0.08, -0.16, 0.15),
            1,
        ),
    ]
}

fn plinth() -> [Mesh; 3] {
    let half = |half: f32, y: f32| STATUE + vec3(half, y, half);
    let flat = |half: f32, y: f32| STATUE + vec3(-half, y, -half);
    [
        cuboid(flat(0.42, -0.01), half(0.42, 0.15), 1),
        cuboid(flat(0.34, 0.15), half(0.34, 0.7), 1),
        cuboid(flat(0.4, 0.7), half(0.4, 0.8), 1),
    ]
}

/// A figure in a long robe that holds up a ball.
fn statue(detail: u32) -> Vec<Mesh> {
    // Radius of the robe from shoulders to hem (m).
    const ROBE: [f32; 8] = [0.08, 0.2, 0.19, 0.15, 0.17, 0.21, 0.25, 0.3];
    let robe = lofted(64 * detail, 32 * detail, |down, turn| {
        // The first and last rows close the robe.
        let body = ((down - 0.02) / 0.96).clamp(0.0, 1.0);
        let is_end = down <= 0.0 || down >= 1.0;
        let folds = 1.0 + 0.13 * body * (9.0 * turn * TAU + 3.0 * body).sin();
        let (sine, cosine) = (turn * TAU).sin_cos();
        let around = vec3(sine, 0.0, 0.75 * cosine) * (sampled(&ROBE, body) * folds);
        let height = Vec3::Y * 1.42 * (1.0 - body);
        height + if is_end { Vec3::ZERO } else { around }
    });
    let lean = vec3(0.02, 0.0, 0.0);
    let part = |mesh: Mesh, at: Vec3| transformed(mesh, &Mat4::from_translation(at + lean));
    let segments = 14 * detail;
    let head = transformed(
        sphere(0.11, segments),
        &Mat4::from_scale(vec3(0.9, 1.25, 1.0)),
    );
    let hair = transformed(
        sphere(0.12, segments),
        &Mat4::from_scale(vec3(0.95, 1.0, 1.0)),
    );
    let limb = |from: Vec3, to: Vec3| {
        let middle = rod(from, to, 0.052, segments);
        join("limb", [middle, part(sphere(0.058, segments), to - lean)])
    };
    let (shoulder, elbow, hand) = (
        vec3(0.17, 1.27, 0.0),
        vec3(0.36, 1.36, 0.16),
        vec3(0.3, 1.66, 0.2),
    );
    let (left, hip, wrist) = (
        vec3(-0.17, 1.27, 0.0),
        vec3(-0.27, 0.98, 0.08),
        vec3(-0.06, 0.9, 0.2),
    );
    let parts = [
        robe,
        rod(vec3(0.0, 1.32, 0.0), vec3(0.02, 1.5, 0.0), 0.05, segments),
        part(head, vec3(0.0, 1.58, 0.02)),
        part(hair, vec3(0.0, 1.63, -0.03)),
        limb(shoulder, elbow),
        limb(elbow, hand),
        limb(left, hip),
        limb(hip, wrist),
        part(sphere(0.13, 20 * detail), hand + vec3(-0.02, 0.16, 0.0)),
    ];
    // It faces the hall.
    let place = Mat4::from_translation(STATUE + Vec3::Y * 0.8) * Mat4::from_rotation_y(0.75 * PI);
    vec![transformed(join("statue", parts), &place)]
}
