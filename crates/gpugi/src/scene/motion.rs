//! Places of instances, and the versions since which they are there.

use std::sync::Arc;

use glam::Mat4;
use gpugi_scene::{Mesh, Scene};

/// Where an instance is, and since when.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// World space from mesh space.
    pub world_from_mesh: Mat4,
    /// [`super::Versions::geometry`] since which the instance is there, with the same mesh.
    pub moved: u64,
    /// [`super::Versions::geometry`] since which the instance has the same mesh.
    pub bent: u64,
}

/// Placements of the instances of a new scene.
pub(super) fn placements(scene: &Scene) -> Vec<Placement> {
    moved(&[], scene, &[], 1)
}

/// Placements of the instances of `scene` at `version` of its geometry. `before`: their previous placements;
/// `same_meshes`: which meshes are unchanged.
pub(super) fn moved(
    before: &[Placement],
    scene: &Scene,
    same_meshes: &[bool],
    version: u64,
) -> Vec<Placement> {
    let instances = scene.instances.iter().enumerate();
    let placements = instances.map(|(index, instance)| {
        let world_from_mesh = instance.world_from_mesh;
        let before = before.get(index).filter(|_| same_meshes[instance.mesh]);
        let is_there = |placement: &&Placement| placement.world_from_mesh == world_from_mesh;
        Placement {
            world_from_mesh,
            moved: before
                .filter(is_there)
                .map_or(version, |placement| placement.moved),
            bent: before.map_or(version, |placement| placement.bent),
        }
    });
    placements.collect()
}

/// Which meshes of `after` are the same as in `before`.
pub(super) fn same_meshes(before: &Scene, after: &Scene) -> Vec<bool> {
    let meshes = after.meshes.iter().enumerate();
    let is_same = |(index, mesh): (usize, &Arc<Mesh>)| {
        let before = before.meshes.get(index);
        before.is_some_and(|before| Arc::ptr_eq(before, mesh))
    };
    meshes.map(is_same).collect()
}
