//! The triangles of an atlas, and the blocks of texels that each touches.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec2, Vec3};
use gpugi_scene::{Atlas, InstanceUvs, Mesh, Scene, Side, provoking_order};

use crate::gpu::{Gpu, GpuError};

/// Texels per side of a block, as in capture/atlas/cover.wesl.
const BLOCK: u32 = 8;
/// Most pages that fit the bits of a packed block.
const MOST_PAGES: u32 = 1 << 12;
/// Most blocks; an atlas without overlap has far fewer.
const MOST_BLOCKS: usize = 1 << 26;
/// Steps per texel to which corners are snapped: their differences to texel centres are then exact, up to 8,192 texels.
const STEPS: f32 = 1024.0;

/// Bit of a triangle's number that marks its back: `BACK` of capture/atlas/coverage.wesl.
const BACK: u32 = 1 << 31;

/// `AtlasTriangle` of capture/atlas/coverage.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct AtlasTriangle {
    pub instance: u32,
    pub primitive: u32,
    pub a: [f32; 2],
    pub b: [f32; 2],
    pub c: [f32; 2],
}

/// All triangles of an atlas.
pub(super) struct Layout {
    pub triangles: Vec<AtlasTriangle>,
    /// Page of each triangle.
    pages: Vec<u32>,
    /// Side of a square whose area is the mean surface area per texel (m).
    pub texel_side: f32,
}

impl Layout {
    pub fn new(gpu: &Gpu, scene: &Scene, atlas: &Atlas) -> Result<Self, GpuError> {
        if atlas.pages > MOST_PAGES {
            return Err(GpuError::TooLarge {
                what: "pages of an atlas".into(),
                needed: u64::from(atlas.pages),
                limit: u64::from(MOST_PAGES),
                adapter: gpu.adapter.name.clone(),
            });
        }
        let mut triangles = Vec::new();
        let mut pages = Vec::new();
        let (mut in_texels, mut in_world) = (0.0, 0.0);
        for (index, side, uvs) in atlas.sides() {
            let instance = &scene.instances[index];
            let mesh = &scene.meshes[instance.mesh];
            in_world += area(mesh, &instance.world_from_mesh);
            for (primitive, corners) in ordered_corners(mesh, uvs).into_iter().enumerate() {
                let on_step = |uv: Vec2| (uv * atlas.size as f32 * STEPS).round() / STEPS;
                let [a, b, c] = corners.map(on_step);
                in_texels += f64::from((b - a).perp_dot(c - a).abs()) / 2.0;
                triangles.push(AtlasTriangle {
                    instance: index as u32,
                    primitive: primitive as u32 | if side == Side::Back { BACK } else { 0 },
                    a: a.to_array(),
                    b: b.to_array(),
                    c: c.to_array(),
                });
                pages.push(uvs.page);
            }
        }
        let mean = in_world / f64::max(in_texels, 1.0);
        Ok(Self {
            triangles,
            pages,
            texel_side: mean.sqrt() as f32,
        })
    }

    /// The blocks in some rows that each triangle touches: index of the triangle, and place of the block as
    /// capture/atlas/cover.wesl reads it.
    pub fn blocks(
        &self,
        gpu: &Gpu,
        atlas: &Atlas,
        rows: &Range<u32>,
    ) -> Result<Vec<[u32; 2]>, GpuError> {
        let mut blocks = Vec::new();
        for (number, (triangle, &page)) in self.triangles.iter().zip(&self.pages).enumerate() {
            let corners = [triangle.a, triangle.b, triangle.c].map(Vec2::from);
            let top = page * atlas.size;
            let last = (atlas.size - 1) as f32;
            let low = corners.iter().fold(last, |low, corner| low.min(corner.y));
            let high = corners
                .iter()
                .fold(0.0_f32, |high, corner| high.max(corner.y));
            for y in low as u32 / BLOCK..=high.min(last) as u32 / BLOCK {
                let first_row = top + y * BLOCK;
                if first_row >= rows.end || first_row + BLOCK <= rows.start {
                    continue;
                }
                let band = [y * BLOCK, (y + 1) * BLOCK].map(|edge| edge as f32);
                let [left, right] = extent_in_band(corners, band);
                // One step wider than the band's extent, so that rounding leaves nothing out.
                let left = (left - 1.0 / STEPS).max(0.0) as u32 / BLOCK;
                let right = (right + 1.0 / STEPS).clamp(0.0, last) as u32 / BLOCK;
                for x in left..=right {
                    blocks.push([number as u32, x | y << 10 | page << 20]);
                }
                if blocks.len() > MOST_BLOCKS {
                    return Err(GpuError::TooLarge {
                        what: "blocks of texels that the triangles of an atlas touch".into(),
                        needed: blocks.len() as u64,
                        limit: MOST_BLOCKS as u64,
                        adapter: gpu.adapter.name.clone(),
                    });
                }
            }
        }
        Ok(blocks)
    }
}

/// The texels that the triangles of an instance touch, sorted, counted row by row through all pages.
pub(crate) fn texels_of(atlas: &Atlas, instance: usize) -> Vec<u32> {
    let last = (atlas.size - 1) as f32;
    let mut texels = Vec::new();
    let sides = atlas.sides().filter(|(index, ..)| *index == instance);
    for (.., uvs) in sides {
        for corners in uvs.corners.as_chunks::<3>().0 {
            let corners = corners.map(|uv| (uv * atlas.size as f32 * STEPS).round() / STEPS);
            let rows = corners.map(|corner| corner.y.clamp(0.0, last) as u32);
            for row in rows[0].min(rows[1]).min(rows[2])..=rows[0].max(rows[1]).max(rows[2]) {
                let [left, right] = extent_in_band(corners, [row as f32, (row + 1) as f32]);
                // As in `Layout::blocks`.
                let left = (left - 1.0 / STEPS).max(0.0) as u32;
                let right = (right + 1.0 / STEPS).clamp(0.0, last) as u32;
                let first = (uvs.page * atlas.size + row) * atlas.size;
                texels.extend((left..=right).map(|column| first + column));
            }
        }
    }
    texels.sort_unstable();
    texels.dedup();
    texels
}

/// Leftmost and rightmost x of a triangle between two rows.
fn extent_in_band(corners: [Vec2; 3], [top, bottom]: [f32; 2]) -> [f32; 2] {
    let mut extent = [f32::INFINITY, f32::NEG_INFINITY];
    let mut include = |x: f32| extent = [extent[0].min(x), extent[1].max(x)];
    for (p, q) in [(0, 1), (1, 2), (2, 0)].map(|(p, q)| (corners[p], corners[q])) {
        if (top..=bottom).contains(&p.y) {
            include(p.x);
        }
        for row in [top, bottom] {
            if (p.y < row) != (q.y < row) {
                include(p.x + (q.x - p.x) * ((row - p.y) / (q.y - p.y)));
            }
        }
    }
    extent
}

/// The corners of each triangle in the vertex order of the scene's tables, which rotate triangles.
pub(super) fn ordered_corners(mesh: &Mesh, uvs: &InstanceUvs) -> Vec<[Vec2; 3]> {
    let ordered = provoking_order(&mesh.indices, mesh.positions.len());
    let triangles = mesh.indices.as_chunks::<3>().0.iter();
    let corners = uvs.corners.as_chunks::<3>().0.iter();
    triangles
        .zip(corners)
        .zip(&ordered.vertices)
        .map(|((triangle, corners), first)| {
            let start = triangle.iter().position(|index| index == first);
            let start = start.unwrap_or(0);
            [0, 1, 2].map(|step| corners[(start + step) % 3])
        })
        .collect()
}

fn area(mesh: &Mesh, world_from_mesh: &Mat4) -> f64 {
    let position =
        |&index: &u32| -> Vec3 { world_from_mesh.transform_point3(mesh.positions[index as usize]) };
    let triangles = mesh.indices.as_chunks::<3>().0.iter();
    let areas = triangles.map(|triangle| {
        let [a, b, c] = triangle.each_ref().map(position);
        f64::from((b - a).cross(c - a).length()) / 2.0
    });
    areas.sum()
}
