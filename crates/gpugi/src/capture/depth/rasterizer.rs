//! Who draws an atlas: the hardware's rasterizer or compute.

use serde::{Deserialize, Serialize};

use super::compute::DepthCompute;
use super::{DepthAtlas, DepthKernels};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::scene::GpuScene;

/// Who draws depth maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Rasterizer {
    /// Whoever is probably faster.
    Auto,
    /// The hardware's rasterizer.
    Hardware,
    /// [`DepthCompute`], where views are parallel and hold the scene.
    Compute,
}

/// Triangles smaller than this are compute's (texels, the mean over a view).
const SMALL: f32 = 8.0;

/// Draws atlases.
#[derive(Debug)]
pub struct DepthRasterizer {
    /// The hardware's pipelines.
    pub kernels: DepthKernels,
    /// Compiled when it is first needed.
    compute: Option<DepthCompute>,
}

impl DepthRasterizer {
    /// Compiles the hardware's pipelines.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        Ok(Self {
            kernels: DepthKernels::new(gpu, scene)?,
            compute: None,
        })
    }

    /// Draws every view of an atlas. Compute takes a second pass, `name`.atlas.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        name: &str,
        scene: &GpuScene,
        atlas: &mut DepthAtlas,
        choice: Rasterizer,
    ) -> Result<(), GpuError> {
        if !by_compute(frame.gpu, scene, atlas, choice) {
            atlas.record(frame, name, &self.kernels, scene);
            return Ok(());
        }
        let mut compute = match self.compute.take() {
            Some(compute) => compute,
            None => DepthCompute::new(frame.gpu)?,
        };
        let result = compute.record(frame, name, &self.kernels, scene, atlas);
        self.compute = Some(compute);
        result
    }
}

fn by_compute(gpu: &Gpu, scene: &GpuScene, atlas: &DepthAtlas, choice: Rasterizer) -> bool {
    let is_wanted = match choice {
        Rasterizer::Auto => {
            gpu.adapter.device_type != wgpu::DeviceType::Cpu && mean_triangle(scene, atlas) < SMALL
        }
        Rasterizer::Hardware => false,
        Rasterizer::Compute => true,
    };
    is_wanted
        && atlas
            .specs
            .iter()
            .all(|spec| DepthCompute::can_draw(spec, &scene.bounds))
}

/// Estimated mean size of a triangle in a view (texels): a convex surface of area S covers S / 4 of a plane on the mean over all directions, twice, by
/// its front and its back; the box of a draw stands for its surface.
fn mean_triangle(scene: &GpuScene, atlas: &DepthAtlas) -> f32 {
    let surface = |draw: &crate::scene::Draw| {
        let size = draw.bounds.max - draw.bounds.min;
        2.0 * (size.x * size.y + size.y * size.z + size.z * size.x)
    };
    let area: f32 = scene.draws.iter().map(surface).sum();
    let triangles: f32 = scene
        .draws
        .iter()
        .map(|draw| draw.indices.len() as f32 / 3.0)
        .sum();
    let texel = atlas.specs.first().map_or(1.0, |spec| spec.texel);
    area / 2.0 / (texel * texel) / triangles.max(1.0)
}
