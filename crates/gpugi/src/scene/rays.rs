//! The scene's bounding volume hierarchies on the GPU, for scenes in which shaders trace rays.

use gpugi_scene::bvh::{
    BottomLevel, BvhInstance, BvhTooLarge, FLAG_ALPHA, INSTANCE_ROWS, NODE_ROWS, Row,
};
use gpugi_scene::{AlphaMode, Scene};

use super::upload::PlacedMesh;
use crate::gpu::{Gpu, GpuError};

/// Hierarchies of all meshes, followed by a top level over the instances.
#[derive(Debug)]
pub(super) struct Rays {
    bottom: BottomLevel,
    pub buffer: wgpu::Buffer,
    /// Where rays start: `bvh_start` of the scene's header.
    pub start: [u32; 2],
}

impl Rays {
    /// Builds the hierarchies of meshes placed in the geometry buffer's `words`, and the top level.
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        meshes: &[PlacedMesh],
        words: &[u32],
    ) -> Result<Self, GpuError> {
        let triangles = meshes.iter().map(|mesh| mesh.triangles(words));
        let (bottom, rows) = BottomLevel::new(triangles).map_err(|error| refused(gpu, error))?;
        let buffer = hierarchy_buffer(gpu, rows.len() + usual_rows(scene))?;
        gpu.queue
            .write_buffer(&buffer, 0, bytemuck::cast_slice(&rows));
        let rays = Self {
            bottom,
            buffer,
            start: [0; 2],
        };
        rays.moved(gpu, scene)
    }

    /// Follows instances that moved, were added or were removed; the meshes must be the same as before.
    pub fn moved(mut self, gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        let instances: Vec<BvhInstance> = scene
            .instances
            .iter()
            .map(|instance| BvhInstance {
                mesh: instance.mesh,
                world_from_mesh: instance.world_from_mesh,
                flags: match scene.materials[instance.material].alpha_mode {
                    AlphaMode::Opaque => 0,
                    AlphaMode::Mask { .. } | AlphaMode::Blend => FLAG_ALPHA,
                },
            })
            .collect();
        let top = self
            .bottom
            .top_level(&instances)
            .map_err(|error| refused(gpu, error))?;
        let end = self.bottom.end() as usize;
        if self.buffer.size() < bytes(end + top.rows.len()) {
            let larger = hierarchy_buffer(gpu, end + top.rows.len().max(usual_rows(scene)))?;
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            encoder.copy_buffer_to_buffer(&self.buffer, 0, &larger, 0, Some(bytes(end)));
            gpu.queue.submit([encoder.finish()]);
            self.buffer = larger;
        }
        gpu.queue
            .write_buffer(&self.buffer, bytes(end), bytemuck::cast_slice(&top.rows));
        self.start = top.start;
        Ok(self)
    }
}

/// Rows that a top level over the scene's instances seldom exceeds, because nodes have at least two children.
fn usual_rows(scene: &Scene) -> usize {
    scene.instances.len().max(1) * (NODE_ROWS + INSTANCE_ROWS) as usize
}

fn bytes(rows: usize) -> u64 {
    (rows * std::mem::size_of::<Row>()) as u64
}

/// A buffer for `rows` rows, filled with zeros, which are an empty node.
pub(super) fn hierarchy_buffer(gpu: &Gpu, rows: usize) -> Result<wgpu::Buffer, GpuError> {
    gpu.buffer(
        "ray hierarchy [bytes]",
        bytes(rows),
        wgpu::BufferUsages::STORAGE,
    )
}

fn refused(gpu: &Gpu, error: BvhTooLarge) -> GpuError {
    GpuError::TooLarge {
        what: format!("ray hierarchy [{}]", error.what),
        needed: error.needed,
        limit: error.limit,
        adapter: gpu.adapter.name.clone(),
    }
}
