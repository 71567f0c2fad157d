//! Somebody who walks through the scene: an upright cylinder that walls stop, and rays to what it stands on.

use glam::{Mat4, Vec2, Vec3, Vec3Swizzles};
use gpugi_scene::Bounds;

use super::solid::{Solid, Triangle};

/// Height of the eye above the ground, and of the body (m, for a person).
pub const EYE: f32 = 1.7;
const HEIGHT: f32 = 1.8;
/// Radius of the body (m).
const RADIUS: f32 = 0.25;
/// Highest step that is climbed (m). What stays below it stops nobody.
const STEP: f32 = 0.4;
/// Height from which the ground is felt: a little more, so that what is as high as a step is one (m).
const KNEES: f32 = 1.001 * STEP;
/// Distance from the axis at which the feet feel the ground, too (m).
const FEET: f32 = 0.15;
/// Speed of a jump (m/s): 0.7 m high.
const JUMP: f32 = 3.7;
/// m/s^2.
pub const GRAVITY: f32 = 9.81;
/// Fastest fall (m/s), and time after which whoever falls is put back (s).
const FASTEST: f32 = 30.0;
const LONGEST_FALL: f32 = 3.0;
/// Most steps in which a frame's way is walked: enough for all that a person does in a frame.
const MOST_STEPS: f32 = 32.0;
/// Points on the line of sight at which a place to begin is looked for.
const PLACES: usize = 16;

/// What the feet are on.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Ground {
    instance: usize,
    /// World space from its mesh space, when the feet came there.
    place: Mat4,
}

/// Somebody who walks.
#[derive(Debug, Clone, PartialEq)]
pub struct Player {
    /// World space (m).
    feet: Vec3,
    /// Upward (m/s).
    velocity: f32,
    ground: Option<Ground>,
    /// Where the feet go back to from a fall (world space (m)).
    first: Vec3,
    /// Time of the fall so far (s).
    falls: f32,
    /// Length of a person's metre in the scene (m).
    unit: f32,
}

impl Player {
    /// Somebody who stands below `eye`, or else below the first place on the way that `looks` from there, as far as
    /// something is seen, under which there is ground. `None` if there is none. A metre of a person is `unit` (m).
    pub fn new(solid: &Solid, eye: Vec3, looks: Vec3, unit: f32) -> Option<Self> {
        let seen = solid
            .cast(eye, looks)
            .map_or(eye + looks, |seen| seen.point);
        let down = Vec3::NEG_Y * looks.length().max(100.0 * unit);
        let mut places = (0..PLACES).map(|place| eye.lerp(seen, place as f32 / PLACES as f32));
        let ground = places.find_map(|place| solid.cast(place, down))?;
        let mut player = Self {
            feet: ground.point,
            velocity: 0.0,
            ground: None,
            first: ground.point,
            falls: 0.0,
            unit,
        };
        player.go(solid, Vec3::ZERO);
        player.fall(solid, 0.0);
        player.first = player.feet;
        Some(player)
    }

    /// World space (m).
    pub fn eye(&self) -> Vec3 {
        self.feet + Vec3::Y * (EYE * self.unit)
    }

    /// Length of a person's metre in the scene (m).
    pub fn unit(&self) -> f32 {
        self.unit
    }

    /// Whether the feet are on something.
    pub fn is_on_ground(&self) -> bool {
        self.ground.is_some()
    }

    /// Index of the instance that the feet are on.
    pub fn stands_on(&self) -> Option<usize> {
        self.ground.map(|ground| ground.instance)
    }

    /// Feet and radius of the body, and the height of its top above the feet (world space (m)).
    pub fn body(&self) -> (Vec3, f32, f32) {
        (self.feet, RADIUS * self.unit, HEIGHT * self.unit)
    }

    /// Lives for `seconds`, with this velocity along the ground (world space (m/s)); `jumps` if there is ground to jump off.
    pub fn advance(&mut self, solid: &Solid, velocity: Vec2, jumps: bool, seconds: f32) {
        self.ride(solid);
        self.go(solid, Vec3::new(velocity.x, 0.0, velocity.y) * seconds);
        if jumps && self.ground.take().is_some() {
            self.velocity = JUMP * self.unit;
        }
        self.fall(solid, seconds);
        self.falls = match self.ground {
            Some(_) => 0.0,
            None => self.falls + seconds,
        };
        if self.falls > LONGEST_FALL || !self.feet.is_finite() {
            (self.feet, self.velocity, self.falls) = (self.first, 0.0, 0.0);
            self.ground = None;
        }
    }

    /// Goes where the ground goes.
    fn ride(&mut self, solid: &Solid) {
        let Some(ground) = self.ground else { return };
        let place = solid.place_of(ground.instance);
        if place != ground.place {
            let feet = (place * ground.place.inverse()).transform_point3(self.feet);
            if feet.is_finite() {
                self.feet = feet;
            }
        }
    }

    /// Goes along the ground, as far as walls let it (m), and makes way for what has come too near.
    fn go(&mut self, solid: &Solid, way: Vec3) {
        let radius = RADIUS * self.unit;
        let aside = Vec3::new(radius, 0.0, radius);
        let [low, high] = [KNEES, HEIGHT].map(|height| self.feet + Vec3::Y * (height * self.unit));
        let walls = solid.near(&Bounds {
            min: low.min(low + way) - aside,
            max: high.max(high + way) + aside,
        });
        let steps = (way.length() / (radius / 2.0)).ceil();
        let steps = steps.clamp(1.0, MOST_STEPS);
        for _ in 0..steps as u32 {
            self.feet += way / steps;
            // In a corner, one wall pushes toward the other.
            for _ in 0..4 {
                let pushed = walls.iter().filter(|wall| self.make_way(wall)).count();
                if pushed == 0 {
                    break;
                }
            }
        }
    }

    /// Goes out of a wall, if it is in one, and says so.
    fn make_way(&mut self, wall: &Triangle) -> bool {
        let radius = RADIUS * self.unit;
        let heights = [KNEES, HEIGHT].map(|height| self.feet.y + height * self.unit);
        let Some(nearest) = nearest_in_plan(wall, heights, self.feet.xz()) else {
            return false;
        };
        let away = self.feet.xz() - nearest;
        let distance = away.length();
        // Rounding must not count as a wall forever.
        if distance >= 0.9999 * radius || distance <= 0.0 {
            return false;
        }
        let push = away * (radius / distance - 1.0);
        self.feet += Vec3::new(push.x, 0.0, push.y);
        true
    }

    /// Falls, lands, climbs and comes down steps.
    fn fall(&mut self, solid: &Solid, seconds: f32) {
        let unit = self.unit;
        let gravity = GRAVITY * unit;
        let mut rise = (self.velocity - 0.5 * gravity * seconds) * seconds;
        self.velocity = (self.velocity - gravity * seconds).max(-FASTEST * unit);
        let knees = self.feet + Vec3::Y * (KNEES * unit);
        if rise > 0.0 {
            let up = Vec3::Y * ((HEIGHT - KNEES) * unit + rise);
            if let Some(ceiling) = solid.cast(knees, up) {
                let free = ceiling.point.y - HEIGHT * unit - self.feet.y;
                rise = rise.min(free.max(0.0));
                self.velocity = 0.0;
            }
            self.feet.y += rise;
            self.ground = None;
            return;
        }
        // Whoever walks down stairs does not fly off each step.
        let reach = match self.ground {
            Some(_) => STEP * unit,
            None => 0.0,
        };
        // A hair longer: what ends on the ground may miss it.
        let down = Vec3::NEG_Y * (1.001 * KNEES * unit + reach.max(-rise));
        let around = [Vec2::ZERO, Vec2::X, Vec2::NEG_X, Vec2::Y, Vec2::NEG_Y];
        let below = around.iter().filter_map(|aside| {
            let aside = *aside * (FEET * unit);
            solid.cast(knees + Vec3::new(aside.x, 0.0, aside.y), down)
        });
        match below.max_by(|a, b| a.point.y.total_cmp(&b.point.y)) {
            Some(touch) => {
                // Rounding must not move who stands.
                if (touch.point.y - self.feet.y).abs() > 1e-4 * unit {
                    self.feet.y = touch.point.y;
                }
                self.velocity = 0.0;
                self.ground = Some(Ground {
                    instance: touch.instance,
                    place: solid.place_of(touch.instance),
                });
            }
            None => {
                self.feet.y += rise;
                self.ground = None;
            }
        }
    }
}

/// The point of the part of a triangle between two heights that is nearest to `point`, all seen from above: x and z (m).
/// `None` if no part lies there, or if it lies above or below `point`: then no side is nearer than another.
fn nearest_in_plan(triangle: &Triangle, [low, high]: [f32; 2], point: Vec2) -> Option<Vec2> {
    let heights = triangle.map(|corner| corner.y);
    if heights.iter().all(|&y| y <= low) || heights.iter().all(|&y| y >= high) {
        return None;
    }
    let above = clipped(triangle, |corner| corner.y - low);
    let part = clipped(&above, |corner| high - corner.y);
    let ends = || part.iter().zip(part.iter().cycle().skip(1));
    let side = |(a, b): (&Vec3, &Vec3)| (b.xz() - a.xz()).perp_dot(point - a.xz());
    if ends().map(side).all(|side| side > 0.0) || ends().map(side).all(|side| side < 0.0) {
        return None;
    }
    let nearest = ends().map(|(a, b)| {
        let (a, way) = (a.xz(), b.xz() - a.xz());
        let along = (point - a).dot(way) / way.length_squared().max(f32::MIN_POSITIVE);
        a + way * along.clamp(0.0, 1.0)
    });
    let distance = |corner: &Vec2| corner.distance_squared(point);
    nearest.min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// The part of a convex polygon where `side` is positive.
fn clipped(polygon: &[Vec3], side: impl Fn(Vec3) -> f32) -> Vec<Vec3> {
    let mut part = Vec::with_capacity(polygon.len() + 1);
    for (&a, &b) in polygon.iter().zip(polygon.iter().cycle().skip(1)) {
        let (of_a, of_b) = (side(a), side(b));
        if of_a >= 0.0 {
            part.push(a);
        }
        if (of_a > 0.0 && of_b < 0.0) || (of_a < 0.0 && of_b > 0.0) {
            part.push(a.lerp(b, of_a / (of_a - of_b)));
        }
    }
    part
}
