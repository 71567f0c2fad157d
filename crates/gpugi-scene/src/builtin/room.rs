//! The room of figures 33 and 34 of the tutorial: coloured walls, a box that makes it concave, and a mirror sphere.

use glam::{Mat4, Vec3, vec3};

use super::shapes::{cuboid, quad, sphere};
use crate::{Camera, Light, LightKind, Material, Scene};

pub(super) fn build(detail: u32) -> Scene {
    let mut scene = Scene::new("room");
    scene.cameras.push(Camera::look_at(
        "inside",
        vec3(0.3, 1.6, 1.9),
        vec3(-0.05, 0.95, -1.0),
        65.0_f32.to_radians(),
    ));

    walls(&mut scene, detail);
    let turned = Mat4::from_translation(vec3(1.0, 0.0, -0.8)) * Mat4::from_rotation_y(0.4);
    matt_box(&mut scene, vec3(0.4, 1.2, 0.4), turned, detail);
    mirror_ball(&mut scene, 0.6, vec3(-0.6, 0.6, -0.3), 16 * detail);

    let cone = LightKind::Spot {
        inner_cone_angle: 25.0_f32.to_radians(),
        outer_cone_angle: 40.0_f32.to_radians(),
    };
    let mut spot = Light::new("spot", cone, vec3(40.0, 38.0, 34.0))
        .aimed(vec3(1.3, 2.8, 1.3), vec3(-0.1, 0.2, -0.5));
    spot.radius = 0.05;
    let fill = Light::new("fill", LightKind::Point, vec3(2.0, 2.2, 2.5))
        .aimed(vec3(-1.4, 2.5, 1.4), Vec3::ZERO);
    scene.lights = vec![spot, fill];
    scene
}

/// Walls, floor and ceiling of a room of 4 x 3 x 4 m. The floor is at y = 0 and its centre is the origin.
pub(super) fn walls(scene: &mut Scene, detail: u32) {
    // For each wall: name, albedo, lower left corner as seen from inside, the edge to the right and the edge up.
    let (width, height) = (4.0, 3.0);
    let half = width / 2.0;
    let (x, y, z) = (Vec3::X * width, Vec3::Y * height, Vec3::Z * width);
    let walls = [
        ("floor", vec3(0.6, 0.55, 0.5), vec3(-half, 0.0, half), x, -z),
        (
            "ceiling",
            vec3(0.75, 0.75, 0.75),
            vec3(-half, height, -half),
            x,
            z,
        ),
        (
            "back wall",
            vec3(0.2, 0.3, 0.7),
            vec3(-half, 0.0, -half),
            x,
            y,
        ),
        (
            "front wall",
            vec3(0.7, 0.6, 0.15),
            vec3(half, 0.0, half),
            -x,
            y,
        ),
        (
            "left wall",
            vec3(0.65, 0.1, 0.08),
            vec3(-half, 0.0, half),
            -z,
            y,
        ),
        (
            "right wall",
            vec3(0.12, 0.5, 0.12),
            vec3(half, 0.0, -half),
            z,
            y,
        ),
    ];
    for (name, albedo, corner, right, up) in walls {
        let mut mesh = quad(corner, right, up, 4 * detail);
        mesh.name = name.into();
        let mesh = scene.add_mesh(mesh);
        let material = scene.add_material(Material::matt(name, albedo));
        scene.add_instance(name, mesh, material, Mat4::IDENTITY);
    }
}

/// A box that stands on its origin. `size`: half width along x, height, half width along z (m).
pub(super) fn matt_box(scene: &mut Scene, size: Vec3, world_from_mesh: Mat4, detail: u32) {
    let [low, high] = [vec3(-size.x, 0.0, -size.z), size];
    let mut mesh = cuboid(low, high, 2 * detail);
    mesh.name = "box".into();
    let mesh = scene.add_mesh(mesh);
    let material = scene.add_material(Material::matt("box", vec3(0.15, 0.6, 0.25)));
    scene.add_instance("box", mesh, material, world_from_mesh);
}

/// An ideal mirror ball.
pub(super) fn mirror_ball(scene: &mut Scene, radius: f32, center: Vec3, segments: u32) {
    let mesh = scene.add_mesh(sphere(radius, segments));
    let material = scene.add_material(Material::metal("mirror", Vec3::splat(0.95), 0.0));
    let center = Mat4::from_translation(center);
    scene.add_instance("sphere", mesh, material, center);
}
