//! The texels of an atlas as surface points, which every technique lights just as it lights a camera's pixels: light in
//! texture space (tutorial, section 2 and figure 6).
//!
//! Each texel that a triangle touches is a point, even where the triangle misses the texel's centre (section 7.3,
//! figures 71 to 73): the point of the surface nearest to the centre. A texel's area is the exact area of all triangles
//! within it; the areas of all texels add up to the scene's. Points lie on the front faces of surfaces, including
//! double-sided ones. What alpha cuts out has points like any other surface, but no area. Transmission is left out.

mod alpha;
pub(crate) mod blocks;
pub(crate) mod dilate;
pub(crate) mod gather;
mod kept;
pub(crate) mod leaks;
pub mod lookup;
pub(crate) mod seams;
#[cfg(test)]
mod tests;

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use gpugi_scene::{Atlas, Scene};

use super::{Output, SURFACE_POINT_BYTES, SurfacePoints, ViewUniform, hits_of_points};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::scene::{GpuScene, Versions};
use crate::shader;
pub use alpha::alpha;
use blocks::Layout;
pub use dilate::Dilation;
pub(crate) use gather::TexelGather;
pub(crate) use kept::{KeptIrradiance, KeptTexels, tiles_of};
pub use leaks::{LeakReport, LeakTest};
pub use lookup::AtlasLookup;
pub(crate) use seams::SeamFilter;

/// Which lobes the points of texels have. Mirror reflection looks different from every direction, and a texel is seen
/// from every direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TexelLobes {
    /// Diffuse reflection, as of a Lambert surface that reflects as much of uniform illumination. Gathers give
    /// radiance, the same in all directions.
    #[default]
    Diffuse,
    /// All lobes, seen from straight above.
    All,
}

/// How texels become points.
#[derive(Debug, Clone, PartialEq)]
pub struct AtlasCaptureOptions {
    /// Lobes of the points.
    pub lobes: TexelLobes,
    /// What gathers give at them.
    pub output: Output,
    /// Most texels in one buffer; the adapter's limits may be lower.
    pub most_texels: u32,
    /// The rows to capture, counted through all pages; `None` captures all rows.
    pub rows: Option<Range<u32>>,
}

impl Default for AtlasCaptureOptions {
    fn default() -> Self {
        Self {
            lobes: TexelLobes::Diffuse,
            output: Output::RadianceToEye,
            most_texels: u32::MAX,
            rows: None,
        }
    }
}

/// `Piece` of capture/atlas/coverage.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct PieceUniform {
    pub size: u32,
    pub first_row: u32,
    pub end_row: u32,
    pub phase: u32,
    pub block_count: u32,
    pub lobes: u32,
}

/// Points that a part of a piece has at least, and parts that a piece has at most.
const LEAST_PART: u32 = 1 << 12;
const MOST_PARTS: u32 = 64;

/// Bytes of a `Texel` of capture/atlas/coverage.wesl.
const TEXEL_BYTES: u64 = 16;

/// Rows of an atlas that fit one buffer.
#[derive(Debug)]
pub struct AtlasPiece {
    /// The rows' texels, row by row.
    pub points: SurfacePoints,
    /// The same points, a few rows each, to be lit one after the other.
    pub(crate) parts: Vec<Part>,
    /// The rows, counted through all pages, which are stacked vertically.
    pub rows: Range<u32>,
    /// `Texel` of capture/atlas/coverage.wesl, one per point.
    pub texels: wgpu::Buffer,
    /// `Piece` of capture/atlas/coverage.wesl.
    uniform: wgpu::Buffer,
    block_count: u32,
    /// Bind group 1 of `cover`, by phase.
    cover: [wgpu::BindGroup; 2],
    resolve: wgpu::BindGroup,
}

/// Some rows of a piece.
#[derive(Debug)]
pub(crate) struct Part {
    pub points: SurfacePoints,
    /// Counted from the first row of the piece.
    rows: Range<u32>,
}

/// Captures the texels of an atlas as surface points.
#[derive(Debug)]
pub struct AtlasCapture {
    /// Texels per side of a page.
    pub size: u32,
    /// Number of pages.
    pub pages: u32,
    /// Side of a square whose area is the mean surface area per texel (m).
    pub texel_side: f32,
    /// Bytes of all buffers and textures.
    pub bytes: u64,
    /// How many times the points were captured.
    number: u64,
    pieces: Vec<AtlasPiece>,
    triangles: wgpu::Buffer,
    cover: Kernel,
    resolve: Kernel,
    /// Version of the meshes for which the atlas was made.
    meshes: u64,
    captured: Option<Versions>,
}

impl AtlasCapture {
    /// Allocates the capture of `atlas`, which must belong to `scene`; `on_gpu` is the upload of `scene`.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when the atlas does not belong to the scene; [`GpuError::TooLarge`] when a row of it does not
    /// fit a buffer; [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        on_gpu: &GpuScene,
        atlas: &Atlas,
        options: &AtlasCaptureOptions,
    ) -> Result<Self, GpuError> {
        atlas.check(scene).map_err(|reason| GpuError::Pass {
            pass: "capture.atlas".into(),
            reason,
        })?;
        let cover = Kernel::new(
            gpu,
            &shader!("capture.atlas.cover"),
            "main",
            Some(&on_gpu.layout),
        )?;
        let resolve = Kernel::new(
            gpu,
            &shader!("capture.atlas.resolve"),
            "main",
            Some(&on_gpu.layout),
        )?;
        let layout = Layout::new(gpu, scene, atlas)?;
        let triangles = gpu.storage("atlas triangles [bytes]", &layout.triangles)?;
        let mut bytes = triangles.size();
        let mut rows = rows_of(gpu, atlas)?;
        if let Some(wanted) = &options.rows {
            rows = rows.start.max(wanted.start)..rows.end.min(wanted.end);
        }
        let pieces = cut(gpu, atlas.size, rows, options.most_texels)?
            .into_iter()
            .map(|rows| {
                let blocks = layout.blocks(gpu, atlas, &rows)?;
                let blocks_on_gpu = gpu.storage("blocks of an atlas [bytes]", &blocks)?;
                let count = (rows.end - rows.start) * atlas.size;
                // A hit record has four bytes.
                bytes += u64::from(count) * (TEXEL_BYTES + SURFACE_POINT_BYTES + 4);
                bytes += blocks_on_gpu.size();
                let storage = wgpu::BufferUsages::STORAGE;
                let texels = gpu.buffer(
                    "texels of an atlas [bytes]",
                    u64::from(count) * TEXEL_BYTES,
                    storage,
                )?;
                let hits = hits_of_points(gpu, [atlas.size, rows.end - rows.start])?;
                let view = || {
                    let bytes = size_of::<ViewUniform>() as u64;
                    gpu.buffer("view", bytes, wgpu::BufferUsages::UNIFORM)
                };
                let points = SurfacePoints {
                    points: gpu.buffer(
                        "surface points [bytes]",
                        u64::from(count) * SURFACE_POINT_BYTES,
                        storage,
                    )?,
                    view: view()?,
                    first: 0,
                    count,
                    lit: count,
                    hits: hits.clone(),
                    output: options.output,
                    slots: Default::default(),
                };
                let height = rows.end - rows.start;
                let rows_of_part = LEAST_PART.div_ceil(atlas.size.max(1));
                let rows_of_part = rows_of_part.max(height.div_ceil(MOST_PARTS)).max(1);
                let part = |first: u32| {
                    let rows = first..height.min(first + rows_of_part);
                    let count = rows.len() as u32 * atlas.size;
                    let points = SurfacePoints {
                        view: view()?,
                        first: rows.start * atlas.size,
                        count,
                        lit: count,
                        ..points.clone()
                    };
                    Ok(Part { points, rows })
                };
                let parts = (0..height).step_by(rows_of_part as usize).map(part);
                let parts = parts.collect::<Result<_, GpuError>>()?;
                let uniform = |phase| {
                    gpu.uniform(
                        "piece of an atlas",
                        &PieceUniform {
                            size: atlas.size,
                            first_row: rows.start,
                            end_row: rows.end,
                            phase,
                            block_count: blocks.len() as u32,
                            lobes: options.lobes as u32,
                        },
                    )
                };
                let phases = [uniform(0)?, uniform(1)?];
                let bind_cover = |phase: usize| {
                    let resources = [
                        ("piece", phases[phase].as_entire_binding()),
                        ("triangles", triangles.as_entire_binding()),
                        ("blocks", blocks_on_gpu.as_entire_binding()),
                        ("texels", texels.as_entire_binding()),
                    ];
                    cover.bind(gpu, 1, &resources)
                };
                let resources = [
                    ("piece", phases[0].as_entire_binding()),
                    ("triangles", triangles.as_entire_binding()),
                    ("texels", texels.as_entire_binding()),
                    ("points", points.points.as_entire_binding()),
                    ("hits", wgpu::BindingResource::TextureView(&hits)),
                ];
                Ok(AtlasPiece {
                    cover: [bind_cover(0)?, bind_cover(1)?],
                    resolve: resolve.bind(gpu, 1, &resources)?,
                    uniform: phases[0].clone(),
                    points,
                    parts,
                    rows,
                    texels,
                    block_count: blocks.len() as u32,
                })
            })
            .collect::<Result<_, GpuError>>()?;
        let capture = Self {
            size: atlas.size,
            pages: atlas.pages,
            texel_side: layout.texel_side,
            bytes,
            number: 0,
            pieces,
            triangles,
            cover,
            resolve,
            meshes: on_gpu.versions.meshes,
            captured: None,
        };
        capture.look(gpu, 0, 0);
        Ok(capture)
    }

    /// The pieces, from the first row to the last.
    pub fn pieces(&self) -> &[AtlasPiece] {
        &self.pieces
    }

    /// The points of each piece.
    pub fn points(&self) -> impl Iterator<Item = &SurfacePoints> {
        self.pieces.iter().map(|piece| &piece.points)
    }

    /// Sets the sample of light that the next gathers take, and its seed. Sample 0 restarts targets.
    pub fn look(&self, gpu: &Gpu, sample_index: u32, seed: u32) {
        for piece in &self.pieces {
            let all = 0..piece.rows.end - piece.rows.start;
            let parts = piece.parts.iter().map(|part| (&part.points, &part.rows));
            for (points, rows) in parts.chain([(&piece.points, &all)]) {
                let mut view = ViewUniform {
                    width: self.size,
                    first_row: rows.start,
                    height: rows.end,
                    sample_index,
                    accumulates: u32::from(sample_index > 0),
                    first_texel: piece.rows.start * self.size,
                    // Otherwise all pieces would use the same random numbers.
                    seed: seed.wrapping_add(piece.rows.start.wrapping_mul(0x0001_0001)),
                    ..Zeroable::zeroed()
                };
                points.output.write(&mut view);
                gpu.write(&points.view, 0, std::slice::from_ref(&view));
            }
        }
    }

    /// Captures the points again if the scene's geometry or materials changed: passes `capture.atlas.cover` and
    /// `capture.atlas.resolve`.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when the scene's triangles differ from the atlas's.
    pub fn record(&mut self, frame: &mut Frame<'_>, scene: &GpuScene) -> Result<(), GpuError> {
        if scene.versions.meshes != self.meshes {
            return Err(GpuError::Pass {
                pass: "capture.atlas".into(),
                reason: "the scene has other triangles than the atlas".into(),
            });
        }
        let versions = scene.versions;
        let is_kept = |before: &Versions| {
            before.geometry == versions.geometry && before.materials == versions.materials
        };
        if self.captured.as_ref().is_some_and(is_kept) {
            return Ok(());
        }
        for piece in &self.pieces {
            frame.clear(&piece.texels);
            for group in &piece.cover {
                frame.compute("capture.atlas.cover", |pass| {
                    let groups = [(0, &scene.bind_group), (1, group)];
                    self.cover
                        .dispatch(pass, &groups, [piece.block_count, 1, 1]);
                });
            }
            frame.compute("capture.atlas.resolve", |pass| {
                let groups = [(0, &scene.bind_group), (1, &piece.resolve)];
                self.resolve
                    .dispatch(pass, &groups, [piece.points.count, 1, 1]);
            });
        }
        self.number += 1;
        self.captured = Some(versions);
        Ok(())
    }
}

/// The rows of all pages of an atlas.
///
/// # Errors
/// [`GpuError::TooLarge`] when their number does not fit 32 bits.
fn rows_of(gpu: &Gpu, atlas: &Atlas) -> Result<Range<u32>, GpuError> {
    let all = u64::from(atlas.pages) * u64::from(atlas.size);
    let end = u32::try_from(all).map_err(|_| GpuError::TooLarge {
        what: "rows of all pages of an atlas".into(),
        needed: all,
        limit: u64::from(u32::MAX),
        adapter: gpu.adapter.name.clone(),
    })?;
    Ok(0..end)
}

/// Extra rows captured around a cut tile, because its gutters continue their texels.
pub(crate) const HALO: u32 = 8;

/// Rows that are processed independently of the others.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Tile {
    /// The rows.
    pub rows: Range<u32>,
    /// The rows to capture: where a page is cut, also some rows around, whose texels the gutters at the cut continue.
    pub captured: Range<u32>,
}

impl Tile {
    /// The tile's own rows in an image of its captured rows; pages have `size` texels per side.
    pub fn of<'a, T>(&self, image: &'a [T], size: u32) -> &'a [T] {
        let first = (self.rows.start - self.captured.start) as usize * size as usize;
        &image[first..][..self.rows.len() * size as usize]
    }
}

/// Splits the rows of an atlas into tiles of at most `most_texels`: whole pages where they fit; where a page is cut, with
/// `halo` rows around.
///
/// # Errors
/// [`GpuError::TooLarge`].
pub(crate) fn tiles(
    gpu: &Gpu,
    atlas: &Atlas,
    most_texels: u32,
    halo: u32,
) -> Result<Vec<Tile>, GpuError> {
    let all = rows_of(gpu, atlas)?;
    // At least one row, however many texels it has.
    let pieces = cut(gpu, atlas.size, all.clone(), most_texels.max(atlas.size))?;
    let whole = |rows: Range<u32>| Tile {
        captured: rows.clone(),
        rows,
    };
    let step = pieces.first().map_or(0, |rows| rows.len() as u32);
    if pieces.len() < 2 || step % atlas.size == 0 {
        return Ok(pieces.into_iter().map(whole).collect());
    }
    let step = step.saturating_sub(2 * halo).max(1);
    let firsts = all.clone().step_by(step as usize);
    let tile = |first: u32| {
        let rows = first..first.saturating_add(step).min(all.end);
        Tile {
            captured: rows.start.saturating_sub(halo)..rows.end.saturating_add(halo).min(all.end),
            rows,
        }
    };
    Ok(firsts.map(tile).collect())
}

/// Splits `rows`, in pages of `size` texels per side, into the fewest pieces that fit the adapter's buffers and have at
/// most `most_texels`: whole pages where they fit, so that no chart is cut.
///
/// # Errors
/// [`GpuError::TooLarge`] when not even one row fits.
pub(crate) fn cut(
    gpu: &Gpu,
    size: u32,
    rows: Range<u32>,
    most_texels: u32,
) -> Result<Vec<Range<u32>>, GpuError> {
    let limits = gpu.limits();
    let bytes = limits
        .max_buffer_size
        .min(limits.max_storage_buffer_binding_size);
    let most_texels = (bytes / SURFACE_POINT_BYTES).min(u64::from(most_texels));
    let size = u64::from(size.max(1));
    let most_rows = most_texels / size;
    if most_rows == 0 {
        return Err(GpuError::TooLarge {
            what: "texels in a row of an atlas".into(),
            needed: size,
            limit: most_texels,
            adapter: gpu.adapter.name.clone(),
        });
    }
    let most_rows = most_rows.min(u64::from(limits.max_texture_dimension_2d));
    let most_rows = if most_rows >= size {
        most_rows - most_rows % size
    } else {
        most_rows
    };
    let most_rows = most_rows.min(u64::from(u32::MAX)) as u32;
    let firsts = rows.clone().step_by(most_rows as usize);
    Ok(firsts
        .map(|first| first..first.saturating_add(most_rows).min(rows.end))
        .collect())
}
