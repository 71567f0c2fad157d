//! What a scene is about, however large the scene is.

use std::cmp::Ordering;

use glam::Vec3;

use crate::{Bounds, Scene};

/// A box that reaches this many times farther from the middle than all before it is no part of the core.
const GAP: f32 = 30.0;

/// The box around a scene's core: all but what is far larger than the rest or far away, such as the ground of a landscape,
/// the dome of a sky and what was left lying about. The box around all if no half of the boxes tells what the core is.
pub fn core_of(boxes: &[Bounds], all: Bounds) -> Bounds {
    // Of an even number, each of the two in the middle may be outside of the core.
    let cores =
        [(boxes.len().max(1) - 1) / 2, boxes.len() / 2].map(|rank| core_around(boxes, rank));
    match cores {
        [Some(a), Some(b)] if a == b => a.0,
        [a, b] => {
            let count = |core: &Option<(Bounds, usize)>| core.map_or(0, |(_, count)| count);
            match count(&a).cmp(&count(&b)) {
                Ordering::Equal => all,
                Ordering::Greater => a.map_or(all, |core| core.0),
                Ordering::Less => b.map_or(all, |core| core.0),
            }
        }
    }
}

/// The core around the middle of the boxes, which has `rank` of their centres below it along each axis, and the number of
/// its boxes.
fn core_around(boxes: &[Bounds], rank: usize) -> Option<(Bounds, usize)> {
    let middle = Vec3::from_array([0, 1, 2].map(|axis| {
        let centers = boxes.iter().map(|bounds| bounds.center()[axis]);
        let mut centers: Vec<f32> = centers.collect();
        match rank < centers.len() {
            true => *centers.select_nth_unstable_by(rank, f32::total_cmp).1,
            false => 0.0,
        }
    }));
    let reach = |bounds: &Bounds| {
        let farthest = (bounds.max - middle).abs().max((bounds.min - middle).abs());
        farthest.length()
    };
    let mut by_reach: Vec<(f32, &Bounds)> =
        boxes.iter().map(|bounds| (reach(bounds), bounds)).collect();
    by_reach.sort_by(|a, b| a.0.total_cmp(&b.0));
    let is_gap = |pair: &[(f32, &Bounds)]| pair[1].0 > GAP * pair[0].0 && pair[0].0 > 0.0;
    let count = by_reach.windows(2).position(is_gap);
    let count = count.map_or(by_reach.len(), |last| last + 1);
    let core = by_reach[..count].iter().map(|(_, bounds)| **bounds);
    (2 * count >= boxes.len()).then(|| (core.fold(Bounds::EMPTY, Bounds::union), count))
}

impl Scene {
    /// The box around the scene's core ([`core_of`] its instances).
    pub fn core(&self) -> Bounds {
        let mesh_bounds: Vec<Bounds> = self.meshes.iter().map(|mesh| mesh.bounds()).collect();
        let boxes = self
            .instances
            .iter()
            .map(|instance| mesh_bounds[instance.mesh].transformed(&instance.world_from_mesh))
            .collect::<Vec<_>>();
        core_of(&boxes, self.bounds())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(center: Vec3, side: f32) -> Bounds {
        Bounds {
            min: center - side / 2.0,
            max: center + side / 2.0,
        }
    }

    fn core(boxes: &[Bounds]) -> Bounds {
        let all = boxes.iter().copied().fold(Bounds::EMPTY, Bounds::union);
        core_of(boxes, all)
    }

    #[test]
    fn what_is_far_larger_or_far_away_is_no_part_of_the_core() {
        let house = [-2.0, 0.0, 3.0].map(|x| cube(Vec3::new(x, 1.0, 0.0), 2.0));
        let alone = core(&house);
        assert_eq!(alone.max.x, 4.0);
        let ground = cube(Vec3::ZERO, 1e5);
        let stray = cube(Vec3::splat(1e5), 1.0);
        let with = |others: &[Bounds]| core(&[&house, others].concat());
        assert_eq!(with(&[ground]), alone);
        assert_eq!(with(&[stray]), alone);
        assert_eq!(with(&[ground, stray]), alone);
        // A ground ten times as large belongs to it.
        let garden = cube(Vec3::ZERO, 50.0);
        assert_eq!(with(&[garden]), garden);
        // A box on a ground; two boxes far apart, of which none is more than the other; nothing.
        let box_on_ground = cube(Vec3::new(0.0, 0.5, 0.0), 1.0);
        assert_eq!(core(&[ground, box_on_ground]), box_on_ground);
        assert_eq!(core(&[box_on_ground, stray]).max, stray.max);
        assert!(core(&[]).is_empty());
    }
}
