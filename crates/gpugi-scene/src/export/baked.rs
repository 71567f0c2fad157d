//! What is exported, and what becomes of it.

use glam::Vec3;

use crate::{Limits, Resolver};

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

/// How a file stores transfer vectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TransferFormat {
    /// 16-bit floats: 8 bytes per texel and function.
    #[default]
    Half,
    /// Signed fractions in 8 bits, of a scale per function: 4 bytes per texel and function.
    Byte,
}
