//! Lenses: what a camera does not see sharply.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

use glam::Vec2;
use serde::{Deserialize, Serialize};

/// An ideal thin lens, whose aperture is a disc or a regular polygon.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Lens {
    /// Radius of the aperture (m); 0: a pinhole, which sees everything sharply.
    pub aperture: f32,
    /// Distance along the camera's axis at which it sees sharply (m).
    pub focus: f32,
    /// Blades of the diaphragm, which are sides of the aperture: a polygon in the circle of that radius, with one corner
    /// at the top. 0: the aperture is round.
    pub blades: u32,
}

/// The reason why there is no such lens.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LensError {
    /// The aperture is negative or not finite.
    #[error(
        "an aperture of {0} m: it is the radius of the lens, 0 (a pinhole) or more, and finite"
    )]
    Aperture(f32),
    /// Nothing lies at that distance.
    #[error("a focus of {0} m: it is the distance at which the camera sees sharply, and above 0")]
    Focus(f32),
    /// There is no such polygon.
    #[error("{0} blades: 0 makes a round aperture, 3 to 16 a polygon")]
    Blades(u32),
    /// No lens has negative time.
    #[error("a shutter of {0} s: it is the time for which it is open, 0 or more")]
    Shutter(f32),
}

impl Default for Lens {
    fn default() -> Self {
        Self::PINHOLE
    }
}

impl Lens {
    /// A lens that sees everything sharply.
    pub const PINHOLE: Self = Self {
        aperture: 0.0,
        focus: 1.0,
        blades: 0,
    };
    /// Most blades.
    pub const MOST_BLADES: u32 = 16;

    /// The lens with these values.
    ///
    /// # Errors
    /// [`LensError`] if a value has no meaning. The focus of a pinhole has none, and is not looked at.
    pub fn new(aperture: f32, focus: f32, blades: u32) -> Result<Self, LensError> {
        if !aperture.is_finite() || aperture < 0.0 {
            return Err(LensError::Aperture(aperture));
        }
        if aperture > 0.0 && (!focus.is_finite() || focus <= 0.0) {
            return Err(LensError::Focus(focus));
        }
        if !matches!(blades, 0 | 3..=Self::MOST_BLADES) {
            return Err(LensError::Blades(blades));
        }
        Ok(match aperture > 0.0 {
            true => Self {
                aperture,
                focus,
                blades,
            },
            false => Self::PINHOLE,
        })
    }

    /// Whether it sees everything sharply.
    pub fn is_pinhole(&self) -> bool {
        self.aperture == 0.0
    }

    /// A point of the aperture (m, from its centre, to the right and up), uniformly distributed over it for uniform
    /// numbers `u` in [0, 1). Shirley and Chiu, "A Low Distortion Map Between Disk and Square", 1997; a polygon is a fan of
    /// triangles.
    pub fn sample(&self, u: Vec2) -> Vec2 {
        let unit = match self.blades {
            0 => on_disc(u),
            blades => in_polygon(blades, u),
        };
        self.aperture * unit
    }

    /// Radius of an aperture of the same shape on whose edge a point lies (m, from its centre, to the right and up).
    pub fn edge(&self, point: Vec2) -> f32 {
        if self.blades == 0 {
            return point.length();
        }
        let part = TAU / self.blades as f32;
        let along = |side: u32| point.dot(Vec2::from_angle(FRAC_PI_2 + part * (side as f32 + 0.5)));
        let farthest = (0..self.blades).map(along).fold(0.0, f32::max);
        farthest / (part / 2.0).cos()
    }

    /// Area of the aperture (m^2).
    pub fn area(&self) -> f32 {
        let square = self.aperture * self.aperture;
        match self.blades {
            0 => square * TAU / 2.0,
            blades => square * blades as f32 / 2.0 * (TAU / blades as f32).sin(),
        }
    }
}

fn on_disc(u: Vec2) -> Vec2 {
    let Vec2 { x, y } = 2.0 * u - 1.0;
    if x == 0.0 && y == 0.0 {
        return Vec2::ZERO;
    }
    match x.abs() > y.abs() {
        true => x * Vec2::from_angle(FRAC_PI_4 * y / x),
        false => y * Vec2::from_angle(FRAC_PI_2 - FRAC_PI_4 * x / y),
    }
}

fn in_polygon(blades: u32, u: Vec2) -> Vec2 {
    let place = u.x * blades as f32;
    let side = place.floor().min(blades as f32 - 1.0);
    let corner = |index: f32| Vec2::from_angle(TAU * index / blades as f32 + FRAC_PI_2);
    let along = place - side;
    u.y.sqrt() * corner(side).lerp(corner(side + 1.0), along)
}

/// The time for which a shutter is open (s).
///
/// # Errors
/// [`LensError::Shutter`] if it is negative or not finite.
pub fn shutter(seconds: f32) -> Result<f32, LensError> {
    match seconds.is_finite() && seconds >= 0.0 {
        true => Ok(seconds),
        false => Err(LensError::Shutter(seconds)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_uniform_over_the_aperture() {
        for blades in [0, 3, 6] {
            let lens = Lens::new(2.0, 1.0, blades).unwrap();
            let count = 128;
            let mut mean = Vec2::ZERO;
            let mut square = 0.0;
            for index in 0..count * count {
                let u = Vec2::new((index % count) as f32, (index / count) as f32) + 0.5;
                let point = lens.sample(u / count as f32);
                assert!(point.length() <= 2.0 + 1e-5);
                assert!(lens.edge(point) <= 2.0 + 1e-5);
                mean += point;
                square += point.length_squared();
            }
            mean /= (count * count) as f32;
            square /= (count * count) as f32;
            // Polar moment of a regular polygon over its area: r^2 (2 + cos(2 pi / n)) / 6; of a disc, r^2 / 2.
            let expected = match blades {
                0 => 2.0,
                blades => 4.0 * (2.0 + (TAU / blades as f32).cos()) / 6.0,
            };
            assert!(mean.length() < 1e-3, "{blades} blades: {mean}");
            assert!(
                (square / expected - 1.0).abs() < 1e-3,
                "{blades} blades: {square}"
            );
        }
        let hexagon = Lens::new(2.0, 1.0, 6).unwrap().area();
        assert!((hexagon - 6.0 * 3.0_f32.sqrt()).abs() < 1e-4, "{hexagon}");
    }

    #[test]
    fn lenses_that_cannot_be_are_refused() {
        let nan = f32::NAN;
        assert!(matches!(
            Lens::new(-1.0, 1.0, 0),
            Err(LensError::Aperture(_))
        ));
        assert!(matches!(
            Lens::new(nan, 1.0, 0),
            Err(LensError::Aperture(_))
        ));
        assert!(matches!(Lens::new(0.1, 0.0, 0), Err(LensError::Focus(_))));
        assert!(matches!(Lens::new(0.1, nan, 0), Err(LensError::Focus(_))));
        assert!(matches!(Lens::new(0.1, 1.0, 2), Err(LensError::Blades(2))));
        assert!(matches!(
            Lens::new(0.1, 1.0, 17),
            Err(LensError::Blades(17))
        ));
        assert_eq!(Lens::new(0.0, nan, 5), Ok(Lens::PINHOLE));
        assert!(shutter(nan).is_err() && shutter(-0.1).is_err());
        assert_eq!(shutter(0.0), Ok(0.0));
    }
}
