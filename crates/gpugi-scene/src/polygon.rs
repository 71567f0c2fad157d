//! Triangulates polygons, for file formats whose faces have any number of corners.

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

/// Polygons with more corners than this become a fan even if they are concave, because ear clipping takes quadratic
/// time.
const EAR_CORNERS: usize = 100;

/// Triangulates a polygon and keeps its winding. Returns corner numbers. A convex polygon becomes a fan; a concave one
/// is cut by ear clipping. A polygon that intersects itself or has no area yields the same number of triangles, of
/// arbitrary shape. Fewer than three corners yield none.
pub fn triangulate(corners: &[Vec3]) -> Vec<[u32; 3]> {
    let fan = || {
        (2..corners.len() as u32)
            .map(|i| [0, i - 1, i])
            .collect::<Vec<_>>()
    };
    if corners.len() <= 3 || corners.len() > EAR_CORNERS {
        return fan();
    }
    let points: Vec<DVec3> = corners.iter().map(|corner| corner.as_dvec3()).collect();
    let normal = polygon_normal(&points);
    // Twice the signed area of the triangle projected along the normal, times the length of the normal.
    let area = |a: u32, b: u32, c: u32| {
        let [a, b, c] = [a, b, c].map(|corner| points[corner as usize]);
        (b - a).cross(c - a).dot(normal)
    };
    if fan().iter().all(|&[a, b, c]| area(a, b, c) > 0.0) && is_convex(&points, normal) {
        return fan();
    }

    let mut left: Vec<u32> = (0..points.len() as u32).collect();
    let mut triangles = Vec::with_capacity(points.len() - 2);
    while left.len() > 3 {
        let neighbours = |i: usize| {
            [
                left[(i + left.len() - 1) % left.len()],
                left[i],
                left[(i + 1) % left.len()],
            ]
        };
        let is_ear = |&i: &usize| {
            let [a, b, c] = neighbours(i);
            let inside =
                |p: u32| area(a, b, p) >= 0.0 && area(b, c, p) >= 0.0 && area(c, a, p) >= 0.0;
            area(a, b, c) > 0.0
                && !left
                    .iter()
                    .any(|&p| p != a && p != b && p != c && inside(p))
        };
        let ear = (0..left.len()).find(is_ear).unwrap_or(1);
        triangles.push(neighbours(ear));
        left.remove(ear);
    }
    triangles.push([left[0], left[1], left[2]]);
    triangles
}

fn is_convex(points: &[DVec3], normal: DVec3) -> bool {
    let count = points.len();
    (0..count).all(|i| {
        let [a, b, c] = [i, i + 1, i + 2].map(|corner| points[corner % count]);
        (b - a).cross(c - b).dot(normal) >= 0.0
    })
}
