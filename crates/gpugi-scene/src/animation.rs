//! Animation: a node hierarchy, skins and morph targets, posed at a given time.
//!
//! [`Scene::pose`] evaluates everything for one moment. Channels move nodes; nodes move instances, lights and cameras;
//! and meshes that deform (by skin or morph targets) are rewritten in world or mesh space. Techniques know nothing of
//! animation: they see a scene that has changed.

mod rig;

use std::sync::Arc;

use glam::{DMat4, Mat3, Mat4, Vec3};

use crate::{Camera, Edit, Light, Mesh, Scene};
pub(crate) use rig::JOINT_BYTES;
pub use rig::{
    Animation, Channel, Deformer, Influences, Interpolation, MorphTarget, Node, Pose, Property,
    Rig, Skin, Transform, unit_rotation,
};

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

    /// The camera at `time_seconds`, if a node of the rig carries it; otherwise as it is.
    pub fn camera_at(&self, camera: &Camera, time_seconds: f32) -> Camera {
        let world_from_view = self.rig.as_ref().zip(camera.node).and_then(|(rig, node)| {
            let file_from_view = *rig.pose(time_seconds).file_from_node.get(node)?;
            let world_from_view =
                (DMat4::from_translation(-self.origin) * file_from_view).as_mat4();
            Some(rigid(world_from_view)).filter(Mat4::is_finite)
        });
        Camera {
            world_from_view: world_from_view.unwrap_or(camera.world_from_view),
            ..camera.clone()
        }
    }

    /// As [`Scene::posed`], with a rig beside the scene, whose nodes and deformers are those of the scene's own.
    pub fn posed_by(&self, rig: &Rig, time_seconds: f32) -> Vec<Edit> {
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
