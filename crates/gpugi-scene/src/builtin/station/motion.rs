//! Nodes and what moves them, as functions of the part of a period that has passed (0 to 1).

use std::ops::{Add, Mul};

use glam::{DVec3, Mat4, Quat, Vec3};

use crate::animation::{Animation, Channel, Interpolation, Node, Property, Rig, Transform};

/// A rig in the making.
#[derive(Default)]
pub struct Motion {
    pub rig: Rig,
}

impl Motion {
    /// A node below `parent`, placed rigidly in its space; returns its index.
    pub fn node(&mut self, parent: Option<usize>, place: Mat4) -> usize {
        let (_, rotation, translation) = place.to_scale_rotation_translation();
        let index = self.rig.nodes.len();
        self.rig.order.push(index);
        self.rig.nodes.push(Node {
            parent,
            rest: Transform::Parts {
                translation: translation.as_dvec3(),
                rotation: rotation.as_dquat(),
                scale: DVec3::ONE,
            },
            weights: Vec::new(),
        });
        index
    }

    /// A node that is scaled along its axes.
    pub fn scaled(&mut self, parent: Option<usize>, at: Vec3, scale: Vec3) -> usize {
        let node = self.node(parent, Mat4::from_translation(at));
        if let Transform::Parts { scale: own, .. } = &mut self.rig.nodes[node].rest {
            *own = scale.as_dvec3();
        }
        node
    }

    /// Moves a node: its place in its parent's space (m). `pace`: period (s) and number of keys.
    pub fn slide(&mut self, node: usize, pace: (f32, usize), place: impl Fn(f32) -> Vec3) {
        let value = |phase: f32| place(phase).to_array();
        self.play(node, Property::Translation, pace, value);
    }

    /// Turns a node.
    pub fn turn(&mut self, node: usize, pace: (f32, usize), rotation: impl Fn(f32) -> Quat) {
        let value = |phase: f32| rotation(phase).to_array();
        self.play(node, Property::Rotation, pace, value);
    }

    /// Weighs the morph targets of a node's mesh.
    pub fn weigh<const N: usize>(
        &mut self,
        node: usize,
        pace: (f32, usize),
        weights: impl Fn(f32) -> [f32; N],
    ) {
        self.rig.nodes[node].weights = weights(0.0).to_vec();
        self.play(node, Property::Weights, pace, weights);
    }

    fn play<const N: usize>(
        &mut self,
        node: usize,
        property: Property,
        (period, keys): (f32, usize),
        value: impl Fn(f32) -> [f32; N],
    ) {
        let channel = Channel {
            node,
            property,
            interpolation: Interpolation::Linear,
            times: (0..=keys)
                .map(|key| period * key as f32 / keys as f32)
                .collect(),
            // The last key repeats the first one, so that the loop closes.
            values: (0..=keys)
                .flat_map(|key| value((key % keys) as f32 / keys as f32))
                .collect(),
        };
        let animations = &mut self.rig.animations;
        match animations
            .iter_mut()
            .find(|animation| animation.duration == period)
        {
            Some(animation) => animation.channels.push(channel),
            None => animations.push(Animation {
                name: format!("{period} s"),
                duration: period,
                channels: vec![channel],
            }),
        }
    }
}

/// Eases from 0 to 1 while `value` goes from `start` to `end`.
pub fn eased(value: f32, start: f32, end: f32) -> f32 {
    let t = ((value - start) / (end - start)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The value at `part` (0 to 1) of the way through `values`, which lie at equal steps; linear between them.
pub fn sampled<T: Copy + Add<Output = T> + Mul<f32, Output = T>>(values: &[T], part: f32) -> T {
    let along = part * (values.len() - 1) as f32;
    let before = (along as usize).min(values.len() - 2);
    let t = along - before as f32;
    values[before] * (1.0 - t) + values[before + 1] * t
}
