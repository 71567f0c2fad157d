//! A depth atlas of parallel views by compute: for meshes with triangles about as small as texels, which the hardware
//! rasterizer of large GPUs draws too slowly.
//!
//! The atlas is drawn in bands of its rows. A kernel draws small triangles into a buffer with atomic maxima and lists
//! larger ones. One render pass then copies the buffer to the atlas, and the hardware draws the listed triangles and
//! those with alpha. The result is the texture that [`DepthAtlas::record`] draws, with the same coverage and depths.

use bytemuck::{Pod, Zeroable};
use glam::Vec4;
use gpugi_scene::Bounds;

use super::{DepthAtlas, DepthDraw, DepthKernels, DepthViewSpec};
use crate::gpu::{
    DepthTest, Frame, Gpu, GpuError, Keeps, Kernel, KernelOptions, RasterKernel, RasterState,
};
use crate::scene::{Casters, Draw, DrawClass};
use crate::shader;

/// Most texels of a band, unless one row of tiles has more: 32 MiB, which stay in the cache of a large GPU.
const BAND_TEXELS: u64 = 1 << 23;
/// Most triangles times views per dispatch: each may turn out to be large, and the list has room for all of them.
const DISPATCH_TRIANGLES: u64 = 1 << 23;
/// `VIEWS_AT_ONCE` of small.wesl.
const VIEWS_AT_ONCE: u32 = 16;
/// Most workgroups along one axis.
const MOST_WORKGROUPS: u64 = 65_535;

/// `ParallelView` of parallel.wesl.
#[allow(missing_docs)] // Documented in the shader.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct ParallelView {
    pub x: [f32; 4],
    pub y: [f32; 4],
    pub depth: [f32; 4],
    pub corner: u32,
    pub width: u32,
    pub height: u32,
    pub padding: u32,
}

/// `Range` of parallel.wesl.
#[allow(missing_docs)] // Documented in the shader.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct Range {
    pub first_view: u32,
    pub view_count: u32,
    pub first_triangle: u32,
    pub end_triangle: u32,
    pub first_row: u32,
    pub side: u32,
    pub padding_0: u32,
    pub padding_1: u32,
}

/// The passes, and the buffers shared by all atlases that they draw.
#[derive(Debug)]
pub struct DepthCompute {
    small: Kernel,
    large: RasterKernel,
    resolve: RasterKernel,
    list: wgpu::Buffer,
    arguments: wgpu::Buffer,
    depths: wgpu::Buffer,
    /// [`BAND_TEXELS`] and [`DISPATCH_TRIANGLES`], which tests lower.
    pub(super) band_texels: u64,
    pub(super) dispatch_triangles: u64,
}

/// Rows of the atlas that are drawn together, and the views in them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Band {
    first_row: u32,
    rows: u32,
    first_view: u32,
    view_count: u32,
}

/// How an atlas is drawn. Kept with the atlas until the scene's buffers or the atlas's views are replaced.
#[derive(Debug)]
pub(super) struct Plan {
    list: wgpu::Buffer,
    depths: wgpu::Buffer,
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    triangles: u32,
    /// Views in the order of the atlas's rows.
    order: Vec<usize>,
    views: wgpu::Buffer,
    compute: [wgpu::BindGroup; 2],
    large: [wgpu::BindGroup; 2],
    resolve: wgpu::BindGroup,
    bands: Vec<(Band, Vec<Step>)>,
}

/// One dispatch.
#[derive(Debug)]
struct Step {
    invocations: [u32; 3],
    compute: wgpu::BindGroup,
    large: wgpu::BindGroup,
    resolve: wgpu::BindGroup,
}

/// Number of opaque triangles. Merged triangles are sorted by class.
fn opaque_triangles(draws: &[Draw]) -> u32 {
    let opaque = draws.iter().filter(|draw| draw.class < DrawClass::Alpha);
    opaque.map(|draw| draw.indices.end / 3).max().unwrap_or(0)
}

impl DepthCompute {
    /// Compiles the passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`], [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let state = |has_fragment| RasterState {
            colors: &[],
            blend: None,
            constants: &[],
            cull: None,
            slope_bias: 0.0,
            has_vertices: false,
            has_fragment,
            depth: DepthTest::Nearest,
        };
        let storage = wgpu::BufferUsages::STORAGE;
        Ok(Self {
            small: Kernel::with_options(
                gpu,
                &shader!("capture.depth.small"),
                "main",
                None,
                // Unchecked indices are in range: of triangles because the host counts them, of vertices because the
                // host wrote the indices, of texels because boxes are clipped to their tiles, of the list because it
                // has room for every triangle of a dispatch. Loops end because boxes are small.
                &KernelOptions {
                    unchecked: true,
                    ..Default::default()
                },
            )?,
            large: RasterKernel::new(gpu, &shader!("capture.depth.large"), None, &state(false))?,
            resolve: RasterKernel::new(gpu, &shader!("capture.depth.resolve"), None, &state(true))?,
            list: gpu.buffer("large triangles [bytes]", 0, storage)?,
            arguments: gpu.buffer(
                "arguments of large triangles",
                16,
                storage | wgpu::BufferUsages::INDIRECT,
            )?,
            depths: gpu.buffer("depths of a band [bytes]", 0, storage)?,
            band_texels: BAND_TEXELS,
            dispatch_triangles: DISPATCH_TRIANGLES,
        })
    }

    /// Whether compute can draw a view. The view must be parallel, must contain the scene, because nothing is clipped,
    /// and must show the nearest surfaces, not back faces.
    pub fn can_draw(spec: &DepthViewSpec, bounds: &Bounds) -> bool {
        let is_parallel = spec.clip_from_world.row(3) == Vec4::W;
        is_parallel
            && !spec.second_depth
            && bounds.corners().iter().all(|corner| {
                let clip = spec.clip_from_world * corner.extend(1.0);
                clip.x.abs() <= 1.0 && clip.y.abs() <= 1.0 && (0.0..=1.0).contains(&clip.z)
            })
    }

    /// Draws every view of `atlas` in passes `name` (small triangles) and `name`.atlas (the rest).
    /// [`DepthCompute::can_draw`] must hold for the views.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when a row of tiles does not fit a binding, [`GpuError::OutOfMemory`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        name: &str,
        kernels: &DepthKernels,
        casters: Casters<'_>,
        atlas: &mut DepthAtlas,
    ) -> Result<(), GpuError> {
        let triangles = opaque_triangles(casters.draws);
        if triangles == 0 || atlas.specs.is_empty() {
            atlas.record(frame, name, kernels, casters);
            return Ok(());
        }
        let kept = atlas.plan.take().filter(|plan| {
            plan.list == self.list
                && plan.vertices == casters.scene.vertices
                && plan.indices == *casters.indices
                && plan.triangles == triangles
                && plan.depths == self.depths
        });
        let plan = match kept {
            Some(plan) => plan,
            None => self.plan(frame.gpu, casters, atlas, triangles)?,
        };
        let views = plan.parallel_views(atlas);
        frame.gpu.write(&plan.views, 0, &views);
        let pass_name = format!("{name}.atlas");
        let mut keeps = Keeps::Nothing;
        for (at, (band, steps)) in plan.bands.iter().enumerate() {
            frame.clear(&self.depths);
            for (index, step) in steps.iter().enumerate() {
                frame.clear(&self.arguments);
                frame.compute(name, |pass| {
                    let [inputs, outputs] = &plan.compute;
                    let groups = [(1, inputs), (2, outputs), (3, &step.compute)];
                    self.small.dispatch(pass, &groups, step.invocations);
                });
                let ends_band = index + 1 == steps.len();
                let ends_atlas = ends_band && at + 1 == plan.bands.len();
                frame.render_onto(&pass_name, keeps, &[], &atlas.view, |pass| {
                    let side = atlas.texture.width();
                    self.large.set(pass);
                    for (group, bound) in
                        [(1, &plan.large[0]), (2, &plan.large[1]), (3, &step.large)]
                    {
                        pass.set_bind_group(group, bound, &[]);
                    }
                    pass.draw_indirect(&self.arguments, 0);
                    if ends_band {
                        self.resolve.set(pass);
                        pass.set_bind_group(2, &plan.resolve, &[]);
                        pass.set_bind_group(3, &step.resolve, &[]);
                        pass.set_scissor_rect(0, band.first_row, side, band.rows);
                        pass.draw(0..3, 0..1);
                    }
                    if ends_atlas {
                        atlas.draw(pass, kernels, casters, &[DepthDraw::Alpha], |_| true);
                    }
                });
                keeps = Keeps::Everything;
            }
        }
        atlas.record_layer(frame, name, kernels, casters, |_| true);
        atlas.plan = Some(plan);
        Ok(())
    }

    fn plan(
        &mut self,
        gpu: &Gpu,
        casters: Casters<'_>,
        atlas: &DepthAtlas,
        triangles: u32,
    ) -> Result<Plan, GpuError> {
        let side = atlas.texture.width();
        let (order, bands) = bands(atlas, side, self.band_texels);
        let triangles_at_once = |band: &Band| {
            let most = self.dispatch_triangles / u64::from(band.view_count);
            most.clamp(1, MOST_WORKGROUPS * 64).min(triangles.into()) as u32
        };
        let texels = bands
            .iter()
            .map(|band| u64::from(band.rows) * u64::from(side));
        let entries = bands
            .iter()
            .map(|band| u64::from(triangles_at_once(band)) * u64::from(band.view_count));
        for (buffer, label, words) in [
            (&mut self.depths, "depths of a band [bytes]", texels.max()),
            (&mut self.list, "large triangles [bytes]", entries.max()),
        ] {
            let bytes = words.unwrap_or(0) * 4;
            if buffer.size() < bytes {
                *buffer = gpu.buffer(label, bytes, wgpu::BufferUsages::STORAGE)?;
            }
        }
        let views = gpu.buffer(
            "parallel views [bytes]",
            order.len() as u64 * size_of::<ParallelView>() as u64,
            wgpu::BufferUsages::STORAGE,
        )?;
        let inputs = [
            ("views", views.as_entire_binding()),
            ("vertices", casters.scene.vertices.as_entire_binding()),
            ("indices", casters.indices.as_entire_binding()),
        ];
        let depths = ("depths", self.depths.as_entire_binding());
        let large = ("large", self.list.as_entire_binding());
        let arguments = ("arguments", self.arguments.as_entire_binding());
        let mut steps = Vec::new();
        for band in &bands {
            let at_once = triangles_at_once(band);
            let mut parts = Vec::new();
            for first_triangle in (0..triangles).step_by(at_once as usize) {
                let range = Range {
                    first_view: band.first_view,
                    view_count: band.view_count,
                    first_triangle,
                    end_triangle: (first_triangle + at_once).min(triangles),
                    first_row: band.first_row,
                    side,
                    padding_0: 0,
                    padding_1: 0,
                };
                let uniform = gpu.uniform("range of depth", &range)?;
                let bound = [("range", uniform.as_entire_binding())];
                parts.push(Step {
                    invocations: [
                        range.end_triangle - first_triangle,
                        band.view_count.div_ceil(VIEWS_AT_ONCE),
                        1,
                    ],
                    compute: self.small.bind(gpu, 3, &bound)?,
                    large: self.large.bind(gpu, 3, &bound)?,
                    resolve: self.resolve.bind(gpu, 3, &bound)?,
                });
            }
            steps.push((*band, parts));
        }
        Ok(Plan {
            compute: [
                self.small.bind(gpu, 1, &inputs)?,
                self.small
                    .bind(gpu, 2, &[depths.clone(), large.clone(), arguments])?,
            ],
            large: [
                self.large.bind(gpu, 1, &inputs)?,
                self.large.bind(gpu, 2, &[large])?,
            ],
            resolve: self.resolve.bind(gpu, 2, &[depths])?,
            list: self.list.clone(),
            depths: self.depths.clone(),
            vertices: casters.scene.vertices.clone(),
            indices: casters.indices.clone(),
            triangles,
            order,
            views,
            bands: steps,
        })
    }
}

impl Plan {
    /// The views as shaders read them, in the order of the atlas's rows.
    fn parallel_views(&self, atlas: &DepthAtlas) -> Vec<ParallelView> {
        let mut views = Vec::with_capacity(self.order.len());
        for (band, _) in &self.bands {
            let first = band.first_view as usize;
            for &index in &self.order[first..first + band.view_count as usize] {
                let spec = &atlas.specs[index];
                let [x, y] = atlas.corners[index];
                let [width, height] = spec.size;
                let [across, up, depth] = [0, 1, 2].map(|row| spec.clip_from_world.row(row));
                let texels = |row: Vec4, size: u32| (row + Vec4::W) * (size as f32 / 2.0);
                views.push(ParallelView {
                    x: texels(across, width).to_array(),
                    y: texels(-up, height).to_array(),
                    depth: depth.to_array(),
                    corner: (y - band.first_row) * atlas.texture.width() + x,
                    width,
                    height,
                    padding: 0,
                });
            }
        }
        views
    }
}

/// Cuts an atlas into bands of whole rows of tiles. Also returns its views in the order of their rows.
fn bands(atlas: &DepthAtlas, side: u32, most_texels: u64) -> (Vec<usize>, Vec<Band>) {
    let mut order: Vec<usize> = (0..atlas.specs.len()).collect();
    order.sort_by_key(|&index| atlas.corners[index][1]);
    let most_rows = (most_texels / u64::from(side)) as u32;
    let mut bands: Vec<Band> = Vec::new();
    for (at, &index) in order.iter().enumerate() {
        let row = atlas.corners[index][1];
        let end = row + atlas.specs[index].size[1];
        match bands.last_mut() {
            // Tiles of one row stay together, because the tallest come first.
            Some(band) if end - band.first_row <= most_rows.max(band.rows) => {
                band.rows = band.rows.max(end - band.first_row);
                band.view_count += 1;
            }
            _ => bands.push(Band {
                first_row: row,
                rows: end - row,
                first_view: at as u32,
                view_count: 1,
            }),
        }
    }
    (order, bands)
}
