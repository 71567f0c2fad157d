//! The unit of unwrapping: a mesh as its instances stretch it.

use glam::{DMat3, DVec3};

use crate::{Instance, Mesh};

/// A stretched mesh, up to rotation and size.
#[derive(Debug, Clone)]
pub(super) struct Shape {
    pub mesh: usize,
    /// Positions with the stretch applied.
    pub positions: Vec<[f32; 3]>,
    /// Per instance, the world length of a unit length in `positions`.
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
    /// The shape of one instance, without its positions; `None` if it has no area.
    pub fn new(instance: &Instance, mesh: &Mesh) -> Result<Option<(Key, Self)>, String> {
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
        if !(is_positive(of_mesh) && is_positive(of_world) && is_positive(scale)) {
            return Ok(None);
        }
        if of_world > f64::from(f32::MAX) || scale > f64::from(f32::MAX) {
            return Err(format!("its area of {of_world:e} m^2 is no 32-bit number"));
        }
        let stretch = linear * (1.0 / scale);
        let [x, y, z] = [stretch.x_axis, stretch.y_axis, stretch.z_axis];
        let products = [x.dot(x), y.dot(y), z.dot(z), x.dot(y), y.dot(z), z.dot(x)];
        let key = (
            instance.mesh,
            products.map(|product| (product * 1000.0).round() as i64),
            scale.log2().floor() as i32,
        );
        let shape = Self {
            mesh: instance.mesh,
            positions: Vec::new(),
            scales: vec![scale as f32],
            area: of_world,
            stretch,
        };
        Ok(Some((key, shape)))
    }

    /// Adds the positions to the shape.
    pub fn with_positions(self, mesh: &Mesh) -> Self {
        let stretched = |position: &glam::Vec3| (self.stretch * position.as_dvec3()).as_vec3();
        Self {
            positions: mesh
                .positions
                .iter()
                .map(|position| stretched(position).to_array())
                .collect(),
            ..self
        }
    }
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
