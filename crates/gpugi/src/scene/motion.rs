//! Instances that move and change in nothing else: a few words of the tables, no upload of the rest.

use std::mem::offset_of;

use gpugi_scene::{Bounds, Scene};

use super::emitters::emitters;
use super::rows::is_mirrored;
use super::{GpuScene, Use, gpu};
use crate::gpu::Gpu;

impl GpuScene {
    /// Moves instances to where `after` has them. False, and nothing done, when they differ in more than their places.
    pub(super) fn move_instances(&mut self, gpu: &Gpu, before: &Scene, after: &Scene) -> bool {
        let pairs = || before.instances.iter().zip(&after.instances);
        // A mirroring transform turns the winding of triangles.
        let is_only_moved = self.use_of == Use::Captures
            && before.instances.len() == after.instances.len()
            && pairs().all(|(old, new)| {
                old.name == new.name
                    && is_mirrored(&old.world_from_mesh) == is_mirrored(&new.world_from_mesh)
            });
        if !is_only_moved {
            return false;
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
