//! Closed meshes whose fronts no light reaches: solids that are wound inward, and rooms that are wound outward. Both
//! sides of a double-sided surface are visible, but a texel holds the light of one.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{DVec3, Mat4, Vec3};

use crate::{AlphaMode, Bounds, LightKind, Material, Mesh, Scene};

/// Vertices of an emitter that are looked at, at most.
const MOST_VERTICES: usize = 8;

impl Scene {
    /// The scene with all closed, opaque, double-sided meshes turned inside out of which light reaches only the back,
    /// and the numbers of their instances. It looks the same.
    ///
    /// No light passes such a mesh, so the places of lights tell which sides they reach. Where lights reach both sides
    /// or none, the front stays the front.
    pub fn with_lit_fronts(&self) -> (Self, Vec<usize>) {
        let lights = Lights::of(self);
        let mut is_solid = vec![None; self.meshes.len()];
        let is_unlit = |index: &usize| {
            let instance = &self.instances[*index];
            let mesh = &self.meshes[instance.mesh];
            hides_a_side(&self.materials[instance.material])
                && !instance.is_sphere
                && *is_solid[instance.mesh].get_or_insert_with(|| mesh.is_closed())
                && lights.reach_the_back_alone(mesh, &instance.world_from_mesh)
        };
        let turned: Vec<usize> = (0..self.instances.len()).filter(is_unlit).collect();
        let mut scene = self.clone();
        let mut numbers = HashMap::new();
        for &index in &turned {
            let mesh = self.instances[index].mesh;
            let number = *numbers
                .entry(mesh)
                .or_insert_with(|| scene.add_mesh(self.meshes[mesh].inside_out()));
            scene.instances[index].mesh = number;
        }
        (scene, turned)
    }
}

/// Whether surfaces of this material have two sides, and no light passes from one to the other or starts there.
fn hides_a_side(material: &Material) -> bool {
    material.double_sided
        && material.alpha_mode == AlphaMode::Opaque
        && material.transmission == 0.0
        && !material.is_translucent()
        && material.emissive == Vec3::ZERO
}

/// Where the light of a scene starts.
struct Lights {
    places: Vec<DVec3>,
    /// Whether there is also light from infinitely far away. Without any light, that is the ambient light.
    from_afar: bool,
}

impl Lights {
    fn of(scene: &Scene) -> Self {
        let mut from_afar = scene.environment.is_some();
        let mut places = Vec::new();
        let shining = scene
            .lights
            .iter()
            .filter(|light| light.intensity != Vec3::ZERO);
        for light in shining {
            match light.kind {
                LightKind::Directional => from_afar = true,
                LightKind::Point | LightKind::Spot { .. } => {
                    places.push(light.position().as_dvec3());
                }
            }
        }
        for instance in &scene.instances {
            let positions = &scene.meshes[instance.mesh].positions;
            if scene.materials[instance.material].emissive != Vec3::ZERO {
                let step = positions.len().div_ceil(MOST_VERTICES).max(1);
                let world_from_mesh = instance.world_from_mesh.as_dmat4();
                let some = positions.iter().step_by(step);
                places.extend(
                    some.map(|position| world_from_mesh.transform_point3(position.as_dvec3())),
                );
            }
        }
        for medium in &scene.media {
            if medium.emission != Vec3::ZERO {
                let center = medium
                    .world_from_box
                    .map(|world_from_box| world_from_box.w_axis.truncate());
                from_afar |= center.is_none();
                places.extend(center.map(|center| center.as_dvec3()));
            }
        }
        from_afar |= places.is_empty();
        Self { places, from_afar }
    }

    /// Whether light reaches the back of a closed mesh, and not its front.
    fn reach_the_back_alone(&self, mesh: &Mesh, world_from_mesh: &Mat4) -> bool {
        let world_from_mesh = world_from_mesh.as_dmat4();
        let corner = |&index: &u32| {
            world_from_mesh.transform_point3(mesh.positions[index as usize].as_dvec3())
        };
        // A mirroring transform reverses the winding, and keeps fronts in front.
        let sign = world_from_mesh.determinant().signum();
        let triangles: Vec<[DVec3; 3]> = mesh
            .indices
            .as_chunks::<3>()
            .0
            .iter()
            .map(|triangle| triangle.each_ref().map(corner))
            .collect();
        let bounds = Bounds::of(triangles.as_flattened().iter().map(|point| point.as_vec3()));
        let volume: f64 = triangles.iter().map(|[a, b, c]| a.dot(b.cross(*c))).sum();
        let faces_outward = volume * sign > 0.0;
        if faces_outward && self.from_afar {
            return false;
        }
        let is_inside = |place: &DVec3| {
            let near = place.as_vec3();
            near.cmpge(bounds.min).all()
                && near.cmple(bounds.max).all()
                && turns_around(&triangles, *place).abs() > 0.5
        };
        let inside = self.places.iter().filter(|place| is_inside(place)).count();
        let is_lit_inside = inside > 0;
        let is_lit_outside = self.from_afar || inside < self.places.len();
        if faces_outward {
            is_lit_inside && !is_lit_outside
        } else {
            is_lit_outside && !is_lit_inside
        }
    }
}

/// How often triangles surround a point: the sum of their solid angles over 4 pi (Van Oosterom and Strackee 1983).
fn turns_around(triangles: &[[DVec3; 3]], point: DVec3) -> f64 {
    let halves = triangles.iter().map(|corners| {
        let [a, b, c] = corners.map(|corner| corner - point);
        let [la, lb, lc] = [a, b, c].map(DVec3::length);
        let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        a.dot(b.cross(c)).atan2(below)
    });
    halves.sum::<f64>() / (2.0 * std::f64::consts::PI)
}

impl Mesh {
    /// The mesh with fronts for backs. Triangle t stays triangle t; its second and third corners change places.
    fn inside_out(&self) -> Arc<Self> {
        let mut mesh = self.clone();
        mesh.tree = None;
        for triangle in mesh.indices.as_chunks_mut::<3>().0 {
            triangle.swap(1, 2);
        }
        for normal in &mut mesh.normals {
            *normal = -*normal;
        }
        // Seen from behind, all of a normal map's frame is reversed. With both of them, the cross product of normal and
        // tangent would keep its direction.
        for tangent in &mut mesh.tangents {
            *tangent = -*tangent;
        }
        Arc::new(mesh)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Light;

    /// Whether the front of a tetrahedron around the origin is turned to the light of a lamp at `place`.
    fn turns(is_inward: bool, scale: Vec3, place: Option<Vec3>, change: fn(&mut Scene)) -> bool {
        let corners = [
            [1.0, 1.0, 1.0],
            [1.0, -1.0, -1.0],
            [-1.0, 1.0, -1.0],
            [-1.0, -1.0, 1.0],
        ];
        let corners = corners.map(|[x, y, z]| Vec3::new(x, y, z));
        let solid = Mesh {
            positions: corners.to_vec(),
            normals: corners.map(Vec3::normalize).to_vec(),
            indices: vec![0, 1, 2, 0, 3, 1, 0, 2, 3, 1, 3, 2],
            ..Mesh::default()
        };
        let mut scene = Scene::new("solid");
        let mesh = scene.add_mesh(if is_inward {
            solid.inside_out()
        } else {
            Arc::new(solid)
        });
        let material = scene.add_material(Material {
            double_sided: true,
            ..Material::matt("matt", Vec3::ONE)
        });
        scene.add_instance("solid", mesh, material, Mat4::from_scale(scale));
        if let Some(place) = place {
            let light = Light::new("lamp", LightKind::Point, Vec3::ONE);
            scene.lights.push(light.aimed(place, place + Vec3::X));
        }
        change(&mut scene);
        let (lit, turned) = scene.with_lit_fronts();
        assert!(turned.is_empty() || turned == [0]);
        let again = lit.with_lit_fronts().1;
        assert!(again.is_empty(), "what is turned faces the light");
        !turned.is_empty()
    }

    #[test]
    fn closed_meshes_face_the_light() {
        let keep: fn(&mut Scene) = |_| ();
        let (inside, outside) = (Some(Vec3::ZERO), Some(Vec3::splat(9.0)));
        let mirror = Vec3::new(-1.0, 1.0, 1.0);
        // A mirroring transform keeps fronts in front.
        for scale in [Vec3::ONE, mirror] {
            for is_inward in [false, true] {
                let turns = |place, change| turns(is_inward, scale, place, change);
                assert_eq!(turns(inside, keep), !is_inward, "{scale}");
                assert_eq!(turns(outside, keep), is_inward, "{scale}");
                assert_eq!(turns(None, keep), is_inward, "ambient light");
                let sun = |scene: &mut Scene| {
                    let light = Light::new("sun", LightKind::Directional, Vec3::ONE);
                    scene.lights.push(light);
                };
                assert!(!turns(inside, sun), "light on both sides");
                assert_eq!(turns(outside, sun), is_inward);
                let changes: [fn(&mut Scene); 5] = [
                    |scene: &mut Scene| scene.materials[0].double_sided = false,
                    |scene| scene.materials[0].transmission = 0.5,
                    |scene| scene.materials[0].alpha_mode = AlphaMode::Blend,
                    |scene| scene.materials[0].emissive = Vec3::ONE,
                    |scene| {
                        let mut open = scene.meshes[0].as_ref().clone();
                        open.indices.truncate(3);
                        scene.meshes[0] = Arc::new(open);
                    },
                ];
                for change in changes {
                    assert!(!turns(inside, change) && !turns(outside, change));
                }
            }
        }
    }
}
