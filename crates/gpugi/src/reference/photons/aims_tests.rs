//! Where photons are sent.

use bytemuck::Zeroable;
use glam::{Mat4, Quat, Vec3, vec3};
use gpugi_scene::builtin::shapes::cuboid;
use gpugi_scene::{Bounds, Material, Scene};

use super::aims::Measured;
use super::spheres;
use crate::paths::lights::Light;

/// Spheres hold the objects, however they are placed, and without a light there are none.
#[test]
fn spheres_hold_objects() {
    let mut mesh = cuboid(vec3(0.5, -1.0, 2.0), vec3(1.5, 1.0, 2.5), 1);
    // A vertex without a triangle does not count.
    mesh.positions.push(Vec3::splat(1e6));
    mesh.normals.push(Vec3::Y);
    let corners = mesh.positions[..mesh.positions.len() - 1].to_vec();
    let turned = Mat4::from_rotation_y(0.7) * Mat4::from_scale(vec3(3.0, 0.1, -2.0));
    let places = [
        Mat4::IDENTITY,
        turned,
        Mat4::from_scale(vec3(1.0, 4.0, 1.0)) * turned,
        Mat4::from_translation(Vec3::splat(1e4)) * turned,
    ];
    let table = [Light::zeroed()];
    for count in [1, 200] {
        let mut scene = Scene::new("objects");
        let mesh = scene.add_mesh(mesh.clone());
        let mirror = scene.add_material(Material::metal("mirror", Vec3::ONE, 0.0));
        for at in 0..count * places.len() {
            let turn = Mat4::from_quat(Quat::from_rotation_x(at as f32));
            let place =
                turn * Mat4::from_translation(Vec3::X * at as f32) * places[at % places.len()];
            scene.add_instance("", mesh, mirror, place);
        }
        assert!(spheres(&scene, &[], &mut Measured::default()).is_empty());
        let found = spheres(&scene, &table, &mut Measured::default());
        assert_eq!(found.len(), if count == 1 { 4 } else { 64 });
        for (at, instance) in scene.instances.iter().enumerate() {
            let points = corners
                .iter()
                .map(|corner| instance.world_from_mesh.transform_point3(*corner));
            let points: Vec<Vec3> = points.collect();
            let holder = found.iter().find(|sphere| {
                let mut distances = points.iter().map(|point| point.distance(sphere.center));
                distances.all(|distance| distance <= sphere.radius)
            });
            let holder = holder.unwrap_or_else(|| panic!("nothing holds object {at}"));
            if count == 1 {
                let size = Bounds::of(points.iter().copied()).diagonal() / 2.0;
                assert!(
                    holder.radius < 1.3 * size,
                    "object {at}: {} for {size}",
                    holder.radius
                );
            }
        }
    }
}
