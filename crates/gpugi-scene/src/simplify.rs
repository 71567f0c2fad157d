//! Mesh simplification for uses that tolerate it, such as casters of soft shadows.

use glam::Vec3;

/// Whether [`simplified`] simplifies: true with the cargo feature `meshopt`.
pub const CAN_SIMPLIFY: bool = cfg!(feature = "meshopt");

/// Maximum simplification error, relative to the mesh's extent. Walls and boxes keep their shape.
#[cfg(feature = "meshopt")]
const MOST_ERROR: f32 = 0.02;

/// Simplifies a mesh to about `detail` times its number of triangles by edge collapse (Garland, Heckbert 1997, as
/// implemented in meshoptimizer). The result uses the mesh's own vertices. Seams of normals and texture coordinates are
/// closed. Indices must be in range. Without the cargo feature `meshopt`, or if `detail` is 1, returns the original
/// triangles.
pub fn simplified(positions: &[Vec3], indices: &[u32], detail: f32) -> Vec<u32> {
    #[cfg(feature = "meshopt")]
    if detail < 1.0 {
        return collapsed(positions, indices, detail.max(0.0));
    }
    let _ = (positions, detail);
    indices.to_vec()
}

#[cfg(feature = "meshopt")]
fn collapsed(positions: &[Vec3], indices: &[u32], detail: f32) -> Vec<u32> {
    // Pass only vertices with distinct positions: meshoptimizer keeps vertices that share a position with another
    // vertex, even with an unused one.
    let numbers = crate::mesh::weld(positions);
    let mut first_at: Vec<u32> = Vec::new();
    for (vertex, &number) in numbers.iter().enumerate() {
        if number as usize == first_at.len() {
            first_at.push(vertex as u32);
        }
    }
    let corners: Vec<Vec3> = first_at
        .iter()
        .map(|&vertex| positions[vertex as usize])
        .collect();
    let Ok(vertices) = meshopt::VertexDataAdapter::new(bytemuck::cast_slice(&corners), 12, 0)
    else {
        return indices.to_vec();
    };
    let welded: Vec<u32> = indices
        .iter()
        .map(|&index| numbers[index as usize])
        .collect();
    let wanted = (indices.len() as f32 / 3.0 * detail).ceil() as usize * 3;
    let options = meshopt::SimplifyOptions::None;
    meshopt::simplify(&welded, &vertices, wanted, MOST_ERROR, options, None)
        .into_iter()
        .map(|number| first_at[number as usize])
        .collect()
}

#[cfg(all(test, feature = "meshopt"))]
mod tests {
    use super::simplified;
    use crate::builtin::builtin;
    use crate::provoking_order;
    use glam::Vec3;

    fn area(positions: &[Vec3], indices: &[u32]) -> f32 {
        let corner = |&index: &u32| positions[index as usize];
        let triangles = indices.as_chunks::<3>().0.iter();
        let areas = triangles.map(|triangle| {
            let [a, b, c] = triangle.each_ref().map(corner);
            (b - a).cross(c - a).length() / 2.0
        });
        areas.sum()
    }

    #[test]
    fn curved_meshes_lose_triangles_and_flat_ones_keep_their_shape() {
        for name in ["spheres", "room", "teapot"] {
            for mesh in &builtin(name, 2).unwrap().meshes {
                // In the order in which captures draw it, with duplicated vertices.
                let ordered = provoking_order(&mesh.indices, mesh.positions.len());
                let mesh = mesh.with_vertices(&ordered.vertices, ordered.indices);
                let before = area(&mesh.positions, &mesh.indices);
                let coarse = simplified(&mesh.positions, &mesh.indices, 0.25);
                let count = coarse.len() / 3;
                assert_eq!(coarse.len() % 3, 0);
                // The edges of boxes stay, and so do their last triangles.
                let most = mesh.indices.len() / 3 / 2 + 12;
                assert!(count <= most, "{}: {count}, not {most}", mesh.name);
                let change = area(&mesh.positions, &coarse) / before - 1.0;
                assert!(change.abs() < 0.05, "{}: area {change}", mesh.name);
                assert_eq!(
                    simplified(&mesh.positions, &mesh.indices, 1.0),
                    mesh.indices
                );
            }
        }
    }

    #[test]
    fn nothing_stays_nothing() {
        assert!(simplified(&[], &[], 0.5).is_empty());
        // Triangles without area must do no harm.
        let coarse = simplified(&[Vec3::ONE; 3], &[0, 1, 2], 0.5);
        assert!(coarse.len() <= 3);
    }
}
