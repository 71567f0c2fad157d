//! The points that have transfer vectors: texels of an atlas, or vertices.

use std::sync::Arc;

use gpugi_scene::Atlas;

use super::vertices::{Vertices, WIDTH};
use super::{INFO, Settings};
use crate::capture::atlas::blocks::texels_of;
use crate::capture::atlas::{AtlasCapture, AtlasCaptureOptions, AtlasLookup, LeakTest};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::scene::GpuScene;

/// The points, and where triangles find them.
#[derive(Debug)]
pub(super) enum Places {
    Texels(Box<Texels>),
    Vertices(Box<Vertices>),
}

/// The texels of an atlas.
#[derive(Debug)]
pub(super) struct Texels {
    pub atlas: Arc<Atlas>,
    pub capture: AtlasCapture,
    leaks: LeakTest,
    lookup: AtlasLookup,
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
        let host = scene.host().ok_or_else(|| GpuError::Pass {
            pass: INFO.name.into(),
            reason: "the scene was uploaded without its meshes".into(),
        })?;
        let Some(atlas) = atlas else {
            let vertices = Vertices::new(gpu, scene, host, settings)?;
            return Ok(Self::Vertices(Box::new(vertices)));
        };
        let options = AtlasCaptureOptions {
            most_texels: most_texels.unwrap_or(u32::MAX),
            ..AtlasCaptureOptions::default()
        };
        let capture = AtlasCapture::new(gpu, host, scene, &atlas, &options)?;
        Ok(Self::Texels(Box::new(Texels {
            lookup: AtlasLookup::new(gpu, host, &atlas)?,
            leaks: LeakTest::new(gpu, scene, &capture)?,
            capture,
            atlas,
        })))
    }

    /// Width and height of a map of all points.
    pub fn map_size(&self) -> [u32; 2] {
        match self {
            Self::Texels(texels) => {
                let size = texels.capture.size;
                [size, size * texels.capture.pages]
            }
            Self::Vertices(vertices) => [WIDTH, vertices.count / WIDTH],
        }
    }

    /// The points, in order.
    pub fn pieces(&self) -> Vec<Piece<'_>> {
        match self {
            Self::Texels(texels) => {
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
            Self::Texels(texels) => texels_of(&texels.atlas, instance),
            Self::Vertices(vertices) => vertices.of_instance(instance).collect(),
        }
    }

    /// Captures the points again if the scene has changed.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(&mut self, frame: &mut Frame<'_>, scene: &GpuScene) -> Result<(), GpuError> {
        match self {
            Self::Texels(texels) => {
                texels.capture.record(frame, scene)?;
                texels.leaks.record(frame, scene, &texels.capture);
                Ok(())
            }
            Self::Vertices(vertices) => vertices.record(frame, scene),
        }
    }

    /// The buffer by which a triangle's points are found: `atlas` of capture/atlas/lookup.wesl.
    pub fn lookup(&self) -> &wgpu::Buffer {
        match self {
            Self::Texels(texels) => &texels.lookup.words,
            Self::Vertices(vertices) => &vertices.lookup,
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
            Self::Texels(texels) => Some(&texels.capture),
            Self::Vertices(_) => None,
        }
    }

    /// What they cost, in words, if that is more than the meshes say.
    pub fn described(&self, settings: &Settings) -> Option<String> {
        match self {
            Self::Texels(_) => None,
            Self::Vertices(vertices) => vertices.described(settings),
        }
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        match self {
            Self::Texels(texels) => {
                let states = texels.leaks.states().map(wgpu::Buffer::size);
                texels.capture.bytes + texels.lookup.words.size() + states.sum::<u64>()
            }
            Self::Vertices(vertices) => vertices.bytes(),
        }
    }
}
