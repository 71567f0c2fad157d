//! A hotel room that sees the sky through one window: what light of an environment finds difficult indoors. Walls are
//! single quads without thickness, and one unit of length is a centimetre, as in many files.
//!
//! The room is 400 cm wide, 260 cm high and 500 cm long. The window is in the left wall, and the sun shines through it.

use glam::{Mat4, Vec3, vec3};

use super::shapes::{Vertex, cuboid, grid, join, quad};
use crate::{Camera, Environment, Material, Mesh, Scene};

/// Corners of the room (cm).
const LOW: Vec3 = vec3(-200.0, 0.0, -250.0);
const HIGH: Vec3 = vec3(200.0, 260.0, 250.0);
/// Corners of the window, in the plane x = `LOW.x` (cm).
const WINDOW_LOW: Vec3 = vec3(LOW.x, 75.0, -90.0);
const WINDOW_HIGH: Vec3 = vec3(LOW.x, 225.0, 90.0);

pub(super) fn build(detail: u32) -> Scene {
    let mut scene = Scene::new("window-room");
    scene.cameras.push(Camera::look_at(
        "inside",
        vec3(165.0, 155.0, 240.0),
        vec3(-70.0, 90.0, -100.0),
        62.0_f32.to_radians(),
    ));
    let mut place = |material: Material, mesh: Mesh| {
        let name = material.name.clone();
        let mesh = scene.add_mesh(Mesh {
            name: name.clone().into(),
            ..mesh
        });
        let material = scene.add_material(material);
        scene.add_instance(&name, mesh, material, Mat4::IDENTITY);
    };
    let matt = Material::matt;
    place(matt("floor", vec3(0.42, 0.27, 0.16)), floor(detail));
    place(matt("walls", vec3(0.78, 0.74, 0.66)), walls(detail));
    place(matt("frame", vec3(0.8, 0.8, 0.8)), frame(detail));
    let curtain = Material {
        double_sided: true,
        ..matt("curtains", vec3(0.62, 0.2, 0.15))
    };
    place(curtain, curtains(detail));
    place(matt("rug", vec3(0.25, 0.35, 0.5)), rug(detail));
    place(matt("wood", vec3(0.35, 0.2, 0.1)), wood(detail));
    place(matt("linen", vec3(0.85, 0.84, 0.8)), linen(detail));
    place(matt("blanket", vec3(0.2, 0.42, 0.35)), blanket(detail));
    place(matt("painting", vec3(0.75, 0.5, 0.12)), painting(detail));
    scene.environment = Some(Environment::default_sky());
    scene
}

fn floor(detail: u32) -> Mesh {
    let size = HIGH - LOW;
    let (right, up) = (Vec3::X * size.x, Vec3::NEG_Z * size.z);
    quad(LOW.with_z(HIGH.z), right, up, 4 * detail)
}

/// Ceiling and walls, which face inward. Four quads leave the window open.
fn walls(detail: u32) -> Mesh {
    let size = HIGH - LOW;
    let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
    // Of the wall with the window: the part between two heights and two depths.
    let left = |low: f32, high: f32, back: f32, front: f32| {
        let corner = vec3(LOW.x, low, front);
        let (right, up) = (Vec3::NEG_Z * (front - back), Vec3::Y * (high - low));
        quad(corner, right, up, 2 * detail)
    };
    join(
        "walls",
        [
            quad(LOW.with_y(HIGH.y), x, z, 4 * detail),
            quad(LOW, x, y, 4 * detail),
            quad(HIGH.with_y(LOW.y), -x, y, 4 * detail),
            quad(LOW.with_x(HIGH.x), z, y, 4 * detail),
            left(LOW.y, WINDOW_LOW.y, LOW.z, HIGH.z),
            left(WINDOW_HIGH.y, HIGH.y, LOW.z, HIGH.z),
            left(WINDOW_LOW.y, WINDOW_HIGH.y, LOW.z, WINDOW_LOW.z),
            left(WINDOW_LOW.y, WINDOW_HIGH.y, WINDOW_HIGH.z, HIGH.z),
        ],
    )
}

/// Bars around the window, and two that cross in it.
fn frame(detail: u32) -> Mesh {
    let (low, high) = (WINDOW_LOW, WINDOW_HIGH);
    let half = 3.0;
    let bar = |from: Vec3, to: Vec3| {
        let thickness = Vec3::splat(half);
        cuboid(from - thickness, to + thickness, detail)
    };
    let (middle, inset) = ((low + high) / 2.0, 2.0 * half);
    let across = |y: f32| {
        let from = vec3(low.x, y, low.z + inset);
        bar(from, from.with_z(high.z - inset))
    };
    let upright = |z: f32, from: f32, to: f32| bar(vec3(low.x, from, z), vec3(low.x, to, z));
    let shelf = cuboid(
        vec3(low.x + half, low.y - 8.0, low.z - 5.0),
        vec3(low.x + 18.0, low.y - 4.0, high.z + 5.0),
        detail,
    );
    join(
        "frame",
        [
            across(low.y),
            across(high.y),
            upright(low.z, low.y, high.y),
            upright(high.z, low.y, high.y),
            upright(middle.z, low.y + inset, high.y - inset),
            shelf,
        ],
    )
}

/// Two curtains in folds, drawn aside.
fn curtains(detail: u32) -> Mesh {
    let steps = 16 * detail;
    let hanging = |from: f32, to: f32| {
        grid(steps, detail, move |column, row| {
            let along = column as f32 / steps as f32;
            let phase = along * 4.0 * std::f32::consts::TAU;
            let down = row as f32 / detail as f32;
            let top = WINDOW_HIGH.y + 15.0;
            // From the front (+x), columns run toward -z.
            let slope = -phase.cos() * 4.0 * 4.0 * std::f32::consts::TAU / (from - to);
            Vertex {
                position: vec3(
                    LOW.x + 14.0 + 4.0 * phase.sin(),
                    top + (8.0 - top) * down,
                    from + (to - from) * along,
                ),
                normal: vec3(1.0, 0.0, -slope).normalize(),
                uv: glam::vec2(along, down),
            }
        })
    };
    let (low, high) = (WINDOW_LOW.z, WINDOW_HIGH.z);
    join(
        "curtains",
        [
            hanging(low + 8.0, low - 42.0),
            hanging(high + 42.0, high - 8.0),
        ],
    )
}

fn rug(detail: u32) -> Mesh {
    let corner = vec3(-130.0, 0.5, 190.0);
    quad(corner, Vec3::X * 170.0, Vec3::NEG_Z * 150.0, 2 * detail)
}

/// Bedstead, bedside table, table and stool.
fn wood(detail: u32) -> Mesh {
    let block = |low: [f32; 3], high: [f32; 3]| cuboid(low.into(), high.into(), detail);
    let legs = |low: [f32; 3], high: [f32; 3], thickness: f32| {
        let corners = [
            (low[0], low[2]),
            (high[0] - thickness, low[2]),
            (low[0], high[2] - thickness),
            (high[0] - thickness, high[2] - thickness),
        ];
        corners.map(|(x, z)| block([x, low[1], z], [x + thickness, high[1], z + thickness]))
    };
    let parts = [
        // The bedstead, with its head at the back wall.
        block([20.0, 0.0, -249.0], [185.0, 105.0, -243.0]),
        block([20.0, 12.0, -243.0], [185.0, 30.0, -35.0]),
        // The bedside table.
        block([-30.0, 0.0, -245.0], [12.0, 48.0, -205.0]),
        // Tops of the table and the stool.
        block([-185.0, 72.0, -235.0], [-85.0, 76.0, -170.0]),
        block([-150.0, 44.0, -150.0], [-112.0, 48.0, -112.0]),
    ];
    let legs = [
        legs([20.0, 0.0, -243.0], [185.0, 12.0, -35.0], 8.0),
        legs([-183.0, 0.0, -233.0], [-87.0, 72.0, -172.0], 5.0),
        legs([-148.0, 0.0, -148.0], [-114.0, 44.0, -114.0], 4.0),
    ];
    join("wood", parts.into_iter().chain(legs.into_iter().flatten()))
}

/// Mattress and pillows.
fn linen(detail: u32) -> Mesh {
    join(
        "linen",
        [
            cuboid(vec3(23.0, 30.0, -241.0), vec3(182.0, 52.0, -40.0), detail),
            cuboid(vec3(32.0, 52.0, -238.0), vec3(96.0, 64.0, -198.0), detail),
            cuboid(vec3(109.0, 52.0, -238.0), vec3(173.0, 64.0, -198.0), detail),
        ],
    )
}

/// A blanket over the lower part of the bed.
fn blanket(detail: u32) -> Mesh {
    cuboid(vec3(21.0, 28.0, -150.0), vec3(184.0, 54.0, -37.0), detail)
}

fn painting(detail: u32) -> Mesh {
    cuboid(
        vec3(60.0, 140.0, -249.0),
        vec3(145.0, 200.0, -246.0),
        detail,
    )
}
