//! Builds the rows of the scene's tables from its instances, materials and textures.

use glam::{Mat4, Vec3};
use gpugi_scene::{
    AlphaMode, Bounds, Instance, Material, MaterialModel, Scene, Sphere, TextureRef, Wrap,
};

use super::geometry::PlacedMesh;
use super::gpu;
use super::images::{ImageArrays, ImagePlace};
use crate::gpu::GpuError;

/// The sphere that each instance is, if it is one.
///
/// # Errors
/// [`GpuError::Input`] for instances that cannot be the sphere that they should be.
pub(super) fn checked_spheres(scene: &Scene) -> Result<Vec<Option<Sphere>>, GpuError> {
    scene.spheres().map_err(|(index, error)| GpuError::Input {
        what: format!("instance {:?}: {error}", scene.instances[index].name),
    })
}

pub(super) fn instance_row(
    instance: &Instance,
    mesh: &PlacedMesh,
    sphere: Option<Sphere>,
    first_merged_vertex: u32,
) -> gpu::Instance {
    let mut row = gpu::Instance {
        first_vertex_word: mesh.first_vertex_word,
        first_index_word: mesh.first_index_word,
        first_merged_vertex,
        material: instance.material as u32,
        vertex_count: mesh.vertex_count(),
        closed: u32::from(mesh.closed || sphere.is_some()),
        sphere: sphere.map_or([0.0; 4], |sphere| {
            sphere.center.extend(sphere.radius).to_array()
        }),
        ..bytemuck::Zeroable::zeroed()
    };
    set_place(&mut row, &instance.world_from_mesh);
    row
}

/// The box of an instance's mesh, and of the sphere that it may be, in mesh space.
pub(super) fn mesh_bounds(row: &gpu::Instance, mesh: &PlacedMesh) -> Bounds {
    let [x, y, z, radius] = row.sphere;
    let center = Vec3::new(x, y, z);
    let sphere = (radius > 0.0).then(|| Sphere { center, radius }.bounds());
    sphere.map_or(mesh.bounds, |sphere| sphere.union(mesh.bounds))
}

/// Writes into an instance's row where it is.
pub(super) fn set_place(row: &mut gpu::Instance, world_from_mesh: &Mat4) {
    row.world_from_mesh_0 = world_from_mesh.row(0).to_array();
    row.world_from_mesh_1 = world_from_mesh.row(1).to_array();
    row.world_from_mesh_2 = world_from_mesh.row(2).to_array();
    row.mirrored = u32::from(is_mirrored(world_from_mesh));
}

pub(super) fn is_mirrored(matrix: &Mat4) -> bool {
    glam::Mat3::from_mat4(*matrix).determinant() < 0.0
}

/// Textures that a material may read.
pub(super) const TEXTURE_SLOTS: usize = 9;

/// A material's textures, and whether each holds colours (space 0) or data (space 1).
pub(super) fn texture_slots(material: &Material) -> [(&Option<TextureRef>, usize); TEXTURE_SLOTS] {
    [
        (&material.base_color_texture, 0),
        (&material.metallic_roughness_texture, 1),
        (&material.normal_texture, 1),
        (&material.emissive_texture, 0),
        (&material.specular_texture, 1),
        (&material.specular_color_texture, 0),
        (&material.transmission_texture, 1),
        (&material.diffuse_transmission_texture, 1),
        (&material.diffuse_transmission_color_texture, 0),
    ]
}

/// The row of a material and those of its textures; zeros for the textures that it does not read.
pub(super) fn material_row(
    scene: &Scene,
    index: usize,
    images: &ImageArrays,
) -> (gpu::Material, [gpu::TextureReference; TEXTURE_SLOTS]) {
    let material = &scene.materials[index];
    let slots = texture_slots(material);
    let textures = slots.map(|(texture, space)| match texture {
        None => bytemuck::Zeroable::zeroed(),
        Some(texture) => texture_row(scene, texture, images, space),
    });
    let reference = |slot: usize| match slots[slot].0 {
        None => u32::MAX,
        Some(_) => (index * TEXTURE_SLOTS + slot) as u32,
    };
    let (model, model_a, model_b, shininess) = match material.model {
        MaterialModel::MetallicRoughness => (0, Vec3::ZERO, Vec3::ZERO, 0.0),
        MaterialModel::Phong { kd, ks, shininess } => (1, kd, ks, shininess),
        MaterialModel::Conductor { n, k } => (2, n, k, 0.0),
        MaterialModel::Blinn { kd, ks, shininess } => (3, kd, ks, shininess),
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
    let row = gpu::Material {
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
        double_sided: u32::from(material.has_two_sides()),
        base_color_texture: reference(0),
        metallic_roughness_texture: reference(1),
        normal_texture: reference(2),
        emissive_texture: reference(3),
        specular_texture: reference(4),
        specular_color_texture: reference(5),
        transmission_texture: reference(6),
        solid: u32::from(material.volume.is_some()),
        diffuse_transmission_texture: reference(7),
        absorption: material
            .volume
            .map_or(Vec3::ZERO, |volume| volume.absorption())
            .to_array(),
        ior: material.ior,
        diffuse_transmission_color: material.diffuse_transmission_color.to_array(),
        diffuse_transmission: material.diffuse_transmission,
        diffuse_transmission_color_texture: reference(8),
        padding_0: 0,
        padding_1: 0,
        padding_2: 0,
    };
    (row, textures)
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
