//! A hierarchy of nodes, what moves them, and what they bend.

use glam::{DMat4, DQuat, DVec3, DVec4, Mat4, Vec3, Vec4};
use serde::{Deserialize, Serialize};

/// The animation data of a scene.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Rig {
    /// The hierarchy; instances, lights and cameras refer to a node by its index.
    pub nodes: Vec<Node>,
    /// Every node once, parents before their children.
    pub order: Vec<usize>,
    /// Skeletons that deform meshes.
    pub skins: Vec<Skin>,
    /// Meshes that deform.
    pub deformers: Vec<Deformer>,
    /// All animations play at the same time, each looping on its own.
    pub animations: Vec<Animation>,
}

/// A node of the hierarchy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Node {
    /// Index of the parent node.
    pub parent: Option<usize>,
    /// Placement relative to the parent when no channel overrides it.
    pub rest: Transform,
    /// Weights of the morph targets of the node's mesh when no channel overrides them.
    pub weights: Vec<f32>,
}

/// Placement of a node relative to its parent. In 64 bits, because a node may stand far from the file's origin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Transform {
    /// Any affine matrix.
    Matrix(DMat4),
    /// Scale first, then rotation, then translation.
    Parts {
        /// Translation (m).
        translation: DVec3,
        /// Unit rotation.
        rotation: DQuat,
        /// Scale along each axis.
        scale: DVec3,
    },
}

impl Transform {
    /// Parent space from node space.
    pub fn matrix(&self) -> DMat4 {
        match *self {
            Self::Matrix(matrix) => matrix,
            Self::Parts {
                translation,
                rotation,
                scale,
            } => DMat4::from_scale_rotation_translation(scale, rotation, translation),
        }
    }

    fn set(&mut self, property: Property, value: &[f32]) {
        // A channel changes a single component, so decompose a matrix first.
        let (mut scale, mut rotation, mut translation) = match *self {
            Self::Matrix(matrix) => matrix.to_scale_rotation_translation(),
            Self::Parts {
                translation,
                rotation,
                scale,
            } => (scale, rotation, translation),
        };
        let vector = |value: [f32; 3]| Vec3::from(value).as_dvec3();
        match (property, value) {
            (Property::Translation, &[x, y, z]) => translation = vector([x, y, z]),
            (Property::Scale, &[x, y, z]) => scale = vector([x, y, z]),
            (Property::Rotation, &[x, y, z, w]) => {
                rotation = unit_rotation([x, y, z, w].map(f64::from))
            }
            _ => {}
        }
        *self = Self::Parts {
            translation,
            rotation,
            scale,
        };
    }
}

/// The rotation of the quaternion `xyzw`, normalized; the identity if its length is zero or not finite.
pub fn unit_rotation(xyzw: [f64; 4]) -> DQuat {
    let length_squared = DVec4::from(xyzw).length_squared();
    if length_squared > 0.0 && length_squared.is_finite() {
        DQuat::from_array(xyzw).normalize()
    } else {
        DQuat::IDENTITY
    }
}

/// A skeleton.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Skin {
    /// Node indices of the joints.
    pub joints: Vec<usize>,
    /// Joint space from mesh space at rest, one matrix per joint.
    pub joint_from_mesh: Vec<Mat4>,
}

impl Skin {
    /// The file's coordinates from mesh space, one matrix per joint.
    pub(super) fn matrices(&self, pose: &Pose) -> impl Iterator<Item = DMat4> {
        let joints = self.joints.iter().zip(&self.joint_from_mesh);
        joints.map(|(&joint, joint_from_mesh)| {
            pose.file_from_node[joint] * joint_from_mesh.as_dmat4()
        })
    }
}

/// A mesh that deforms: the mesh at rest and what deforms it. No other instance uses the mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Deformer {
    /// Index into [`Scene::instances`](crate::Scene::instances).
    pub instance: usize,
    /// Node that carries the instance and the morph target weights.
    pub node: usize,
    /// Positions at rest, mesh space.
    #[serde(with = "crate::plain")]
    pub positions: Vec<Vec3>,
    /// Normals at rest, mesh space.
    #[serde(with = "crate::plain")]
    pub normals: Vec<Vec3>,
    /// Tangents at rest, mesh space; may be empty.
    #[serde(with = "crate::plain")]
    pub tangents: Vec<Vec4>,
    /// Normals are recomputed from the deformed triangles. Each triangle then has three vertices of its own, in order.
    pub flat: bool,
    /// Displacements, in the order of the node's weights.
    pub targets: Vec<MorphTarget>,
    /// Index into [`Rig::skins`], and the joints that influence each vertex. Skinned instances are in world space.
    pub skin: Option<(usize, Influences)>,
}

/// Displacements of every vertex, in mesh space; a list is empty if the target does not change that attribute.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct MorphTarget {
    /// Added to positions (m).
    #[serde(with = "crate::plain")]
    pub positions: Vec<Vec3>,
    /// Added to normals.
    #[serde(with = "crate::plain")]
    pub normals: Vec<Vec3>,
    /// Added to tangents.
    #[serde(with = "crate::plain")]
    pub tangents: Vec<Vec3>,
}

impl MorphTarget {
    /// Bytes in memory.
    pub fn byte_size(&self) -> usize {
        let vectors = self.positions.len() + self.normals.len() + self.tangents.len();
        size_of::<Self>() + vectors * size_of::<Vec3>()
    }
}

/// Memory of a joint that influences a vertex (bytes).
pub(crate) const JOINT_BYTES: usize = size_of::<(u32, f32)>();

/// Which joints move each vertex.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Influences {
    /// Number of influences per vertex.
    pub per_vertex: usize,
    /// Joint index within the skin, and weight; `per_vertex` consecutive entries per vertex. The weights of a vertex
    /// sum to 1.
    pub joints: Vec<(u32, f32)>,
}

/// Channels that play together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Animation {
    /// Name for reports.
    pub name: String,
    /// Time of the last key (s); the animation then starts again.
    pub duration: f32,
    /// Its channels.
    pub channels: Vec<Channel>,
}

impl Animation {
    /// The time within the loop (s). A duration of 0 and a non-finite time both give NaN on the way: such an animation
    /// stays at its start.
    fn looped(&self, time_seconds: f32) -> f32 {
        let looped = time_seconds.rem_euclid(self.duration);
        if looped.is_finite() { looped } else { 0.0 }
    }
}

/// One property of one node over time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Channel {
    /// Index into [`Rig::nodes`].
    pub node: usize,
    /// The property that it sets.
    pub property: Property,
    /// Interpolation between keys.
    pub interpolation: Interpolation,
    /// Times of the keys (s), increasing, at least one.
    #[serde(with = "crate::plain")]
    pub times: Vec<f32>,
    /// The same number of values for each key; cubic splines store in-tangent, value and out-tangent.
    #[serde(with = "crate::plain")]
    pub values: Vec<f32>,
}

/// What a channel sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Property {
    /// Three values.
    Translation,
    /// Four values: a quaternion x, y, z, w.
    Rotation,
    /// Three values.
    Scale,
    /// One value per morph target.
    Weights,
}

/// How a channel interpolates between keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Interpolation {
    /// A key's value holds until the next key.
    Step,
    /// Linear interpolation; rotations take the shortest arc.
    Linear,
    /// Cubic Hermite spline with the tangents stored in the file.
    CubicSpline,
}

impl Channel {
    /// The values at `time` (s). Before the first key and after the last one, the value of that key holds.
    pub fn sample(&self, time: f32) -> Vec<f32> {
        let cubic = self.interpolation == Interpolation::CubicSpline;
        let key_width = self.values.len() / self.times.len().max(1);
        let width = if cubic { key_width / 3 } else { key_width };
        let part = |key: usize, part: usize| {
            let start = key * key_width + part * width;
            self.values.get(start..start + width).unwrap_or(&[])
        };
        let value = |key: usize| part(key, usize::from(cubic));
        let next = self.times.partition_point(|&key| key <= time);
        if next == 0 || next == self.times.len() {
            return value(next.saturating_sub(1)).to_vec();
        }
        let last = next - 1;
        let span = self.times[next] - self.times[last];
        let s = (time - self.times[last]) / span;
        match self.interpolation {
            Interpolation::Step => value(last).to_vec(),
            Interpolation::Linear if self.property == Property::Rotation => {
                match (value(last), value(next)) {
                    (&[ax, ay, az, aw], &[bx, by, bz, bw]) => {
                        let [a, b] = [[ax, ay, az, aw], [bx, by, bz, bw]]
                            .map(|xyzw| unit_rotation(xyzw.map(f64::from)));
                        a.slerp(b, s.into()).as_quat().to_array().to_vec()
                    }
                    _ => Vec::new(),
                }
            }
            Interpolation::Linear => {
                let pairs = value(last).iter().zip(value(next));
                pairs.map(|(a, b)| a + (b - a) * s).collect()
            }
            Interpolation::CubicSpline => {
                // glTF 2.0, appendix C.5:
                // v = (2s^3-3s^2+1) v_k + td (s^3-2s^2+s) b_k + (-2s^3+3s^2) v_k+1 + td (s^3-s^2) a_k+1
                let (s2, s3) = (s * s, s * s * s);
                let (leaving, arriving) = (part(last, 2), part(next, 0));
                (0..width)
                    .map(|i| {
                        (2.0 * s3 - 3.0 * s2 + 1.0) * value(last)[i]
                            + span * (s3 - 2.0 * s2 + s) * leaving[i]
                            + (3.0 * s2 - 2.0 * s3) * value(next)[i]
                            + span * (s3 - s2) * arriving[i]
                    })
                    .collect()
            }
        }
    }
}

/// The hierarchy evaluated at one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Pose {
    /// The file's coordinates from each node's space.
    pub file_from_node: Vec<DMat4>,
    /// Weights of each node's morph targets.
    pub weights: Vec<Vec<f32>>,
}

impl Rig {
    /// Whether anything deforms or any animation has channels.
    pub fn moves(&self) -> bool {
        !self.deformers.is_empty()
            || self
                .animations
                .iter()
                .any(|animation| !animation.channels.is_empty())
    }

    /// Duration of the longest loop (s).
    pub fn duration(&self) -> f32 {
        self.animations
            .iter()
            .map(|animation| animation.duration)
            .fold(0.0, f32::max)
    }

    /// Time after which a node that animations move is where it was (s); `None` if none moves it by itself.
    pub fn period(&self, node: usize) -> Option<f32> {
        let moves =
            |channel: &Channel| channel.node == node && channel.property != Property::Weights;
        let animations = self.animations.iter();
        let moving = animations.filter(|animation| animation.channels.iter().any(moves));
        moving.map(|animation| animation.duration).reduce(f32::max)
    }

    /// The placement of one node relative to its parent at `time_seconds`.
    pub fn local(&self, node: usize, time_seconds: f32) -> Transform {
        let mut place = self.nodes[node].rest;
        for animation in &self.animations {
            let time = animation.looped(time_seconds);
            let channels = animation.channels.iter();
            let moves =
                |channel: &&Channel| channel.node == node && channel.property != Property::Weights;
            for channel in channels.filter(moves) {
                place.set(channel.property, &channel.sample(time));
            }
        }
        place
    }

    /// Takes a node out of the animations: it stays at `place`, relative to its parent, while what it carries and the
    /// weights of its mesh go on as before.
    pub fn hold(&mut self, node: usize, place: Transform) {
        for animation in &mut self.animations {
            let channels = &mut animation.channels;
            channels
                .retain(|channel| channel.node != node || channel.property == Property::Weights);
        }
        self.nodes[node].rest = place;
    }

    /// Evaluates all nodes at `time_seconds`.
    pub fn pose(&self, time_seconds: f32) -> Pose {
        let mut transforms: Vec<Transform> = self.nodes.iter().map(|node| node.rest).collect();
        let mut weights: Vec<Vec<f32>> =
            self.nodes.iter().map(|node| node.weights.clone()).collect();
        for animation in &self.animations {
            let time = animation.looped(time_seconds);
            for channel in &animation.channels {
                let value = channel.sample(time);
                match channel.property {
                    Property::Weights => weights[channel.node] = value,
                    property => transforms[channel.node].set(property, &value),
                }
            }
        }
        let mut file_from_node = vec![DMat4::IDENTITY; self.nodes.len()];
        for &node in &self.order {
            let parent_from_node = transforms[node].matrix();
            file_from_node[node] = match self.nodes[node].parent {
                Some(parent) => file_from_node[parent] * parent_from_node,
                None => parent_from_node,
            };
        }
        Pose {
            file_from_node,
            weights,
        }
    }
}
