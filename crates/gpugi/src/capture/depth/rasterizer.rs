//! Draws an atlas with the hardware rasterizer or by compute.

use gpugi_scene::simplify::CAN_SIMPLIFY;

use super::compute::DepthCompute;
use super::{DepthAtlas, DepthKernels, DepthViewSpec, clear_tiles};
use crate::gpu::{Frame, Gpu, GpuError, RasterKernel};
use crate::scene::{CasterGeometry, Casters, Draw, GpuScene, SimplifiedCasters};

crate::choices! {
    /// What rasterizes depth maps.
    pub enum Rasterizer {
        /// The one that is probably faster.
        Auto = "auto",
        /// The hardware rasterizer.
        Hardware = "hardware",
        /// [`DepthCompute`], where views are parallel and contain the scene.
        Compute = "compute",
    }
}

/// How depth maps are drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthDrawing {
    /// What rasterizes them.
    pub rasterizer: Rasterizer,
    /// Fraction of the casters' triangles that is drawn; 1 is all.
    pub caster_detail: f32,
}

/// Below this mean size of triangles over a view (texels), compute draws them. Measured: see
/// docs/techniques/image-based-lighting.md.
const SMALL: f32 = 16.0;

/// Draws atlases.
#[derive(Debug)]
pub struct DepthRasterizer {
    /// The pipelines of the hardware rasterizer.
    pub kernels: DepthKernels,
    compute: DepthCompute,
    /// Compiled on first use.
    clear: RasterKernel,
    simplified: Option<SimplifiedCasters>,
    /// Geometry to simplify, on its way to the host.
    geometry: Option<CasterGeometry>,
}

impl DepthRasterizer {
    /// Compiles the pipelines of both rasterizers.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        Ok(Self {
            kernels: DepthKernels::of_environment(gpu, scene)?,
            compute: DepthCompute::new(gpu)?,
            clear: clear_tiles(gpu)?,
            simplified: None,
            geometry: None,
        })
    }

    /// Prepares the casters that [`DepthRasterizer::record`] draws. Returns false while geometry to simplify is on its
    /// way to the host.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn prepare(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        caster_detail: f32,
    ) -> Result<bool, GpuError> {
        if !CAN_SIMPLIFY || caster_detail >= 1.0 {
            (self.simplified, self.geometry) = (None, None);
            return Ok(true);
        }
        if self
            .simplified
            .as_ref()
            .is_some_and(|kept| kept.serve(scene, caster_detail))
        {
            return Ok(true);
        }
        self.simplified = None;
        let Some(geometry) = self
            .geometry
            .as_ref()
            .filter(|geometry| geometry.is_of(scene))
        else {
            self.geometry = Some(CasterGeometry::read_back(frame, scene)?);
            return Ok(false);
        };
        self.simplified = SimplifiedCasters::new(frame.gpu, scene, caster_detail, geometry)?;
        Ok(self.simplified.is_some())
    }

    /// Draws every view of an atlas. Compute needs a second pass, `name`.atlas.
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
        if let Some(simplified) = &mut self.simplified {
            simplified.follow(scene);
        }
        let casters = match &self.simplified {
            Some(simplified) => simplified.casters(scene),
            None => scene.casters(),
        };
        if !by_compute(casters, atlas, drawing.rasterizer) {
            atlas.record(frame, name, &self.kernels, casters);
            return Ok(());
        }
        self.compute
            .record(frame, name, &self.kernels, casters, atlas)
    }

    /// Whether compute draws an atlas.
    pub fn draws_by_compute(
        &self,
        scene: &GpuScene,
        atlas: &DepthAtlas,
        drawing: DepthDrawing,
    ) -> bool {
        let casters = match &self.simplified {
            Some(simplified) => simplified.casters(scene),
            None => scene.casters(),
        };
        by_compute(casters, atlas, drawing.rasterizer)
    }

    /// Draws those views with the hardware rasterizer whose indices `is_drawn` accepts; the others keep their depth.
    pub fn record_some(
        &mut self,
        frame: &mut Frame<'_>,
        name: &str,
        scene: &GpuScene,
        atlas: &DepthAtlas,
        is_drawn: impl Fn(usize) -> bool,
    ) {
        if let Some(simplified) = &mut self.simplified {
            simplified.follow(scene);
        }
        let casters = match &self.simplified {
            Some(simplified) => simplified.casters(scene),
            None => scene.casters(),
        };
        let kernels = (&self.clear, &self.kernels);
        atlas.record_some(frame, name, kernels, casters, is_drawn);
    }
}

/// Whether compute draws the atlas.
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

/// Estimated mean size of a triangle in a view (texels). A convex surface of area S covers, averaged over all
/// directions, S / 4 of a plane, twice: by its front and by its back. A draw's bounding box stands for its surface.
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
