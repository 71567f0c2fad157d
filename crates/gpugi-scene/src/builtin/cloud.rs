//! A cumulus cloud above a plain, under a clear sky and its sun. The cloud's density is fractal noise in an ellipsoid.

use std::sync::Arc;

use glam::{IVec3, Mat4, Vec3, ivec3, vec3};

use super::shapes::{cuboid, quad};
use crate::{
    Camera, DensityGrid, Environment, Light, LightKind, Material, Medium, PhaseFunction, Scene,
};

/// Cells of the density grid along each axis.
const CELLS: u32 = 32;

pub(super) fn build(detail: u32) -> Scene {
    let mut scene = Scene::new("cloud");
    scene.cameras.push(Camera::look_at(
        "front",
        vec3(0.0, 2.0, 8.5),
        vec3(0.0, 2.0, 0.0),
        42.0_f32.to_radians(),
    ));
    let mut plain = quad(
        vec3(-40.0, 0.0, 20.0),
        Vec3::X * 80.0,
        Vec3::NEG_Z * 80.0,
        8 * detail,
    );
    plain.name = "plain".into();
    let mut tower = cuboid(vec3(-0.3, 0.0, -0.3), vec3(0.3, 1.0, 0.3), detail);
    tower.name = "tower".into();
    for (mesh, albedo, x) in [
        (plain, vec3(0.35, 0.33, 0.28), 0.0),
        (tower, vec3(0.7, 0.3, 0.2), 1.6),
    ] {
        let name = mesh.name.to_string();
        let mesh = scene.add_mesh(mesh);
        let material = scene.add_material(Material::matt(&name, albedo));
        let place = Mat4::from_translation(Vec3::X * x);
        scene.add_instance(&name, mesh, material, place);
    }
    let place = Mat4::from_translation(vec3(0.0, 2.9, 0.0));
    scene.media.push(Medium {
        name: "cloud".into(),
        world_from_box: Some(place * Mat4::from_scale(vec3(4.0, 2.2, 3.0))),
        extinction: Vec3::splat(12.0),
        albedo: Vec3::splat(0.98),
        phase: PhaseFunction::HenyeyGreenstein(0.6),
        emission: Vec3::ZERO,
        density: Some(Arc::new(cumulus())),
        node: None,
    });
    let sun = Light::new("sun", LightKind::Directional, vec3(4.0, 3.7, 3.2));
    scene.lights = vec![sun.aimed(vec3(-4.5, 6.5, 4.0), Vec3::ZERO)];
    scene.environment = Some(Environment::clear_sky());
    scene
}

/// Densities from 0, outside of an ellipsoid, to 1.
pub(super) fn cumulus() -> DensityGrid {
    let place = |index: u32| (index as f32 + 0.5) / CELLS as f32;
    let mut values = Vec::with_capacity((CELLS * CELLS * CELLS) as usize);
    for z in 0..CELLS {
        for y in 0..CELLS {
            for x in 0..CELLS {
                let point = vec3(place(x), place(y), place(z));
                let from_center = 2.0 * point - 1.0;
                // The underside is flatter than the top.
                let height = from_center.y + 0.3;
                let flat = if height < 0.0 { 1.5 } else { 0.75 };
                let radius = vec3(from_center.x, flat * height, from_center.z).length();
                let density = 3.0 * (fractal_noise(4.0 * point) - 0.2 - 0.55 * radius * radius);
                values.push(if from_center.length() < 1.0 {
                    density.clamp(0.0, 1.0)
                } else {
                    0.0
                });
            }
        }
    }
    DensityGrid {
        size: [CELLS; 3],
        values,
    }
}

/// Four octaves of noise, each with twice the frequency and half the amplitude; 0 to 1.
pub(super) fn fractal_noise(point: Vec3) -> f32 {
    let octaves = (0..4).map(|octave| {
        let frequency = (1 << octave) as f32;
        noise(point * frequency) / (2.0 * frequency)
    });
    octaves.sum::<f32>() / (1.0 - 1.0 / 16.0)
}

/// Random values at the integer points, interpolated smoothly; 0 to 1.
fn noise(point: Vec3) -> f32 {
    let corner = point.floor().as_ivec3();
    let t = point - point.floor();
    let t = t * t * (3.0 - 2.0 * t);
    let mut sum = 0.0;
    for index in 0..8 {
        let offset = ivec3(index & 1, index >> 1 & 1, index >> 2);
        let weight = Vec3::select(offset.cmpeq(IVec3::ONE), t, 1.0 - t);
        sum += weight.element_product() * random(corner + offset);
    }
    sum
}

/// A hash of the point; 0 to 1.
fn random(point: IVec3) -> f32 {
    let [x, y, z] = point.to_array().map(|coordinate| coordinate as u32);
    let mut hash =
        x.wrapping_mul(0x9E37_79B1) ^ y.wrapping_mul(0x85EB_CA77) ^ z.wrapping_mul(0xC2B2_AE3D);
    // The finalizer of MurmurHash3.
    hash = (hash ^ hash >> 16).wrapping_mul(0x85EB_CA6B);
    hash = (hash ^ hash >> 13).wrapping_mul(0xC2B2_AE35);
    (hash ^ hash >> 16) as f32 / u32::MAX as f32
}
