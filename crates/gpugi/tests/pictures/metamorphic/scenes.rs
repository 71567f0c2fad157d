//! Small scenes that nobody tuned.

use std::f32::consts::FRAC_PI_2;

use glam::{EulerRot, Mat4, Quat, Vec3, vec3};
use gpugi_scene::builtin::builtin;
use gpugi_scene::builtin::shapes::{cuboid, join, quad, sphere};
use gpugi_scene::{Camera, Environment, Light, LightKind, Material, Mesh, Scene};

use crate::common::{floor, inside_out};

/// Name of a light that no wall lets in.
pub const OUTSIDE: &str = "outside";

/// Adds an instance of a mesh, placed by a matrix.
fn put(scene: &mut Scene, name: &str, mesh: Mesh, material: Material, at: Mat4) {
    let mesh = scene.add_mesh(mesh);
    let material = scene.add_material(material);
    scene.add_instance(name, mesh, material, at);
}

/// A matrix that turns about Y, and stretches before.
fn placed(position: Vec3, turn: f32, stretch: Vec3) -> Mat4 {
    let rotation = Quat::from_euler(EulerRot::YXZ, turn, 0.0, 0.0);
    Mat4::from_scale_rotation_translation(stretch, rotation, position)
}

/// The box on the floor: its transform turns and stretches, which makes a difference to who ignores a part of it.
fn put_box(scene: &mut Scene) {
    let unit = cuboid(vec3(-0.5, 0.0, -0.5), vec3(0.5, 1.0, 0.5), 1);
    let at = placed(vec3(0.2, 0.0, -0.1), 0.6, vec3(0.7, 0.9, 0.5));
    let material = Material::matt("box", vec3(0.7, 0.4, 0.3));
    put(scene, "box", unit, material, at);
}

fn looking_down() -> Camera {
    Camera::look_at("", vec3(0.4, 2.6, 2.4), vec3(0.0, 0.3, 0.0), 0.8)
}

pub fn cornell() -> Scene {
    builtin("cornell", 1).expect("a built-in scene")
}

/// A floor, a box and every kind of light.
pub fn furnished() -> Scene {
    let mut scene = floor(4.0);
    put_box(&mut scene);
    let lamp = quad(vec3(-1.0, 1.2, -1.0), Vec3::X * 0.5, Vec3::Z * 0.5, 1);
    let shining = Material::emitter("lamp", vec3(9.0, 8.0, 7.0));
    put(&mut scene, "lamp", lamp, shining, Mat4::IDENTITY);
    let spot = LightKind::Spot {
        inner_cone_angle: 0.3,
        outer_cone_angle: 0.6,
    };
    let mut sun = Light::new("sun", LightKind::Directional, Vec3::splat(1.0))
        .aimed(vec3(-1.0, 2.0, 0.7), Vec3::ZERO);
    sun.radius = 0.05;
    let mut point = Light::new("point", LightKind::Point, vec3(1.5, 2.0, 2.5))
        .aimed(vec3(0.9, 1.7, 0.5), Vec3::ZERO);
    point.range = Some(6.0);
    let mut spot =
        Light::new("spot", spot, Vec3::splat(6.0)).aimed(vec3(0.5, 2.0, -1.0), vec3(0.2, 0.0, 0.3));
    spot.radius = 0.03;
    scene.lights = vec![sun, point, spot];
    scene.cameras = vec![looking_down()];
    scene
}

/// A floor and a box under the default sky.
pub fn open() -> Scene {
    let mut scene = floor(4.0);
    put_box(&mut scene);
    scene.environment = Some(Environment::default_sky());
    scene.cameras = vec![looking_down()];
    scene
}

/// A room of 3 x 2 x 3 m seen from within, with a light under its ceiling.
fn room() -> Scene {
    let mut scene = Scene::new("room");
    let walls = inside_out(cuboid(vec3(-1.5, 0.0, -1.5), vec3(1.5, 2.0, 1.5), 2));
    let grey = Material::matt("walls", vec3(0.6, 0.5, 0.4));
    put(&mut scene, "walls", walls, grey, Mat4::IDENTITY);
    let point = Light::new("point", LightKind::Point, Vec3::splat(2.0));
    scene.lights = vec![point.aimed(vec3(-0.4, 1.3, 0.3), Vec3::ZERO)];
    scene.cameras = vec![Camera::look_at(
        "",
        vec3(1.2, 1.4, 1.35),
        vec3(-0.2, 0.6, -0.4),
        1.1,
    )];
    scene
}

/// A room with a ball of rough metal and a mirror.
pub fn glossy() -> Scene {
    let mut scene = room();
    let metal = Material::metal("metal", vec3(0.9, 0.7, 0.4), 0.4);
    let at = placed(vec3(0.0, 0.45, -0.2), 0.3, Vec3::splat(0.9));
    put(&mut scene, "ball", sphere(0.5, 10), metal, at);
    let mirror = Material::metal("mirror", Vec3::splat(0.9), 0.0);
    let sheet = quad(vec3(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y, 1);
    let at = placed(vec3(-1.45, 0.9, -0.2), FRAC_PI_2, vec3(1.4, 1.2, 1.0));
    put(&mut scene, "mirror", sheet, mirror, at);
    scene
}

/// A room with a thin pane of glass between the light and a part of the floor.
pub fn glazed() -> Scene {
    let mut scene = room();
    let glass = Material {
        transmission: 1.0,
        roughness: 0.0,
        double_sided: true,
        ..Material::matt("glass", vec3(0.6, 0.8, 0.9))
    };
    let glass = Material {
        specular: 1.0,
        ..glass
    };
    let sheet = quad(vec3(-0.5, 0.0, 0.5), Vec3::X, Vec3::NEG_Z, 1);
    let at = placed(vec3(-0.2, 0.7, 0.1), 0.2, vec3(1.3, 1.0, 1.1));
    put(&mut scene, "pane", sheet, glass, at);
    scene
}

/// A closed room with walls of 2 cm, a light within and a bright one outside.
pub fn closed() -> Scene {
    let mut scene = room();
    let thick = Vec3::splat(0.02);
    let (min, max) = (vec3(-1.5, 0.0, -1.5), vec3(1.5, 2.0, 1.5));
    let inner = inside_out(cuboid(min, max, 2));
    let outer = cuboid(min - thick, max + thick, 1);
    scene.meshes[0] = join("walls", [inner, outer]).into();
    put_box(&mut scene);
    let outside = Light::new(OUTSIDE, LightKind::Point, vec3(9.0, 3.0, 3.0));
    let outside = outside.aimed(vec3(2.5, 1.0, 0.5), Vec3::ZERO);
    scene.lights.push(outside);
    scene
}
