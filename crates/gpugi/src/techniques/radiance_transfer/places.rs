//! The points that have transfer vectors: texels of an atlas, or vertices.

use std::sync::Arc;

use gpugi_scene::Atlas;

use super::vertices::{Vertices, WIDTH};
use super::{INFO, Settings};
use crate::capture::atlas::blocks::texels_of;
use crate::capture::atlas::{AtlasCapture, KeptTexels};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::scene::GpuScene;

/// The points, and where triangles find them.
#[derive(Debug)]
pub(super) enum Places {
    /// The texels of an atlas.
    Texels(Arc<Atlas>, Box<KeptTexels>),
    Vertices(Box<Vertices>),
}

/// Points in one buffer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece<'a> {
    /// `PackedSurfacePoint` of capture/surface_point.wesl.
    pub points: &'a wgpu::Buffer,
    pub count: u32,
    /// Number of the first one among all points.
    pub first: u32,
}

impl Places {
    /// The texels of `atlas`, of which at most `most_texels` are captured at once, or without one the vertices.
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        settings: &Settings,
        atlas: Option<Arc<Atlas>>,
        most_texels: Option<u32>,
    ) -> Result<Self, GpuError> {
        if let Some(atlas) = atlas {
            let most = most_texels.unwrap_or(u32::MAX);
            let texels = KeptTexels::new(gpu, scene, &atlas, most)?;
            return Ok(Self::Texels(atlas, Box::new(texels)));
        }
        let host = scene.host();
        let host = host.ok_or_else(|| INFO.refused("the scene was uploaded without its meshes"))?;
        let vertices = Vertices::new(gpu, scene, host, settings)?;
        Ok(Self::Vertices(Box::new(vertices)))
    }

    /// Width and height of a map of all points.
    pub fn map_size(&self) -> [u32; 2] {
        match self {
            Self::Texels(_, texels) => texels.size(),
            Self::Vertices(vertices) => [WIDTH, vertices.count / WIDTH],
        }
    }

    /// The points, in order.
    pub fn pieces(&self) -> Vec<Piece<'_>> {
        match self {
            Self::Texels(_, texels) => {
                let pieces = texels.capture.pieces().iter().map(|piece| Piece {
                    points: &piece.points.points,
                    count: piece.points.count,
                    first: piece.rows.start * texels.capture.size,
                });
                pieces.collect()
            }
            Self::Vertices(vertices) => vec![Piece {
                points: &vertices.points,
                count: vertices.count,
                first: 0,
            }],
        }
    }

    /// The points of an instance, sorted.
    pub fn of_instance(&self, instance: usize) -> Vec<u32> {
        match self {
            Self::Texels(atlas, _) => texels_of(atlas, instance),
            Self::Vertices(vertices) => vertices.of_instance(instance).collect(),
        }
    }

    /// Captures the points again if the scene has changed.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(&mut self, frame: &mut Frame<'_>, scene: &GpuScene) -> Result<(), GpuError> {
        match self {
            Self::Texels(_, texels) => texels.record(frame, scene),
            Self::Vertices(vertices) => vertices.record(frame, scene),
        }
    }

    /// The buffer by which a triangle's points are found: `atlas` of capture/atlas/lookup.wesl.
    pub fn lookup(&self) -> &wgpu::Buffer {
        match self {
            Self::Texels(_, texels) => &texels.lookup.words,
            Self::Vertices(vertices) => &vertices.lookup,
        }
    }

    /// The atlas, if they are texels.
    pub fn atlas(&self) -> Option<&Atlas> {
        match self {
            Self::Texels(atlas, _) => Some(atlas),
            Self::Vertices(_) => None,
        }
    }

    /// The constant that says which it is.
    pub fn constant(&self) -> (&'static str, f64) {
        let at_vertices = matches!(self, Self::Vertices(_));
        ("AT_VERTICES", f64::from(u8::from(at_vertices)))
    }

    /// The captured texels, if they are texels: those are lit at their own place.
    pub fn capture(&self) -> Option<&AtlasCapture> {
        match self {
            Self::Texels(_, texels) => Some(&texels.capture),
            Self::Vertices(_) => None,
        }
    }

    /// What they cost, in words, if that is more than the meshes say.
    pub fn described(&self, settings: &Settings) -> Option<String> {
        match self {
            Self::Texels(..) => None,
            Self::Vertices(vertices) => vertices.described(settings),
        }
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        match self {
            Self::Texels(_, texels) => texels.bytes(),
            Self::Vertices(vertices) => vertices.bytes(),
        }
    }
}
