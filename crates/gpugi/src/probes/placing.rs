//! Where the points of a grid lie: those inside solids are moved out of them, by half a cell at most.

use glam::Vec3;
use gpugi_scene::Bounds;

use super::Grid;
use crate::gpu::ReadBack;

/// How far from a solid's surface a point lies that was moved out of it, as a share of the distance between points.
const MARGIN: f32 = 0.1;

/// Where points belong, and how far the search for their ways out of solids is.
#[derive(Debug)]
pub struct Placing {
    /// Points of the grid (m).
    pub home: Vec<Vec3>,
    spacing: Vec3,
    bounds: Bounds,
    pub step: Step,
}

/// Where a point may be moved: by half a cell, inside the scene.
#[derive(Debug, Clone, Copy)]
pub struct Reach {
    /// Corners (m).
    pub low: Vec3,
    pub high: Vec3,
    /// How far from the surface of a solid that it leaves (m).
    pub margin: f32,
}

/// How far the search is.
#[derive(Debug)]
pub enum Step {
    /// All points lie in the grid, or will once they are captured there.
    Home,
    /// The ways out are being read back; they were found at this version of the scene's geometry.
    Asked(Box<ReadBack<Vec<[f32; 4]>>>, u64),
    /// Points inside solids have been moved, at this version.
    Placed(u64),
}

impl Placing {
    pub fn new(grid: &Grid, bounds: &Bounds) -> Self {
        Self {
            home: grid.points().collect(),
            spacing: grid.spacing,
            bounds: *bounds,
            step: Step::Home,
        }
    }

    /// That of a point.
    pub fn reach(&self, point: usize) -> Reach {
        let home = self.home[point];
        Reach {
            low: (home - 0.5 * self.spacing).max(self.bounds.min),
            high: (home + 0.5 * self.spacing).min(self.bounds.max),
            margin: MARGIN * self.spacing.min_element(),
        }
    }
}
