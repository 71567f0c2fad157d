//! Builds the rows of the scene's tables from its instances, materials and textures.

use glam::{Mat4, Vec3};
use gpugi_scene::{AlphaMode, Instance, Material, MaterialModel, Scene, TextureRef, Wrap};

use super::gpu;
use super::images::{ImageArrays, ImagePlace};
use super::upload::PlacedMesh;

pub(super) fn instance_row(
    instance: &Instance,
    mesh: &PlacedMesh,
    first_merged_vertex: u32,
) -> gpu::Instance {
    let matrix = instance.world_from_mesh;
    gpu::Instance {
        world_from_mesh_0: matrix.row(0).to_array(),
        world_from_mesh_1: matrix.row(1).to_array(),
        world_from_mesh_2: matrix.row(2).to_array(),
        first_vertex_word: mesh.first_vertex_word,
        first_index_word: mesh.first_index_word,
        first_merged_vertex,
        material: instance.material as u32,
        vertex_count: mesh.vertex_count,
        mirrored: u32::from(is_mirrored(&matrix)),
        closed: u32::from(mesh.closed),
        claims: 0,
    }
}

pub(super) fn is_mirrored(matrix: &Mat4) -> bool {
    glam::Mat3::from_mat4(*matrix).determinant() < 0.0
}

pub(super) fn material_row(
    scene: &Scene,
    material: &Material,
    images: &ImageArrays,
    textures: &mut Vec<gpu::TextureReference>,
) -> gpu::Material {
    let mut reference = |texture: &Option<TextureRef>, space: usize| match texture {
        None => u32::MAX,
        Some(texture) => {
            textures.push(texture_row(scene, texture, images, space));
            textures.len() as u32 - 1
        }
    };
    let (model, model_a, model_b, shininess) = match material.model {
        MaterialModel::MetallicRoughness => (0, Vec3::ZERO, Vec3::ZERO, 0.0),
        MaterialModel::Phong { kd, ks, shininess } => (1, kd, ks, shininess),
        MaterialModel::Conductor { n, k } => (2, n, k, 0.0),
    };
    // KHR_materials_ior: an index of 0 stands for a reflectance of 1 at normal incidence.
    let dielectric_f0 = if material.ior == 0.0 {
        1.0
    } else {
        ((material.ior - 1.0) / (material.ior + 1.0)).powi(2)
    };
    let (alpha_mode, alpha_cutoff) = match material.alpha_mode {
        AlphaMode::Opaque => (0, 0.0),
        AlphaMode::Mask { cutoff } => (1, cutoff),
        AlphaMode::Blend => (2, 0.0),
    };
    gpu::Material {
        base_color: material.base_color.to_array(),
        emissive: material.emissive.to_array(),
        alpha_cutoff,
        metallic: material.metallic,
        roughness: material.roughness,
        dielectric_f0,
        specular: material.specular,
        specular_color: material.specular_color.to_array(),
        transmission: material.transmission,
        model_a: model_a.to_array(),
        shininess,
        model_b: model_b.to_array(),
        normal_scale: material.normal_scale,
        model,
        alpha_mode,
        double_sided: u32::from(material.double_sided),
        base_color_texture: reference(&material.base_color_texture, 0),
        metallic_roughness_texture: reference(&material.metallic_roughness_texture, 1),
        normal_texture: reference(&material.normal_texture, 1),
        emissive_texture: reference(&material.emissive_texture, 0),
        specular_texture: reference(&material.specular_texture, 1),
        specular_color_texture: reference(&material.specular_color_texture, 0),
        transmission_texture: reference(&material.transmission_texture, 1),
        solid: u32::from(material.volume.is_some()),
        padding: 0,
        absorption: material
            .volume
            .map_or(Vec3::ZERO, |volume| volume.absorption())
            .to_array(),
        ior: material.ior,
    }
}

fn texture_row(
    scene: &Scene,
    reference: &TextureRef,
    images: &ImageArrays,
    space: usize,
) -> gpu::TextureReference {
    let texture = &scene.textures[reference.texture];
    let image = &scene.images[texture.image];
    let place = images.places[texture.image][space].unwrap_or(ImagePlace { class: 0, layer: 0 });
    let wrap = |wrap: Wrap| match wrap {
        Wrap::Repeat => 0,
        Wrap::MirroredRepeat => 1,
        Wrap::ClampToEdge => 2,
    };
    gpu::TextureReference {
        uv_from_mesh: reference.uv_from_mesh.matrix2.to_cols_array(),
        translation: reference.uv_from_mesh.translation.to_array(),
        mode: place.class
            | u32::from(texture.nearest) << 3
            | wrap(texture.wrap[0]) << 4
            | wrap(texture.wrap[1]) << 6
            | reference.uv_set.min(1) << 8
            | u32::from(!texture.has_levels) << 9,
        layer: place.layer,
        width: image.width,
        height: image.height,
        padding_0: 0,
        padding_1: 0,
    }
}
