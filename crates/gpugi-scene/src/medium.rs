//! Media that scatter light: fog, smoke and clouds in boxes.

use std::sync::Arc;

use glam::{Mat4, Vec3};
use serde::{Deserialize, Serialize};

use crate::bounds::Bounds;
use crate::names::Name;

/// Most media of a scene that can be imported and rendered: shaders look at each of them in every step.
pub const MAX_MEDIA: usize = 64;

/// A medium that scatters, absorbs and emits light in a box, or everywhere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Medium {
    /// Name for reports.
    pub name: Name,
    /// World space (m) from the space of the box, which spans -0.5 to 0.5 on each axis. `None` for a medium that fills
    /// everything.
    pub world_from_box: Option<Mat4>,
    /// Extinction coefficient (1/m) where the density is 1: scattering and absorption together, at least 0.
    pub extinction: Vec3,
    /// Scattered share of the extinction, 0 to 1.
    pub albedo: Vec3,
    /// Directions of scattered light.
    pub phase: PhaseFunction,
    /// Emitted power density (W/(m^3 sr)) where the density is 1.
    pub emission: Vec3,
    /// Density over the box, a factor of extinction and emission. `None` stands for 1.
    pub density: Option<Arc<DensityGrid>>,
    /// The animation node that carries the box, if any.
    pub node: Option<usize>,
}

impl Medium {
    /// Checks all values; the error says which one is wrong.
    ///
    /// # Errors
    /// A value that is not finite or out of its range, a box without volume, or densities that do not fill their grid.
    pub fn check(&self) -> Result<(), String> {
        let refuse = |what: &str| Err(what.to_owned());
        if !(self.extinction.is_finite() && self.extinction.min_element() >= 0.0) {
            return refuse("the extinction is negative or not finite");
        }
        if !(self.albedo.min_element() >= 0.0 && self.albedo.max_element() <= 1.0) {
            return refuse("the albedo is not from 0 to 1");
        }
        if !(self.emission.is_finite() && self.emission.min_element() >= 0.0) {
            return refuse("the emission is negative or not finite");
        }
        let (PhaseFunction::HenyeyGreenstein(g) | PhaseFunction::CornetteShanks(g)) = self.phase;
        if !(-1.0..=1.0).contains(&g) {
            return refuse("g is not from -1 to 1");
        }
        if let Some(world_from_box) = &self.world_from_box
            && !(world_from_box.is_finite() && world_from_box.inverse().is_finite())
        {
            return refuse("the box is not finite or has no volume");
        }
        let is_unbounded = self.world_from_box.is_none() && {
            let absorbs = self.extinction.cmpgt(Vec3::ZERO);
            (self.emission.cmpgt(Vec3::ZERO) & !absorbs).any()
        };
        if is_unbounded {
            return refuse("a medium that fills everything and emits light needs extinction");
        }
        match &self.density {
            Some(density) => density.check(),
            None => Ok(()),
        }
    }

    /// Bounding box of the medium's box in world space (m); `None` for a medium that fills everything.
    pub fn bounds(&self) -> Option<Bounds> {
        let unit = Bounds {
            min: Vec3::splat(-0.5),
            max: Vec3::splat(0.5),
        };
        (self.world_from_box.as_ref()).map(|world_from_box| unit.transformed(world_from_box))
    }
}

/// How a medium distributes scattered light over directions, by the mean cosine g (-1 to 1) of the scattering angle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum PhaseFunction {
    /// Henyey and Greenstein 1941; g is the mean cosine.
    HenyeyGreenstein(f32),
    /// Cornette and Shanks 1992; its mean cosine differs from g.
    CornetteShanks(f32),
}

/// Densities at the centres of a grid of cells that fills a medium's box. Between the centres densities are
/// interpolated linearly; beyond the outermost centres they are constant, and 0 outside of the box.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DensityGrid {
    /// Cells along x, y and z.
    pub size: [u32; 3],
    /// Densities, finite and at least 0; x varies fastest, then y.
    #[serde(with = "crate::plain")]
    pub values: Vec<f32>,
}

impl DensityGrid {
    /// Checks the grid; the error says what is wrong.
    ///
    /// # Errors
    /// A grid without cells, another number of values than of cells, or a value that is negative or not finite.
    pub fn check(&self) -> Result<(), String> {
        let [x, y, z] = self.size;
        let cells = u128::from(x) * u128::from(y) * u128::from(z);
        if cells == 0 || cells != self.values.len() as u128 {
            return Err(format!(
                "the density has {} values for {x} x {y} x {z} cells",
                self.values.len()
            ));
        }
        let is_wrong = |value: &f32| !(value.is_finite() && *value >= 0.0);
        match self.values.iter().position(is_wrong) {
            Some(cell) => Err(format!(
                "the density of cell {cell} is {}, neither 0 nor a positive number",
                self.values[cell]
            )),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn medium() -> Medium {
        Medium {
            name: "fog".into(),
            world_from_box: Some(Mat4::IDENTITY),
            extinction: Vec3::ONE,
            albedo: Vec3::ONE,
            phase: PhaseFunction::HenyeyGreenstein(0.5),
            emission: Vec3::ZERO,
            density: Some(Arc::new(DensityGrid {
                size: [2, 1, 1],
                values: vec![0.0, 1.0],
            })),
            node: None,
        }
    }

    #[test]
    fn values_without_meaning_are_refused() {
        assert_eq!(medium().check(), Ok(()));
        let grid = |size, values: &[f32]| {
            let values = values.to_vec();
            Some(Arc::new(DensityGrid { size, values }))
        };
        type Damage = fn(&mut Medium);
        let wrong: [(&str, Damage); 10] = [
            ("extinction", |medium| medium.extinction.y = -1.0),
            ("extinction", |medium| medium.extinction.y = f32::INFINITY),
            ("albedo", |medium| medium.albedo.z = 1.1),
            ("albedo", |medium| medium.albedo.z = f32::NAN),
            ("emission", |medium| medium.emission.x = f32::NAN),
            ("g is", |medium| {
                medium.phase = PhaseFunction::CornetteShanks(-1.5)
            }),
            ("g is", |medium| {
                medium.phase = PhaseFunction::HenyeyGreenstein(f32::NAN)
            }),
            ("box", |medium| {
                medium.world_from_box = Some(Mat4::from_scale(Vec3::new(1.0, 0.0, 1.0)))
            }),
            ("box", |medium| medium.world_from_box = Some(Mat4::NAN)),
            ("needs extinction", |medium| {
                medium.world_from_box = None;
                medium.extinction.y = 0.0;
                medium.emission = Vec3::Y;
            }),
        ];
        for (what, damage) in wrong {
            let mut damaged = medium();
            damage(&mut damaged);
            let reason = damaged.check().unwrap_err();
            assert!(reason.contains(what), "{reason}");
        }
        for density in [
            grid([2, 1, 1], &[1.0]),
            grid([0, 1, 1], &[]),
            grid([u32::MAX; 3], &[1.0]),
            grid([2, 1, 1], &[1.0, -1.0]),
            grid([2, 1, 1], &[f32::NAN, 1.0]),
        ] {
            let damaged = Medium {
                density,
                ..medium()
            };
            let reason = damaged.check().unwrap_err();
            assert!(reason.contains("density"), "{reason}");
        }
    }
}
