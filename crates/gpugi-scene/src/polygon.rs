//! Triangulates polygons, for file formats whose faces have any number of corners.

use earcut::Earcut;
use glam::{DVec3, Vec3};

/// The normal of a polygon by Newell's method. It is not a unit vector: its length is twice the area. Zero for a
/// degenerate polygon.
fn polygon_normal(corners: &[DVec3]) -> DVec3 {
    let next = corners.iter().cycle().skip(1);
    let origin = corners[0];
    corners
        .iter()
        .zip(next)
        .map(|(&a, &b)| (a - origin).cross(b - origin))
        .sum()
}

/// Polygons with more corners than this become a fan even if they are concave: cutting a damaged one takes more than
/// quadratic time.
const MOST_CUT: usize = 1000;

/// Triangulates a polygon and keeps its winding. Returns corner numbers. A convex polygon becomes a fan; any other is
/// cut into ears. Its edges may run along a bridge to a hole and back. A polygon without area becomes a fan, too; one
/// that intersects itself yields triangles of arbitrary shape, at most as many as a fan. Fewer than three corners yield
/// none.
pub fn triangulate(corners: &[Vec3]) -> Vec<[u32; 3]> {
    let fan = || {
        (2..corners.len() as u32)
            .map(|i| [0, i - 1, i])
            .collect::<Vec<_>>()
    };
    if corners.len() <= 3 || corners.len() > MOST_CUT {
        return fan();
    }
    let points: Vec<DVec3> = corners.iter().map(|corner| corner.as_dvec3()).collect();
    let normal = polygon_normal(&points);
    // Twice the signed area of the triangle projected along the normal, times the length of the normal.
    let area = |[a, b, c]: [u32; 3]| {
        let [a, b, c] = [a, b, c].map(|corner| points[corner as usize]);
        (b - a).cross(c - a).dot(normal)
    };
    if fan().iter().all(|&triangle| area(triangle) > 0.0) && is_convex(&points, normal) {
        return fan();
    }
    let cut = cut(&points, normal);
    if cut.is_empty() { fan() } else { cut }
}

/// Cuts a polygon into ears: triangles that face along `normal`.
fn cut(points: &[DVec3], normal: DVec3) -> Vec<[u32; 3]> {
    // Leaving out the axis closest to the normal rounds nothing: equal points and straight lines stay what they are.
    let [x, y, z] = normal.abs().to_array();
    let flat = points.iter().map(|point| match () {
        () if z >= x && z >= y => [point.x, point.y * normal.z.signum()],
        () if y >= x => [point.z, point.x * normal.y.signum()],
        () => [point.y, point.z * normal.x.signum()],
    });
    let mut triangles: Vec<u32> = Vec::new();
    Earcut::new().earcut(flat, &[], &mut triangles);
    triangles.as_chunks().0.to_vec()
}

fn is_convex(points: &[DVec3], normal: DVec3) -> bool {
    let count = points.len();
    (0..count).all(|i| {
        let [a, b, c] = [i, i + 1, i + 2].map(|corner| points[corner % count]);
        (b - a).cross(c - b).dot(normal) >= 0.0
    })
}
