//! Martin Newell's teapot of 1975 on a plane: 32 bicubic Bézier patches.
//!
//! The published 306 control points follow by symmetry from far fewer numbers: rim, body, lid and bottom are rotated
//! profiles; handle and spout are mirrored. Coordinates here are Newell's, z upward, and are multiplied by 0.1 to give
//! metres.

use glam::{Mat4, Vec2, Vec3, vec2, vec3};

use super::shapes::{Vertex, grid, join, quad};
use crate::{Camera, Light, LightKind, Material, Mesh, Scene};

/// Radius and height of the four control points of a profile, and for each the ratio of handle length to radius of its
/// quarter circles.
pub(super) type Profile = ([[f32; 2]; 4], [f32; 4]);

/// Newell's quarter circles have handles of 0.56 radii, which is almost circular.
const ROUND: [f32; 4] = [0.56; 4];

/// Rim, body (upper and lower part), lid (upper and lower part), bottom.
pub(super) const PROFILES: [Profile; 6] = [
    // Rim, from the inside over the top.
    (
        [[1.4, 2.4], [1.3375, 2.53125], [1.4375, 2.53125], [1.5, 2.4]],
        ROUND,
    ),
    // Body, downward.
    ([[1.5, 2.4], [1.75, 1.875], [2.0, 1.35], [2.0, 0.9]], ROUND),
    ([[2.0, 0.9], [2.0, 0.45], [1.5, 0.225], [1.5, 0.15]], ROUND),
    // Lid, from the top; the published points have 0.45 where 0.56 radii would be 0.448.
    (
        [[0.0, 3.15], [0.8, 3.15], [0.0, 2.85], [0.2, 2.7]],
        [0.56, 0.5625, 0.56, 0.56],
    ),
    ([[0.2, 2.7], [0.4, 2.55], [1.3, 2.55], [1.3, 2.4]], ROUND),
    // Bottom, inward.
    ([[1.5, 0.15], [1.5, 0.075], [1.425, 0.0], [0.0, 0.0]], ROUND),
];

/// A row of control points across a tube: x and z on its inner side and on its outer side, and its half width.
pub(super) type Across = ([f32; 2], [f32; 2], f32);

/// Handle and spout, two patches each along their length, starting at the body.
pub(super) const TUBES: [[Across; 4]; 4] = [
    [
        ([-1.6, 2.025], [-1.5, 2.25], 0.3),
        ([-2.3, 2.025], [-2.5, 2.25], 0.3),
        ([-2.7, 2.025], [-3.0, 2.25], 0.3),
        ([-2.7, 1.8], [-3.0, 1.8], 0.3),
    ],
    [
        ([-2.7, 1.8], [-3.0, 1.8], 0.3),
        ([-2.7, 1.575], [-3.0, 1.35], 0.3),
        ([-2.5, 1.125], [-2.65, 0.9375], 0.3),
        ([-2.0, 0.9], [-1.9, 0.6], 0.3),
    ],
    [
        ([1.7, 1.425], [1.7, 0.6], 0.66),
        ([2.6, 1.425], [3.1, 0.825], 0.66),
        ([2.3, 2.1], [2.4, 2.025], 0.25),
        ([2.7, 2.4], [3.3, 2.4], 0.25),
    ],
    [
        ([2.7, 2.4], [3.3, 2.4], 0.25),
        ([2.8, 2.475], [3.525, 2.49375], 0.25),
        ([2.9, 2.475], [3.45, 2.5125], 0.15),
        ([2.8, 2.4], [3.2, 2.4], 0.15),
    ],
];

pub(super) fn build(detail: u32) -> Scene {
    let mut scene = Scene::new("teapot");
    scene.cameras.push(Camera::look_at(
        "front",
        vec3(0.35, 0.55, 1.15),
        vec3(0.02, 0.13, 0.0),
        35.0_f32.to_radians(),
    ));

    let mesh = scene.add_mesh(teapot(6 * detail));
    let material = scene.add_material(Material {
        name: "glaze".into(),
        base_color: vec3(0.55, 0.16, 0.08).extend(1.0),
        roughness: 0.25,
        // The lid leaves a gap that shows the inside.
        double_sided: true,
        ..Material::default()
    });
    scene.add_instance("teapot", mesh, material, Mat4::IDENTITY);

    let mut plane = quad(
        vec3(-2.0, 0.0, 2.0),
        Vec3::X * 4.0,
        Vec3::NEG_Z * 4.0,
        8 * detail,
    );
    plane.name = "plane".into();
    let mesh = scene.add_mesh(plane);
    let material = scene.add_material(Material::matt("plane", vec3(0.6, 0.6, 0.62)));
    scene.add_instance("plane", mesh, material, Mat4::IDENTITY);

    // A panel above and to the left that faces the teapot.
    let mut panel = quad(
        vec3(-0.9, 0.8, 0.25),
        Vec3::NEG_Z * 0.5,
        vec3(0.35, 0.35, 0.0),
        detail,
    );
    panel.name = "panel".into();
    let mesh = scene.add_mesh(panel);
    let material = scene.add_material(Material::emitter("panel", vec3(3.0, 3.2, 3.6)));
    scene.add_instance("panel", mesh, material, Mat4::IDENTITY);

    let cone = LightKind::Spot {
        inner_cone_angle: 14.0_f32.to_radians(),
        outer_cone_angle: 22.0_f32.to_radians(),
    };
    let mut spot = Light::new("spot", cone, vec3(12.0, 11.0, 9.0))
        .aimed(vec3(1.1, 1.6, 0.9), vec3(0.0, 0.1, 0.0));
    spot.radius = 0.03;
    scene.lights = vec![spot];
    scene
}

/// Control points of a bicubic Bézier patch; rows run from top to bottom as seen from the front.
pub(super) type Patch = [[Vec3; 4]; 4];

/// The teapot in metres, +Y up, with its spout toward +X. Each patch has `divisions` x `divisions` cells. It is open
/// where Newell left it open: between lid and rim, and at the ends of handle and spout.
fn teapot(divisions: u32) -> Mesh {
    let tubes = TUBES
        .iter()
        .flat_map(|rows| [-1.0, 1.0].map(|side| half_tube(rows, side)));
    join(
        "teapot",
        PROFILES
            .iter()
            .flat_map(turned)
            .chain(tubes)
            .map(|points| patch(&points, divisions)),
    )
}

/// A profile rotated about the vertical axis, one patch per quarter turn.
pub(super) fn turned((profile, handles): &Profile) -> [Patch; 4] {
    [0, 1, 2, 3].map(|quarter| {
        std::array::from_fn(|row| {
            let [radius, height] = profile[row];
            let handle = radius * handles[row];
            let arc = [
                vec2(radius, 0.0),
                vec2(radius, handle),
                vec2(handle, radius),
                vec2(0.0, radius),
            ];
            // Quarter turns that exchange coordinates are exact, so neighbouring patches share their edges bitwise.
            arc.map(|point| (0..quarter).fold(point, |p, _| p.perp()).extend(height))
        })
    })
}

/// The half of a tube on the -y (`side` -1) or +y (`side` 1) side; its columns run around the tube.
pub(super) fn half_tube(rows: &[Across; 4], side: f32) -> Patch {
    rows.map(|([x0, z0], [x1, z1], width)| {
        let mut across = [
            vec3(x1, 0.0, z1),
            vec3(x1, side * width, z1),
            vec3(x0, side * width, z0),
            vec3(x0, 0.0, z0),
        ];
        if side > 0.0 {
            across.reverse();
        }
        across
    })
}

/// Tessellates a patch.
pub(super) fn patch(points: &Patch, divisions: u32) -> Mesh {
    grid(divisions, divisions, |column, row| {
        let uv = vec2(column as f32, row as f32) / divisions as f32;
        placed(surface(points, uv), normal(points, uv), uv)
    })
}

/// Converts a vertex from Newell's coordinates to metres, +Y up.
pub(super) fn placed(position: Vec3, normal: Vec3, uv: Vec2) -> Vertex {
    Vertex {
        position: vec3(position.x, position.z, -position.y) * 0.1,
        normal: vec3(normal.x, normal.z, -normal.y),
        uv,
    }
}

/// The unit normal of a patch at `uv`, toward its front.
pub(super) fn normal(points: &Patch, uv: Vec2) -> Vec3 {
    let mut normal = cross_of_tangents(points, uv);
    if normal.length() < 1e-5 {
        // At a pole the rows shrink to a point; a nearby normal approximates the limit.
        normal = cross_of_tangents(points, uv.lerp(vec2(uv.x, 0.5), 1e-3));
    }
    normal.normalize()
}

/// Bernstein polynomials of degree 3.
fn weights(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t]
}

/// Derivatives of the Bernstein polynomials.
fn slopes(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [
        -3.0 * s * s,
        3.0 * s * (s - 2.0 * t),
        3.0 * t * (2.0 * s - t),
        3.0 * t * t,
    ]
}

fn combine(points: &Patch, columns: [f32; 4], rows: [f32; 4]) -> Vec3 {
    let row = |row: usize| (0..4).map(|i| points[row][i] * columns[i]).sum::<Vec3>();
    (0..4).map(|i| row(i) * rows[i]).sum()
}

/// The point of a patch at `uv`.
pub(super) fn surface(points: &Patch, uv: Vec2) -> Vec3 {
    let pole = if uv.y == 0.0 { points[0] } else { points[3] };
    if (uv.y == 0.0 || uv.y == 1.0) && pole == [pole[0]; 4] {
        // Weights that do not sum to exactly 1 would split the pole.
        return pole[0];
    }
    combine(points, weights(uv.x), weights(uv.y))
}

/// Points toward the front: down x right.
fn cross_of_tangents(points: &Patch, uv: Vec2) -> Vec3 {
    let right = combine(points, slopes(uv.x), weights(uv.y));
    down(points, uv).cross(right)
}

/// The downward derivative of a patch.
pub(super) fn down(points: &Patch, uv: Vec2) -> Vec3 {
    combine(points, weights(uv.x), slopes(uv.y))
}
