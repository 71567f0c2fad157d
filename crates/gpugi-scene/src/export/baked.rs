//! What is exported, and what becomes of it.

use glam::Vec3;

use super::{ExportError, gltf};
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
    /// Light that arrives, whose diffuse reflection viewers add: MOZ_lightmap of the materials refers to the texture, of 8
    /// linear bits and with a scale per instance. The materials are otherwise unchanged.
    Lightmap {
        /// The texels.
        texels: Vec<Vec3>,
        /// What they hold.
        quantity: LightmapQuantity,
        /// Whether the file also holds them as Radiance HDR, by MOZ_texture_rgbe.
        with_hdr: bool,
        /// A file next to the exported one that holds the same texels without loss, named in `extras.gpugi.lightmap` of the
        /// materials. The caller writes it.
        file: String,
    },
}

/// What a lightmap holds [W/m^2].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LightmapQuantity {
    /// Irradiance E: a diffuse surface of albedo a reflects the radiance a E / pi. As three.js reads them.
    #[default]
    Irradiance,
    /// Irradiance over pi: the radiance of a white surface. As most engines read them.
    IrradianceOverPi,
}

impl LightmapQuantity {
    /// Its name in `extras.gpugi.lightmap.quantity`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Irradiance => "irradiance",
            Self::IrradianceOverPi => "irradiance / pi",
        }
    }
}

/// A glTF file in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Exported {
    /// The .glb file.
    pub glb: Vec<u8>,
    /// What could not be kept or expressed.
    pub warnings: Vec<String>,
}

/// What is changed of a whole file after it is written, for the programs that read it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Changes {
    /// Leave out punctual lights: programs would add their light to that of a lightmap.
    pub drops_lights: bool,
    /// Write the intensity of punctual lights in photometric units, as glTF has them: 683 lumens per watt. gpugi takes one
    /// candela for one watt per steradian.
    pub photometric: bool,
    /// Decode geometry that meshoptimizer or Draco has compressed, for programs without their decoders.
    pub unpacks: bool,
    /// Leave out meshes, materials, textures, images, accessors, attributes and bytes that nothing shows any more. Files with
    /// extensions that are unknown here, and files that hold what relights them, stay whole.
    pub prunes: bool,
}

impl Exported {
    /// The same file with `changes`.
    ///
    /// # Errors
    /// If it would exceed 4 GiB, or if what is compressed cannot be decoded.
    pub fn changed(self, changes: &Changes) -> Result<Self, ExportError> {
        if *changes == Changes::default() {
            return Ok(self);
        }
        gltf::changed::changed(self, changes)
    }
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
