//! Where photons are sent: the lights that emit them, and spheres around the objects with ideal lobes.

use glam::Vec3;
use gpugi_scene::{Bounds, Image, Material, MaterialModel, Pixels, Scene};

use crate::light_paths::LightClass;
use crate::reference::alias;
use crate::reference::lights::{DIRECTIONAL, LIGHT_TRACED, Light, SKY, TRIANGLE, luminance};
use crate::reference::surroundings::{Solid, around};
use crate::scene::DELTA_ROUGHNESS;

/// Most spheres; objects that lie close together share one. Each photon visits all of them.
const MOST_SPHERES: usize = 64;
/// Part of a light's power by which it is chosen even if no object looks large from it, because a lamp or a soft light
/// is wider than its centre.
const LEAST_SHARE: f64 = 1e-3;

/// The light tracer finds the light of a lamp only if the spheres look smaller than this from it (sr). Photons of lamps
/// close to large mirrors spread over the whole scene, most of them out of view, while paths from the eye find such lamps.
const LARGEST_AIM: f64 = std::f64::consts::PI;

/// A sphere around an object, in world space [m].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    pub center: Vec3,
    pub radius: f32,
}

/// Lights and spheres, ready for upload.
#[derive(Debug)]
pub struct Aims {
    /// Rows of the light tracer's own light table. Lights are chosen by the power that they send into the spheres.
    pub rows: Vec<Light>,
    /// `aims` of photons/emission.wesl.
    pub words: Vec<[u32; 4]>,
    /// Number of spheres.
    pub spheres: u32,
    /// Power that the lights send into the spheres (luminance; W).
    pub power: f64,
}

/// Marks the emissive triangles whose light by way of ideal surfaces the path tracer leaves to the light tracer. Returns
/// whether there are any. This depends on the scene alone, so that parts of its light add up path by path.
pub fn mark_lamps(scene: &Scene, table: &mut [Light]) -> bool {
    let spheres = spheres(scene);
    let mut has_lamps = false;
    for row in table.iter_mut().filter(|row| row.kind == TRIANGLE) {
        if !spheres.is_empty() && solid_angle(&spheres, middle(row)) < LARGEST_AIM {
            row.flags |= LIGHT_TRACED;
            has_lamps = true;
        }
    }
    has_lamps
}

impl Aims {
    /// The aims of the lights of some classes; `None` if no light may meet an ideal lobe first. `table` are the rows of
    /// the path tracer, after [`mark_lamps`].
    pub fn new(
        scene: &Scene,
        table: &[Light],
        classes: &[LightClass],
        solids: &[Solid],
    ) -> Option<Self> {
        let is_wanted = |row: &&Light| match row.kind {
            SKY => false,
            TRIANGLE => classes.contains(&LightClass::Area) && row.flags & LIGHT_TRACED != 0,
            _ => classes.contains(&LightClass::Punctual),
        };
        let mut rows: Vec<Light> = table.iter().filter(is_wanted).copied().collect();
        let spheres = spheres(scene);
        if rows.is_empty() || spheres.is_empty() {
            return None;
        }
        let powers: Vec<f64> = rows.iter().map(|row| power_toward(row, &spheres)).collect();
        let entries = alias::table(&powers);
        if entries.is_empty() {
            return None;
        }
        for (row, entry) in rows.iter_mut().zip(entries) {
            row.threshold = entry.threshold;
            row.alias_row = entry.alias;
            row.probability = entry.probability;
        }
        let of_spheres = spheres.iter().map(|one| {
            let Sphere { center, radius } = one;
            [center.x, center.y, center.z, *radius].map(f32::to_bits)
        });
        let of_lights = rows.iter().map(|row| match row.kind {
            DIRECTIONAL => around(&[], Vec3::ZERO),
            _ => around(solids, middle(row)),
        });
        Some(Self {
            words: of_spheres.chain(of_lights).collect(),
            spheres: spheres.len() as u32,
            power: powers.iter().sum(),
            rows,
        })
    }
}

/// Position of a point or spot light, or the centre of a triangle.
fn middle(row: &Light) -> Vec3 {
    let [position, a, b] = [row.position, row.direction, row.edge].map(Vec3::from_array);
    match row.kind {
        TRIANGLE => position + (a + b) / 3.0,
        _ => position,
    }
}

/// Power that a light sends into the spheres, about (luminance; W).
fn power_toward(row: &Light, spheres: &[Sphere]) -> f64 {
    let emitted = luminance(Vec3::from_array(row.emission));
    if row.kind == DIRECTIONAL {
        let radii = spheres.iter().map(|one| f64::from(one.radius));
        return emitted * std::f64::consts::PI * radii.map(|radius| radius * radius).sum::<f64>();
    }
    // Power over the solid angles of the spheres. An emissive triangle sends pi L A, most of it in one direction.
    let solid_angle = solid_angle(spheres, middle(row));
    let intensity = match row.kind {
        TRIANGLE => {
            let [a, b] = [row.direction, row.edge].map(Vec3::from_array);
            emitted * f64::from(a.cross(b).length()) / 2.0
        }
        _ => emitted,
    };
    let least = LEAST_SHARE * 4.0 * std::f64::consts::PI;
    intensity * solid_angle.max(least)
}

/// Solid angle of all spheres seen from a point (sr); overlaps count several times.
fn solid_angle(spheres: &[Sphere], from: Vec3) -> f64 {
    spheres.iter().map(|one| one.solid_angle(from)).sum()
}

impl Sphere {
    fn around(points: &[Vec3]) -> Self {
        let center = Bounds::of(points.iter().copied()).center();
        let radii = points.iter().map(|point| point.distance(center));
        Self {
            center,
            // Rays that touch the surface from inside must not miss the sphere by rounding.
            radius: radii.fold(0.0, f32::max) * 1.0001,
        }
    }

    /// Solid angle seen from a point (sr).
    fn solid_angle(&self, from: Vec3) -> f64 {
        let sine = f64::from(self.radius) / f64::from(from.distance(self.center)).max(1e-30);
        if sine >= 1.0 {
            return 4.0 * std::f64::consts::PI;
        }
        2.0 * std::f64::consts::PI * (1.0 - (1.0 - sine * sine).sqrt())
    }
}

/// Spheres around the objects that may have ideal lobes.
fn spheres(scene: &Scene) -> Vec<Sphere> {
    let objects = scene.instances.iter().filter_map(|instance| {
        if !may_be_ideal(scene, &scene.materials[instance.material]) {
            return None;
        }
        let mesh = &scene.meshes[instance.mesh];
        let place = |at: &Vec3| instance.world_from_mesh.transform_point3(*at);
        let points: Vec<Vec3> = mesh.positions.iter().map(place).collect();
        let is_visible = !points.is_empty() && points.iter().all(|point| point.is_finite());
        is_visible.then_some(points)
    });
    let mut groups = Vec::new();
    share(objects.collect(), MOST_SPHERES, &mut groups);
    let spheres = groups.iter().map(|points| Sphere::around(points));
    spheres.filter(|one| one.radius > 0.0).collect()
}

/// Splits objects into at most `most` groups of neighbours.
fn share(mut objects: Vec<Vec<Vec3>>, most: usize, groups: &mut Vec<Vec<Vec3>>) {
    if objects.len() <= most {
        groups.append(&mut objects);
    } else if most == 1 {
        groups.push(objects.concat());
    } else {
        let center = |points: &[Vec3]| Bounds::of(points.iter().copied()).center();
        let spread = Bounds::of(objects.iter().map(|points| center(points)));
        let axis = (spread.max - spread.min).max_position();
        objects.sort_by_cached_key(|points| ordered(center(points)[axis]));
        let upper = objects.split_off(objects.len() / 2);
        share(objects, most / 2, groups);
        share(upper, most - most / 2, groups);
    }
}

/// Bits of a finite float in the order of the floats.
fn ordered(value: f32) -> i32 {
    let bits = value.to_bits() as i32;
    if bits < 0 {
        i32::MIN.wrapping_sub(bits)
    } else {
        bits
    }
}

/// Whether a material may reflect or refract ideally anywhere. The path tracer leaves light of lamps by way of ideal
/// surfaces to the light tracer, so none may be forgotten.
fn may_be_ideal(scene: &Scene, material: &Material) -> bool {
    let reflects = match material.model {
        MaterialModel::Phong { .. } => false,
        MaterialModel::Conductor { .. } => true,
        MaterialModel::MetallicRoughness => {
            material.specular > 0.0 || material.metallic > 0.0 || material.transmission > 0.0
        }
    };
    let least = match &material.metallic_roughness_texture {
        Some(reference) => least_green(&scene.images[scene.textures[reference.texture].image]),
        None => 1.0,
    };
    reflects && material.roughness * least < DELTA_ROUGHNESS
}

/// The smallest value of an image's green channel.
fn least_green(image: &Image) -> f32 {
    match &image.pixels {
        Pixels::Rgba8(texels) => {
            let green = texels.chunks_exact(4).map(|texel| texel[1]);
            f32::from(green.min().unwrap_or(0)) / 255.0
        }
        Pixels::Rgba32Float(texels) => {
            let green = texels.chunks_exact(4).map(|texel| texel[1]);
            green.fold(f32::INFINITY, f32::min)
        }
    }
}
