//! `extras.gpugi.radianceTransfer`: transfer vectors that `gpugi bake` stored (docs/relight.md).

use std::sync::Arc;

use half::f16;
use serde::Deserialize;

use super::document::Document;
use super::texels::{self, Part};
use crate::image::{decode_byte, decode_half};
use crate::transfer::{MOST_BOUNCES, ORDERS, TransferVectors};
use crate::{ImportError, Scene};

/// The name of the extras, of the file and of its materials.
pub const NAME: &str = "radianceTransfer";
/// The version of what is stored.
pub const VERSION: u32 = 1;
/// The functions that are read.
pub const BASIS: &str = "spherical harmonics";

/// Extras of the file.
#[derive(Deserialize)]
struct FileExtras {
    version: u32,
    basis: String,
    order: u32,
    bounces: u32,
    size: u32,
    /// For 8-bit texels: the value of 1 of each function.
    scale: Option<Vec<f32>>,
    geometry: String,
    pages: Vec<Part>,
}

/// Reads the vectors, if the file has any, and checks that they belong to `scene`, which is what the file gives.
pub fn read(
    document: &Document,
    scene: &Scene,
) -> Result<Option<Arc<TransferVectors>>, ImportError> {
    let Some(extras) = texels::extras::<FileExtras>(document, NAME)? else {
        return Ok(None);
    };
    let place = format!("extras.gpugi.{NAME}");
    let error = |reason: String| document.error(&place, reason);
    texels::check_version(extras.version, VERSION).map_err(error)?;
    if extras.basis != BASIS {
        return Err(error(format!(
            "the basis \"{}\" is not read, \"{BASIS}\" is",
            crate::import::quoted(&extras.basis)
        )));
    }
    if !ORDERS.contains(&extras.order) || !(1..=MOST_BOUNCES).contains(&extras.bounces) {
        return Err(error(format!(
            "order {} and {} bounces: 2 to 8 and 1 to {MOST_BOUNCES} are read",
            extras.order, extras.bounces
        )));
    }
    texels::check_size(extras.size, extras.pages.len()).map_err(error)?;
    let functions = extras.order * extras.order;
    let is_scale = |scale: &Vec<f32>| {
        scale.len() == functions as usize && scale.iter().all(|factor| factor.is_finite())
    };
    if !extras.scale.as_ref().is_none_or(is_scale) {
        return Err(error(format!("scale needs {functions} finite numbers")));
    }
    let mut coefficients = Vec::new();
    for (number, page) in extras.pages.iter().enumerate() {
        let place = format!("{place}.pages[{number}]");
        let error = |reason: String| document.error(&place, reason);
        let bytes = page.bytes(document, &place)?;
        // The copy that is decoded first, and what is kept.
        document.charge(bytes.len() as u64, 4, &place)?;
        match &extras.scale {
            None => {
                coefficients.extend(decode_half(bytes, extras.size, functions).map_err(error)?);
            }
            Some(scale) => {
                let texels = decode_byte(bytes, extras.size, functions).map_err(error)?;
                let layer = (extras.size as usize).pow(2);
                for (texels, scale) in texels.chunks(layer).zip(scale) {
                    coefficients.extend(texels.iter().map(|&texel| from_bytes(texel, *scale)));
                }
            }
        }
    }
    let is_finite = |texel: &[f16; 4]| texel.iter().all(|channel| channel.is_finite());
    if !coefficients.iter().all(is_finite) {
        return Err(error("coefficients that are not finite".to_owned()));
    }
    let pages = extras.pages.len() as u32;
    let atlas = texels::atlas(document, scene, NAME, extras.size, pages)?;
    let vectors = TransferVectors {
        order: extras.order,
        bounces: extras.bounces,
        atlas: Arc::new(atlas),
        coefficients,
        geometry: texels::hash("geometry", &extras.geometry).map_err(error)?,
    };
    vectors
        .check(scene)
        .map_err(|reason| error(format!("the transfer vectors do not fit: {reason}")))?;
    Ok(Some(Arc::new(vectors)))
}

/// 8-bit values as signed fractions of `scale`.
fn from_bytes([red, green, blue, point]: [i8; 4], scale: f32) -> [f16; 4] {
    let value = |byte: i8| f16::from_f32((f32::from(byte) / 127.0).max(-1.0) * scale);
    let point = f16::from_f32(if point > 0 { 1.0 } else { 0.0 });
    [value(red), value(green), value(blue), point]
}
