//! Exporters: what was baked into texture space goes into a file that other software shows right. They make bytes; writing
//! those is the caller's.

mod gltf;

use glam::Vec3;

use crate::atlas::Atlas;
use crate::{ImportError, Limits, Resolver, Scene};

/// The glTF file that a scene was imported from.
#[derive(Clone, Copy)]
pub struct Original<'a> {
    /// The file, as the user named it.
    pub name: &'a str,
    /// Its bytes, JSON or binary.
    pub bytes: &'a [u8],
    /// What gives its buffers and images.
    pub resolver: &'a dyn Resolver,
    /// What it may ask for.
    pub limits: Limits,
}

/// What was baked into a page of an atlas: each list holds a value a texel, row by row from the top. Texels that no
/// triangle covers should continue their neighbours, because filters look beyond the triangles' borders.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct BakedPage {
    /// Obscurance, 0 to 1: how much of the ambient light arrives. Becomes the materials' `occlusionTexture`.
    pub obscurance: Option<Vec<f32>>,
    /// Obscurance with the colours of what obscures, 0 to 1. glTF has no place for it: `extras.gpugi.coloredObscurance` of
    /// the materials names the texture.
    pub colored_obscurance: Option<Vec<Vec3>>,
    /// Light, in the form that the file shall hold it in.
    pub light: Option<BakedLight>,
}

/// Light that was baked.
#[derive(Debug, Clone, PartialEq)]
pub enum BakedLight {
    /// What a display shows of the surface's radiance (sRGB), and the surface's coverage as alpha. The materials become
    /// unlit (KHR_materials_unlit), and nothing but this colours them.
    Unlit(Vec<[u8; 4]>),
    /// Radiance [W/sr/m^2], emission included. The materials become black and emit it.
    Emissive(Vec<Vec3>),
    /// Irradiance [W/m^2], which viewers multiply by albedo / pi. glTF has no place for it: `extras.gpugi.lightmap` of the
    /// materials names the texture. The materials stay as they are.
    Lightmap {
        /// Irradiance [W/m^2].
        irradiance: Vec<Vec3>,
        /// The file beside the exported one that holds the same without loss. The caller writes it.
        exr: String,
    },
}

/// A glTF file made in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Exported {
    /// The .glb.
    pub glb: Vec<u8>,
    /// What could not be kept or expressed.
    pub warnings: Vec<String>,
}

/// A scene or a bake that cannot become a file.
#[derive(Debug, Clone, thiserror::Error, PartialEq, Eq)]
pub enum ExportError {
    /// The original file cannot be read.
    #[error(transparent)]
    Original(#[from] ImportError),
    /// The scene, the atlas and what was baked do not fit together, or not into a file.
    #[error("{place}: {reason}")]
    Refused {
        /// Where: `instances[3]`, `pages[0]`.
        place: String,
        /// What is wrong there.
        reason: String,
    },
}

impl ExportError {
    fn new(place: impl Into<String>, reason: impl std::fmt::Display) -> Self {
        Self::Refused {
            place: place.into(),
            reason: reason.to_string(),
        }
    }
}

/// Writes `scene` as a .glb: a node an instance, materials as far as glTF and its extensions express them, punctual lights
/// and cameras. Environment and animation are left out, with a warning.
///
/// # Errors
/// When the file would exceed 4 GiB.
pub fn export_scene(scene: &Scene) -> Result<Exported, ExportError> {
    let written = gltf::scene::write(scene)?;
    Ok(Exported {
        glb: written.output.glb()?,
        warnings: written.warnings,
    })
}

/// Writes a .glb that shows `scene` with what was baked, `pages`, on the texture coordinates of `atlas`.
///
/// With an `original`, from which `scene` was imported, everything of that file stays as it is but what the bake must
/// change: the instances that the atlas holds get materials, texture coordinates and, where the atlas cuts them, vertices
/// of their own. Their other attributes, skins and morph targets included, are copied bit for bit. Buffers and images beside
/// the original come into the file; geometry that nothing uses any more stays in it. What the atlas does not hold stays as it
/// was, also what was removed from `scene` after the import. Without an original, the scene is first written as
/// [`export_scene`] does.
///
/// # Errors
/// When the original cannot be read, when the parts do not fit together, or when the file would exceed 4 GiB.
pub fn export_bake(
    original: Option<Original>,
    scene: &Scene,
    atlas: &Atlas,
    pages: &[BakedPage],
) -> Result<Exported, ExportError> {
    gltf::bake(original, scene, atlas, pages)
}
