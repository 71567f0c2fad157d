//! Animation: a node hierarchy, skins and morph targets, posed at a given time.
//!
//! [`Scene::pose`] evaluates everything for one moment. Channels move nodes; nodes move instances, lights and cameras;
//! and meshes that deform (by skin or morph targets) are rewritten in world or mesh space. Techniques know nothing of
//! animation: they see a scene that has changed.

use std::sync::Arc;

use glam::{DMat4, DQuat, DVec3, DVec4, Mat3, Mat4, Vec3, Vec4};
use serde::{Deserialize, Serialize};

use crate::{Camera, Edit, Light, Mesh, Scene};

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
    fn matrices(&self, pose: &Pose) -> impl Iterator<Item = DMat4> {
        let joints = self.joints.iter().zip(&self.joint_from_mesh);
        joints.map(|(&joint, joint_from_mesh)| {
            pose.file_from_node[joint] * joint_from_mesh.as_dmat4()
        })
    }
}

/// A mesh that deforms: the mesh at rest and what deforms it. No other instance uses the mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Deformer {
    /// Index into [`Scene::instances`].
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

    /// Evaluates all nodes at `time_seconds`.
    pub fn pose(&self, time_seconds: f32) -> Pose {
        let mut transforms: Vec<Transform> = self.nodes.iter().map(|node| node.rest).collect();
        let mut weights: Vec<Vec<f32>> =
            self.nodes.iter().map(|node| node.weights.clone()).collect();
        for animation in &self.animations {
            // A duration of 0 and a non-finite time both give NaN here: such an animation stays at its start.
            let looped = time_seconds.rem_euclid(animation.duration);
            let time = if looped.is_finite() { looped } else { 0.0 };
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

impl Scene {
    /// Moves everything to `time_seconds`: makes the edits of [`Scene::posed`].
    pub fn pose(&mut self, time_seconds: f32) {
        for edit in self.posed(time_seconds) {
            edit.apply_to(self);
        }
    }

    /// The edits that move everything to `time_seconds`: instances, lights, cameras, media and meshes that deform.
    /// Animations loop. None without a rig. Values that would not be finite are left out, and so are boxes of media
    /// without volume.
    pub fn posed(&self, time_seconds: f32) -> Vec<Edit> {
        let rig = self.rig.as_ref();
        rig.map_or_else(Vec::new, |rig| self.posed_by(rig, time_seconds))
    }

    /// As [`Scene::posed`], with a rig beside the scene.
    pub(crate) fn posed_by(&self, rig: &Rig, time_seconds: f32) -> Vec<Edit> {
        let pose = rig.pose(time_seconds);
        let world_from_file = DMat4::from_translation(-self.origin);
        let file_from_node = |node: Option<usize>| pose.file_from_node.get(node?).copied();
        let place = |file_from_space: Option<DMat4>| {
            let world_from_space = file_from_space.map(|space| (world_from_file * space).as_mat4());
            world_from_space.filter(Mat4::is_finite)
        };
        let placed = |node: Option<usize>| place(file_from_node(node));
        let mut edits = Vec::new();
        let skins: Vec<Vec<Mat4>> = (rig.skins.iter())
            .map(|skin| {
                let world_from_mesh = skin.matrices(&pose).map(|mesh| world_from_file * mesh);
                world_from_mesh.map(|matrix| matrix.as_mat4()).collect()
            })
            .collect();
        let mut is_skinned = vec![false; self.instances.len()];
        for deformer in &rig.deformers {
            let index = self.instances[deformer.instance].mesh;
            let mut mesh = self.meshes[index].as_ref().clone();
            deformer.morph(&pose.weights[deformer.node], &mut mesh);
            if let Some((skin, influences)) = &deformer.skin {
                bend(&skins[*skin], influences, &mut mesh);
                is_skinned[deformer.instance] = true;
            }
            let mesh = Arc::new(mesh);
            edits.push(Edit::Mesh { index, mesh });
        }
        for (index, instance) in self.instances.iter().enumerate() {
            let node_from_mesh = DMat4::from_translation(self.meshes[instance.mesh].origin);
            let file_from_mesh = file_from_node(instance.node).map(|node| node * node_from_mesh);
            let world_from_mesh = match is_skinned[index] {
                true => Some(Mat4::IDENTITY),
                false => place(file_from_mesh),
            };
            if let Some(world_from_mesh) = world_from_mesh
                && world_from_mesh != instance.world_from_mesh
            {
                edits.push(Edit::Instance {
                    index,
                    world_from_mesh,
                });
            }
        }
        for (index, light) in self.lights.iter().enumerate() {
            if let Some(world_from_light) = placed(light.node).map(rigid)
                && world_from_light != light.world_from_light
            {
                let light = Light {
                    world_from_light,
                    ..light.clone()
                };
                edits.push(Edit::Light { index, light });
            }
        }
        for (index, camera) in self.cameras.iter().enumerate() {
            if let Some(world_from_view) = placed(camera.node).map(rigid)
                && world_from_view != camera.world_from_view
            {
                let camera = Camera {
                    world_from_view,
                    ..camera.clone()
                };
                edits.push(Edit::Camera { index, camera });
            }
        }
        let mut media = self.media.clone();
        let mut has_moved = false;
        for medium in &mut media {
            // A box without volume holds nothing, and has no inverse.
            let has_volume = |place: &Mat4| place.inverse().is_finite();
            if let Some(world_from_box) = &mut medium.world_from_box
                && let Some(place) = placed(medium.node).filter(has_volume)
                && place != *world_from_box
            {
                *world_from_box = place;
                has_moved = true;
            }
        }
        if has_moved {
            edits.push(Edit::Media(media));
        }
        edits
    }
}

impl Deformer {
    /// Writes the mesh at rest plus the weighted displacements.
    fn morph(&self, weights: &[f32], mesh: &mut Mesh) {
        mesh.positions.clone_from(&self.positions);
        mesh.normals.clone_from(&self.normals);
        mesh.tangents.clone_from(&self.tangents);
        for (target, &weight) in self.targets.iter().zip(weights) {
            if weight == 0.0 {
                continue;
            }
            for (position, offset) in mesh.positions.iter_mut().zip(&target.positions) {
                *position = finite_or(*position + weight * *offset, *position);
            }
            for (normal, offset) in mesh.normals.iter_mut().zip(&target.normals) {
                *normal = finite_or(*normal + weight * *offset, *normal);
            }
            for (tangent, offset) in mesh.tangents.iter_mut().zip(&target.tangents) {
                let moved = tangent.truncate() + weight * *offset;
                *tangent = finite_or(moved, tangent.truncate()).extend(tangent.w);
            }
        }
        if self.flat {
            crate::tangents::flatten_normals(mesh);
        }
        for (normal, rest) in mesh.normals.iter_mut().zip(&self.normals) {
            *normal = normal.normalize_or(*rest);
        }
        for (tangent, rest) in mesh.tangents.iter_mut().zip(&self.tangents) {
            let direction = tangent.truncate().normalize_or(rest.truncate());
            *tangent = direction.extend(tangent.w);
        }
    }
}

/// Linear blend skinning: transforms each vertex to world space by the weighted sum of its joints' matrices.
/// `matrices`: world space from mesh space, per joint.
fn bend(matrices: &[Mat4], influences: &Influences, mesh: &mut Mesh) {
    let vertices = influences.joints.chunks_exact(influences.per_vertex.max(1));
    for (index, joints) in vertices.enumerate() {
        let world_from_mesh = joints.iter().fold(Mat4::ZERO, |sum, &(joint, weight)| {
            sum + matrices[joint as usize] * weight
        });
        if !world_from_mesh.is_finite() {
            continue;
        }
        let linear = Mat3::from_mat4(world_from_mesh);
        let position = &mut mesh.positions[index];
        *position = finite_or(world_from_mesh.transform_point3(*position), *position);
        // The inverse transpose is the cofactor matrix divided by the determinant; only the sign of the determinant
        // matters here. Unlike the inverse, the cofactor matrix exists for joints that are scaled to zero.
        let sign = 1.0_f32.copysign(linear.determinant());
        let cofactors = Mat3::from_cols(
            linear.y_axis.cross(linear.z_axis),
            linear.z_axis.cross(linear.x_axis),
            linear.x_axis.cross(linear.y_axis),
        );
        let normal = &mut mesh.normals[index];
        *normal = (cofactors * *normal * sign).normalize_or(*normal);
        if let Some(tangent) = mesh.tangents.get_mut(index) {
            let direction = (linear * tangent.truncate()).normalize_or(tangent.truncate());
            *tangent = direction.extend(tangent.w * sign);
        }
    }
}

fn finite_or(value: Vec3, otherwise: Vec3) -> Vec3 {
    if value.is_finite() { value } else { otherwise }
}

/// Rotation and translation of an affine matrix, without scale, shear or mirroring. -Z keeps its direction, and +Y
/// stays in the plane of the original Y and Z axes.
pub fn rigid(matrix: Mat4) -> Mat4 {
    let back = matrix.z_axis.truncate().normalize_or(Vec3::Z);
    let up = matrix.y_axis.truncate();
    let up = (up - back * up.dot(back))
        .try_normalize()
        .unwrap_or_else(|| back.any_orthonormal_vector());
    Mat4::from_cols(
        up.cross(back).extend(0.0),
        up.extend(0.0),
        back.extend(0.0),
        matrix.w_axis,
    )
}
