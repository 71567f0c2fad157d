//! Checks whether a file's second set of texture coordinates is an atlas of its mesh.

use glam::{DVec2, Vec2};

use crate::Mesh;

/// Why a mesh's second set of texture coordinates is not an atlas.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SecondSetFault {
    /// There is no second set.
    #[error("there is no second set")]
    None,
    /// A coordinate lies outside 0 to 1.
    #[error("vertex {vertex} has {uv}, which is not in 0 to 1")]
    OutOfRange {
        /// Vertex index.
        vertex: usize,
        /// Its coordinate.
        uv: Vec2,
    },
    /// Triangles overlap.
    #[error("triangles overlap in more than {} of {} samples", MOST_OVERLAPPED, SIDE * SIDE)]
    Overlap,
    /// Part of the surface has no area in the set.
    #[error("{share} of the surface has no area there")]
    Collapsed {
        /// Share of the mesh's area (0 to 1).
        share: f64,
    },
}

/// Samples per side of the raster that detects overlaps.
const SIDE: usize = 1024;

/// Number of samples that may lie in two triangles, because rounding of coordinates affects edges.
const MOST_OVERLAPPED: usize = SIDE * SIDE / 1000;

/// Maximum share of the surface that may have no area in the set.
const MOST_COLLAPSED: f64 = 1e-3;

/// Distance by which coordinates may leave the unit square, because of quantization.
const TOLERANCE: f32 = 1e-4;

/// Checks whether the second set of texture coordinates is an atlas of the mesh: inside 0 to 1, without overlap, and
/// with room for the whole surface. Indices must be in range.
///
/// Overlaps are detected on a raster of 1,024 x 1,024 samples with the fill rule of rasterizers, by which a sample on
/// an edge belongs to one triangle. The unwrapper later makes a chart of each connected piece and checks exactly that
/// it does not overlap itself, so an overlap that the raster misses does no harm. The time grows with the number of
/// triangles, not with their overlap.
///
/// # Errors
/// The fault found.
pub fn check_second_set(mesh: &Mesh) -> Result<(), SecondSetFault> {
    let uvs = &mesh.uvs[1];
    if uvs.is_empty() || mesh.indices.is_empty() {
        return Err(SecondSetFault::None);
    }
    let (low, high) = (Vec2::splat(-TOLERANCE), Vec2::splat(1.0 + TOLERANCE));
    // Written so that NaN counts as outside.
    let is_inside = |uv: &Vec2| uv.cmpge(low).all() && uv.cmple(high).all();
    if let Some(vertex) = uvs.iter().position(|uv| !is_inside(uv)) {
        let uv = uvs[vertex];
        return Err(SecondSetFault::OutOfRange { vertex, uv });
    }
    let (mut surface, mut collapsed) = (0.0, 0.0);
    let mut covered = vec![false; SIDE * SIDE];
    let mut overlapped = 0;
    for triangle in mesh.indices.as_chunks::<3>().0 {
        let corners = triangle.map(|index| uvs[index as usize].as_dvec2() * SIDE as f64);
        let [a, b, c] = triangle.map(|index| mesh.positions[index as usize].as_dvec3());
        let area = (b - a).cross(c - a).length();
        surface += area;
        if (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]) == 0.0 {
            collapsed += area;
        }
        visit_samples(corners, |sample| {
            overlapped += usize::from(std::mem::replace(&mut covered[sample], true));
            overlapped <= MOST_OVERLAPPED
        });
        if overlapped > MOST_OVERLAPPED {
            return Err(SecondSetFault::Overlap);
        }
    }
    let share = collapsed / surface;
    // The set is not an atlas of a mesh without area, either.
    if share.is_nan() || share > MOST_COLLAPSED {
        return Err(SecondSetFault::Collapsed { share });
    }
    Ok(())
}

/// Calls `visit` for each sample of the raster inside a triangle, until `visit` returns `false`. A sample on an edge
/// that two triangles share belongs to exactly one of them, provided that they lie on different sides of it.
fn visit_samples(corners: [DVec2; 3], mut visit: impl FnMut(usize) -> bool) {
    let lowest = corners
        .iter()
        .map(|corner| corner.y)
        .fold(f64::INFINITY, f64::min);
    let highest = corners
        .iter()
        .map(|corner| corner.y)
        .fold(f64::NEG_INFINITY, f64::max);
    // Samples lie at the centres of their cells. Both directions are half-open.
    let first_at = |from: f64| (from - 0.5).ceil().clamp(0.0, SIDE as f64) as usize;
    for row in first_at(lowest)..first_at(highest) {
        let y = row as f64 + 0.5;
        let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            // Go from the lower to the upper end, so that both triangles of an edge compute the same crossing.
            let (mut p, mut q) = (corners[from], corners[to]);
            if p.y > q.y {
                std::mem::swap(&mut p, &mut q);
            }
            if p.y <= y && y < q.y {
                let x = p.x + (q.x - p.x) * ((y - p.y) / (q.y - p.y));
                ends = [ends[0].min(x), ends[1].max(x)];
            }
        }
        if ends[0] > ends[1] {
            continue;
        }
        for column in first_at(ends[0])..first_at(ends[1]) {
            if !visit(row * SIDE + column) {
                return;
            }
        }
    }
}
