//! The scene's bounding volume hierarchies on the GPU, for scenes in which shaders trace rays.

use std::sync::Arc;

use glam::{Mat4, Vec3};
use gpugi_scene::bvh::{
    BottomLevel, BvhError, BvhInstance, FLAG_ALPHA, FLAG_BLACK_BACK, INSTANCE_ROWS, MeshTriangles,
    MovedItem, NODE_ROWS, Row, TopLevel,
};
use gpugi_scene::{AlphaMode, Material, Scene};

use super::geometry::Geometry;
use super::refit::{Refit, WorldBox};
use super::rows::checked_spheres;
use super::tables::joined;
use crate::gpu::{Gpu, GpuError, Kernel};

/// Hierarchies of all meshes, followed by a top level over the instances.
#[derive(Debug)]
pub(super) struct Rays {
    bottom: Arc<BottomLevel>,
    top: TopLevel,
    pub buffer: wgpu::Buffer,
    refit_kernel: Kernel,
    refit: Refit,
}

impl Rays {
    /// Builds the hierarchies of meshes, and the top level. Meshes that have deformed since `before` keep their trees.
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        geometry: &Geometry,
        before: Option<&Self>,
    ) -> Result<Self, GpuError> {
        let meshes = geometry.meshes.iter().zip(&scene.meshes);
        let triangles = meshes.map(|(placed, mesh)| MeshTriangles {
            corners: placed.triangles(mesh),
            tree: mesh.tree.clone(),
        });
        let built = match before {
            Some(before) => before.bottom.following(triangles),
            None => BottomLevel::new(triangles),
        };
        let (bottom, rows) = built.map_err(|error| refused(gpu, error))?;
        let buffer = hierarchy_buffer(gpu, rows.len() + usual_rows(scene))?;
        gpu.write(&buffer, 0, &rows);
        let refit = match before {
            Some(before) => before.refit_kernel.clone(),
            None => Refit::kernel(gpu)?,
        };
        Self::over(gpu, scene, Arc::new(bottom), buffer, &refit)
    }

    /// The hierarchies of the same meshes under a top level over other instances.
    pub fn with_instances(&self, gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        let (bottom, buffer) = (self.bottom.clone(), self.buffer.clone());
        Self::over(gpu, scene, bottom, buffer, &self.refit_kernel)
    }

    /// Fits the hierarchy of one mesh to its triangles after it has deformed; its instances are yet to follow. Returns
    /// false if the hierarchies should be built again.
    pub fn bend(
        &mut self,
        gpu: &Gpu,
        mesh: usize,
        triangles: &[[Vec3; 3]],
    ) -> Result<bool, GpuError> {
        let bent = Arc::make_mut(&mut self.bottom).bend(mesh, triangles);
        let Some((first, rows)) = bent.map_err(|error| refused(gpu, error))? else {
            return Ok(false);
        };
        gpu.write(&self.buffer, bytes(first as usize), &rows);
        Ok(true)
    }

    /// Builds the top level. `buffer` begins with the rows of `bottom`.
    fn over(
        gpu: &Gpu,
        scene: &Scene,
        bottom: Arc<BottomLevel>,
        mut buffer: wgpu::Buffer,
        refit_kernel: &Kernel,
    ) -> Result<Self, GpuError> {
        let spheres = checked_spheres(scene)?;
        let instances: Vec<BvhInstance> = scene
            .instances
            .iter()
            .zip(spheres)
            .map(|(instance, sphere)| BvhInstance {
                mesh: instance.mesh,
                world_from_mesh: instance.world_from_mesh,
                flags: flags(&scene.materials[instance.material]),
                sphere,
            })
            .collect();
        let (top, rows) = bottom
            .top_level(&instances)
            .map_err(|error| refused(gpu, error))?;
        let end = bottom.end() as usize;
        if buffer.size() < bytes(end + rows.len()) {
            let larger = hierarchy_buffer(gpu, end + rows.len().max(usual_rows(scene)))?;
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            encoder.copy_buffer_to_buffer(&buffer, 0, &larger, 0, Some(bytes(end)));
            gpu.submit(encoder.finish());
            buffer = larger;
        }
        gpu.write(&buffer, bytes(end), &rows);
        let refit = Refit::new(gpu, refit_kernel, &top, &buffer, bottom.end())?;
        Ok(Self {
            bottom,
            top,
            buffer,
            refit_kernel: refit_kernel.clone(),
            refit,
        })
    }

    /// Where rays start: `bvh_start` of the scene's header.
    pub fn start(&self) -> [u32; 2] {
        self.top.start
    }

    /// The triangles and spheres of all instances: [`BottomLevel::runs`].
    pub fn runs(&self, gpu: &Gpu, scene: &Scene) -> Result<Vec<Row>, GpuError> {
        let runs = self
            .bottom
            .runs(&self.top, |instance| scene.instances[instance].mesh);
        runs.map_err(|error| refused(gpu, error))
    }

    /// Whether the move keeps the instance in the hierarchy or keeps it out: no ray hits an instance whose transform
    /// has no inverse.
    pub fn can_refit(&self, number: usize, mesh: usize, world_from_mesh: &Mat4) -> bool {
        self.bottom
            .can_refit(&self.top, number, mesh, world_from_mesh)
    }

    /// Follows instances that moved, and has the GPU refit the nodes above them. Returns false if the top level should
    /// be built again.
    pub fn follow(&mut self, gpu: &Gpu, scene: &Scene, moved: &[usize]) -> bool {
        let moved = moved.iter().filter_map(|&number| {
            let instance = &scene.instances[number];
            let place = &instance.world_from_mesh;
            self.bottom
                .place(&mut self.top, number, instance.mesh, place)
        });
        let mut moved: Vec<MovedItem> = moved.collect();
        if moved.is_empty() {
            return true;
        }
        if self.top.has_become_bad() {
            return false;
        }
        moved.sort_unstable_by_key(|moved| moved.item);
        let first = self.bottom.end() + self.top.nodes() * NODE_ROWS;
        let items = moved
            .iter()
            .map(|moved| moved.item as usize..moved.item as usize + 1);
        let mut rest = &moved[..];
        for items in joined(items) {
            let (these, others) = rest.split_at(items.len());
            let rows: Vec<_> = these.iter().map(|moved| moved.rows).collect();
            let boxes: Vec<WorldBox> = these
                .iter()
                .map(|moved| WorldBox::new(&moved.bounds))
                .collect();
            let row = first as usize + items.start * INSTANCE_ROWS as usize;
            gpu.write(&self.buffer, bytes(row), &rows);
            self.refit.write(gpu, items.start as u32, &boxes);
            rest = others;
        }
        self.refit.record(gpu);
        true
    }
}

/// What rays have to know of a material.
fn flags(material: &Material) -> u32 {
    let alpha = match material.alpha_mode {
        AlphaMode::Opaque => 0,
        AlphaMode::Mask { .. } | AlphaMode::Blend => FLAG_ALPHA,
    };
    let has_black_back = !material.double_sided && material.transmission <= 0.0;
    alpha | if has_black_back { FLAG_BLACK_BACK } else { 0 }
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

fn refused(gpu: &Gpu, error: BvhError) -> GpuError {
    match error {
        BvhError::TooLarge {
            what,
            needed,
            limit,
        } => GpuError::TooLarge {
            what: format!("ray hierarchy [{what}]"),
            needed,
            limit,
            adapter: gpu.adapter.name.clone(),
        },
        BvhError::NotFinite { .. } => GpuError::Input {
            what: error.to_string(),
        },
    }
}
