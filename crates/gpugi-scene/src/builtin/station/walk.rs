//! A walk along a closed path: feet that stay where they were put, and legs that reach them.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{Mat3, Quat, Vec3, vec3};

/// Two straights along x and two half circles around them.
pub struct Path {
    pub middle: Vec3,
    /// Half the length of the straights (m).
    pub half: f32,
    /// Radius of the half circles (m).
    pub radius: f32,
}

impl Path {
    pub fn length(&self) -> f32 {
        4.0 * self.half + TAU * self.radius
    }

    /// The place after a way of `way` (m), and the turn about +Y from +Z to where it leads (rad).
    pub fn at(&self, way: f32) -> (Vec3, f32) {
        let laps = (way / self.length()).floor();
        let mut rest = way - laps * self.length();
        let (half, radius) = (self.half, self.radius);
        let straight = 2.0 * half;
        let bend = PI * radius;
        // The second half is the first one, turned about the middle.
        let is_back = rest >= straight + bend;
        if is_back {
            rest -= straight + bend;
        }
        let (place, turn) = if rest < straight {
            (vec3(rest - half, 0.0, radius), FRAC_PI_2)
        } else {
            let angle = (rest - straight) / radius;
            let (sine, cosine) = angle.sin_cos();
            (
                vec3(half + radius * sine, 0.0, radius * cosine),
                FRAC_PI_2 + angle,
            )
        };
        let (place, turn) = if is_back {
            (-place, turn + PI)
        } else {
            (place, turn)
        };
        (self.middle + place, turn + laps * TAU)
    }
}

/// Lengths of a leg (m): from hip to knee, from knee to ankle, from ankle to ground.
pub const THIGH: f32 = 0.42;
pub const SHIN: f32 = 0.38;
pub const ANKLE: f32 = 0.08;
/// Distance of the hips from the body's middle, and their height while walking (m).
pub const HIPS: f32 = 0.11;
pub const STANCE: f32 = 0.81;
/// Part of a cycle in which a foot stands.
const STANDS: f32 = 0.6;

/// A body that walks `cycles` double steps along its path.
pub struct Walk {
    pub path: Path,
    pub cycles: u32,
    /// Time in which it does so (s).
    pub period: f32,
}

/// Where pelvis and legs are. Rotations are in the world.
pub struct Gait {
    pub pelvis: Vec3,
    pub heading: Quat,
    /// Thigh, shin and foot of the left and the right leg.
    pub legs: [[Quat; 3]; 2],
    /// Part of the double step that has passed.
    pub cycle: f32,
}

impl Walk {
    /// The gait after a part of the path (0 to 1).
    pub fn gait(&self, phase: f32) -> Gait {
        let way = phase * self.path.length();
        let cycle = phase * self.cycles as f32;
        let (place, turn) = self.path.at(way);
        let heading = Quat::from_rotation_y(turn);
        // The body is highest above a standing foot.
        let bob = 0.012 * (2.0 * TAU * (cycle - STANDS / 2.0)).cos();
        let pelvis = place + Vec3::Y * (STANCE + bob);
        let legs = [1.0, -1.0].map(|side| {
            let hip = pelvis + heading * (Vec3::X * HIPS * side);
            let (ankle, foot) = self.foot(cycle, side);
            let [thigh, shin] = reach(hip, ankle, heading * Vec3::X);
            [thigh, shin, foot]
        });
        Gait {
            pelvis,
            heading,
            legs,
            cycle: cycle.fract(),
        }
    }

    /// Place of an ankle, and rotation of its foot. `side`: 1 left, -1 right.
    fn foot(&self, cycle: f32, side: f32) -> (Vec3, Quat) {
        let start = if side > 0.0 { 0.0 } else { 0.5 };
        let stride = self.path.length() / self.cycles as f32;
        let own = cycle + start;
        // Put down so that the body passes it in the middle of its stand.
        let put = |number: f32| {
            let (place, turn) = self.path.at((number - start + STANDS / 2.0) * stride);
            (
                place + Quat::from_rotation_y(turn) * (Vec3::X * HIPS * side),
                turn,
            )
        };
        let (before, after) = (put(own.floor()), put(own.floor() + 1.0));
        let swing = ((own.fract() - STANDS) / (1.0 - STANDS)).max(0.0);
        let eased = swing * swing * (3.0 - 2.0 * swing);
        let lift = 0.1 * (PI * swing).sin();
        let turn = before.1 + (after.1 - before.1) * eased;
        let tip = 0.45 * (PI * swing).sin() * (1.0 - swing);
        (
            before.0.lerp(after.0, eased) + Vec3::Y * (ANKLE + lift),
            Quat::from_rotation_y(turn) * Quat::from_rotation_x(tip),
        )
    }
}

/// Rotations of thigh and shin, both of which point along -Y at rest, so that the ankle is reached. The knee bends
/// forward about the axis `left`.
fn reach(hip: Vec3, ankle: Vec3, left: Vec3) -> [Quat; 2] {
    let way = ankle - hip;
    let length = way.length().min(0.999 * (THIGH + SHIN));
    let cosine = (THIGH * THIGH + length * length - SHIN * SHIN) / (2.0 * THIGH * length);
    let thigh = Quat::from_axis_angle(left, -cosine.clamp(-1.0, 1.0).acos()) * way.normalize();
    let shin = (way.normalize() * length - thigh * THIGH).normalize();
    [thigh, shin].map(|bone| {
        let x = left.reject_from_normalized(bone).normalize();
        Quat::from_mat3(&Mat3::from_cols(x, -bone, x.cross(-bone)))
    })
}
