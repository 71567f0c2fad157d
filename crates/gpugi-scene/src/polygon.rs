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

/// Polygons with more corners than this become a fan even if they are concave: cutting a damaged one may take cubic
/// time.
const MOST_CUT: usize = 300;

/// Triangulates a polygon and keeps its winding. Returns corner numbers. A convex polygon becomes a fan; any other is
/// cut into ears, if it has at most 300 corners. Its outline may run along a bridge to a hole and back. A polygon
/// without area becomes a fan, too; one that intersects itself yields triangles of arbitrary shape, at most as many as a
/// fan. Fewer than three corners yield none.
pub fn triangulate(corners: &[Vec3]) -> Vec<[u32; 3]> {
    if corners.len() > 3 && corners.len() <= MOST_CUT {
        let points: Vec<DVec3> = corners.iter().map(|corner| corner.as_dvec3()).collect();
        let normal = polygon_normal(&points);
        if !is_convex(&points, normal) {
            let cut = cut(&points, normal);
            if !cut.is_empty() {
                return cut;
            }
        }
    }
    (2..corners.len() as u32).map(|i| [0, i - 1, i]).collect()
}

/// Whether a polygon becomes a fan though it is concave, because it has too many corners.
pub(crate) fn is_too_large(corners: &[Vec3]) -> bool {
    corners.len() > MOST_CUT && {
        let points: Vec<DVec3> = corners.iter().map(|corner| corner.as_dvec3()).collect();
        !is_convex(&points, polygon_normal(&points))
    }
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

/// Whether no corner turns inward, and each triangle of the fan has an area.
fn is_convex(points: &[DVec3], normal: DVec3) -> bool {
    let (first, count) = (points[0], points.len());
    let mut fan = points[1..].windows(2);
    let turns = |i: usize| {
        let [a, b, c] = [i, i + 1, i + 2].map(|corner| points[corner % count]);
        (b - a).cross(c - b).dot(normal)
    };
    fan.all(|edge| (edge[0] - first).cross(edge[1] - first).dot(normal) > 0.0)
        && (0..count).all(|i| turns(i) >= 0.0)
}
