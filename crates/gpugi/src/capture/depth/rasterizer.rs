//! Who draws an atlas: the hardware's rasterizer or compute.

use gpugi_scene::simplify::CAN_SIMPLIFY;
use serde::{Deserialize, Serialize};

use super::compute::DepthCompute;
use super::{DepthAtlas, DepthKernels, DepthViewSpec};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::scene::{Casters, Draw, GpuScene, SimplifiedCasters};

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

/// How depth maps are drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthDrawing {
    /// Who draws them.
    pub rasterizer: Rasterizer,
    /// Part of the casters' triangles that is drawn; 1 is all.
    pub caster_detail: f32,
}

/// Triangles that cover less than this are compute's (texels, the mean over a view). Measured: see docs/techniques/image-based-lighting.md.
const SMALL: f32 = 16.0;

/// Draws atlases.
#[derive(Debug)]
pub struct DepthRasterizer {
    /// The hardware's pipelines.
    pub kernels: DepthKernels,
    /// Compiled when it is first needed.
    compute: Option<DepthCompute>,
    simplified: Option<SimplifiedCasters>,
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
            simplified: None,
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
        drawing: DepthDrawing,
    ) -> Result<(), GpuError> {
        let kept = self.simplified.take();
        if CAN_SIMPLIFY && drawing.caster_detail < 1.0 {
            let detail = drawing.caster_detail;
            self.simplified = Some(SimplifiedCasters::new(frame, scene, detail, kept)?);
        }
        let casters = match &self.simplified {
            Some(simplified) => simplified.casters(scene),
            None => scene.casters(),
        };
        if !by_compute(casters, atlas, drawing.rasterizer) {
            atlas.record(frame, name, &self.kernels, casters);
            return Ok(());
        }
        let mut compute = match self.compute.take() {
            Some(compute) => compute,
            None => DepthCompute::new(frame.gpu)?,
        };
        let result = compute.record(frame, name, &self.kernels, casters, atlas);
        self.compute = Some(compute);
        result
    }
}

/// Whether compute draws an atlas.
pub(super) fn by_compute(casters: Casters<'_>, atlas: &DepthAtlas, choice: Rasterizer) -> bool {
    let is_wanted = match choice {
        Rasterizer::Auto => mean_triangle(casters.draws, atlas) < SMALL,
        Rasterizer::Hardware => false,
        Rasterizer::Compute => true,
    };
    let bounds = &casters.scene.bounds;
    let can_draw = |spec: &DepthViewSpec| DepthCompute::can_draw(spec, bounds);
    is_wanted && atlas.specs.iter().all(can_draw)
}

/// Estimated mean size of a triangle in a view (texels): a convex surface of area S covers S / 4 of a plane on the mean over all directions, twice, by
/// its front and its back; the box of a draw stands for its surface.
fn mean_triangle(draws: &[Draw], atlas: &DepthAtlas) -> f32 {
    let surface = |draw: &Draw| {
        let size = draw.bounds.max - draw.bounds.min;
        2.0 * (size.x * size.y + size.y * size.z + size.z * size.x)
    };
    let area: f32 = draws.iter().map(surface).sum();
    let triangles: f32 = draws
        .iter()
        .map(|draw| draw.indices.len() as f32 / 3.0)
        .sum();
    let texel = atlas.specs.first().map_or(1.0, |spec| spec.texel);
    area / 2.0 / (texel * texel) / triangles.max(1.0)
}
