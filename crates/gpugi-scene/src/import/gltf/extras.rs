//! `extras.gpugi`: what gpugi's own scenes store beyond glTF.

use glam::Vec3;
use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::Value;

use super::document::Document;
use crate::lens::{Lens, shutter};
use crate::{ImportError, MaterialModel};

#[derive(Deserialize)]
struct MaterialExtras {
    phong: Option<Phong>,
    blinn: Option<Phong>,
    conductor: Option<Conductor>,
}

/// Of Phong's model and of Blinn's.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Phong {
    kd: Vec3,
    ks: Vec3,
    shininess: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Conductor {
    n: Vec3,
    k: Vec3,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NodeExtras {
    #[serde(default)]
    sphere: bool,
    /// media.rs reads it.
    #[serde(rename = "medium")]
    _medium: Option<IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LightExtras {
    #[serde(default)]
    radius: f32,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct CameraExtras {
    aperture: f32,
    focus: Option<f32>,
    blades: u32,
    shutter: f32,
}

/// The reflection model that a material's extras select.
pub fn material_model(
    document: &Document,
    extras: &Value,
    place: &str,
) -> Result<MaterialModel, ImportError> {
    let Some(value) = extras.get("gpugi") else {
        return Ok(MaterialModel::MetallicRoughness);
    };
    let place = format!("{place}.extras.gpugi");
    let extras =
        MaterialExtras::deserialize(value).map_err(|error| document.error(&place, error))?;
    let wrong = |reason: &str| Err(document.error(&place, reason));
    let is_blinn = extras.blinn.is_some();
    match (extras.phong, extras.blinn, extras.conductor) {
        (None, None, None) => Ok(MaterialModel::MetallicRoughness),
        (Some(Phong { kd, ks, shininess }), None, None)
        | (None, Some(Phong { kd, ks, shininess }), None) => {
            // Tolerate rounding errors in kd + ks.
            let keeps_energy = (kd + ks).cmple(Vec3::splat(1.0 + 1e-4)).all();
            let is_positive = kd.cmpge(Vec3::ZERO).all() && ks.cmpge(Vec3::ZERO).all();
            if !keeps_energy || !is_positive {
                return wrong("kd and ks must not be negative, and kd + ks at most 1");
            }
            if !shininess.is_finite() || shininess < 0.0 {
                return wrong("shininess must be finite and not negative");
            }
            Ok(match is_blinn {
                true => MaterialModel::Blinn { kd, ks, shininess },
                false => MaterialModel::Phong { kd, ks, shininess },
            })
        }
        (None, None, Some(Conductor { n, k })) => {
            let is_metal = n.is_finite()
                && k.is_finite()
                && n.cmpgt(Vec3::ZERO).all()
                && k.cmpge(Vec3::ZERO).all();
            if !is_metal {
                return wrong("n must be positive, k not negative, both finite");
            }
            Ok(MaterialModel::Conductor { n, k })
        }
        _ => wrong("a material is one of phong, blinn and conductor"),
    }
}

/// Whether a node's extras make a sphere of its mesh.
pub fn is_sphere(document: &Document, extras: &Value, place: &str) -> Result<bool, ImportError> {
    let Some(value) = extras.get("gpugi") else {
        return Ok(false);
    };
    let place = format!("{place}.extras.gpugi");
    let extras = NodeExtras::deserialize(value).map_err(|error| document.error(place, error))?;
    Ok(extras.sphere)
}

/// The radius of the emitter, from a light's extras: (m), or (rad) for a directional light. 0 if there is none.
pub fn light_radius(document: &Document, extras: &Value, place: &str) -> Result<f32, ImportError> {
    let Some(value) = extras.get("gpugi") else {
        return Ok(0.0);
    };
    let place = format!("{place}.extras.gpugi");
    let extras = LightExtras::deserialize(value).map_err(|error| document.error(&place, error))?;
    if !extras.radius.is_finite() || extras.radius < 0.0 {
        return Err(document.error(place, "radius must be finite and not negative"));
    }
    Ok(extras.radius)
}

/// The lens of camera `index`, and the time for which its shutter is open (s), from its extras.
pub fn lens(document: &Document, extras: &Value, index: usize) -> Result<(Lens, f32), ImportError> {
    let Some(value) = extras.get("gpugi") else {
        return Ok((Lens::PINHOLE, 0.0));
    };
    let place = format!("cameras[{index}].extras.gpugi");
    let extras = CameraExtras::deserialize(value).map_err(|error| document.error(&place, error))?;
    if extras.aperture > 0.0 && extras.focus.is_none() {
        return Err(document.error(
            format!("{place}.focus"),
            "an aperture needs the distance at which the camera sees sharply (m)",
        ));
    }
    let lens = Lens::new(extras.aperture, extras.focus.unwrap_or(1.0), extras.blades);
    let both = lens.and_then(|lens| Ok((lens, shutter(extras.shutter)?)));
    both.map_err(|error| document.error(place, error))
}
