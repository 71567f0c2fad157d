//! What people use: a node that no longer follows the clock, but goes along its own path from one end to the other.

use glam::DMat4;
use gpugi_scene::animation::{Rig, Transform};

/// Moments of a loop among which the ends of a path are looked for.
const MOMENTS: usize = 128;
/// Most steps in which a pause on the way is left out.
const MOST_STEPS: usize = 4096;
/// Part of the way between the ends that is no motion.
const NO_MOTION: f64 = 1e-5;

/// A node in use.
#[derive(Debug, Clone, PartialEq)]
pub struct Drive {
    /// Index of the node.
    pub node: usize,
    /// Where it is on its path: time of its loop (s).
    time: f32,
    /// Where its path ends: the times when it is farthest from itself (s).
    ends: [f32; 2],
    /// The end to which it goes.
    toward: usize,
    /// What counts as motion from one step to the next ([`difference`]).
    motion: f64,
}

/// The node that moves by itself and carries `node`, or is it.
pub fn moving(rig: &Rig, node: usize) -> Option<usize> {
    let carriers = std::iter::successors(Some(node), |&node| rig.nodes[node].parent);
    let mut carriers = carriers.take(rig.nodes.len());
    carriers.find(|&node| rig.period(node).is_some())
}

impl Drive {
    /// Takes a node over at `seconds` of the clock, toward the end that is farther away. `None` if it never moves.
    pub fn new(rig: &Rig, node: usize, seconds: f32) -> Option<Self> {
        let period = rig.period(node)?;
        let time = seconds.rem_euclid(period);
        if !time.is_finite() {
            return None;
        }
        let at = |time: f32| rig.local(node, time).matrix();
        let moments = || (0..MOMENTS).map(|moment| period * moment as f32 / MOMENTS as f32);
        let places: Vec<(f32, DMat4)> = moments().map(|time| (time, at(time))).collect();
        let farthest = |from: DMat4| {
            let far = |place: &DMat4| difference(*place, from);
            let all = places.iter().rev();
            all.max_by(|(_, a), (_, b)| far(a).total_cmp(&far(b)))
                .copied()
        };
        let (first, of_first) = farthest(places.first()?.1)?;
        let (second, of_second) = farthest(of_first)?;
        let way = difference(of_first, of_second);
        let now = at(time);
        let is_first_nearer = difference(now, of_first) < difference(now, of_second);
        (way > 0.0 && way.is_finite()).then_some(Self {
            node,
            time,
            ends: [first, second],
            toward: usize::from(is_first_nearer),
            motion: NO_MOTION * way,
        })
    }

    /// Sends it to its other end.
    pub fn turn(&mut self) {
        self.toward = 1 - self.toward;
    }

    /// Moves on for `seconds`. Pauses on the way take no time. Returns whether it moves.
    pub fn advance(&mut self, rig: &Rig, seconds: f32) -> bool {
        let end = self.ends[self.toward];
        if self.time == end || seconds <= 0.0 {
            return false;
        }
        let before = self.place(rig).matrix();
        for _ in 0..MOST_STEPS {
            let rest = end - self.time;
            self.time += rest.clamp(-seconds, seconds);
            if rest.abs() <= seconds {
                self.time = end;
                break;
            }
            if difference(before, self.place(rig).matrix()) > self.motion {
                break;
            }
        }
        true
    }

    /// Where it is, relative to its parent. `rig` is the scene's own.
    pub fn place(&self, rig: &Rig) -> Transform {
        rig.local(self.node, self.time)
    }
}

/// How far apart two placements are: the length of the difference of their matrices.
fn difference(a: DMat4, b: DMat4) -> f64 {
    let squares = (a - b).to_cols_array().map(|value| value * value);
    squares.iter().sum::<f64>().sqrt()
}
