//! Whether a file's second set of texture coordinates is an atlas of its mesh.

use glam::{DVec2, Vec2};

use crate::Mesh;

/// Why a mesh's second set of texture coordinates is no atlas.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SecondSetFault {
    /// There is none.
    #[error("there is no second set")]
    None,
    /// A coordinate is not in 0 to 1.
    #[error("vertex {vertex} has {uv}, which is not in 0 to 1")]
    OutOfRange {
        /// Vertex.
        vertex: usize,
        /// Its coordinate.
        uv: Vec2,
    },
    /// Triangles lie on each other.
    #[error("triangles overlap in more than {} of {} samples", MOST_OVERLAPPED, SIDE * SIDE)]
    Overlap,
    /// Part of the surface has no area there.
    #[error("{share} of the surface has no area there")]
    Collapsed {
        /// Share of the mesh's area (0 to 1).
        share: f64,
    },
}

/// Samples a side of the raster that finds overlaps.
const SIDE: usize = 1024;

/// So many samples may lie in two triangles: what rounding of coordinates does to edges.
const MOST_OVERLAPPED: usize = SIDE * SIDE / 1000;

/// Of the surface, at most so much may have no area in the set.
const MOST_COLLAPSED: f64 = 1e-3;

/// Coordinates may leave the unit square by so much: what quantization does.
const TOLERANCE: f32 = 1e-4;

/// Whether the second set of texture coordinates is an atlas of the mesh: in 0 to 1, without overlap, and with room for all of the surface.
///
/// Overlap is looked for at a raster of 1,024 samples squared, by the rule of rasterizers, after which a sample on an edge belongs to one triangle. The
/// unwrapper then makes a chart of each connected piece, of which it checks exactly that it does not overlap itself; so what slips through the
/// raster does no harm. Takes a time that grows with triangles, not with how they overlap.
///
/// # Errors
/// What is wrong. Indices must be in range.
pub fn check_second_set(mesh: &Mesh) -> Result<(), SecondSetFault> {
    let uvs = &mesh.uvs[1];
    if uvs.is_empty() || mesh.indices.is_empty() {
        return Err(SecondSetFault::None);
    }
    let (low, high) = (Vec2::splat(-TOLERANCE), Vec2::splat(1.0 + TOLERANCE));
    // Written so that what is no number is not inside.
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
    // Neither is it an atlas of a mesh that has no area.
    if share.is_nan() || share > MOST_COLLAPSED {
        return Err(SecondSetFault::Collapsed { share });
    }
    Ok(())
}

/// Calls `visit` with each sample of the raster inside a triangle until it says no. A sample on an edge that two triangles share belongs to one of them,
/// as long as they lie on different sides of it.
fn visit_samples(corners: [DVec2; 3], mut visit: impl FnMut(usize) -> bool) {
    let lowest = corners
        .iter()
        .map(|corner| corner.y)
        .fold(f64::INFINITY, f64::min);
    let highest = corners
        .iter()
        .map(|corner| corner.y)
        .fold(f64::NEG_INFINITY, f64::max);
    // Samples lie in the middle of their squares. Half-open in both directions.
    let first_at = |from: f64| (from - 0.5).ceil().clamp(0.0, SIDE as f64) as usize;
    for row in first_at(lowest)..first_at(highest) {
        let y = row as f64 + 0.5;
        let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            // From the lower end to the upper, so that both triangles of an edge compute the same crossing.
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
