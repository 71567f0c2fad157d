//! Finds the solids that contain the eye. They are the initial media stack of every path.

use std::sync::Arc;

use glam::{DVec3, Mat4, Vec3};
use gpugi_scene::{Bounds, Mesh};

use crate::scene::GpuScene;

/// Number of solids that a stack of scene/medium.wesl holds, and its marker for an empty entry.
const DEPTH: usize = 4;
const NONE: u32 = u32::MAX;

/// A closed, transmissive mesh with an interior (KHR_materials_volume).
#[derive(Debug)]
pub struct Solid {
    material: u32,
    /// In world space.
    bounds: Bounds,
    mesh: Arc<Mesh>,
    world_from_mesh: Mat4,
}

/// The solids of a scene.
pub fn solids(scene: &GpuScene) -> Vec<Solid> {
    let kept = scene.kept();
    let mut solids = Vec::new();
    for instance in &kept.instances {
        let material = &kept.materials[instance.material];
        if material.transmission <= 0.0 || material.volume.is_none() {
            continue;
        }
        let (is_closed, bounds) = scene.shape_of_mesh(instance.mesh);
        if is_closed {
            solids.push(Solid {
                material: instance.material as u32,
                bounds: bounds.transformed(&instance.world_from_mesh),
                mesh: kept.meshes[instance.mesh].clone(),
                world_from_mesh: instance.world_from_mesh,
            });
        }
    }
    solids
}

/// Materials of the solids that contain `eye` (world space (m)), innermost first, as a stack of scene/medium.wesl.
pub fn around(solids: &[Solid], eye: Vec3) -> [u32; DEPTH] {
    let mut found: Vec<(f64, u32)> = solids
        .iter()
        .filter_map(|solid| Some((solid.way_out(eye)?, solid.material)))
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut stack = [NONE; DEPTH];
    for (place, (_, material)) in stack.iter_mut().zip(found) {
        *place = material;
    }
    stack
}

impl Solid {
    /// Distance from `eye` to the nearest crossing of a ray with the solid's surface (m). `None` if `eye` is outside,
    /// where the ray crosses the surface an even number of times.
    fn way_out(&self, eye: Vec3) -> Option<f64> {
        let Bounds { min, max } = self.bounds;
        if !(eye.cmpge(min).all() && eye.cmple(max).all()) {
            return None;
        }
        // Avoid the axes and diagonals, because model edges often lie along them.
        let direction = DVec3::new(0.267_309_1, 0.801_783_7, 0.534_522_5).normalize();
        let (mut count, mut nearest) = (0, f64::INFINITY);
        let place = |&index: &u32| {
            let position = self.mesh.positions[index as usize];
            self.world_from_mesh.transform_point3(position)
        };
        for triangle in self.mesh.indices.as_chunks::<3>().0 {
            if let Some(t) = crossing(&triangle.each_ref().map(place), eye.as_dvec3(), direction) {
                count += 1;
                nearest = nearest.min(t);
            }
        }
        (count % 2 == 1).then_some(nearest)
    }
}

/// Distance along a ray to its intersection with a triangle (Moeller and Trumbore, "Fast, Minimum Storage Ray-Triangle
/// Intersection", 1997).
fn crossing(triangle: &[Vec3; 3], origin: DVec3, direction: DVec3) -> Option<f64> {
    let [a, b, c] = triangle.map(|corner| corner.as_dvec3());
    let (e1, e2) = (b - a, c - a);
    let p = direction.cross(e2);
    let determinant = e1.dot(p);
    let s = origin - a;
    let u = s.dot(p) / determinant;
    let q = s.cross(e1);
    let v = direction.dot(q) / determinant;
    let t = e2.dot(q) / determinant;
    // These are NaN if the determinant is 0, which fails every comparison.
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
}

#[cfg(test)]
mod tests {
    use glam::{Mat4, vec3};
    use gpugi_scene::builtin::shapes::{cuboid, quad, sphere};
    use gpugi_scene::{Material, Scene, Volume};

    use super::*;
    use crate::testing::test_gpu;

    #[test]
    fn the_innermost_solid_comes_first() {
        let Some(gpu) = test_gpu() else { return };
        let glass = Material {
            transmission: 1.0,
            volume: Some(Volume {
                attenuation_distance: 1.0,
                attenuation_color: Vec3::ONE,
            }),
            ..Material::default()
        };
        let mut scene = Scene::new("nested");
        let meshes = [
            cuboid(Vec3::splat(-1.0), Vec3::ONE, 2),
            sphere(0.5, 16),
            quad(vec3(-3.0, 0.9, 3.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0, 1),
        ]
        .map(|mesh| scene.add_mesh(mesh));
        for mesh in meshes {
            let material = scene.add_material(glass.clone());
            scene.add_instance("", mesh, material, Mat4::from_translation(Vec3::X));
        }
        // A block that is not transmissive, and one without an interior.
        for material in [
            Material::default(),
            Material {
                volume: None,
                ..glass
            },
        ] {
            let material = scene.add_material(material);
            scene.add_instance("", meshes[0], material, Mat4::from_translation(Vec3::X));
        }
        let on_gpu = GpuScene::with_rays(&gpu, &scene).unwrap();
        let solids = solids(&on_gpu);
        let at = |x: f32| around(&solids, vec3(x, 0.0, 0.0));
        assert_eq!(at(-0.5), [NONE; 4]);
        assert_eq!(at(0.2), [0, NONE, NONE, NONE]);
        assert_eq!(at(1.0), [1, 0, NONE, NONE]);
        assert_eq!(at(1.4), [1, 0, NONE, NONE]);
        assert_eq!(at(1.9), [0, NONE, NONE, NONE]);
        assert_eq!(at(2.1), [NONE; 4]);
        assert_eq!(around(&solids, Vec3::NAN), [NONE; 4]);
    }
}
