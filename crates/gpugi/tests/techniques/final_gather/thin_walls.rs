//! Rooms with a lit and a dark half, and a thin wall between them.

use glam::{Mat4, Vec3, vec3};
use gpugi_scene::builtin::shapes::{cuboid, quad};
use gpugi_scene::{Light, LightKind, Material, Scene};

use crate::common::{inside_out, place};

/// A lit room and a dark one, each 2 m wide, with `gap` (m) between them.
pub fn two_rooms(gap: f32) -> Scene {
    let mut scene = Scene::new("rooms");
    for (name, side) in [("lit", -1.0), ("dark", 1.0)] {
        let (near, far) = (side * gap * 0.5, side * 2.0);
        let (low, high) = (f32::min(near, far), f32::max(near, far));
        let room = inside_out(cuboid(vec3(low, 0.0, -1.0), vec3(high, 2.0, 1.0), 1));
        place(&mut scene, room, Material::matt(name, Vec3::splat(0.8)));
    }
    lit_on_the_left(scene)
}

/// One room with a wall in its middle that has no thickness, and faces both ways.
pub fn a_room_with_a_wall() -> Scene {
    let mut scene = Scene::new("wall");
    let white = Material::matt("white", Vec3::splat(0.8));
    let room = inside_out(cuboid(vec3(-2.0, 0.0, -1.0), vec3(2.0, 2.0, 1.0), 1));
    place(&mut scene, room, white.clone());
    let wall = quad(vec3(0.0, 0.0, 1.0), Vec3::NEG_Z * 2.0, Vec3::Y * 2.0, 1);
    let wall = scene.add_mesh(wall);
    let both = scene.add_material(Material {
        double_sided: true,
        ..white
    });
    scene.add_instance("wall", wall, both, Mat4::IDENTITY);
    lit_on_the_left(scene)
}

fn lit_on_the_left(mut scene: Scene) -> Scene {
    let light = Light::new("", LightKind::Point, Vec3::ONE);
    let lit = light.aimed(vec3(-1.0, 1.5, 0.0), Vec3::ZERO);
    scene.lights.push(lit);
    scene
}
