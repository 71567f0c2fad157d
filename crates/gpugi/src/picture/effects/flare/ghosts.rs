//! Where the ghosts of a lens lie, how large and how bright they are, for light from every angle.
//!
//! A ghost is the light that two surfaces reflect, the back one first. Near a ray that is traced exactly, all places are
//! linear in the place p where light passes the stop: film = c + M (p - m), entrance = e + E (p - m), and so on, with diagonal
//! M and E along the plane of axis and light and across it. Lee and Eisemann ("Practical Real-Time Lens-Flare Rendering",
//! EGSR 2013) take these matrices at the axis, where they are exact for narrow openings. Here they are those that fit exact
//! rays through all of the opening best, for each angle of the light, and c is the mean place of these rays.

use bytemuck::{Pod, Zeroable};
use glam::{DVec2, dvec2};

use super::coating::{Coating, reflectance};
use super::prescription::{Pair, Passage, Prescription};

/// Angles for which ghosts are computed: their tangents are multiples of `TANGENT_STEP`.
pub const ANGLES: u32 = 33;
/// Step between the tangents of these angles.
pub const TANGENT_STEP: f64 = 0.025;

/// Rays across the opening of which a ghost is made.
const RAYS: u32 = 20;
/// Margin of the grid of rays beyond the opening, as its slope at the middle tells it.
const WIDER: f64 = 1.3;
/// Rays that are too few for that.
const FEW: usize = 4;
/// Newton's steps to the ray through the middle of the stop.
const STEPS: u32 = 20;

/// `GhostAt` of place.wesl: a ghost of light at one angle. Lengths are in focal lengths, places on the stop in radii of
/// the widest one. The first of two numbers is along the plane of axis and light, the second one across it.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct GhostAt {
    /// Its mean place in the picture, toward the light.
    pub center: f32,
    /// How places in the picture change with that on the stop.
    pub size_along: f32,
    pub size_across: f32,
    /// Area of light that comes in per area of the stop, across the light's direction.
    pub gathered: f32,
    /// Share of light that arrives, in red, green and blue.
    pub arriving: [f32; 3],
    /// The mean place on the stop, along.
    pub stop: f32,
    /// Place on the first and the last surface in radii of their rims, and on the stop when it is passed again: its mean
    /// along, and how it changes with the place on the stop.
    pub limits: [[f32; 4]; 4],
}

/// Where a ray passes: the stop, the plane of the first vertex, the film, the first and the last surface, and the stop
/// again, if it does.
type Places = [DVec2; 7];

/// How one of these places follows from that on the stop, of rays that are mirrored across the plane of axis and light.
#[derive(Debug, Clone, Copy)]
struct Fit {
    /// Its mean along that plane.
    mean: f64,
    /// Its standard deviation, along and across.
    deviation: DVec2,
    /// How it changes with the place on the stop, along and across.
    slope: DVec2,
}

impl Fit {
    /// The least squares.
    fn of(rays: &[Places], which: usize) -> Self {
        let mean = |value: &dyn Fn(&Places) -> DVec2| {
            rays.iter().map(value).sum::<DVec2>() / rays.len() as f64
        };
        let along = |which: usize| dvec2(mean(&|ray| ray[which]).x, 0.0);
        let (stop, place) = (along(0), along(which));
        let variance = mean(&|ray| (ray[which] - place).powf(2.0));
        let common = mean(&|ray| (ray[which] - place) * (ray[0] - stop));
        Self {
            mean: place.x,
            deviation: variance.map(f64::sqrt),
            slope: common / mean(&|ray| (ray[0] - stop).powf(2.0)),
        }
    }
}

/// Rays through a lens, by where they come in.
struct Bundle<'a> {
    lens: &'a Prescription,
    pair: Pair,
    tangent: f64,
    /// Which passage of the stop has to be in the middle.
    passage: usize,
}

impl Bundle<'_> {
    fn trace(&self, entrance: DVec2) -> Option<Passage> {
        let ray = Prescription::incoming(self.tangent, entrance);
        self.lens.trace(self.pair, ray)
    }

    /// Where the ray through the middle of the stop comes in, near `guess`.
    fn middle(&self, guess: f64) -> Option<f64> {
        const SMALL: f64 = 1e-6;
        let at = |x: f64| Some(self.trace(dvec2(x, 0.0))?.stops[self.passage].x);
        let mut x = guess;
        for _ in 0..STEPS {
            let (here, there) = (at(x)?, at(x + SMALL)?);
            // Far from the middle, straight lines lead too far.
            let step = (here * SMALL / (there - here)).clamp(-0.05, 0.05);
            x -= step;
            if step.abs() < 1e-10 {
                return Some(x);
            }
        }
        None
    }

    /// The ghost by rays around the one that comes in at `middle`. `opening`: radius of the stop's opening.
    fn ghost(&self, middle: f64, opening: f64, coating: Coating) -> Option<GhostAt> {
        const SMALL: f64 = 1e-6;
        let chief = self.trace(dvec2(middle, 0.0))?;
        let on_stop =
            |offset: DVec2| Some(self.trace(dvec2(middle, 0.0) + offset)?.stops[self.passage]);
        let along = on_stop(dvec2(SMALL, 0.0))?.x / SMALL;
        let across = on_stop(dvec2(0.0, SMALL))?.y / SMALL;
        let half = WIDER * opening / dvec2(along, across).abs();
        let passing = self.rays(middle, half, opening, true);
        // Where the rims let next to nothing through, as without them.
        let rays = match passing.len() >= FEW {
            true => passing,
            false => self.rays(middle, half, opening, false),
        };
        let [stop, entrance, film, ends @ ..] =
            [0, 1, 2, 3, 4, 5, 6].map(|which| Fit::of(&rays, which));
        // As wide as the ghost is, which its rays do not quite follow.
        let size = film.slope.signum() * film.deviation / stop.deviation;
        let cosine = (1.0 + self.tangent * self.tangent).sqrt().recip();
        let limit = |fit: Fit| [fit.mean, fit.slope.x, fit.slope.y, 0.0].map(|value| value as f32);
        let ghost = GhostAt {
            // What the film shows is upside down.
            center: -film.mean as f32,
            size_along: -size.x as f32,
            size_across: -size.y as f32,
            gathered: (cosine * (entrance.slope.x * entrance.slope.y).abs()) as f32,
            arriving: self.arriving(&chief, coating).map(|share| share as f32),
            stop: stop.mean as f32,
            limits: ends.map(limit),
        };
        let numbers: &[f32] = bytemuck::cast_slice(std::slice::from_ref(&ghost));
        numbers
            .iter()
            .all(|number| number.is_finite())
            .then_some(ghost)
    }

    /// Rays that come in around `middle`, less than `half` away, and pass the opening; or that pass the rims and the stop
    /// again, too.
    fn rays(&self, middle: f64, half: DVec2, opening: f64, is_whole: bool) -> Vec<Places> {
        let at = |index: u32| 2.0 * (f64::from(index) + 0.5) / f64::from(RAYS) - 1.0;
        // The other half is its mirror image.
        let offsets =
            (0..RAYS).flat_map(|x| (RAYS / 2..RAYS).map(move |y| half * dvec2(at(x), at(y))));
        let rays = offsets.filter_map(|offset| {
            let entrance = dvec2(middle, 0.0) + offset;
            let passage = self.trace(entrance)?;
            let stop = passage.stops[self.passage];
            let is_open = passage.stops.iter().all(|at| at.length() <= opening);
            let passes = match is_whole {
                true => is_open && passage.is_within_rims,
                false => stop.length() <= opening,
            };
            let mut again = (0..passage.stops.len()).filter(|&index| index != self.passage);
            let mut again = || {
                again
                    .next()
                    .map_or(DVec2::ZERO, |index| passage.stops[index])
            };
            let [first, last] = passage.ends;
            passes.then(|| [stop, entrance, passage.film, first, last, again(), again()])
        });
        rays.collect()
    }

    /// Share of light that arrives, by what each surface reflects.
    fn arriving(&self, passage: &Passage, coating: Coating) -> [f64; 3] {
        let mut arriving = [1.0; 3];
        let mut is_back = false;
        for &(index, cosine, is_reflected) in &passage.met {
            let surface = &self.lens.surfaces[index];
            let ways = match is_back {
                false => [surface.before, surface.behind],
                true => [surface.behind, surface.before],
            };
            let shares = reflectance(coating, index, ways, cosine);
            for (arriving, share) in arriving.iter_mut().zip(shares) {
                *arriving *= if is_reflected { share } else { 1.0 - share };
            }
            is_back ^= is_reflected;
        }
        arriving
    }
}

/// All ghosts of a lens, each at all [`ANGLES`]. `opening`: radius of the stop's opening, in radii of the widest one. Where
/// no ray arrives, the ghost is dark, and as at the angle before.
pub fn ghosts(lens: &Prescription, opening: f64, coating: Coating) -> Vec<GhostAt> {
    let pairs = lens.pairs();
    let all = pairs.iter().flat_map(|&pair| {
        let passage = narrowest(lens, pair);
        let mut middle = Some(0.0);
        let mut last = GhostAt::zeroed();
        (0..ANGLES).map(move |angle| {
            let bundle = Bundle {
                lens,
                pair,
                tangent: f64::from(angle) * TANGENT_STEP,
                passage,
            };
            middle = middle.and_then(|guess| bundle.middle(guess));
            let found = middle.and_then(|middle| bundle.ghost(middle, opening, coating));
            last = found.unwrap_or(GhostAt {
                arriving: [0.0; 3],
                ..last
            });
            last
        })
    });
    all.collect()
}

/// Of the times at which light near the axis passes the stop, the one at which it is widest, so most is lost.
fn narrowest(lens: &Prescription, pair: Pair) -> usize {
    let ray = Prescription::incoming(0.0, dvec2(1e-6, 0.0));
    let stops = lens.trace(pair, ray).map(|passage| passage.stops);
    let stops = stops.unwrap_or_default().into_iter().enumerate();
    let widest = stops.max_by(|(_, one), (_, other)| one.x.abs().total_cmp(&other.x.abs()));
    widest.map_or(0, |(index, _)| index)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ghost by many rays, or by the table.
    #[derive(Debug, Clone, Copy, Default)]
    struct Extent {
        /// Light on the film, in green.
        light: f64,
        /// Its mean place in the picture, along the plane of axis and light.
        place: f64,
        /// Twice the root mean square of the distance to it, along and across: the diameter of an even disc.
        size: [f64; 2],
    }

    impl Extent {
        /// The radiance of its middle, but for a factor.
        fn brightness(&self) -> f64 {
            // What is smaller than four pixels of a thousand rows is not brighter for that.
            self.light
                / self
                    .size
                    .map(|size| size.max(0.002))
                    .iter()
                    .product::<f64>()
        }
    }

    /// The extent of light at places, each with a weight.
    fn extent(rays: &[(DVec2, f64)]) -> Extent {
        let light: f64 = rays.iter().map(|(_, weight)| weight).sum();
        let mean = |value: &dyn Fn(DVec2) -> f64| {
            rays.iter()
                .map(|(at, weight)| weight * value(*at))
                .sum::<f64>()
                / light
        };
        let place = mean(&|at| at.x);
        Extent {
            light,
            place,
            size: [
                4.0 * mean(&|at| (at.x - place).powi(2)).sqrt(),
                4.0 * mean(&|at| at.y.powi(2)).sqrt(),
            ],
        }
    }

    /// A grid of points of the square of this half width.
    fn grid(half: f64, count: u32) -> impl Iterator<Item = DVec2> {
        let at = move |index: u32| half * (2.0 * (f64::from(index) + 0.5) / f64::from(count) - 1.0);
        (0..count * count).map(move |index| dvec2(at(index % count), at(index / count)))
    }

    /// By rays through all surfaces, their rims and a round stop.
    fn exact(lens: &Prescription, pair: Pair, tangent: f64, opening: f64) -> Extent {
        const RAYS: u32 = 60;
        let passage = narrowest(lens, pair);
        let bundle = Bundle {
            lens,
            pair,
            tangent,
            passage,
        };
        let mut middle = Some(0.0);
        for step in 0..=8 {
            let tangent = tangent * f64::from(step) / 8.0;
            let nearer = Bundle { tangent, ..bundle };
            middle = middle.and_then(|guess| nearer.middle(guess));
        }
        let slope = |offset: DVec2| {
            let at =
                |offset: DVec2| Some(bundle.trace(dvec2(middle?, 0.0) + offset)?.stops[passage]);
            Some((at(offset)? - at(DVec2::ZERO)?).length() / offset.length())
        };
        let widths = [dvec2(1e-6, 0.0), dvec2(0.0, 1e-6)].map(slope);
        let [Some(along), Some(across)] = widths else {
            return Extent::default();
        };
        let half = 2.0 * opening / dvec2(along, across);
        let area = 4.0 * half.x * half.y / f64::from(RAYS * RAYS);
        let rays = grid(1.0, RAYS).filter_map(|at| {
            let passage = bundle.trace(dvec2(middle?, 0.0) + half * at)?;
            let is_open = passage.stops.iter().all(|at| at.length() <= opening);
            let light = bundle.arriving(&passage, Coating::Single)[1] * area;
            (is_open && passage.is_within_rims).then_some((-passage.film, light))
        });
        extent(&rays.collect::<Vec<_>>())
    }

    /// By the table, between two angles as the shader reads it.
    fn linear(table: &[GhostAt], tangent: f64, opening: f64) -> Extent {
        const RAYS: u32 = 60;
        let place = tangent / TANGENT_STEP;
        let part = place.fract() as f32;
        let [one, other] = [0, 1].map(|next| &table[place as usize + next]);
        let numbers = |ghost: &GhostAt| -> [f32; 24] { bytemuck::cast(*ghost) };
        let (one, other) = (numbers(one), numbers(other));
        let mix = |one: f32, other: f32| one + part * (other - one);
        let mixed: [f32; 24] = std::array::from_fn(|index| mix(one[index], other[index]));
        let mut ghost: GhostAt = bytemuck::cast(mixed);
        [ghost.size_along, ghost.size_across] = [1, 2].map(|axis| {
            let nearer = if part < 0.5 { one[axis] } else { other[axis] };
            mix(one[axis].abs(), other[axis].abs()) * nearer.signum()
        });
        let cosine = (1.0 + tangent * tangent).sqrt().recip();
        let area = (2.0 * opening / f64::from(RAYS)).powi(2);
        let light = f64::from(ghost.gathered) / cosine * f64::from(ghost.arriving[1]) * area;
        let rays = grid(opening, RAYS).filter(|at| {
            let within = |index: usize, radius: f64| {
                let [mean, along, across, _] = ghost.limits[index].map(f64::from);
                let place = dvec2(mean + along * (at.x - f64::from(ghost.stop)), across * at.y);
                place.length() <= radius
            };
            at.length() <= opening
                && within(0, 1.0)
                && within(1, 1.0)
                && within(2, opening)
                && within(3, opening)
        });
        let place = |at: DVec2| {
            let [along, across] = [ghost.size_along, ghost.size_across].map(f64::from);
            dvec2(
                f64::from(ghost.center) + along * (at.x - f64::from(ghost.stop)),
                across * at.y,
            )
        };
        extent(&rays.map(|at| (place(at), light)).collect::<Vec<_>>())
    }

    /// The six brightest of each angle and opening: their places within 2 percent of the picture's height, their sizes and
    /// their light within 10. It takes some 3 s, for a million rays.
    #[test]
    fn ghosts_lie_where_exact_rays_arrive() {
        let lens = Prescription::double_gauss();
        // A picture of 24 mm by a lens of 50 mm.
        let height = 0.48;
        let mut misses = Vec::new();
        for f_number in [4.0, 8.0, 16.0] {
            let opening = 2.0 / f_number;
            let table = ghosts(&lens, opening, Coating::Single);
            for tangent in [0.1, 0.21] {
                let pairs = lens.pairs().into_iter();
                let of_ghosts = table.chunks_exact(ANGLES as usize);
                let mut both: Vec<(Extent, Extent, Pair)> = pairs
                    .zip(of_ghosts)
                    .map(|(pair, table)| {
                        (
                            exact(&lens, pair, tangent, opening),
                            linear(table, tangent, opening),
                            pair,
                        )
                    })
                    .collect();
                both.sort_by(|(one, ..), (other, ..)| {
                    other.brightness().total_cmp(&one.brightness())
                });
                for (exact, linear, pair) in &both[..6] {
                    let apart = (exact.place - linear.place).abs() / height;
                    let larger = [0, 1].map(|axis| linear.size[axis] / exact.size[axis] - 1.0);
                    let brighter = linear.light / exact.light - 1.0;
                    let case = format!("f/{f_number}, {tangent}, {pair:?}");
                    println!(
                        "{case}: {apart:.3}, {larger:.3?}, {brighter:.3} {:.4?}",
                        exact.size
                    );
                    assert!(apart < 0.02, "{case}: {apart:.3} heights apart");
                    for (larger, size) in larger.into_iter().zip(exact.size) {
                        // Or two pixels of a thousand rows.
                        let is_near = larger.abs() < 0.1 || larger.abs() * size < 0.002 * height;
                        if !is_near {
                            misses.push(format!("{case}: {larger:.3} of {size:.4} larger"));
                        }
                    }
                    assert!(brighter.abs() < 0.1, "{case}: {brighter:.3} brighter");
                }
            }
        }
        // Of 36: a sliver at f/8, 12 x 23 pixels of a thousand rows, whose rays cross each other.
        let is_sliver = |miss: &String| miss.starts_with("f/8, 0.21, Pair { front: 4, back: 8 }");
        assert!(misses.iter().all(is_sliver), "{misses:#?}");
    }
}
