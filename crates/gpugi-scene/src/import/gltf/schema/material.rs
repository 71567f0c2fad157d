//! Materials and their extensions, as represented in JSON.

use serde::Deserialize;
use serde_json::Value;

use super::numbers::{finite, one, ones};

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Material {
    pub name: Option<String>,
    pub pbr_metallic_roughness: MetallicRoughness,
    pub normal_texture: Option<TextureInfo>,
    #[serde(deserialize_with = "finite")]
    pub emissive_factor: [f32; 3],
    pub emissive_texture: Option<TextureInfo>,
    pub alpha_mode: Option<String>,
    #[serde(deserialize_with = "finite")]
    pub alpha_cutoff: Option<f32>,
    pub double_sided: bool,
    pub extensions: Box<MaterialExtensions>,
    pub extras: Value,
}

#[derive(Debug, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct MetallicRoughness {
    #[serde(deserialize_with = "finite")]
    pub base_color_factor: [f32; 4],
    pub base_color_texture: Option<TextureInfo>,
    #[serde(deserialize_with = "finite")]
    pub metallic_factor: f32,
    #[serde(deserialize_with = "finite")]
    pub roughness_factor: f32,
    pub metallic_roughness_texture: Option<TextureInfo>,
}

impl Default for MetallicRoughness {
    fn default() -> Self {
        Self {
            base_color_factor: [1.0; 4],
            base_color_texture: None,
            metallic_factor: 1.0,
            roughness_factor: 1.0,
            metallic_roughness_texture: None,
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct TextureInfo {
    pub index: usize,
    #[serde(default)]
    pub tex_coord: u32,
    /// For normal textures only.
    #[serde(default = "one", deserialize_with = "finite")]
    pub scale: f32,
    #[serde(default)]
    pub extensions: TextureInfoExtensions,
}

impl TextureInfo {
    /// The UV set used to sample the texture.
    pub fn uv_set(&self) -> u32 {
        let transform = self.extensions.transform.as_ref();
        transform
            .and_then(|transform| transform.tex_coord)
            .unwrap_or(self.tex_coord)
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct TextureInfoExtensions {
    #[serde(rename = "KHR_texture_transform")]
    pub transform: Option<TextureTransform>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct TextureTransform {
    #[serde(default, deserialize_with = "finite")]
    pub offset: [f32; 2],
    #[serde(default, deserialize_with = "finite")]
    pub rotation: f32,
    #[serde(default = "ones", deserialize_with = "finite")]
    pub scale: [f32; 2],
    pub tex_coord: Option<u32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct MaterialExtensions {
    #[serde(rename = "KHR_materials_diffuse_transmission")]
    pub diffuse_transmission: Option<DiffuseTransmission>,
    #[serde(rename = "KHR_materials_emissive_strength")]
    pub emissive_strength: Option<EmissiveStrength>,
    #[serde(rename = "KHR_materials_ior")]
    pub ior: Option<Ior>,
    #[serde(rename = "KHR_materials_specular")]
    pub specular: Option<Specular>,
    #[serde(rename = "KHR_materials_transmission")]
    pub transmission: Option<Transmission>,
    #[serde(rename = "KHR_materials_unlit")]
    pub unlit: Option<Unlit>,
    #[serde(rename = "KHR_materials_volume")]
    pub volume: Option<Volume>,
    #[serde(rename = "KHR_materials_pbrSpecularGlossiness")]
    pub specular_glossiness: Option<SpecularGlossiness>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct DiffuseTransmission {
    #[serde(default, deserialize_with = "finite")]
    pub diffuse_transmission_factor: f32,
    pub diffuse_transmission_texture: Option<TextureInfo>,
    #[serde(default = "ones", deserialize_with = "finite")]
    pub diffuse_transmission_color_factor: [f32; 3],
    pub diffuse_transmission_color_texture: Option<TextureInfo>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct EmissiveStrength {
    #[serde(default = "one", deserialize_with = "finite")]
    pub emissive_strength: f32,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Ior {
    #[serde(default = "glass", deserialize_with = "finite")]
    pub ior: f32,
}

fn glass() -> f32 {
    1.5
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Specular {
    #[serde(default = "one", deserialize_with = "finite")]
    pub specular_factor: f32,
    pub specular_texture: Option<TextureInfo>,
    #[serde(default = "ones", deserialize_with = "finite")]
    pub specular_color_factor: [f32; 3],
    pub specular_color_texture: Option<TextureInfo>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Transmission {
    #[serde(default, deserialize_with = "finite")]
    pub transmission_factor: f32,
    pub transmission_texture: Option<TextureInfo>,
}

#[derive(Debug, Deserialize)]
pub struct Unlit {}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Volume {
    #[serde(default, deserialize_with = "finite")]
    pub thickness_factor: f32,
    #[serde(default, deserialize_with = "finite")]
    pub attenuation_distance: Option<f32>,
    #[serde(default = "ones", deserialize_with = "finite")]
    pub attenuation_color: [f32; 3],
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct SpecularGlossiness {
    #[serde(default = "ones", deserialize_with = "finite")]
    pub diffuse_factor: [f32; 4],
    pub diffuse_texture: Option<TextureInfo>,
    #[serde(default = "ones", deserialize_with = "finite")]
    pub specular_factor: [f32; 3],
    #[serde(default = "one", deserialize_with = "finite")]
    pub glossiness_factor: f32,
    pub specular_glossiness_texture: Option<TextureInfo>,
}
