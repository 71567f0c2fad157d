//! Checks for input that cannot be rendered.

use std::fmt::Debug;

use glam::Mat4;
use gpugi_scene::{Edit, Light, LightKind, Material, MaterialModel, Pixels, Scene};

use crate::gpu::GpuError;
use crate::scene::{check_environment, check_media};

/// Rejects scenes that would silently make the whole image infinite or black.
pub fn check(scene: &Scene) -> Result<(), GpuError> {
    scene.lights.iter().try_for_each(check_light)?;
    scene.materials.iter().try_for_each(check_material)?;
    for instance in &scene.instances {
        check_place(&instance.world_from_mesh, &instance.name)?;
    }
    check_media(&scene.media)?;
    check_environment(scene.environment.as_ref())?;
    check_texels(scene)
}

/// Rejects edits for whose values [`check`] would reject the scene.
pub fn check_edit(edit: &Edit) -> Result<(), GpuError> {
    match edit {
        Edit::Instance {
            index,
            world_from_mesh,
        } => check_place(world_from_mesh, index),
        Edit::Material { material, .. } => check_material(material),
        Edit::Light { light, .. } => check_light(light),
        Edit::Lights(lights) => lights.iter().try_for_each(check_light),
        // Any upload checks these.
        Edit::Mesh { .. } | Edit::Environment(_) | Edit::Media(_) | Edit::Camera { .. } => Ok(()),
    }
}

/// Rejects images without pixels.
pub fn check_size(size: [u32; 2]) -> Result<(), GpuError> {
    if size.contains(&0) {
        let what = format!(
            "a picture of {} x {} pixels shows nothing",
            size[0], size[1]
        );
        return Err(GpuError::Input { what });
    }
    Ok(())
}

fn refuse(what: String) -> Result<(), GpuError> {
    Err(GpuError::Input { what })
}

fn check_light(light: &Light) -> Result<(), GpuError> {
    let is_finite = light.intensity.is_finite()
        && light.world_from_light.is_finite()
        && light.radius.is_finite()
        && !light.range.is_some_and(f32::is_nan)
        && has_finite_cone(&light.kind);
    match is_finite {
        true => Ok(()),
        false => refuse(format!("light {:?} is not finite", light.name)),
    }
}

fn check_material(material: &Material) -> Result<(), GpuError> {
    let name = &material.name;
    if !material.emissive.is_finite() {
        return refuse(format!("the emission of material {name:?} is not finite"));
    }
    if !reflects_finitely(material) {
        return refuse(format!(
            "what material {name:?} reflects or transmits is not finite"
        ));
    }
    Ok(())
}

fn check_place(world_from_mesh: &Mat4, name: &dyn Debug) -> Result<(), GpuError> {
    match world_from_mesh.is_finite() {
        true => Ok(()),
        false => refuse(format!("the transform of instance {name:?} is not finite")),
    }
}

fn check_texels(scene: &Scene) -> Result<(), GpuError> {
    if let Some(environment) = &scene.environment
        && let Pixels::Rgba32Float(values) = &environment.image.pixels
        && let Some(value) = values.iter().position(|value| !value.is_finite())
    {
        let what = format!(
            "texel {} of environment {:?} is not finite",
            value / 4,
            environment.image.name
        );
        return Err(GpuError::Input { what });
    }
    Ok(())
}

fn has_finite_cone(kind: &LightKind) -> bool {
    match kind {
        LightKind::Spot {
            inner_cone_angle,
            outer_cone_angle,
        } => inner_cone_angle.is_finite() && outer_cone_angle.is_finite(),
        LightKind::Point | LightKind::Directional => true,
    }
}

fn reflects_finitely(material: &Material) -> bool {
    let of_model = match material.model {
        MaterialModel::MetallicRoughness => true,
        MaterialModel::Phong { kd, ks, shininess } | MaterialModel::Blinn { kd, ks, shininess } => {
            kd.is_finite() && ks.is_finite() && shininess.is_finite()
        }
        MaterialModel::Conductor { n, k } => n.is_finite() && k.is_finite(),
    };
    let numbers = [
        material.metallic,
        material.roughness,
        material.normal_scale,
        material.ior,
        material.specular,
        material.transmission,
        material.diffuse_transmission,
    ];
    of_model
        && material.base_color.is_finite()
        && material.specular_color.is_finite()
        && material.diffuse_transmission_color.is_finite()
        && numbers.iter().all(|number| number.is_finite())
}
