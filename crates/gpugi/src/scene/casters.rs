//! What depth maps draw: the scene's triangles, or fewer.

use glam::Vec3;
use gpugi_scene::simplify::simplified;

use super::{Draw, DrawClass, GpuScene};
use crate::gpu::{Frame, GpuError, read_buffer};

/// Triangles between a scene's merged vertices.
#[derive(Debug, Clone, Copy)]
pub struct Casters<'a> {
    /// The scene.
    pub scene: &'a GpuScene,
    /// Indices of merged vertices.
    pub indices: &'a wgpu::Buffer,
    /// Ranges of them, in order of class.
    pub draws: &'a [Draw],
}

impl GpuScene {
    /// Every triangle.
    pub fn casters(&self) -> Casters<'_> {
        Casters {
            scene: self,
            indices: &self.indices,
            draws: &self.draws,
        }
    }
}

/// Casters of fewer triangles, kept while the scene's meshes are the same, wherever their instances move.
#[derive(Debug)]
pub struct SimplifiedCasters {
    detail: f32,
    topology: u64,
    indices: wgpu::Buffer,
    draws: Vec<Draw>,
}

impl SimplifiedCasters {
    /// Casters of about `detail` times as many triangles, for which merged vertices are waited for; `kept` where it will do. Surfaces
    /// with alpha keep their triangles, since these decide where they exist.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        detail: f32,
        kept: Option<Self>,
    ) -> Result<Self, GpuError> {
        let mut casters = match kept {
            Some(kept) if kept.topology == scene.versions.topology && kept.detail == detail => kept,
            _ => Self::simplify(frame, scene, detail)?,
        };
        for (draw, at) in casters.draws.iter_mut().zip(&scene.draws) {
            draw.bounds = at.bounds;
        }
        Ok(casters)
    }

    fn simplify(frame: &mut Frame<'_>, scene: &GpuScene, detail: f32) -> Result<Self, GpuError> {
        frame.flush()?;
        let gpu = frame.gpu;
        let vertices: Vec<[f32; 4]> = read_buffer(gpu, &scene.vertices, scene.vertices.size())?;
        let all: Vec<u32> = read_buffer(gpu, &scene.indices, scene.indices.size())?;
        let mut indices: Vec<u32> = Vec::new();
        let mut draws = Vec::with_capacity(scene.draws.len());
        for draw in &scene.draws {
            let start = indices.len() as u32;
            let own = &all[draw.indices.start as usize..draw.indices.end as usize];
            if draw.class >= DrawClass::Alpha {
                indices.extend(own);
            } else if let (Some(&first), Some(&last)) = (own.iter().min(), own.iter().max()) {
                // The vertices of an instance lie together.
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
        Ok(Self {
            detail,
            topology: scene.versions.topology,
            indices: gpu.buffer_with(
                "simplified indices [bytes]",
                &indices,
                wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDEX,
            )?,
            draws,
        })
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
