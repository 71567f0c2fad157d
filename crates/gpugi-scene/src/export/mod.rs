//! Exporters: write what was baked into texture space to a file that other software displays correctly. They return
//! bytes; writing the file is up to the caller.

mod gltf;

use glam::Vec3;

use crate::atlas::Atlas;
use crate::{ImportError, LightPathPanes, Limits, Resolver, Scene, TransferVectors};

/// The glTF file that a scene was imported from.
#[derive(Clone, Copy)]
pub struct Original<'a> {
    /// The file, as the user named it.
    pub name: &'a str,
    /// Its bytes, JSON or binary.
    pub bytes: &'a [u8],
    /// Provides its buffers and images.
    pub resolver: &'a dyn Resolver,
    /// Limits on what the file may request.
    pub limits: Limits,
}

/// What was baked into a page of an atlas. Each list holds one value per texel, row by row from the top. Texels that no
/// triangle covers should extend the values of their neighbours, because filters read beyond the borders of triangles.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct BakedPage {
    /// Obscurance, 0 to 1: the fraction of the ambient light that arrives. Becomes the materials' `occlusionTexture`.
    pub obscurance: Option<Vec<f32>>,
    /// Obscurance that includes the colours of the obscuring surfaces, 0 to 1. glTF has no place for it:
    /// `extras.gpugi.coloredObscurance` of the materials refers to the texture.
    pub colored_obscurance: Option<Vec<Vec3>>,
    /// Light, in the form in which the file stores it.
    pub light: Option<BakedLight>,
}

/// Baked light.
#[derive(Debug, Clone, PartialEq)]
pub enum BakedLight {
    /// The surface's radiance as displayed (sRGB), with the surface's coverage as alpha. The materials become unlit
    /// (KHR_materials_unlit) and are coloured by nothing else.
    Unlit(Vec<[u8; 4]>),
    /// Radiance [W/sr/m^2], including emission. The materials become black and emit it.
    Emissive(Vec<Vec3>),
    /// Irradiance [W/m^2], which viewers multiply by albedo / pi. glTF has no place for it: `extras.gpugi.lightmap` of
    /// the materials refers to the texture. The materials are otherwise unchanged.
    Lightmap {
        /// Irradiance [W/m^2].
        irradiance: Vec<Vec3>,
        /// A file next to the exported one that holds the same data without loss. The caller writes it.
        exr: String,
    },
}

/// A glTF file in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Exported {
    /// The .glb file.
    pub glb: Vec<u8>,
    /// What could not be kept or expressed.
    pub warnings: Vec<String>,
}

/// Why a scene or a bake cannot be exported.
#[derive(Debug, Clone, thiserror::Error, PartialEq, Eq)]
pub enum ExportError {
    /// The original file cannot be read.
    #[error(transparent)]
    Original(#[from] ImportError),
    /// The scene, the atlas and the baked pages do not match, or do not fit into a file.
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

/// Writes `scene` as a .glb: one node per instance, materials as far as glTF and its extensions can express them,
/// punctual lights, cameras and media. Environment and animation are left out, with a warning.
///
/// # Errors
/// If the file would exceed 4 GiB.
pub fn export_scene(scene: &Scene) -> Result<Exported, ExportError> {
    let written = gltf::scene::write(scene)?;
    Ok(Exported {
        glb: written.output.glb()?,
        warnings: written.warnings,
    })
}

/// Writes a .glb that shows `scene` with the baked `pages`, using the texture coordinates of `atlas`.
///
/// If there is an `original`, from which `scene` was imported, everything in that file stays as it is except what the
/// bake must change: the instances that the atlas holds get their own materials, texture coordinates and, where the
/// atlas has cuts, vertices. Their other attributes, including skins and morph targets, are copied bit for bit.
/// External buffers, images and densities of the original are embedded; geometry that is no longer used stays in the file.
/// Whatever the atlas does not hold stays unchanged, including what was removed from `scene` after the import. Without
/// an original, the scene is first written as by [`export_scene`].
///
/// # Errors
/// If the original cannot be read, the parts do not match, or the file would exceed 4 GiB.
pub fn export_bake(
    original: Option<Original>,
    scene: &Scene,
    atlas: &Atlas,
    pages: &[BakedPage],
) -> Result<Exported, ExportError> {
    gltf::bake(original, scene, atlas, pages, None)
}

/// How a file stores transfer vectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TransferFormat {
    /// 16-bit floats: 8 bytes per texel and function.
    #[default]
    Half,
    /// Signed fractions in 8 bits, of a scale per function: 4 bytes per texel and function.
    Byte,
}

/// Writes a .glb that holds `scene` and its transfer vectors, for programs that relight it: docs/relight.md. Materials
/// stay as they are, but for a note in `extras.gpugi`; the geometry gets the texture coordinates of the vectors' atlas.
/// `original` is as for [`export_bake`]. [`TransferVectors::geometry`] is not used: it follows from the file.
///
/// # Errors
/// As [`export_bake`].
pub fn export_transfer(
    original: Option<Original>,
    scene: &Scene,
    vectors: &TransferVectors,
    format: TransferFormat,
) -> Result<Exported, ExportError> {
    let atlas = &vectors.atlas;
    let fits = vectors.check_size();
    fits.map_err(|reason| ExportError::new("transfer vectors", reason))?;
    let pages = vec![BakedPage::default(); atlas.pages as usize];
    let transfer = gltf::Stored::Transfer(gltf::Transfer { vectors, format });
    gltf::bake(original, scene, atlas, &pages, Some(transfer))
}

/// Writes a .glb that holds `scene` and its panes, for programs that relight it: docs/panes.md. Materials stay as they
/// are, but for a note in `extras.gpugi`; the geometry gets the texture coordinates of the panes' atlas. `original` is as
/// for [`export_bake`]. The hashes of `panes` are not used: they follow from the file.
///
/// # Errors
/// As [`export_bake`].
pub fn export_panes(
    original: Option<Original>,
    scene: &Scene,
    panes: &LightPathPanes,
) -> Result<Exported, ExportError> {
    let fits = panes.check_size();
    fits.map_err(|reason| ExportError::new("panes", reason))?;
    let pages = vec![BakedPage::default(); panes.atlas.pages as usize];
    let stored = gltf::Stored::Panes(panes);
    gltf::bake(original, scene, &panes.atlas, &pages, Some(stored))
}
