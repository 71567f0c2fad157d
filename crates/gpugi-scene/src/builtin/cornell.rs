//! The Cornell box: the geometry that Cornell University's Program of Computer Graphics measured and published, with
//! the usual linear RGB reflectances and light.
//!
//! The published millimetres, multiplied by 0.01, are metres here: the room is 5.5 m wide, ten times the original. The
//! published coordinates are right-handed; their camera looks along +Z, with +X to its left. Half a turn about +Y makes
//! it look along -Z, with the red wall on the left and the green wall on the right.

use glam::{Mat4, Vec3, vec3};

use super::shapes::{hexahedron, quadrilateral};
use crate::{Camera, Material, Mesh, Scene};

/// Heights of the ceiling and of the light [mm]. The light hangs 1 mm below the ceiling, so that the two are not
/// coplanar.
const CEILING: f32 = 548.8;
const LIGHT: f32 = 547.8;

/// World space (m) from the published coordinates [mm].
fn world(x: f32, y: f32, z: f32) -> Vec3 {
    vec3(278.0 - x, y, -z) * 0.01
}

pub(super) fn build(detail: u32) -> Scene {
    let mut scene = Scene::new("cornell");
    // 35 mm focal length, 25 mm film: 39.3 degrees.
    let vertical_fov = 2.0 * (25.0_f32 / (2.0 * 35.0)).atan();
    scene.cameras.push(Camera::look_at(
        "front",
        world(278.0, 273.0, -800.0),
        world(278.0, 273.0, 0.0),
        vertical_fov,
    ));

    let white = scene.add_material(Material::matt("white", vec3(0.725, 0.71, 0.68)));
    let red = scene.add_material(Material::matt("red", vec3(0.63, 0.065, 0.05)));
    let green = scene.add_material(Material::matt("green", vec3(0.14, 0.45, 0.091)));
    let light = scene.add_material(Material::emitter("light", vec3(17.0, 12.0, 4.0)));

    let mut place = |name: &str, mesh: Mesh, material: usize| {
        let name_of_mesh = name.to_owned();
        let mesh = scene.add_mesh(Mesh {
            name: name_of_mesh.into(),
            ..mesh
        });
        scene.add_instance(name, mesh, material, Mat4::IDENTITY);
    };
    let wall =
        |corners: [[f32; 3]; 4]| quadrilateral(corners.map(|[x, y, z]| world(x, y, z)), 4 * detail);
    let floor = [
        [552.8, 0.0, 0.0],
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 559.2],
        [549.6, 0.0, 559.2],
    ];
    let ceiling = [
        [556.0, CEILING, 559.2],
        [0.0, CEILING, 559.2],
        [0.0, CEILING, 0.0],
        [556.0, CEILING, 0.0],
    ];
    let back = [
        [549.6, 0.0, 559.2],
        [0.0, 0.0, 559.2],
        [0.0, CEILING, 559.2],
        [556.0, CEILING, 559.2],
    ];
    let left = [
        [552.8, 0.0, 0.0],
        [549.6, 0.0, 559.2],
        [556.0, CEILING, 559.2],
        [556.0, CEILING, 0.0],
    ];
    let right = [
        [0.0, 0.0, 559.2],
        [0.0, 0.0, 0.0],
        [0.0, CEILING, 0.0],
        [0.0, CEILING, 559.2],
    ];
    let lamp = [
        [343.0, LIGHT, 332.0],
        [213.0, LIGHT, 332.0],
        [213.0, LIGHT, 227.0],
        [343.0, LIGHT, 227.0],
    ];
    place("floor", wall(floor), white);
    place("ceiling", wall(ceiling), white);
    place("back wall", wall(back), white);
    place("left wall", wall(left), red);
    place("right wall", wall(right), green);
    place("light", wall(lamp), light);

    let short = [[130.0, 65.0], [82.0, 225.0], [240.0, 272.0], [290.0, 114.0]];
    let tall = [
        [423.0, 247.0],
        [265.0, 296.0],
        [314.0, 456.0],
        [472.0, 406.0],
    ];
    place("short block", block(short, 165.0, detail), white);
    place("tall block", block(tall, 330.0, detail), white);
    scene
}

/// A block of the given height [mm] over its published base, given as x and z of each corner [mm].
fn block(base: [[f32; 2]; 4], height: f32, detail: u32) -> Mesh {
    let level = |y: f32| base.map(|[x, z]| world(x, y, z));
    hexahedron(level(0.0), level(height), 2 * detail)
}
