//! Seven steps from matt to mirror, as metals (back row) and dielectrics (front row), under the sky and its sun.

use glam::{Mat4, Vec3, vec3};

use super::shapes::{quad, sphere};
use crate::{Camera, Environment, Material, Scene};

/// Number of spheres per row.
const STEPS: u32 = 7;

pub(super) fn build(detail: u32) -> Scene {
    let mut scene = Scene::new("spheres");
    scene.cameras.push(Camera::look_at(
        "front",
        vec3(0.0, 3.8, 9.0),
        vec3(0.0, 0.3, -0.3),
        42.0_f32.to_radians(),
    ));

    let ball = scene.add_mesh(sphere(0.42, 16 * detail));
    for step in 0..STEPS {
        let matt_to_mirror = step as f32 / (STEPS - 1) as f32;
        let roughness = 1.0 - matt_to_mirror;
        let metal = Material::metal(
            &format!("metal, roughness {roughness:.2}"),
            vec3(0.95, 0.78, 0.45),
            roughness,
        );
        let dielectric = Material {
            name: format!("dielectric, roughness {roughness:.2}"),
            base_color: vec3(0.1, 0.2, 0.5).extend(1.0),
            roughness,
            ..Material::default()
        };
        for (material, z) in [(metal, -0.8), (dielectric, 0.6)] {
            let name = material.name.clone();
            let material = scene.add_material(material);
            let center = vec3(step as f32 - (STEPS - 1) as f32 / 2.0, 0.42, z);
            scene.add_instance(&name, ball, material, Mat4::from_translation(center));
        }
    }

    let mut plane = quad(
        vec3(-10.0, 0.0, 10.0),
        Vec3::X * 20.0,
        Vec3::NEG_Z * 20.0,
        8 * detail,
    );
    plane.name = "plane".into();
    let mesh = scene.add_mesh(plane);
    let material = scene.add_material(Material::matt("plane", vec3(0.35, 0.35, 0.33)));
    scene.add_instance("plane", mesh, material, Mat4::IDENTITY);

    scene.environment = Some(Environment::default_sky());
    scene
}
