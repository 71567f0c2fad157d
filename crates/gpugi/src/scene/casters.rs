//! The triangles that depth maps draw: all of the scene's, or fewer.

use glam::Vec3;
use gpugi_scene::AlphaMode;
use gpugi_scene::simplify::simplified;

use super::{Claims, Draw, DrawClass, GpuScene};
use crate::gpu::{Frame, Gpu, GpuError, ReadBack};

/// Triangles over a scene's merged vertices.
#[derive(Debug, Clone, Copy)]
pub struct Casters<'a> {
    /// The scene.
    pub scene: &'a GpuScene,
    /// Indices of merged vertices.
    pub indices: &'a wgpu::Buffer,
    /// Ranges of the indices, sorted by class.
    pub draws: &'a [Draw],
}

/// Work of a triangle in a depth map, in units of [`crate::lighting::Budget`]: on one H100, where few units rasterize, as
/// much as so many lookups.
const TRIANGLE_WORK: u64 = 64;

impl Casters<'_> {
    /// Work of drawing them all into a view, without its texels, in units of [`crate::lighting::Budget`].
    pub(crate) fn work(&self) -> u64 {
        let indices: u64 = self
            .draws
            .iter()
            .map(|draw| draw.indices.len() as u64)
            .sum();
        indices / 3 * TRIANGLE_WORK
    }
}

impl GpuScene {
    /// All triangles.
    pub fn casters(&self) -> Casters<'_> {
        Casters {
            scene: self,
            indices: &self.indices,
            draws: &self.draws,
        }
    }

    /// Whether light may pass straight through a draw's surface. Objects with the claim `whole` transmit none.
    pub(crate) fn is_see_through(&self, draw: &Draw, whole: Claims) -> bool {
        let index = draw.instance as usize;
        let is_whole = whole != Claims::NONE && self.claims(index).contains(whole);
        let transmits = self.objects[index].is_transmissive && !is_whole;
        transmits || self.alpha_modes[index] == AlphaMode::Blend
    }

    /// Whether light may pass straight through any caster.
    pub(crate) fn has_see_through(&self, whole: Claims) -> bool {
        let mut draws = self.draws.iter();
        draws.any(|draw| self.is_see_through(draw, whole))
    }
}

/// Merged vertices and indices on their way to the host, to be simplified there.
#[derive(Debug)]
pub struct CasterGeometry {
    topology: u64,
    vertices: ReadBack<Vec<[f32; 4]>>,
    indices: ReadBack<Vec<u32>>,
}

impl CasterGeometry {
    /// Reads back the geometry of a scene whose vertices are merged.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn read_back(frame: &mut Frame<'_>, scene: &GpuScene) -> Result<Self, GpuError> {
        Ok(Self {
            topology: scene.versions.topology,
            vertices: frame.read_back(&scene.vertices, scene.vertices.size())?,
            indices: frame.read_back(&scene.indices, scene.indices.size())?,
        })
    }

    /// Whether the geometry is that of the scene in its current state.
    pub fn is_of(&self, scene: &GpuScene) -> bool {
        self.topology == scene.versions.topology
    }
}

/// Casters with fewer triangles, kept while the scene's meshes are the same, however their instances move.
#[derive(Debug)]
pub struct SimplifiedCasters {
    detail: f32,
    topology: u64,
    indices: wgpu::Buffer,
    draws: Vec<Draw>,
}

impl SimplifiedCasters {
    /// Casters with about `detail` times as many triangles; `None` until their geometry has arrived. Surfaces with
    /// alpha keep all their triangles, since the triangles decide where such a surface exists.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        detail: f32,
        geometry: &CasterGeometry,
    ) -> Result<Option<Self>, GpuError> {
        let (Some(vertices), Some(all)) = (geometry.vertices.get(), geometry.indices.get()) else {
            return Ok(None);
        };
        let (vertices, all) = (vertices?, all?);
        let mut indices: Vec<u32> = Vec::new();
        let mut draws = Vec::with_capacity(scene.draws.len());
        for draw in &scene.draws {
            let start = indices.len() as u32;
            let own = &all[draw.indices.start as usize..draw.indices.end as usize];
            if draw.class >= DrawClass::Alpha {
                indices.extend(own);
            } else if let (Some(&first), Some(&last)) = (own.iter().min(), own.iter().max()) {
                // The vertices of an instance are contiguous.
                let positions: Vec<Vec3> = vertices[first as usize..=last as usize]
                    .iter()
                    .map(|&[x, y, z, _]| Vec3::new(x, y, z))
                    .collect();
                let local: Vec<u32> = own.iter().map(|index| index - first).collect();
                let coarse = simplified(&positions, &local, detail);
                indices.extend(coarse.iter().map(|index| index + first));
            }
            draws.push(Draw {
                indices: start..indices.len() as u32,
                ..draw.clone()
            });
        }
        Ok(Some(Self {
            detail,
            topology: scene.versions.topology,
            indices: gpu.buffer_with(
                "simplified indices [bytes]",
                &indices,
                wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDEX,
            )?,
            draws,
        }))
    }

    /// Whether the casters are valid for the scene in its current state and for this detail.
    pub fn serve(&self, scene: &GpuScene, detail: f32) -> bool {
        self.topology == scene.versions.topology && self.detail == detail
    }

    /// Follows instances that moved.
    pub fn follow(&mut self, scene: &GpuScene) {
        for (draw, at) in self.draws.iter_mut().zip(&scene.draws) {
            draw.bounds = at.bounds;
        }
    }

    /// The casters.
    pub fn casters<'a>(&'a self, scene: &'a GpuScene) -> Casters<'a> {
        Casters {
            scene,
            indices: &self.indices,
            draws: &self.draws,
        }
    }
}
