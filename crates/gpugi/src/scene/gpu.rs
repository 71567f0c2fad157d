//! The rows of the scene's tables, as scene/tables.wesl reads them.

use bytemuck::{Pod, Zeroable};

/// `SceneHeader` of scene/bindings.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct SceneHeader {
    pub instance_row: u32,
    pub material_row: u32,
    pub texture_row: u32,
    pub instance_count: u32,
    pub environment_rotation: [f32; 4],
    pub environment_intensity: f32,
    pub diagonal: f32,
    pub bvh_start: [u32; 2],
    pub medium_row: u32,
    pub medium_count: u32,
    pub longest: f32,
    pub padding: u32,
}

/// `Instance` of scene/tables.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Instance {
    pub world_from_mesh_0: [f32; 4],
    pub world_from_mesh_1: [f32; 4],
    pub world_from_mesh_2: [f32; 4],
    pub first_vertex_word: u32,
    pub first_index_word: u32,
    pub first_merged_vertex: u32,
    pub material: u32,
    pub vertex_count: u32,
    pub mirrored: u32,
    pub closed: u32,
    pub claims: u32,
    pub sphere: [f32; 4],
}

/// `Material` of scene/tables.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Material {
    pub base_color: [f32; 4],
    pub emissive: [f32; 3],
    pub alpha_cutoff: f32,
    pub metallic: f32,
    pub roughness: f32,
    pub dielectric_f0: f32,
    pub specular: f32,
    pub specular_color: [f32; 3],
    pub transmission: f32,
    pub model_a: [f32; 3],
    pub shininess: f32,
    pub model_b: [f32; 3],
    pub normal_scale: f32,
    pub model: u32,
    pub alpha_mode: u32,
    pub double_sided: u32,
    pub base_color_texture: u32,
    pub metallic_roughness_texture: u32,
    pub normal_texture: u32,
    pub emissive_texture: u32,
    pub specular_texture: u32,
    pub specular_color_texture: u32,
    pub transmission_texture: u32,
    pub solid: u32,
    pub diffuse_transmission_texture: u32,
    pub absorption: [f32; 3],
    pub ior: f32,
    pub diffuse_transmission_color: [f32; 3],
    pub diffuse_transmission: f32,
    pub diffuse_transmission_color_texture: u32,
    pub padding_0: u32,
    pub padding_1: u32,
    pub padding_2: u32,
}

/// `TextureReference` of scene/tables.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct TextureReference {
    pub uv_from_mesh: [f32; 4],
    pub translation: [f32; 2],
    pub mode: u32,
    pub layer: u32,
    pub width: u32,
    pub height: u32,
    pub padding_0: u32,
    pub padding_1: u32,
}

/// A vertex in the geometry buffer: 12 words, which are `Vertex` of scene/tables.wesl and one unused word.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Vertex {
    pub position: [f32; 3],
    pub normal: u32,
    pub tangent: u32,
    pub uv_0: [f32; 2],
    pub uv_1: [f32; 2],
    pub color: [u32; 2],
    pub padding: u32,
}

/// Octahedral encoding as two 16-bit normalized integers: CPU twin of shared/octahedral.wesl.
pub fn octahedral(direction: glam::Vec3) -> u32 {
    let d = direction / (direction.x.abs() + direction.y.abs() + direction.z.abs()).max(1e-20);
    let (x, y) = if d.z >= 0.0 {
        (d.x, d.y)
    } else {
        // -0 counts as positive, as in the shader, which compares.
        let sign = |value: f32| if value >= 0.0 { 1.0 } else { -1.0 };
        ((1.0 - d.y.abs()) * sign(d.x), (1.0 - d.x.abs()) * sign(d.y))
    };
    let snorm = |value: f32| (value.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16;
    u32::from(snorm(x)) | u32::from(snorm(y)) << 16
}
