//! A lens as it is built: its surfaces, and rays traced exactly through them. Lengths are in focal lengths; the axis is z,
//! light comes in toward +z, and the first surface's vertex is the origin.

use glam::{DVec2, DVec3, dvec3};

/// A surface of a lens, or its stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Radius of its sphere: positive if the centre lies behind it. 0: the stop, a plane without glass.
    pub radius: f64,
    /// Place of its vertex on the axis.
    pub vertex: f64,
    /// Refractive index before it.
    pub before: f64,
    /// Refractive index behind it.
    pub behind: f64,
    /// Radius of its rim.
    pub rim: f64,
}

/// A lens that is focused at infinity.
#[derive(Debug, Clone, PartialEq)]
pub struct Prescription {
    /// From front to back.
    pub surfaces: Vec<Surface>,
    /// Index of the stop.
    pub stop: usize,
    /// Place of the film on the axis.
    pub film: f64,
    /// Radius of the widest opening: that of the entrance pupil.
    pub pupil: f64,
}

/// A ray of light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    pub origin: DVec3,
    /// Unit vector.
    pub direction: DVec3,
}

/// The two surfaces that reflect the light of a ghost: `back` first, then `front`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pair {
    pub front: usize,
    pub back: usize,
}

/// What becomes of a ray.
#[derive(Debug, Clone, PartialEq)]
pub struct Passage {
    /// Where it passes the stop, one or three times, in radii of the widest stop.
    pub stops: Vec<DVec2>,
    /// Where it meets the first and the last surface, in radii of their rims.
    pub ends: [DVec2; 2],
    /// Where it meets the film.
    pub film: DVec2,
    /// Surfaces of glass that it met, with the cosine of its angle to the normal in front of each, and whether it was
    /// reflected.
    pub met: Vec<(usize, f64, bool)>,
    /// Whether it passed all rims.
    pub is_within_rims: bool,
}

/// Radius, distance to the next surface, index behind it and diameter of each surface (mm). The radius 0 is the stop.
/// A double Gauss of f/2 and 22 degrees: Tronnier, US patent 2,673,491; scaled to a focal length of 50 mm. Smith, "Modern
/// Lens Design", 1992, p. 312.
const DOUBLE_GAUSS: [[f64; 4]; 11] = [
    [29.475, 3.76, 1.67, 25.2],
    [84.83, 0.12, 1.0, 25.2],
    [19.275, 4.025, 1.67, 23.0],
    [40.77, 3.275, 1.699, 23.0],
    [12.75, 5.705, 1.0, 18.0],
    [0.0, 4.5, 1.0, 17.1],
    [-14.495, 1.18, 1.603, 17.0],
    [40.77, 6.065, 1.658, 20.0],
    [-20.385, 0.19, 1.0, 20.0],
    [437.065, 3.22, 1.717, 20.0],
    [-39.73, 0.0, 1.0, 20.0],
];

/// Height of rays that are as good as on the axis.
const PARAXIAL: f64 = 1e-5;

impl Prescription {
    /// The double Gauss, which most lenses of about 50 mm for a film of 36 x 24 mm descend from.
    pub fn double_gauss() -> Self {
        let (mut vertex, mut before) = (0.0, 1.0);
        let surfaces = DOUBLE_GAUSS
            .iter()
            .map(|&[radius, distance, behind, diameter]| {
                let surface = Surface {
                    radius,
                    vertex,
                    before,
                    behind,
                    rim: diameter / 2.0,
                };
                vertex += distance;
                before = behind;
                surface
            });
        let mut lens = Self {
            surfaces: surfaces.collect(),
            stop: 5,
            film: 0.0,
            pupil: 0.0,
        };
        // A ray parallel to the axis meets it where the film is.
        let (bent, _) = lens.behind_last(PARAXIAL);
        let focal_length = -PARAXIAL / (bent.direction.x / bent.direction.z);
        let slope = bent.direction / bent.direction.z;
        lens.film = bent.origin.z - bent.origin.x / slope.x;
        for surface in &mut lens.surfaces {
            surface.radius /= focal_length;
            surface.vertex /= focal_length;
            surface.rim /= focal_length;
        }
        lens.film /= focal_length;
        // A ray this high passes the stop at `passage`; one at the pupil's edge passes its rim.
        let (_, passage) = lens.behind_last(PARAXIAL);
        lens.pupil = PARAXIAL / passage.x;
        lens
    }

    /// What becomes of a ray parallel to the axis at the height `x`, and where it passed the stop.
    fn behind_last(&self, x: f64) -> (Ray, DVec2) {
        let mut ray = Ray {
            origin: dvec3(x, 0.0, -1.0),
            direction: DVec3::Z,
        };
        let mut stop = DVec2::ZERO;
        for (index, surface) in self.surfaces.iter().enumerate() {
            ray = surface.met(ray, false).map_or(ray, |(ray, _)| ray);
            if index == self.stop {
                stop = ray.origin.truncate() / surface.rim;
            }
        }
        (ray, stop)
    }

    /// Pairs of surfaces that make ghosts: all of glass.
    pub fn pairs(&self) -> Vec<Pair> {
        let of_glass: Vec<usize> = (0..self.surfaces.len())
            .filter(|&index| index != self.stop)
            .collect();
        let pairs = of_glass.iter().flat_map(|&front| {
            let behind = of_glass.iter().filter(move |&&back| back > front);
            behind.map(move |&back| Pair { front, back })
        });
        pairs.collect()
    }

    /// The ray of parallel light that comes in at the angle whose tangent is `tangent` to the axis, toward -x, and would
    /// meet the plane of the first vertex at `entrance`.
    pub fn incoming(tangent: f64, entrance: DVec2) -> Ray {
        let direction = dvec3(-tangent, 0.0, 1.0);
        Ray {
            origin: entrance.extend(0.0) - direction,
            direction: direction.normalize(),
        }
    }

    /// Traces a ray that `pair` reflects twice. `None` if it misses a sphere or is reflected totally.
    pub fn trace(&self, pair: Pair, mut ray: Ray) -> Option<Passage> {
        let last = self.surfaces.len() - 1;
        let forth = (0..pair.back).map(|index| (index, false));
        let back = (pair.front + 1..pair.back)
            .rev()
            .map(|index| (index, false));
        let out = (pair.front + 1..=last).map(|index| (index, false));
        let steps = forth
            .chain([(pair.back, true)])
            .chain(back)
            .chain([(pair.front, true)])
            .chain(out);
        let mut passage = Passage {
            stops: Vec::new(),
            ends: [DVec2::ZERO; 2],
            film: DVec2::ZERO,
            met: Vec::new(),
            is_within_rims: true,
        };
        let mut is_first = true;
        for (index, is_reflected) in steps {
            let surface = &self.surfaces[index];
            let (next, cosine) = surface.met(ray, is_reflected)?;
            ray = next;
            let at = ray.origin.truncate() / surface.rim;
            if std::mem::take(&mut is_first) {
                passage.ends[0] = at;
            }
            passage.ends[1] = at;
            if index == self.stop {
                passage.stops.push(at);
            } else {
                passage.met.push((index, cosine, is_reflected));
            }
            passage.is_within_rims &= at.length_squared() <= 1.0;
        }
        let to_film = (self.film - ray.origin.z) / ray.direction.z;
        passage.film = (ray.origin + to_film * ray.direction).truncate();
        Some(passage)
    }
}

impl Surface {
    /// The ray that goes on from this surface, and the cosine of the angle at which it came; `None` if it misses the
    /// sphere, or has to go through and is reflected totally.
    fn met(&self, ray: Ray, is_reflected: bool) -> Option<(Ray, f64)> {
        let Ray { origin, direction } = ray;
        if self.radius == 0.0 {
            let distance = (self.vertex - origin.z) / direction.z;
            let origin = origin + distance * direction;
            return Some((Ray { origin, direction }, direction.z.abs()));
        }
        let from_center = origin - dvec3(0.0, 0.0, self.vertex + self.radius);
        let b = from_center.dot(direction);
        let root = (b * b - from_center.length_squared() + self.radius * self.radius).sqrt();
        if root.is_nan() {
            return None;
        }
        // Of both places on the sphere, the one near the vertex.
        let is_near = (direction.z > 0.0) == (self.radius > 0.0);
        let distance = if is_near { -b - root } else { -b + root };
        let at = from_center + distance * direction;
        // Toward where the ray comes from.
        let outward = at / self.radius.abs();
        let normal = if outward.dot(direction) < 0.0 {
            outward
        } else {
            -outward
        };
        let cosine = -normal.dot(direction);
        let along = if is_reflected {
            direction + 2.0 * cosine * normal
        } else {
            let ratio = match direction.z > 0.0 {
                true => self.before / self.behind,
                false => self.behind / self.before,
            };
            let squared = 1.0 - ratio * ratio * (1.0 - cosine * cosine);
            if squared < 0.0 {
                return None;
            }
            ratio * direction + (ratio * cosine - squared.sqrt()) * normal
        };
        let ray = Ray {
            origin: origin + distance * direction,
            direction: along.normalize(),
        };
        Some((ray, cosine))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// So the numbers are those of the patent: they make a lens of 50 mm and f/2.
    #[test]
    fn the_lens_is_what_its_name_says() {
        let lens = Prescription::double_gauss();
        let focal_length = DOUBLE_GAUSS[0][0] / lens.surfaces[0].radius;
        assert!((focal_length - 50.0).abs() < 0.5, "{focal_length} mm");
        assert!(
            (lens.pupil - 0.25).abs() < 0.01,
            "{} focal lengths",
            lens.pupil
        );
        assert_eq!(lens.pairs().len(), 45);
    }
}
