//! Transfer vectors as array textures in buffer views, and what they mean in `extras` (docs/relight.md).

use half::f16;
use serde_json::json;

use super::material::own_extras;
use super::output::Output;
use super::texels;
use crate::Resolver;
use crate::export::{ExportError, TransferFormat};
use crate::image::{ArrayTexels, encode_array};
use crate::import::gltf::transfer::{BASIS, NAME, VERSION};
use crate::transfer::{TransferVectors, geometry};

/// Transfer vectors, and how the file stores them.
#[derive(Clone, Copy)]
pub struct Transfer<'a> {
    pub vectors: &'a TransferVectors,
    pub format: TransferFormat,
}

/// Adds the textures, and the extras of the file, whose materials know already where the texels are.
pub fn add(
    output: &mut Output,
    Transfer { vectors, format }: Transfer,
    resolver: &dyn Resolver,
) -> Result<(), ExportError> {
    let (scene, atlas) = texels::imported(output, resolver, NAME, &vectors.atlas)?;
    let geometry = geometry(&scene, &atlas);
    let functions = vectors.functions();
    let texels = vectors.texels_per_page();
    let side = vectors.atlas.size;
    let scale = match format {
        TransferFormat::Half => None,
        TransferFormat::Byte => Some(scales(vectors)),
    };
    let mut pages = Vec::new();
    for (number, page) in vectors.coefficients.chunks(texels * functions).enumerate() {
        let texels = match &scale {
            None => ArrayTexels::Half(page.to_vec()),
            Some(scale) => {
                let layers = page.chunks(texels).zip(scale);
                let bytes = layers
                    .flat_map(|(layer, scale)| layer.iter().map(|texel| bytes(texel, *scale)));
                ArrayTexels::Byte(bytes.collect())
            }
        };
        let file = encode_array(side, functions as u32, &texels)
            .map_err(|reason| ExportError::new(format!("pages[{number}]"), reason))?;
        pages.push(texels::part(output, &file)?);
    }
    let mut extras = json!({
        "version": VERSION,
        "basis": BASIS,
        "order": vectors.order,
        "bounces": vectors.bounces,
        "size": side,
        "geometry": texels::hex(geometry),
        "pages": pages,
    });
    if let Some(scale) = scale {
        extras["scale"] = json!(scale);
    }
    own_extras(output.json.root()).insert(NAME.to_owned(), extras);
    Ok(())
}

/// The largest absolute value of each function.
fn scales(vectors: &TransferVectors) -> Vec<f32> {
    let mut scales = vec![0.0_f32; vectors.functions()];
    let layers = vectors.coefficients.chunks(vectors.texels_per_page());
    for (layer, texels) in layers.enumerate() {
        let scale = &mut scales[layer % vectors.functions()];
        for [rgb @ .., _] in texels {
            let largest = rgb.iter().map(|channel| channel.to_f32().abs());
            *scale = largest.fold(*scale, f32::max);
        }
    }
    scales
}

/// Signed fractions of `scale` in 8 bits.
fn bytes([red, green, blue, point]: &[f16; 4], scale: f32) -> [i8; 4] {
    let scale = if scale > 0.0 { scale } else { 1.0 };
    let byte = |value: &f16| (value.to_f32() / scale * 127.0).round() as i8;
    [byte(red), byte(green), byte(blue), byte_of_point(point)]
}

fn byte_of_point(point: &f16) -> i8 {
    if *point > f16::ZERO { 127 } else { 0 }
}
