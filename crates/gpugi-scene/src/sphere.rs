//! Instances that are exact spheres (`extras.gpugi.sphere`): rays meet the sphere, and their mesh is its tessellation.

use std::f64::consts::PI;

use glam::{DMat3, DVec3, Vec3};

use crate::{AlphaMode, Bounds, Mesh, Scene};

/// A sphere in mesh space, where its transform may make it an ellipsoid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Centre (m).
    pub center: Vec3,
    /// Radius (m), positive.
    pub radius: f32,
}

impl Sphere {
    /// The smallest box around it.
    pub fn bounds(&self) -> Bounds {
        Bounds {
            min: self.center - self.radius,
            max: self.center + self.radius,
        }
    }
}

/// Why an instance cannot be a sphere.
#[derive(Debug, Clone, Copy, thiserror::Error, PartialEq, Eq)]
pub enum SphereError {
    /// The mesh is no tessellated ball.
    #[error(
        "a sphere's mesh must be a closed ball, with vertices on its surface and triangles that face outward, no farther \
         than a tenth of its radius below the surface"
    )]
    NoBall,
    /// Rays do not test a sphere's alpha.
    #[error("a sphere must be opaque: its material has alpha")]
    Alpha,
    /// Area lights are sampled by triangles.
    #[error("a sphere must not emit light: its material is emissive")]
    Emissive,
}

/// Farthest that a vertex may lie from the surface (radii): coordinates of 16 bits and less may be rounded.
const FARTHEST_VERTEX: f64 = 5e-3;

/// Least distance of a triangle's plane from the centre (radii).
const NEAREST_TRIANGLE: f64 = 0.9;

/// Most that the triangles of a ball, seen from its centre, may leave out or cover twice (share of all directions): at
/// seams and poles, corners that should be the same may be rounded.
const LARGEST_GAP: f64 = 1e-4;

impl Mesh {
    /// The sphere of which the mesh is a tessellation. Indices must be in range.
    ///
    /// # Errors
    /// [`SphereError::NoBall`].
    pub fn sphere(&self) -> Result<Sphere, SphereError> {
        let sphere = self.fitted().ok_or(SphereError::NoBall)?;
        let center = sphere.center.as_dvec3();
        let radius = f64::from(sphere.radius);
        let from_center = |position: &Vec3| position.as_dvec3() - center;
        let is_on_surface = |position: &Vec3| {
            (from_center(position).length() - radius).abs() <= FARTHEST_VERTEX * radius
        };
        let corners = |triangle: &[u32; 3]| {
            triangle.map(|index| from_center(&self.positions[index as usize]))
        };
        let faces_outward = |triangle: &[u32; 3]| {
            let [a, b, c] = corners(triangle);
            let normal = (b - a).cross(c - a);
            normal == DVec3::ZERO || normal.dot(a) >= NEAREST_TRIANGLE * radius * normal.length()
        };
        let triangles = self.indices.as_chunks().0;
        let is_ball =
            self.positions.iter().all(is_on_surface) && triangles.iter().all(faces_outward) && {
                let covered: f64 = triangles
                    .iter()
                    .map(|triangle| solid_angle(corners(triangle)))
                    .sum();
                (covered / (4.0 * PI) - 1.0).abs() < LARGEST_GAP
            };
        is_ball.then_some(sphere).ok_or(SphereError::NoBall)
    }

    /// The sphere of least squares: |p|^2 = 2 c . p + k with r^2 = k + |c|^2 is linear in c and k. Coordinates are taken
    /// from the middle of the mesh.
    fn fitted(&self) -> Option<Sphere> {
        let middle = self.bounds().center().as_dvec3();
        let count = self.positions.len() as f64;
        let (mut squares, mut sum) = (DMat3::ZERO, DVec3::ZERO);
        let (mut weighted, mut all) = (DVec3::ZERO, 0.0);
        for position in &self.positions {
            let p = position.as_dvec3() - middle;
            squares += DMat3::from_cols(p * p.x, p * p.y, p * p.z);
            sum += p;
            weighted += p * p.length_squared();
            all += p.length_squared();
        }
        let mean = sum / count;
        let covariance = squares - DMat3::from_cols(sum * mean.x, sum * mean.y, sum * mean.z);
        let center = (covariance * 2.0).inverse() * (weighted - mean * all);
        let radius = ((all - 2.0 * sum.dot(center)) / count + center.length_squared()).sqrt();
        let sphere = Sphere {
            center: (middle + center).as_vec3(),
            radius: radius as f32,
        };
        let is_finite = sphere.center.is_finite() && sphere.radius.is_finite();
        (is_finite && sphere.radius > 0.0).then_some(sphere)
    }
}

/// Solid angle of a triangle seen from the origin (sr), positive if it faces away. Van Oosterom and Strackee, "The Solid
/// Angle of a Plane Triangle" (1983).
fn solid_angle([a, b, c]: [DVec3; 3]) -> f64 {
    let [x, y, z] = [a, b, c].map(DVec3::length);
    let under = x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y;
    2.0 * a.dot(b.cross(c)).atan2(under)
}

impl Scene {
    /// The sphere that each instance is, `None` for those that are triangles. Reads each mesh once.
    ///
    /// # Errors
    /// The number of the first instance that cannot be the sphere that it should be, and why.
    pub fn spheres(&self) -> Result<Vec<Option<Sphere>>, (usize, SphereError)> {
        let mut of_meshes = vec![None; self.meshes.len()];
        let instances = self.instances.iter().enumerate();
        let spheres = instances.map(|(index, instance)| {
            if !instance.is_sphere {
                return Ok(None);
            }
            let mesh = &self.meshes[instance.mesh];
            let sphere = of_meshes[instance.mesh].get_or_insert_with(|| mesh.sphere());
            let sphere = sphere.map_err(|error| (index, error))?;
            let material = &self.materials[instance.material];
            if material.alpha_mode != AlphaMode::Opaque {
                return Err((index, SphereError::Alpha));
            }
            if material.emissive != Vec3::ZERO {
                return Err((index, SphereError::Emissive));
            }
            Ok(Some(sphere))
        });
        spheres.collect()
    }
}

#[cfg(test)]
mod tests {
    use glam::{Mat4, vec3};

    use super::*;
    use crate::Material;
    use crate::builtin::shapes::{cuboid, sphere, torus, transformed};

    #[test]
    fn balls_of_any_place_and_size_are_known() {
        for (radius, segments) in [(0.5, 16), (1e-4, 64), (1e6, 32)] {
            let at = vec3(3.0, -20.0, 0.1) * radius;
            let mesh = transformed(sphere(radius, segments), &Mat4::from_translation(at));
            let found = mesh.sphere().unwrap();
            assert!((found.radius / radius - 1.0).abs() < 1e-5, "{found:?}");
            assert!((found.center - at).length() < 1e-5 * radius, "{found:?}");
        }
    }

    /// As exporters write them: seams and poles whose vertices are not quite the same.
    #[test]
    fn seams_may_be_rounded() {
        let mut ball = sphere(0.5, 16);
        for (index, position) in ball.positions.iter_mut().enumerate() {
            position.x += 1e-6 * (index % 3) as f32;
        }
        assert!(!ball.is_closed() && ball.sphere().is_ok());
    }

    #[test]
    fn what_is_no_ball_is_refused() {
        let ball = sphere(0.5, 32);
        let mut open = ball.clone();
        open.indices.truncate(open.indices.len() - 3 * 40);
        let mut inward = ball.clone();
        inward
            .indices
            .chunks_exact_mut(3)
            .for_each(|triangle| triangle.swap(0, 1));
        let mut dented = ball.clone();
        dented.positions[40] *= 0.98;
        let mut not_finite = ball.clone();
        not_finite.positions[40].x = f32::NAN;
        let egg = transformed(ball.clone(), &Mat4::from_scale(vec3(1.0, 1.1, 1.0)));
        let point = transformed(ball.clone(), &Mat4::from_scale(Vec3::ZERO));
        let torus = torus(0.5, 0.2, 32);
        let none = Mesh::default();
        let mut twice = ball.clone();
        twice.indices.extend_from_within(..);
        // The corners of a cube lie on a sphere, but its faces far below.
        let cube = cuboid(Vec3::NEG_ONE, Vec3::ONE, 1);
        for mesh in [
            open, inward, dented, not_finite, egg, point, torus, none, cube, twice,
        ] {
            assert_eq!(mesh.sphere(), Err(SphereError::NoBall));
        }
        assert!(ball.sphere().is_ok());
    }

    #[test]
    fn spheres_have_no_alpha_and_do_not_emit() {
        let mut scene = Scene::new("spheres");
        let mesh = scene.add_mesh(sphere(0.5, 32));
        let material = scene.add_material(Material::default());
        for _ in 0..2 {
            scene.add_instance("ball", mesh, material, Mat4::IDENTITY);
        }
        scene.instances[1].is_sphere = true;
        let found = scene.spheres().unwrap();
        assert!(found[0].is_none() && found[1].is_some());
        scene.materials[material].emissive = Vec3::ONE;
        assert_eq!(scene.spheres(), Err((1, SphereError::Emissive)));
        scene.materials[material].alpha_mode = AlphaMode::Blend;
        assert_eq!(scene.spheres(), Err((1, SphereError::Alpha)));
    }
}
