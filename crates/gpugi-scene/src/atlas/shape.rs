//! The unit of unwrapping: a mesh as its instances stretch it.

use glam::{DMat3, DVec3};

use crate::{Instance, Mesh};

/// A stretched mesh, up to rotation and size.
#[derive(Debug, Clone)]
pub(super) struct Shape {
    pub mesh: usize,
    /// Positions with the stretch applied.
    pub positions: Vec<[f32; 3]>,
    /// Per instance, the world length of a unit length in `positions`, times its density of texels.
    pub scales: Vec<f32>,
    /// Total area of all instances (m^2).
    pub area: f64,
    stretch: DMat3,
}

/// Instances with the same key share an unwrapping. The key holds the mesh; the inner products of the stretched axes,
/// in thousandths of the squared scale; and the octave of the scale, because gutters scale with the instance and must
/// be wide enough for the smallest one.
pub(super) type Key = (usize, [i64; 6], i32);

impl Shape {
    /// The shape of one instance, without its positions; `None` if it has no area, or nothing but slivers. `density`: of
    /// its texels, relative to the atlas.
    pub fn new(
        instance: &Instance,
        mesh: &Mesh,
        density: f32,
    ) -> Result<Option<(Key, Self)>, String> {
        let matrix = instance.world_from_mesh;
        if !matrix.is_finite() {
            return Err("its transform is not finite".into());
        }
        let linear = DMat3::from_mat4(matrix.as_dmat4());
        let of_mesh = area(mesh, &DMat3::IDENTITY);
        let of_world = area(mesh, &linear);
        let scale = (of_world / of_mesh).sqrt();
        // Without area, the scale is NaN.
        let is_positive = |value: f64| value > f64::from(f32::MIN_POSITIVE);
        let has_area = is_positive(of_mesh) && is_positive(of_world) && is_positive(scale);
        let stretch = linear * (1.0 / scale);
        if !(has_area && has_chart(mesh, &stretch)) {
            return Ok(None);
        }
        if of_world > f64::from(f32::MAX) || scale > f64::from(f32::MAX) {
            return Err(format!("its area of {of_world:e} m^2 is no 32-bit number"));
        }
        let [x, y, z] = [stretch.x_axis, stretch.y_axis, stretch.z_axis];
        let products = [x.dot(x), y.dot(y), z.dot(z), x.dot(y), y.dot(z), z.dot(x)];
        let texels = scale * f64::from(density);
        let key = (
            instance.mesh,
            products.map(|product| (product * 1000.0).round() as i64),
            texels.log2().floor() as i32,
        );
        let shape = Self {
            mesh: instance.mesh,
            positions: Vec::new(),
            scales: vec![texels as f32],
            area: of_world,
            stretch,
        };
        Ok(Some((key, shape)))
    }

    /// The shape with its positions, and without instances.
    pub fn with_positions(self, mesh: &Mesh) -> Self {
        let stretched = |position: &glam::Vec3| (self.stretch * position.as_dvec3()).as_vec3();
        Self {
            positions: mesh
                .positions
                .iter()
                .map(|position| stretched(position).to_array())
                .collect(),
            scales: Vec::new(),
            area: 0.0,
            ..self
        }
    }
}

/// Altitude of the thinnest triangle that the unwrapper is given alone, as a fraction of the mesh's diagonal. It leaves
/// out triangles below a tenth of this, and panics if a mesh has no others.
const LEAST_ALTITUDE: f64 = 1e-5;

/// Whether any triangle is thick enough for a chart, after a linear transform.
fn has_chart(mesh: &Mesh, linear: &DMat3) -> bool {
    let position = |position: &glam::Vec3| *linear * position.as_dvec3();
    let (min, max) = mesh.positions.iter().map(position).fold(
        (DVec3::INFINITY, DVec3::NEG_INFINITY),
        |(min, max), point| (min.min(point), max.max(point)),
    );
    let least = (max - min).length() * LEAST_ALTITUDE;
    mesh.indices.as_chunks::<3>().0.iter().any(|triangle| {
        let [a, b, c] = triangle.map(|index| position(&mesh.positions[index as usize]));
        let sides = [b - a, c - b, a - c];
        let longest = sides.map(DVec3::length).into_iter().fold(0.0, f64::max);
        sides[0].cross(sides[2]).length() > longest * least
    })
}

/// Area of a mesh after a linear transform.
fn area(mesh: &Mesh, linear: &DMat3) -> f64 {
    let triangles = mesh.indices.as_chunks::<3>().0.iter();
    let areas = triangles.map(|triangle| {
        let [a, b, c]: [DVec3; 3] =
            triangle.map(|index| *linear * mesh.positions[index as usize].as_dvec3());
        (b - a).cross(c - a).length() / 2.0
    });
    areas.sum()
}
