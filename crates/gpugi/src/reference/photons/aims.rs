//! Where photons are sent: the lights that emit them, and spheres around the objects with ideal lobes.

use std::collections::HashMap;
use std::f64::consts::PI;
use std::sync::Arc;

use glam::{Mat3, Mat4, Vec3};
use gpugi_scene::{Bounds, Image, Material, MaterialModel, Mesh, Pixels, Scene};

use crate::light_paths::LightClass;
use crate::paths::alias;
use crate::paths::lights::{DIRECTIONAL, LIGHT_TRACED, Light, SKY, TRIANGLE, luminance};
use crate::reference::surroundings::{Solid, around};
use crate::scene::DELTA_ROUGHNESS;

/// Most spheres; objects that lie close together share one. Each photon visits all of them.
const MOST_SPHERES: usize = 64;
/// Part of a light's power by which it is chosen even if no object looks large from it, because a lamp or a soft light
/// is wider than its centre.
const LEAST_SHARE: f64 = 1e-3;

/// Factor on radii. Rays that touch a surface from inside must not miss its sphere by rounding.
const ROUNDING: f32 = 1.0001;

/// The light tracer finds the light of a lamp only if the solid angles of the spheres seen from it sum to less than
/// this (sr); overlaps count twice. Photons of lamps close to large mirrors spread over the whole scene, most of them out
/// of view, while paths from the eye find such lamps.
const LARGEST_AIM: f64 = PI;

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
    /// Irradiance of the sphere that the lights light most, across the light (luminance; W/m^2).
    pub irradiance: f64,
}

/// Marks the emissive triangles whose light by way of ideal surfaces the path tracer leaves to the light tracer, and no
/// others. Returns whether there are any. This depends on the scene alone, so that parts of its light add up path by path.
pub fn mark_lamps(spheres: &[Sphere], table: &mut [Light]) -> bool {
    let mut has_lamps = false;
    for row in table.iter_mut().filter(|row| row.kind == TRIANGLE) {
        row.flags &= !LIGHT_TRACED;
        if !spheres.is_empty() && solid_angle(spheres, middle(row)) < LARGEST_AIM {
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
        spheres: &[Sphere],
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
        if rows.is_empty() || spheres.is_empty() {
            return None;
        }
        let powers: Vec<f64> = rows.iter().map(|row| power_toward(row, spheres)).collect();
        let entries = alias::table(&powers);
        if entries.is_empty() {
            return None;
        }
        for (row, entry) in rows.iter_mut().zip(entries) {
            row.threshold = entry.threshold;
            row.alias_row = entry.alias;
            row.probability = entry.probability;
        }
        let of_spheres = spheres.iter().map(|sphere| {
            let Sphere { center, radius } = sphere;
            [center.x, center.y, center.z, *radius].map(f32::to_bits)
        });
        let of_lights = rows.iter().map(|row| match row.kind {
            DIRECTIONAL => around(&[], Vec3::ZERO),
            _ => around(solids, middle(row)),
        });
        Some(Self {
            words: of_spheres.chain(of_lights).collect(),
            spheres: spheres.len() as u32,
            irradiance: spheres
                .iter()
                .map(|sphere| rows.iter().map(|row| irradiance(row, sphere)).sum())
                .fold(0.0, f64::max),
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

/// Irradiance of a sphere by a light, across the light (luminance; W/m^2), about.
fn irradiance(row: &Light, sphere: &Sphere) -> f64 {
    match row.kind {
        DIRECTIONAL => strength(row),
        _ => strength(row) * sphere.solid_angle(middle(row)) / sphere.disc(),
    }
}

/// The weight by which a light is chosen: the power that it sends into the spheres, about (luminance; W).
fn power_toward(row: &Light, spheres: &[Sphere]) -> f64 {
    let of_spheres = spheres
        .iter()
        .map(|sphere| irradiance(row, sphere) * sphere.disc());
    let least = match row.kind {
        DIRECTIONAL => 0.0,
        _ => strength(row) * LEAST_SHARE * 4.0 * PI,
    };
    of_spheres.sum::<f64>().max(least)
}

/// Intensity of a light at a point (luminance; W/sr), or irradiance by a directional light (luminance; W/m^2).
fn strength(row: &Light) -> f64 {
    let emitted = luminance(Vec3::from_array(row.emission));
    match row.kind {
        // An emissive triangle sends pi L A, most of it in one direction.
        TRIANGLE => {
            let [a, b] = [row.direction, row.edge].map(Vec3::from_array);
            emitted * f64::from(a.cross(b).length()) / 2.0
        }
        _ => emitted,
    }
}

/// Sum of the solid angles of all spheres seen from a point (sr). Where spheres overlap, each of them counts.
fn solid_angle(spheres: &[Sphere], from: Vec3) -> f64 {
    spheres.iter().map(|sphere| sphere.solid_angle(from)).sum()
}

impl Sphere {
    /// A sphere around others.
    fn around(spheres: &[Self]) -> Self {
        let boxes = spheres.iter().map(|sphere| Bounds {
            min: sphere.center - sphere.radius,
            max: sphere.center + sphere.radius,
        });
        let center = boxes.fold(Bounds::EMPTY, Bounds::union).center();
        let radii = spheres
            .iter()
            .map(|sphere| sphere.center.distance(center) + sphere.radius);
        Self {
            center,
            radius: radii.fold(0.0, f32::max) * ROUNDING,
        }
    }

    /// Area of the sphere's cross section (m^2).
    fn disc(&self) -> f64 {
        PI * f64::from(self.radius) * f64::from(self.radius)
    }

    /// Solid angle seen from a point (sr).
    fn solid_angle(&self, from: Vec3) -> f64 {
        let sine = f64::from(self.radius) / f64::from(from.distance(self.center)).max(1e-30);
        if sine >= 1.0 {
            return 4.0 * PI;
        }
        // 1 - cos; this form keeps the digits of small angles.
        2.0 * PI * sine * sine / (1.0 + (1.0 - sine * sine).sqrt())
    }
}

/// The extent of a mesh, in mesh space (m).
#[derive(Debug)]
struct Extent {
    bounds: Bounds,
    /// Radius of the sphere around the centre of `bounds`.
    radius: f32,
}

impl Extent {
    fn of(mesh: &Mesh) -> Self {
        let points = || mesh.indices.iter().map(|&at| mesh.positions[at as usize]);
        let bounds = Bounds::of(points());
        let radii = points().map(|point| point.distance(bounds.center()));
        Self {
            bounds,
            radius: radii.fold(0.0, f32::max),
        }
    }

    /// A sphere around an instance of the mesh: the smaller one of those around its ellipsoid and around its box.
    fn placed(&self, world_from_mesh: Mat4) -> Sphere {
        let middle = self.bounds.center();
        let corners = self.bounds.corners().map(|corner| {
            let from_middle = world_from_mesh.transform_vector3(corner - middle);
            from_middle.length()
        });
        let of_box = corners.into_iter().fold(0.0, f32::max);
        let of_ellipsoid = self.radius * largest_stretch(Mat3::from_mat4(world_from_mesh));
        let offset = world_from_mesh.transform_vector3(middle).length();
        let coordinates = world_from_mesh.w_axis.truncate().length() + offset;
        Sphere {
            center: world_from_mesh.transform_point3(middle),
            radius: of_box.min(of_ellipsoid) * ROUNDING + 2.0 * f32::EPSILON * coordinates,
        }
    }
}

/// A bound of the factor by which a linear map stretches vectors, exact if its columns are orthogonal.
fn largest_stretch(map: Mat3) -> f32 {
    let products = map.transpose() * map;
    let columns = [products.x_axis, products.y_axis, products.z_axis];
    let sums = columns.map(|column| column.abs().element_sum());
    sums.into_iter().fold(0.0, f32::max).sqrt()
}

/// What spheres depend on in meshes and images: measured once, and again if a mesh deforms. Edits keep images.
#[derive(Debug, Default)]
pub struct Measured {
    extents: HashMap<usize, (Arc<Mesh>, Extent)>,
    /// The smallest value of an image's green channel.
    greens: HashMap<usize, f32>,
}

/// Spheres around the objects that may have ideal lobes; none if the light table has no light that photons may leave.
pub fn spheres(scene: &Scene, table: &[Light], measured: &mut Measured) -> Vec<Sphere> {
    if table.iter().all(|row| row.kind == SKY) {
        return Vec::new();
    }
    let ideal = ideal_materials(scene, &mut measured.greens);
    let extents = &mut measured.extents;
    let objects = scene.instances.iter().filter_map(|instance| {
        if !ideal[instance.material] {
            return None;
        }
        let mesh = &scene.meshes[instance.mesh];
        let measure = || (mesh.clone(), Extent::of(mesh));
        let (measured, extent) = extents.entry(instance.mesh).or_insert_with(measure);
        if !Arc::ptr_eq(measured, mesh) {
            (*measured, *extent) = measure();
        }
        let sphere = extent.placed(instance.world_from_mesh);
        let has_extent = extent.radius > 0.0 && sphere.radius > 0.0;
        let is_finite = sphere.center.is_finite() && sphere.radius.is_finite();
        (has_extent && is_finite).then_some(sphere)
    });
    let mut spheres = Vec::new();
    share(objects.collect(), MOST_SPHERES, &mut spheres);
    spheres
}

/// Reduces the spheres of objects to at most `most`: neighbours share one.
fn share(mut objects: Vec<Sphere>, most: usize, spheres: &mut Vec<Sphere>) {
    if objects.len() <= most {
        spheres.append(&mut objects);
    } else if most == 1 {
        spheres.push(Sphere::around(&objects));
    } else {
        let spread = Bounds::of(objects.iter().map(|sphere| sphere.center));
        let axis = (spread.max - spread.min).max_position();
        objects.sort_by_cached_key(|sphere| ordered(sphere.center[axis]));
        let upper = objects.split_off(objects.len() / 2);
        share(objects, most / 2, spheres);
        share(upper, most - most / 2, spheres);
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

/// Whether each material is of an instance and may reflect or refract ideally anywhere. The path tracer leaves light of
/// lamps by way of ideal surfaces to the light tracer, so none may be forgotten.
fn ideal_materials(scene: &Scene, greens: &mut HashMap<usize, f32>) -> Vec<bool> {
    let mut is_used = vec![false; scene.materials.len()];
    for instance in &scene.instances {
        is_used[instance.material] = true;
    }
    let mut may_be_smooth = |material: &Material| {
        let least = material.metallic_roughness_texture.as_ref().map(|texture| {
            let image = scene.textures[texture.texture].image;
            *greens
                .entry(image)
                .or_insert_with(|| least_green(&scene.images[image]))
        });
        material.roughness * least.unwrap_or(1.0) < DELTA_ROUGHNESS
    };
    let used = scene.materials.iter().zip(is_used);
    used.map(|(material, is_used)| is_used && reflects(material) && may_be_smooth(material))
        .collect()
}

/// Whether a material has a lobe that is ideal if it is smooth.
fn reflects(material: &Material) -> bool {
    match material.model {
        MaterialModel::Phong { .. } | MaterialModel::Blinn { .. } => false,
        MaterialModel::Conductor { .. } => true,
        MaterialModel::MetallicRoughness => {
            material.specular > 0.0 || material.metallic > 0.0 || material.transmission > 0.0
        }
    }
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
