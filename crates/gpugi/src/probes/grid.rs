//! Grids of points.

use glam::{UVec3, Vec3};
use gpugi_scene::Bounds;

/// Points of a grid of no given density.
const POINTS: u32 = 64;

/// How far points lie from the middles of their cells, as a share of the cells. A point in the very plane of a wall
/// without thickness, such as in the middle of a scene, would see what lies on either side, and not the wall.
const ASIDE: Vec3 = Vec3::new(0.021, 0.013, 0.017);

/// A regular grid of points, each near the middle of its cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// The first point (m).
    pub origin: Vec3,
    /// From point to point (m).
    pub spacing: Vec3,
    /// Points along each axis.
    pub counts: UVec3,
}

impl Grid {
    /// The grid in `bounds` with `density` points per metre; 0: about [`POINTS`].
    pub fn new(bounds: &Bounds, density: f32) -> Self {
        let extent = bounds.max - bounds.min;
        // An empty scene has no extent: one point serves its sky.
        if !extent.is_finite() || extent.min_element() < 0.0 {
            return Self {
                origin: Vec3::ZERO,
                spacing: Vec3::ONE,
                counts: UVec3::ONE,
            };
        }
        let counts_at = |spacing: f32| {
            let counts = (extent / spacing).ceil().max(Vec3::ONE);
            counts.min(Vec3::splat(1e6)).as_uvec3()
        };
        let number = |counts: UVec3| counts.as_vec3().element_product();
        let counts = if density > 0.0 {
            counts_at(1.0 / density)
        } else {
            let longest = extent.max_element().max(1e-6);
            let (mut spacing, least) = (longest, longest / POINTS as f32);
            while spacing > least && number(counts_at(spacing * 0.95)) <= POINTS as f32 {
                spacing *= 0.95;
            }
            counts_at(spacing)
        };
        // A flat scene has one layer of points; positive spacings keep the shader from dividing by zero.
        let spacing = (extent / counts.as_vec3()).max(Vec3::splat(1e-6));
        Self {
            origin: bounds.min + extent / counts.as_vec3() * (0.5 + ASIDE),
            spacing,
            counts,
        }
    }

    /// The number of points, as far as it can be counted.
    pub fn len(&self) -> u64 {
        let counts = self.counts.to_array().map(u64::from);
        counts.into_iter().fold(1, u64::saturating_mul)
    }

    /// The points (m), x first, then y, then z.
    pub fn points(&self) -> impl Iterator<Item = Vec3> {
        let (origin, spacing, counts) = (self.origin, self.spacing, self.counts);
        let all = (0..counts.z).flat_map(move |z| (0..counts.y).map(move |y| (y, z)));
        let all = all.flat_map(move |(y, z)| (0..counts.x).map(move |x| UVec3::new(x, y, z)));
        all.map(move |at| origin + spacing * at.as_vec3())
    }
}
