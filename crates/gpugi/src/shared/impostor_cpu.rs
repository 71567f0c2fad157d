//! Analytic rooms around a reference point at the origin, their distance cubes, and the searches of impostor.wesl in
//! double precision. The robust search visits every half texel that the ray's image crosses, without a pyramid: the
//! cells that the shader skips must not matter.

use glam::{DMat3, DVec2, DVec3};

/// The value in a distance cube where there is no surface (m).
pub const NOTHING: f32 = 1e30;
/// Maximum distance along a ray (m).
const FAR: f64 = 1e18;

/// The surroundings of the reference point.
#[derive(Debug, Clone, Copy)]
pub enum Room {
    /// A sphere, by its centre and radius.
    Sphere(DVec3, f64),
    /// A box, optionally with another box inside, each by opposite corners.
    Box([DVec3; 2], Option<[DVec3; 2]>),
    /// A box seen from outside, with nothing around it.
    Open([DVec3; 2]),
}

/// The reference point is off-centre, so that nothing is symmetric.
pub const SPHERE: Room = Room::Sphere(DVec3::new(0.7, -0.4, 0.9), 3.0);
const WALLS: [DVec3; 2] = [DVec3::new(-2.1, -1.3, -2.6), DVec3::new(3.2, 1.7, 2.3)];
const INNER: [DVec3; 2] = [DVec3::new(0.8, -1.3, -0.5), DVec3::new(1.5, -0.2, 0.6)];
const POLE: [DVec3; 2] = [DVec3::new(0.9, -1.3, 0.4), DVec3::new(0.96, 1.7, 0.46)];
/// The tutorial's figure 33.
pub const BOX: Room = Room::Box(WALLS, None);
/// The tutorial's figure 34.
pub const BOX_IN_BOX: Room = Room::Box(WALLS, Some(INNER));
/// The pole is about two texels wide in a cube of 64 texels per side.
pub const POLE_IN_BOX: Room = Room::Box(WALLS, Some(POLE));
/// A room that rays can leave.
pub const OPEN: Room = Room::Open(INNER);

/// Walls of a box seen from outside have this index or higher.
pub const FIRST_INNER_WALL: usize = 6;

impl Room {
    /// Distance along a unit ray (m), and the index of the wall that it hits; `None` if the ray leaves.
    pub fn cast(&self, x: DVec3, r: DVec3) -> Option<(f64, usize)> {
        let slabs = |[low, high]: [DVec3; 2]| {
            let (a, b) = ((low - x) / r, (high - x) / r);
            (a.min(b), a.max(b))
        };
        let axis = |t: DVec3, which: f64| (0..3).find(|&axis| t[axis] == which).unwrap_or(0);
        let inside = |walls| {
            let (_, far) = slabs(walls);
            let t = far.min_element();
            let axis = axis(far, t);
            (t, 2 * axis + usize::from(r[axis] > 0.0))
        };
        let outside = |walls| {
            let (near, far) = slabs(walls);
            let t = near.max_element();
            let axis = axis(near, t);
            let wall = FIRST_INNER_WALL + 2 * axis + usize::from(r[axis] > 0.0);
            (t > 0.0 && t < far.min_element()).then_some((t, wall))
        };
        match *self {
            Self::Sphere(center, radius) => {
                let o = x - center;
                let b = o.dot(r);
                Some(((b * b - o.length_squared() + radius * radius).sqrt() - b, 0))
            }
            Self::Box(walls, inner) => {
                let hits = inner.and_then(outside).into_iter().chain([inside(walls)]);
                hits.min_by(|a, b| a.0.total_cmp(&b.0))
            }
            Self::Open(walls) => outside(walls),
        }
    }

    /// The same for the second layer, from the reference point: the front of what is behind the visible surface, or the
    /// visible surface itself if there is nothing behind it.
    pub fn cast_second(&self, r: DVec3) -> Option<(f64, usize)> {
        match *self {
            Self::Box(walls, _) => Self::Box(walls, None).cast(DVec3::ZERO, r),
            _ => self.cast(DVec3::ZERO, r),
        }
    }

    /// Whether the reference point sees a point of a wall.
    pub fn is_seen(&self, q: DVec3) -> bool {
        self.cast(DVec3::ZERO, q.normalize())
            .is_some_and(|(distance, _)| distance > q.length() * (1.0 - 1e-6))
    }

    /// Whether a point is in free space, at least 5 cm from the walls.
    pub fn is_free(&self, p: DVec3) -> bool {
        let within = |[low, high]: [DVec3; 2], margin: f64| {
            p.cmpgt(low + margin).all() && p.cmplt(high - margin).all()
        };
        match *self {
            Self::Sphere(center, radius) => p.distance(center) < radius - 0.05,
            Self::Box(walls, inner) => {
                within(walls, 0.05) && !inner.is_some_and(|inner| within(inner, -0.05))
            }
            Self::Open(walls) => !within(walls, -0.05),
        }
    }
}

/// Axes of a cube face as columns: u, v, and outward.
fn frame(face: usize) -> DMat3 {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let [u, v, axis] = match face {
        0 => [-z, -y, x],
        1 => [z, -y, -x],
        2 => [x, z, y],
        3 => [x, -z, -y],
        4 => [x, -y, z],
        _ => [-x, -y, -z],
    };
    DMat3::from_cols(u, v, axis)
}

/// The face that a direction points to.
fn face(d: DVec3) -> usize {
    let axis = d.abs().max_position();
    2 * axis + usize::from(d[axis] < 0.0)
}

/// The result of a search, as in `Hit` of impostor.wesl.
#[derive(Debug, Clone, Copy)]
pub struct Hit {
    pub distance: Option<f64>,
    pub direction: DVec3,
    pub certainty: u32,
}

pub const SEEN: u32 = 0;
pub const PASSED_BEHIND: u32 = 1;
pub const UNSEEN: u32 = 2;
pub const SECOND: u32 = 3;

/// The surface between four texel centres.
struct Patch {
    corners: [f64; 4],
    has_silhouette: bool,
    texel: DVec2,
}

/// Distances (m) from the origin, ordered by layer, face and row.
pub struct Cube {
    pub side: usize,
    pub distances: Vec<f32>,
}

impl Cube {
    /// The cube that the reference point sees.
    pub fn new(side: usize, room: &Room) -> Self {
        Self::cast(side, |toward| room.cast(DVec3::ZERO, toward))
    }

    /// A cube with two layers.
    pub fn with_second(side: usize, room: &Room) -> Self {
        let mut both = Self::new(side, room);
        let second = Self::cast(side, |toward| room.cast_second(toward));
        both.distances.extend(second.distances);
        both
    }

    fn cast(side: usize, cast: impl Fn(DVec3) -> Option<(f64, usize)>) -> Self {
        let at = |i: usize| (2 * i + 1) as f64 / side as f64 - 1.0;
        let distance = |i: usize| {
            let place = DVec3::new(at(i % side), at(i / side % side), 1.0);
            let toward = frame(i / (side * side)) * place.normalize();
            cast(toward).map_or(NOTHING, |hit| hit.0 as f32)
        };
        Self {
            side,
            distances: (0..6 * side * side).map(distance).collect(),
        }
    }

    /// Width of a texel in the middle of a face at distance 1.
    pub fn texel(&self) -> f64 {
        2.0 / self.side as f64
    }

    fn largest_step(&self) -> f64 {
        10.0 * self.texel()
    }

    fn inverse_depth(&self, face: usize, x: usize, y: usize) -> f64 {
        let at = |i: usize| (i as f64 + 0.5) * self.texel() - 1.0;
        let distance = self.distances[(face * self.side + y) * self.side + x];
        if distance >= NOTHING {
            return 0.0;
        }
        DVec3::new(at(x), at(y), 1.0).length() / f64::from(distance)
    }

    fn place(&self, q: DVec3) -> DVec2 {
        (DVec2::new(q.x, q.y) / q.z + 1.0) / self.texel() - 0.5
    }

    fn patch(&self, layer: usize, p: DVec3) -> Patch {
        let face = face(p);
        let last = DVec2::splat(self.side as f64 - 2.0);
        let texel = self
            .place(frame(face).transpose() * p)
            .floor()
            .clamp(DVec2::ZERO, last);
        let (x, y) = (texel.x as usize, texel.y as usize);
        let corners = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)]
            .map(|(x, y)| self.inverse_depth(6 * layer + face, x, y));
        let least = corners.iter().copied().fold(f64::MAX, f64::min);
        let greatest = corners.iter().copied().fold(0.0, f64::max);
        Patch {
            corners,
            has_silhouette: greatest - least > self.largest_step() * least,
            texel,
        }
    }

    /// |p| / |p'|, with the surface that `patch` has in the direction of `within`.
    fn patch_ratio(&self, patch: &Patch, p: DVec3, within: DVec3) -> f64 {
        let axes = frame(face(within)).transpose();
        let (q, middle) = (axes * p, axes * within);
        let w = patch.corners;
        if patch.has_silhouette {
            let f = self.place(middle) - patch.texel;
            return q.z * w[usize::from(f.x > 0.5) + 2 * usize::from(f.y > 0.5)];
        }
        let f = self.place(q) - patch.texel;
        let rows = [0, 2].map(|row| w[row] + f.x * (w[row + 1] - w[row]));
        q.z * (rows[0] + f.y * (rows[1] - rows[0])).max(0.0)
    }

    fn ratio(&self, p: DVec3) -> f64 {
        if p == DVec3::ZERO {
            return 0.0;
        }
        self.patch_ratio(&self.patch(0, p), p, p)
    }

    /// The tutorial's searches: the first version if `is_first`, otherwise the second.
    pub fn tutorial(&self, is_first: bool, x: DVec3, r: DVec3, iterations: u32) -> Hit {
        let r_distance = 1.0 / self.ratio(r).max(1.0 / FAR);
        let start = if is_first {
            (r_distance - r.dot(x)).max(0.0)
        } else {
            0.0
        };
        let ratio = self.ratio(x + r * start);
        let mut front = (ratio < 1.0).then_some((start, ratio));
        let mut behind = (ratio >= 1.0).then_some((start, ratio));
        let mut d = (start + r_distance * (1.0 - ratio)).clamp(0.0, FAR);
        let mut ratio = self.ratio(x + r * d);
        for _ in 0..iterations {
            if (ratio - 1.0).abs() < 1e-4 {
                break;
            }
            let other = if ratio < 1.0 { behind } else { front };
            *(if ratio < 1.0 { &mut front } else { &mut behind }) = Some((d, ratio));
            // The secant through both points, or through this point and r.
            let slope = other.map_or(1.0 / r_distance, |(other_d, other_ratio)| {
                (ratio - other_ratio) / (d - other_d)
            });
            d = (d + (1.0 - ratio) / slope).clamp(0.0, FAR);
            ratio = self.ratio(x + r * d);
        }
        self.ending(x, r, d, ratio)
    }

    /// The secant method proper: always through the last two points.
    pub fn pure_secant(&self, x: DVec3, r: DVec3, iterations: u32) -> Hit {
        let r_distance = 1.0 / self.ratio(r).max(1.0 / FAR);
        let mut d_before = (r_distance - r.dot(x)).max(0.0);
        let mut before = self.ratio(x + r * d_before);
        let mut d = (d_before + r_distance * (1.0 - before)).clamp(0.0, FAR);
        let mut ratio = self.ratio(x + r * d);
        for _ in 0..iterations {
            if (ratio - 1.0).abs() < 1e-4 || ratio == before {
                break;
            }
            let next = d + (d - d_before) * (1.0 - ratio) / (ratio - before);
            (d_before, before) = (d, ratio);
            d = next.clamp(0.0, FAR);
            ratio = self.ratio(x + r * d);
        }
        self.ending(x, r, d, ratio)
    }

    fn ending(&self, x: DVec3, r: DVec3, d: f64, ratio: f64) -> Hit {
        let is_near = (ratio - 1.0).abs() < self.largest_step();
        Hit {
            distance: (ratio > 0.0).then_some(d),
            direction: (x + r * d).try_normalize().unwrap_or(r),
            certainty: if is_near { SEEN } else { UNSEEN },
        }
    }

    /// Distances at which a ray's image passes from one half-texel cell to another: the ray's intersections with all
    /// planes through the origin and a grid line.
    fn crossings(&self, x: DVec3, r: DVec3) -> Vec<f64> {
        let lines: Vec<f64> = (1..2 * self.side - 2)
            .map(|line| (line + 1) as f64 * 0.5 * self.texel() - 1.0)
            .chain([-1.0, 1.0])
            .collect();
        let mut all = vec![0.0, FAR];
        for (i, j) in [(0, 1), (1, 0), (1, 2), (2, 1), (2, 0), (0, 2)] {
            all.extend(
                lines
                    .iter()
                    .map(|line| (line * x[j] - x[i]) / (r[i] - line * r[j]))
                    .filter(|d| *d > 0.0 && *d < FAR),
            );
        }
        all.sort_by(f64::total_cmp);
        all
    }

    /// The robust search, in all layers of the cube.
    pub fn search(&self, x: DVec3, r: DVec3) -> Hit {
        let first = self.search_layer(0, x, r);
        if first.certainty == SEEN || self.distances.len() < 12 * self.side * self.side {
            return first;
        }
        let second = self.search_layer(1, x, r);
        match second.distance {
            Some(d) if second.certainty != UNSEEN && d < 0.999 * first.distance.unwrap_or(FAR) => {
                Hit {
                    certainty: SECOND,
                    ..second
                }
            }
            _ => first,
        }
    }

    fn search_layer(&self, layer: usize, x: DVec3, r: DVec3) -> Hit {
        let crossings = self.crossings(x, r);
        let mut hidden_at = None;
        let mut certainty = SEEN;
        for ends in crossings.windows(2) {
            let (d, end) = (ends[0], ends[1]);
            // A point between the ends; in the last cell, far beyond its beginning.
            let middle = x + r * (0.5 * d + 0.5 * end.min(1e3 * (d + 1.0)));
            let patch = self.patch(layer, middle);
            let excess = |d: f64| self.patch_ratio(&patch, x + r * d, middle) - 1.0;
            let (f0, f1) = (excess(d), excess(end));
            match hidden_at {
                None if f0 >= self.largest_step() => hidden_at = Some(d),
                Some(at) if f0.min(f1) < 0.0 => {
                    if f0 >= 0.0 && at > 0.0 {
                        return Hit {
                            distance: Some(end),
                            direction: (x + r * end).normalize(),
                            certainty: UNSEEN,
                        };
                    }
                    hidden_at = None;
                    certainty = PASSED_BEHIND;
                }
                _ => {}
            }
            if hidden_at.is_none() && f1 >= 0.0 && f1 > f0 {
                let (mut low, mut high) = (d, end);
                if f0 >= 0.0 {
                    high = d;
                }
                while high - low > 1e-9 * high {
                    let middle = 0.5 * (low + high);
                    *(if excess(middle) < 0.0 {
                        &mut low
                    } else {
                        &mut high
                    }) = middle;
                }
                return Hit {
                    distance: Some(high),
                    direction: (x + r * high).normalize(),
                    certainty,
                };
            }
        }
        Hit {
            distance: hidden_at.map(|_| FAR),
            direction: r,
            certainty: hidden_at.map_or(certainty, |_| UNSEEN),
        }
    }
}
