//! Refits the top level of the ray hierarchy on the GPU.

use bytemuck::{Pod, Zeroable};
use gpugi_scene::Bounds;
use gpugi_scene::bvh::TopLevel;

use crate::gpu::{Gpu, GpuError, Kernel};
use crate::shader;

/// `Level` of refit.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct RefitLevel {
    first: u32,
    count: u32,
    first_row: u32,
    node_count: u32,
}

/// `Box` of refit.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct WorldBox {
    low: [f32; 3],
    padding_0: f32,
    high: [f32; 3],
    padding_1: f32,
}

impl WorldBox {
    pub fn new(bounds: &Bounds) -> Self {
        Self {
            low: bounds.min.to_array(),
            padding_0: 0.0,
            high: bounds.max.to_array(),
            padding_1: 0.0,
        }
    }
}

/// The pass that refits nodes, and what it reads.
#[derive(Debug)]
pub(super) struct Refit {
    kernel: Kernel,
    /// Boxes of nodes, which the first refit writes, then those of leaf items.
    boxes: wgpu::Buffer,
    nodes: u32,
    /// Number of nodes and bind group of each level, the deepest first.
    levels: Vec<(u32, wgpu::BindGroup)>,
}

impl Refit {
    /// Of the top level whose first row in `hierarchy` is `first_row`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(
        gpu: &Gpu,
        kernel: &Kernel,
        top: &TopLevel,
        hierarchy: &wgpu::Buffer,
        first_row: u32,
    ) -> Result<Self, GpuError> {
        let node_count = top.nodes();
        let mut boxes = vec![WorldBox::zeroed(); node_count as usize];
        boxes.extend(top.boxes.iter().map(WorldBox::new));
        let boxes = gpu.storage("boxes of the ray hierarchy [bytes]", &boxes)?;
        let levels = top.levels();
        let nodes = gpu.storage("levels of the ray hierarchy [bytes]", &levels.concat())?;
        let mut first = 0;
        let levels = levels.iter().map(|level| {
            let count = level.len() as u32;
            let uniform = RefitLevel {
                first,
                count,
                first_row,
                node_count,
            };
            first += count;
            let uniform = gpu.uniform("level of the ray hierarchy", &uniform)?;
            let resources = [
                ("level", uniform.as_entire_binding()),
                ("nodes", nodes.as_entire_binding()),
                ("boxes", boxes.as_entire_binding()),
                ("rows", hierarchy.as_entire_binding()),
            ];
            Ok((count, kernel.bind(gpu, 0, &resources)?))
        });
        Ok(Self {
            levels: levels.collect::<Result<_, GpuError>>()?,
            kernel: kernel.clone(),
            nodes: node_count,
            boxes,
        })
    }

    /// Compiles the pass.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn kernel(gpu: &Gpu) -> Result<Kernel, GpuError> {
        Kernel::new(gpu, &shader!("scene.refit"), "main", None)
    }

    /// Writes boxes of leaf items from `item` on.
    pub fn write(&self, gpu: &Gpu, item: u32, boxes: &[WorldBox]) {
        let row = u64::from(self.nodes + item);
        gpu.write(&self.boxes, row * size_of::<WorldBox>() as u64, boxes);
    }

    /// Refits all nodes, before all commands that are submitted from now on.
    pub fn record(&self, gpu: &Gpu) {
        gpu.compute_before_next("scene.refit", |pass| {
            for (count, group) in &self.levels {
                self.kernel.dispatch(pass, &[(0, group)], [*count, 1, 1]);
            }
        });
    }
}
