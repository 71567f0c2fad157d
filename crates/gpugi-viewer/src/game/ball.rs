//! Balls that fly, bounce, roll and come to rest.

use glam::{Mat4, Vec3};
use gpugi_scene::builtin::shapes::sphere;
use gpugi_scene::{Bounds, Material, Scene, Volume};

use super::player::GRAVITY;
use super::solid::{Solid, nearest_on};

/// Radius (m, for a person).
pub const RADIUS: f32 = 0.15;
/// Part of the speed with which a ball leaves what it hits.
const RESTITUTION: f32 = 0.7;
/// Part of the speed along a surface that a bounce takes.
const SCRAPE: f32 = 0.05;
/// What rolling costs (m/s^2).
const ROLLING: f32 = 0.6;
/// A ball that hits more slowly does not bounce (m/s).
const SLOWEST_BOUNCE: f32 = 0.25;
/// A ball on the ground that is slower for so long rests (m/s, s).
const SLOWEST: f32 = 0.02;
const STILL_SECONDS: f32 = 0.2;
/// Steps per second, and most of them in a frame.
const STEPS: f32 = 120.0;
const MOST_STEPS: f32 = 64.0;
/// Fastest (m/s): in each of the most steps it goes by less than its radius.
const FASTEST: f32 = 60.0;
/// Balls in a scene that has them.
pub const COUNT: usize = 3;
/// Size of those that nobody has thrown yet.
const DUST: f32 = 1e-5;

/// What balls are made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Finish {
    /// A mirror.
    #[default]
    Chrome,
    /// Clear glass.
    Glass,
}

impl Finish {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Chrome, Self::Glass];

    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Chrome => "chrome",
            Self::Glass => "glass",
        }
    }

    /// The material of such balls.
    pub fn material(self) -> Material {
        match self {
            Self::Chrome => Material::metal("ball", Vec3::splat(0.9), 0.0),
            Self::Glass => Material {
                name: "ball".to_owned(),
                roughness: 0.0,
                transmission: 1.0,
                volume: Some(Volume {
                    attenuation_distance: f32::INFINITY,
                    attenuation_color: Vec3::ONE,
                }),
                ..Material::default()
            },
        }
    }
}

/// Adds balls of this radius (m) to a scene, at `center`: one to be seen, and the others as small as dust in it. Returns the
/// index of the first.
pub fn add_to(scene: &mut Scene, finish: Finish, center: Vec3, radius: f32) -> usize {
    let mut mesh = sphere(radius, 32);
    mesh.name = "ball".into();
    mesh.build_tree();
    let mesh = scene.add_mesh(mesh);
    let material = scene.add_material(finish.material());
    let first = scene.instances.len();
    for number in 0..COUNT {
        let scale = if number == 0 { 1.0 } else { DUST };
        let place = Mat4::from_translation(center) * Mat4::from_scale(Vec3::splat(scale));
        scene.add_instance(&format!("ball {number}"), mesh, material, place);
    }
    first
}

/// A ball. It shows no turning: it is the same all around.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ball {
    /// World space (m).
    pub center: Vec3,
    /// World space (m/s).
    pub velocity: Vec3,
    /// m.
    pub radius: f32,
    /// Time for which it has hardly moved (s).
    still: f32,
}

impl Ball {
    /// A ball in flight.
    pub fn new(center: Vec3, velocity: Vec3, radius: f32) -> Self {
        Self {
            center,
            velocity,
            radius,
            still: 0.0,
        }
    }

    /// World space from the space of the mesh of [`add_to`].
    pub fn place(&self) -> Mat4 {
        Mat4::from_translation(self.center)
    }

    /// Whether it lies still.
    pub fn is_at_rest(&self) -> bool {
        self.still >= STILL_SECONDS
    }

    /// Wakes it.
    pub fn wake(&mut self) {
        self.still = 0.0;
    }

    /// Moves for `seconds`. A metre of a person is `unit` (m). Returns whether it has moved.
    pub fn advance(&mut self, solid: &Solid, unit: f32, seconds: f32) -> bool {
        if self.is_at_rest() {
            return false;
        }
        self.velocity = self.velocity.clamp_length_max(FASTEST * unit);
        let gravity = Vec3::NEG_Y * (GRAVITY * unit);
        let way = self.velocity * seconds + gravity * (seconds * seconds);
        let by_radius = way.length() / (0.5 * self.radius);
        let steps = (seconds * STEPS).max(by_radius).ceil();
        let steps = steps.clamp(1.0, MOST_STEPS);
        let step = seconds / steps;
        let reach = Vec3::splat(2.0 * self.radius);
        let around = solid.near(&Bounds {
            min: self.center.min(self.center + way) - reach,
            max: self.center.max(self.center + way) + reach,
        });
        for _ in 0..steps as u32 {
            self.center += self.velocity * step + gravity * (0.5 * step * step);
            self.velocity += gravity * step;
            let mut is_on_ground = false;
            // In a corner, one surface pushes toward the other.
            for _ in 0..4 {
                let nearest = around
                    .iter()
                    .map(|triangle| nearest_on(*triangle, self.center));
                let distance = |point: &Vec3| point.distance_squared(self.center);
                let Some(nearest) = nearest.min_by(|a, b| distance(a).total_cmp(&distance(b)))
                else {
                    break;
                };
                let away = self.center - nearest;
                let depth = self.radius - away.length();
                let Some(normal) = away.try_normalize().filter(|_| depth > 0.0) else {
                    break;
                };
                self.center += normal * depth;
                self.bounce(normal, depth, gravity, step, unit);
                is_on_ground |= normal.y > 0.7;
            }
            if is_on_ground {
                let speed = self.velocity.length();
                let slower = (speed - ROLLING * unit * step).max(0.0);
                self.velocity *= slower / speed.max(f32::MIN_POSITIVE);
            }
            let is_still = is_on_ground && self.velocity.length() < SLOWEST * unit;
            self.still = if is_still { self.still + step } else { 0.0 };
        }
        if self.is_at_rest() {
            self.velocity = Vec3::ZERO;
        }
        true
    }

    /// Leaves a surface that it has entered by `depth` (m) within a `step` (s).
    fn bounce(&mut self, normal: Vec3, depth: f32, gravity: Vec3, step: f32, unit: f32) {
        let into = -self.velocity.dot(normal);
        if into <= 0.0 {
            return;
        }
        // At the surface it was slower than below it: v^2 = v0^2 + 2 g d.
        let at_surface = (into * into + 2.0 * gravity.dot(normal) * depth).max(0.0);
        let at_surface = at_surface.sqrt().min(into);
        let along = self.velocity + normal * into;
        let falls = gravity.length() * step;
        self.velocity = match at_surface < SLOWEST_BOUNCE * unit + falls {
            true => along,
            false => along * (1.0 - SCRAPE) + normal * (at_surface * RESTITUTION),
        };
    }
}

/// Lets two balls that meet exchange what they have of speed toward each other. Returns whether they met.
pub fn collide(a: &mut Ball, b: &mut Ball) -> bool {
    let between = b.center - a.center;
    let depth = a.radius + b.radius - between.length();
    let Some(normal) = between.try_normalize().filter(|_| depth > 0.0) else {
        return false;
    };
    a.center -= normal * (depth / 2.0);
    b.center += normal * (depth / 2.0);
    let toward = (a.velocity - b.velocity).dot(normal);
    if toward > 0.0 {
        // Of equal balls, each takes half of (1 + e) times that.
        let change = normal * (toward * (1.0 + RESTITUTION) / 2.0);
        a.velocity -= change;
        b.velocity += change;
    }
    a.wake();
    b.wake();
    true
}
