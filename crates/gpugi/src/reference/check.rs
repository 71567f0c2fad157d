//! Checks for input that cannot be rendered.

use gpugi_scene::{LightKind, Material, MaterialModel, Pixels, Scene};

use crate::gpu::GpuError;
use crate::scene::{check_environment, check_media};

/// Rejects scenes that would silently make the whole image infinite or black.
pub fn check(scene: &Scene) -> Result<(), GpuError> {
    check_values(scene)?;
    check_texels(scene)
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

/// What [`check`] says of all but the environment's image, which takes long.
pub fn check_values(scene: &Scene) -> Result<(), GpuError> {
    let refuse = |what: String| Err(GpuError::Input { what });
    for light in &scene.lights {
        let is_finite = light.intensity.is_finite()
            && light.world_from_light.is_finite()
            && light.radius.is_finite()
            && !light.range.is_some_and(f32::is_nan)
            && has_finite_cone(&light.kind);
        if !is_finite {
            return refuse(format!("light {:?} is not finite", light.name));
        }
    }
    for material in &scene.materials {
        if !material.emissive.is_finite() {
            return refuse(format!(
                "the emission of material {:?} is not finite",
                material.name
            ));
        }
        if !reflects_finitely(material) {
            return refuse(format!(
                "what material {:?} reflects or transmits is not finite",
                material.name
            ));
        }
    }
    for instance in &scene.instances {
        if !instance.world_from_mesh.is_finite() {
            return refuse(format!(
                "the transform of instance {:?} is not finite",
                instance.name
            ));
        }
    }
    check_media(scene)?;
    check_environment(scene.environment.as_ref())
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
        MaterialModel::Phong { kd, ks, shininess } => {
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
