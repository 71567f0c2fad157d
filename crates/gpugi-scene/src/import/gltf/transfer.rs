//! `extras.gpugi.radianceTransfer`: transfer vectors that `gpugi bake` stored (docs/relight.md).

use std::collections::HashMap;
use std::sync::Arc;

use glam::Vec2;
use half::f16;
use serde::Deserialize;

use super::document::Document;
use super::geometry;
use crate::atlas::{InstanceUvs, LARGEST_PAGE, NO_CHART};
use crate::image::{ArrayTexels, decode_array};
use crate::transfer::{MOST_BOUNCES, ORDERS, TransferVectors};
use crate::{Atlas, ImportError, Origin, Scene};

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
    pages: Vec<Page>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Page {
    buffer_view: usize,
    blake3: String,
}

/// Extras of a material.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct MaterialExtras {
    page: u32,
    tex_coord: u32,
}

/// Reads the vectors, if the file has any, and checks that they belong to `scene`, which is what the file gives.
pub fn read(
    document: &Document,
    scene: &Scene,
) -> Result<Option<Arc<TransferVectors>>, ImportError> {
    let Some(value) = document
        .root
        .extras
        .get("gpugi")
        .and_then(|own| own.get(NAME))
    else {
        return Ok(None);
    };
    let place = format!("extras.gpugi.{NAME}");
    let error = |reason: String| document.error(&place, reason);
    let extras = FileExtras::deserialize(value).map_err(|reason| error(reason.to_string()))?;
    if extras.version != VERSION {
        return Err(error(format!(
            "version {} is not read, {VERSION} is",
            extras.version
        )));
    }
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
    if !(1..=LARGEST_PAGE).contains(&extras.size) || extras.pages.is_empty() {
        return Err(error(format!(
            "{} pages of {} texels a side: at least one, of 1 to {LARGEST_PAGE}",
            extras.pages.len(),
            extras.size
        )));
    }
    let functions = extras.order * extras.order;
    let is_scale = |scale: &Vec<f32>| {
        scale.len() == functions as usize && scale.iter().all(|one| one.is_finite())
    };
    if !extras.scale.as_ref().is_none_or(is_scale) {
        return Err(error(format!("scale needs {functions} finite numbers")));
    }
    let mut coefficients = Vec::new();
    for (number, page) in extras.pages.iter().enumerate() {
        let place = format!("{place}.pages[{number}]");
        let error = |reason: String| document.error(&place, reason);
        let (bytes, _) = document.view(page.buffer_view, &place)?;
        if blake3::hash(bytes).to_hex().as_str() != page.blake3 {
            return Err(error(
                "the coefficients are damaged: their checksum is wrong; bake them again".to_owned(),
            ));
        }
        // The copy that is decoded first, and what is kept.
        document.charge(bytes.len() as u64, 4, &place)?;
        let is_half = extras.scale.is_none();
        let texels = decode_array(bytes, extras.size, functions, is_half).map_err(error)?;
        match (texels, &extras.scale) {
            (ArrayTexels::Half(texels), _) => coefficients.extend(texels),
            (ArrayTexels::Byte(texels), scale) => {
                let layer = (extras.size as usize).pow(2);
                let scales = scale.iter().flatten();
                for (texels, scale) in texels.chunks(layer).zip(scales) {
                    coefficients.extend(texels.iter().map(|&texel| from_bytes(texel, *scale)));
                }
            }
        }
    }
    let is_finite = |texel: &[f16; 4]| texel.iter().all(|one| one.is_finite());
    if !coefficients.iter().all(is_finite) {
        return Err(error("coefficients that are not finite".to_owned()));
    }
    let atlas = atlas(document, scene, extras.size, extras.pages.len() as u32)?;
    let geometry = blake3::Hash::from_hex(&extras.geometry);
    let vectors = TransferVectors {
        order: extras.order,
        bounces: extras.bounces,
        atlas: Arc::new(atlas),
        coefficients,
        geometry: *geometry
            .map_err(|reason| error(format!("geometry: {reason}")))?
            .as_bytes(),
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

/// The atlas that the materials' extras describe: page and texture coordinates of each instance.
pub fn atlas(
    document: &Document,
    scene: &Scene,
    size: u32,
    pages: u32,
) -> Result<Atlas, ImportError> {
    let mut known: HashMap<(usize, usize), Option<InstanceUvs>> = HashMap::new();
    let mut instances = Vec::with_capacity(scene.instances.len());
    for instance in &scene.instances {
        let Some(Origin {
            node, primitive, ..
        }) = instance.origin
        else {
            instances.push(None);
            continue;
        };
        let mesh = document.root.nodes[node].mesh.unwrap_or(usize::MAX);
        let uvs = match known.get(&(mesh, primitive)) {
            Some(uvs) => uvs,
            None => {
                let uvs = of_primitive(document, mesh, primitive, pages)?;
                known.entry((mesh, primitive)).or_insert(uvs)
            }
        };
        let corners = uvs.as_ref().map_or(0, |uvs| uvs.corners.len() as u64);
        document.charge(corners, size_of::<Vec2>() + 4, &format!("nodes[{node}]"))?;
        instances.push(uvs.clone());
    }
    Ok(Atlas {
        size,
        pages,
        instances,
        backs: Vec::new(),
    })
}

/// Where a primitive lies; `None` if it is not in the atlas.
fn of_primitive(
    document: &Document,
    mesh: usize,
    primitive: usize,
    pages: u32,
) -> Result<Option<InstanceUvs>, ImportError> {
    let root = &document.root;
    let source = &root.meshes[mesh].primitives[primitive];
    let Some(material) = source.material else {
        return Ok(None);
    };
    let place = format!("materials[{material}].extras.gpugi.{NAME}");
    let extras = &root.materials[material].extras;
    let Some(value) = extras.get("gpugi").and_then(|own| own.get(NAME)) else {
        return Ok(None);
    };
    let error = |reason: String| document.error(&place, reason);
    let extras = MaterialExtras::deserialize(value).map_err(|reason| error(reason.to_string()))?;
    if extras.page >= pages {
        return Err(error(format!("page {} of {pages}", extras.page)));
    }
    let place = format!("meshes[{mesh}].primitives[{primitive}]");
    let name = format!("TEXCOORD_{}", extras.tex_coord);
    let accessor = source.attributes.get(&name);
    let accessor =
        *accessor.ok_or_else(|| document.error(&place, format!("there is no {name}")))?;
    let (count, vertices) = geometry::triangle_corners(document, source, &place)?;
    document.charge(count, size_of::<Vec2>(), &place)?;
    let uvs = document.floats::<2>(accessor, &place)?;
    if uvs.len() as u64 != count {
        let reason = format!("{name} has {} elements for {count} vertices", uvs.len());
        return Err(document.error(&place, reason));
    }
    document.charge(vertices.len() as u64, size_of::<Vec2>() + 4, &place)?;
    let corners: Vec<Vec2> = vertices
        .iter()
        .map(|&vertex| uvs[vertex as usize].into())
        .collect();
    let charts = corners.as_chunks::<3>().0.iter().map(|&[a, b, c]| {
        let has_area = (b - a).perp_dot(c - a) != 0.0;
        if has_area { 0 } else { NO_CHART }
    });
    Ok(Some(InstanceUvs {
        page: extras.page,
        charts: charts.collect(),
        corners,
    }))
}
