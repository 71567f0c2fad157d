//! Materials: glTF 2.0 metallic-roughness with extensions, and the tutorial's own reflection models.

use glam::{Affine2, Vec3, Vec4};
use serde::{Deserialize, Serialize};

/// How a texture continues past its border.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Wrap {
    /// Tile the image.
    #[default]
    Repeat,
    /// Tile the image and mirror every other copy.
    MirroredRepeat,
    /// Extend the border texels.
    ClampToEdge,
}

/// An image and how to sample it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Texture {
    /// Index into [`crate::Scene::images`].
    pub image: usize,
    /// Wrapping along u and v.
    pub wrap: [Wrap; 2],
    /// Magnify without interpolation.
    pub nearest: bool,
    /// Minify with mip levels. Without them, minification skips the texels between samples, but no texels from
    /// elsewhere bleed in.
    pub has_levels: bool,
}

/// How a material reads a texture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TextureRef {
    /// Index into [`crate::Scene::textures`].
    pub texture: usize,
    /// UV set: 0 or 1.
    pub uv_set: u32,
    /// KHR_texture_transform: maps the mesh's texture coordinates to those used for sampling.
    pub uv_from_mesh: Affine2,
}

impl TextureRef {
    /// Reads `texture` with the first UV set, untransformed.
    pub fn new(texture: usize) -> Self {
        Self {
            texture,
            uv_set: 0,
            uv_from_mesh: Affine2::IDENTITY,
        }
    }
}

/// How alpha is used.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub enum AlphaMode {
    /// Alpha is ignored.
    #[default]
    Opaque,
    /// The surface exists only where alpha reaches the cutoff.
    Mask {
        /// Smallest alpha at which the surface exists.
        cutoff: f32,
    },
    /// Alpha is coverage; captures decide it stochastically.
    Blend,
}

/// The interior of a closed surface (KHR_materials_volume).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Volume {
    /// Distance (m) after which `attenuation_color` of the light remains; infinite means no absorption.
    pub attenuation_distance: f32,
    /// Linear Rec. 709 transmittance at `attenuation_distance`.
    pub attenuation_color: Vec3,
}

impl Volume {
    /// Absorption coefficient (1/m) of the Beer-Lambert law: transmittance is `exp(-absorption * distance)`. Bounded,
    /// so that a black attenuation colour gives a large coefficient instead of an infinite one.
    pub fn absorption(&self) -> Vec3 {
        const DARKEST: f32 = 1e-6;
        let color = self
            .attenuation_color
            .clamp(Vec3::splat(DARKEST), Vec3::ONE);
        let per_metre = -Vec3::new(color.x.ln(), color.y.ln(), color.z.ln())
            / self.attenuation_distance.max(1e-6);
        per_metre.max(Vec3::ZERO)
    }
}

/// Which reflection model a material uses.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub enum MaterialModel {
    /// Lambert and GGX, as glTF 2.0 defines them.
    #[default]
    MetallicRoughness,
    /// The tutorial's diffuse + Phong model with albedos: f = kd/pi + ks (n+2)/(2 pi) max(0, cos psi)^n, kd + ks <= 1.
    /// `base_color` and its texture multiply kd.
    Phong {
        /// Diffuse albedo.
        kd: Vec3,
        /// Specular albedo.
        ks: Vec3,
        /// Exponent n.
        shininess: f32,
    },
    /// The same with Blinn's glossy lobe, by the half vector h: ks (n+2) (n+4) / (8 pi (n + 2^(-n/2))) max(0, n.h)^n.
    Blinn {
        /// Diffuse albedo.
        kd: Vec3,
        /// Specular albedo, seen from straight above; it is less from elsewhere.
        ks: Vec3,
        /// Exponent n: about four times Phong's for a highlight of the same size.
        shininess: f32,
    },
    /// A metal defined by its complex refractive index per channel; `roughness` applies.
    Conductor {
        /// Real part of the refractive index.
        n: Vec3,
        /// Extinction coefficient.
        k: Vec3,
    },
}

impl MaterialModel {
    /// Whether it is Phong's or Blinn's, which have an exponent in place of a roughness.
    pub fn has_exponent(&self) -> bool {
        matches!(self, Self::Phong { .. } | Self::Blinn { .. })
    }
}

/// A surface's reflection and emission. Colours are linear Rec. 709.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Material {
    /// Name for reports.
    pub name: String,
    /// Reflection model.
    pub model: MaterialModel,
    /// Base colour and alpha.
    pub base_color: Vec4,
    /// Multiplies `base_color` (sRGB image).
    pub base_color_texture: Option<TextureRef>,
    /// 0 dielectric, 1 metal.
    pub metallic: f32,
    /// Perceptual roughness; GGX alpha is its square.
    pub roughness: f32,
    /// G multiplies roughness, B multiplies metallic (linear image).
    pub metallic_roughness_texture: Option<TextureRef>,
    /// Tangent-space normals (linear image).
    pub normal_texture: Option<TextureRef>,
    /// Scale of the x and y components of the normal map.
    pub normal_scale: f32,
    /// Emitted radiance [W/sr/m^2], including emissive strength. glTF's unit: [`crate::Light::intensity`].
    pub emissive: Vec3,
    /// Multiplies `emissive` (sRGB image).
    pub emissive_texture: Option<TextureRef>,
    /// Index of refraction (KHR_materials_ior); 0 means a reflectance of 1 at normal incidence, as that extension
    /// defines.
    pub ior: f32,
    /// Strength of the dielectric reflection (KHR_materials_specular); 0 gives a pure Lambert surface.
    pub specular: f32,
    /// A multiplies `specular` (linear image).
    pub specular_texture: Option<TextureRef>,
    /// Tint of the dielectric reflection at normal incidence.
    pub specular_color: Vec3,
    /// Multiplies `specular_color` (sRGB image).
    pub specular_color_texture: Option<TextureRef>,
    /// Fraction of the light that enters the surface (KHR_materials_transmission).
    pub transmission: f32,
    /// R multiplies `transmission` (linear image).
    pub transmission_texture: Option<TextureRef>,
    /// Fraction of the diffusely scattered light that leaves on the other side (KHR_materials_diffuse_transmission).
    /// Above 0, the surface has two sides, whatever `double_sided` says.
    pub diffuse_transmission: f32,
    /// A multiplies `diffuse_transmission` (linear image).
    pub diffuse_transmission_texture: Option<TextureRef>,
    /// Albedo of the diffusely transmitted light, in the place of the base colour.
    pub diffuse_transmission_color: Vec3,
    /// Multiplies `diffuse_transmission_color` (sRGB image).
    pub diffuse_transmission_color_texture: Option<TextureRef>,
    /// If present, the surface bounds a solid. If absent, a transmissive surface is a thin wall.
    pub volume: Option<Volume>,
    /// How alpha is used.
    pub alpha_mode: AlphaMode,
    /// Both sides are visible; otherwise back faces are culled. See [`Material::has_two_sides`].
    pub double_sided: bool,
}

impl Default for Material {
    /// glTF's default material, except that materials created in code default to dielectrics (metallic 0).
    fn default() -> Self {
        Self {
            name: String::new(),
            model: MaterialModel::MetallicRoughness,
            base_color: Vec4::ONE,
            base_color_texture: None,
            metallic: 0.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            emissive: Vec3::ZERO,
            emissive_texture: None,
            ior: 1.5,
            specular: 1.0,
            specular_texture: None,
            specular_color: Vec3::ONE,
            specular_color_texture: None,
            transmission: 0.0,
            transmission_texture: None,
            diffuse_transmission: 0.0,
            diffuse_transmission_texture: None,
            diffuse_transmission_color: Vec3::ONE,
            diffuse_transmission_color_texture: None,
            volume: None,
            alpha_mode: AlphaMode::Opaque,
            double_sided: false,
        }
    }
}

impl Material {
    /// A pure Lambert surface with the given albedo.
    pub fn matt(name: &str, albedo: Vec3) -> Self {
        Self {
            name: name.to_owned(),
            base_color: albedo.extend(1.0),
            specular: 0.0,
            ..Self::default()
        }
    }

    /// A metal with the given reflectance at normal incidence and perceptual roughness; roughness 0 is an ideal mirror.
    pub fn metal(name: &str, reflectance: Vec3, roughness: f32) -> Self {
        Self {
            name: name.to_owned(),
            base_color: reflectance.extend(1.0),
            metallic: 1.0,
            roughness,
            ..Self::default()
        }
    }

    /// A black Lambert surface that emits `radiance` [W/sr/m^2] from its front.
    pub fn emitter(name: &str, radiance: Vec3) -> Self {
        Self {
            emissive: radiance,
            ..Self::matt(name, Vec3::ZERO)
        }
    }

    /// A Lambert sheet that reflects the fraction 1 - `share` of `albedo` and transmits the rest.
    pub fn translucent(name: &str, albedo: Vec3, share: f32) -> Self {
        Self {
            diffuse_transmission: share,
            diffuse_transmission_color: albedo,
            ..Self::matt(name, albedo)
        }
    }

    /// Whether the surface transmits light diffusely.
    pub fn is_translucent(&self) -> bool {
        self.diffuse_transmission > 0.0 && !matches!(self.model, MaterialModel::Conductor { .. })
    }

    /// Whether both sides of the surface are visible and scatter light.
    pub fn has_two_sides(&self) -> bool {
        self.double_sided || self.is_translucent()
    }

    /// Whether any part of the surface can reflect diffusely (a black albedo counts). False only for pure metals and
    /// for surfaces that transmit all light that enters them.
    pub fn has_diffuse(&self) -> bool {
        let is_metal = self.metallic >= 1.0 && self.metallic_roughness_texture.is_none();
        let is_glass = self.transmission >= 1.0 && self.transmission_texture.is_none();
        match self.model {
            MaterialModel::MetallicRoughness => !is_metal && !is_glass,
            MaterialModel::Phong { .. } | MaterialModel::Blinn { .. } => !is_glass,
            MaterialModel::Conductor { .. } => false,
        }
    }
}
