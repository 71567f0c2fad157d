//! Emissive triangles: area lights.

use glam::Vec3;
use gpugi_scene::image::luminance;
use gpugi_scene::{Material, Pixels, Scene};

use super::rows::is_mirrored;

/// A triangle that emits light, in world space.
#[derive(Debug, Clone, Copy)]
pub struct Emitter {
    /// Index of its instance.
    pub instance: u32,
    /// Index of the triangle in its mesh.
    pub primitive: u32,
    /// Corners (m), counterclockwise seen from the front.
    pub corners: [Vec3; 3],
    /// Mean emitted radiance [W/sr/m^2].
    pub radiance: Vec3,
    /// Whether the back emits, too.
    pub two_sided: bool,
}

impl Emitter {
    /// Luminous power: pi L A, for both sides if both emit.
    pub fn power(&self) -> f64 {
        let [a, b, c] = self.corners;
        let area = f64::from((b - a).cross(c - a).length()) / 2.0;
        let sides = if self.two_sided { 2.0 } else { 1.0 };
        std::f64::consts::PI * f64::from(self.luminance()) * area * sides
    }

    /// Luminance of the mean radiance.
    pub fn luminance(&self) -> f32 {
        luminance(self.radiance)
    }
}

/// Every emissive triangle of the scene in world space, by instance.
pub(super) fn emitters(scene: &Scene) -> Vec<Emitter> {
    let instances = 0..scene.instances.len();
    instances
        .flat_map(|index| emitters_of(scene, index))
        .collect()
}

/// Whether the scene has emissive triangles.
pub(crate) fn has_emitters(scene: &Scene) -> bool {
    (0..scene.instances.len()).any(|index| !emitters_of(scene, index).is_empty())
}

/// The emissive triangles of one instance in world space, with the mean of its emissive texture over each.
pub(super) fn emitters_of(scene: &Scene, index: usize) -> Vec<Emitter> {
    let instance = &scene.instances[index];
    let material = &scene.materials[instance.material];
    if material.emissive == Vec3::ZERO {
        return Vec::new();
    }
    let mesh = &scene.meshes[instance.mesh];
    let mirrored = is_mirrored(&instance.world_from_mesh);
    let triangles = (0..).zip(mesh.indices.chunks_exact(3));
    let emitters = triangles.map(|(primitive, triangle)| {
        let mut corners = [0, 1, 2].map(|corner| {
            instance
                .world_from_mesh
                .transform_point3(mesh.positions[triangle[corner] as usize])
        });
        if mirrored {
            corners.swap(1, 2);
        }
        Emitter {
            instance: index as u32,
            primitive,
            corners,
            radiance: material.emissive * mean_emission(scene, material, mesh, triangle),
            two_sided: material.has_two_sides(),
        }
    });
    let emitters = emitters.filter(|emitter| emitter.radiance.max_element() > 0.0);
    emitters.collect()
}

/// Mean of the emissive texture over a triangle, at a fixed pattern of 36 points.
fn mean_emission(
    scene: &Scene,
    material: &Material,
    mesh: &gpugi_scene::Mesh,
    triangle: &[u32],
) -> Vec3 {
    let Some(reference) = &material.emissive_texture else {
        return Vec3::ONE;
    };
    let uvs = &mesh.uvs[reference.uv_set.min(1) as usize];
    let image = &scene.images[scene.textures[reference.texture].image];
    let Pixels::Rgba8(texels) = &image.pixels else {
        return Vec3::ONE;
    };
    let corner = |index: usize| {
        uvs.get(triangle[index] as usize)
            .copied()
            .unwrap_or_default()
    };
    const STEPS: usize = 8;
    let mut sum = Vec3::ZERO;
    let mut count = 0.0;
    for i in 0..STEPS {
        for j in 0..STEPS - i {
            let (u, v) = (
                (i as f32 + 1.0 / 3.0) / STEPS as f32,
                (j as f32 + 1.0 / 3.0) / STEPS as f32,
            );
            let uv = corner(0) * (1.0 - u - v) + corner(1) * u + corner(2) * v;
            let uv = reference.uv_from_mesh.transform_point2(uv);
            let texel = |coordinate: f32, size: u32| {
                ((coordinate.rem_euclid(1.0) * size as f32) as u32).min(size - 1) as usize
            };
            let at =
                (texel(uv.y, image.height) * image.width as usize + texel(uv.x, image.width)) * 4;
            sum += Vec3::from_array([0, 1, 2].map(|channel| srgb_to_linear(texels[at + channel])));
            count += 1.0;
        }
    }
    sum / count
}

fn srgb_to_linear(value: u8) -> f32 {
    let value = f32::from(value) / 255.0;
    if value <= 0.04045 {
        value / 12.92
    } else {
        ((value + 0.055) / 1.055).powf(2.4)
    }
}
