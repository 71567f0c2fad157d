//! Instances that only move: their rows in the tables and what depends on their places are updated, and the rest of the
//! scene is not uploaded again.

use std::mem::offset_of;

use glam::Mat4;
use gpugi_scene::{Bounds, Scene};

use super::emitters::emitters;
use super::rows::is_mirrored;
use super::{GpuScene, Use, gpu};
use crate::gpu::Gpu;

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
    moved(Vec::new(), scene, &[], 1)
}

/// Placements of the instances of `scene` at `version` of its geometry. `before`: their previous placements;
/// `same_meshes`: which meshes are unchanged.
pub(super) fn moved(
    before: Vec<Placement>,
    scene: &Scene,
    same_meshes: &[bool],
    version: u64,
) -> Vec<Placement> {
    let instances = scene.instances.iter().enumerate();
    let placements = instances.map(|(index, instance)| {
        let world_from_mesh = instance.world_from_mesh;
        let before = before.get(index).filter(|_| same_meshes[instance.mesh]);
        let is_there = |one: &&Placement| one.world_from_mesh == world_from_mesh;
        Placement {
            world_from_mesh,
            moved: before.filter(is_there).map_or(version, |one| one.moved),
            bent: before.map_or(version, |one| one.bent),
        }
    });
    placements.collect()
}

/// Which meshes of `after` are the same as in `before`.
pub(super) fn same_meshes(before: &Scene, after: &Scene) -> Vec<bool> {
    let meshes = after.meshes.iter().enumerate();
    meshes
        .map(|(index, mesh)| before.meshes.get(index) == Some(mesh))
        .collect()
}

impl GpuScene {
    /// Moves instances to where `after` has them. Returns false if the scene must be uploaded instead: if instances
    /// differ in more than their places, if one begins or ceases to mirror, if the scene is for rays only, or if the
    /// ray hierarchy outgrows its buffer.
    pub(super) fn move_instances(&mut self, gpu: &Gpu, before: &Scene, after: &Scene) -> bool {
        let pairs = || before.instances.iter().zip(&after.instances);
        // A mirroring transform flips the winding of triangles.
        let is_only_moved = self.use_of != Use::Rays
            && before.instances.len() == after.instances.len()
            && pairs().all(|(old, new)| {
                old.name == new.name
                    && is_mirrored(&old.world_from_mesh) == is_mirrored(&new.world_from_mesh)
            });
        if !is_only_moved {
            return false;
        }
        if let Some(rays) = self.rays.take() {
            let bound = rays.buffer.clone();
            // A larger hierarchy has another buffer than the one that is bound.
            self.rays = rays.moved(gpu, after).ok();
            let moved = self.rays.as_ref().filter(|rays| rays.buffer == bound);
            let Some(start) = moved.map(|rays| rays.start) else {
                return false;
            };
            let at = offset_of!(gpu::SceneHeader, bvh_start) as u64;
            gpu.queue
                .write_buffer(&self.header, at, bytemuck::bytes_of(&start));
        }
        if let Some(host) = &mut self.host {
            host.instances.clone_from(&after.instances);
        }
        for (index, (old, new)) in pairs().enumerate() {
            if old.world_from_mesh == new.world_from_mesh {
                continue;
            }
            let rows = [0, 1, 2].map(|row| new.world_from_mesh.row(row).to_array());
            let at =
                index * size_of::<gpu::Instance>() + offset_of!(gpu::Instance, world_from_mesh_0);
            gpu.queue
                .write_buffer(&self.tables, at as u64, bytemuck::cast_slice(&rows));
        }
        for draw in &mut self.draws {
            let instance = &after.instances[draw.instance as usize];
            draw.bounds = draw.mesh_bounds.transformed(&instance.world_from_mesh);
        }
        let all = self.draws.iter();
        self.bounds = all.fold(Bounds::EMPTY, |all, draw| all.union(draw.bounds));
        let at = offset_of!(gpu::SceneHeader, diagonal) as u64;
        let diagonal = self.bounds.diagonal().to_le_bytes();
        gpu.queue.write_buffer(&self.header, at, &diagonal);
        self.emitters = emitters(after);
        true
    }
}
