//! `extras.gpugi.lightPathMap`: panes that `gpugi bake` stored (docs/panes.md).

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::Deserialize;

use super::document::Document;
use super::texels::{self, Part};
use crate::image::decode_shared_exponent;
use crate::panes::{LightPathPanes, SurfacePlace};
use crate::{ImportError, Origin, Scene};

/// The name of the extras, of the file and of its materials.
pub const NAME: &str = "lightPathMap";
/// The version of what is stored.
pub const VERSION: u32 = 1;

/// Words of a point: node, primitive, triangle, and two barycentrics.
const WORDS: usize = 5;

/// Extras of the file.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct FileExtras {
    version: u32,
    depth: u32,
    size: u32,
    entries: u32,
    clusters: Part,
    points: Part,
    geometry: String,
    materials: String,
    pages: Vec<Part>,
}

/// Reads the panes, if the file has any, and checks that they belong to `scene`, which is what the file gives.
pub fn read(
    document: &Document,
    scene: &Scene,
) -> Result<Option<Arc<LightPathPanes>>, ImportError> {
    let Some(extras) = texels::extras::<FileExtras>(document, NAME)? else {
        return Ok(None);
    };
    let place = format!("extras.gpugi.{NAME}");
    let error = |reason: String| document.error(&place, reason);
    texels::check_version(extras.version, VERSION).map_err(error)?;
    texels::check_size(extras.size, extras.pages.len()).map_err(error)?;
    let firsts = words(document, &extras.clusters, &format!("{place}.clusters"))?;
    let (firsts, first_samples) = firsts.split_at(firsts.len() / 2);
    let points = points(document, scene, &extras.points, &format!("{place}.points"))?;
    let Some((entries, samples)) = points.split_at_checked(extras.entries as usize) else {
        let reason = format!(
            "{} points, of which {} are entry points",
            points.len(),
            extras.entries
        );
        return Err(error(reason));
    };
    let clusters = firsts.len().saturating_sub(1);
    let panes = panes(document, &extras, clusters as u32)?;
    let pages = extras.pages.len() as u32;
    let panes = LightPathPanes {
        atlas: Arc::new(texels::atlas(document, scene, NAME, extras.size, pages)?),
        depth: extras.depth,
        entries: entries.to_vec(),
        samples: samples.to_vec(),
        firsts: firsts.to_vec(),
        first_samples: first_samples.to_vec(),
        panes,
        geometry: texels::hash("geometry", &extras.geometry).map_err(error)?,
        materials: texels::hash("materials", &extras.materials).map_err(error)?,
    };
    panes
        .check(scene)
        .map_err(|reason| error(format!("the panes do not fit: {reason}")))?;
    Ok(Some(Arc::new(panes)))
}

/// Stored 32-bit words.
fn words(document: &Document, part: &Part, place: &str) -> Result<Vec<u32>, ImportError> {
    let bytes = part.bytes(document, place)?;
    document.charge(bytes.len() as u64, 1, place)?;
    let (words, rest) = bytes.as_chunks::<4>();
    if !rest.is_empty() {
        let reason = format!("{} bytes are no 32-bit numbers", bytes.len());
        return Err(document.error(place, reason));
    }
    Ok(words.iter().map(|word| u32::from_le_bytes(*word)).collect())
}

/// Points, which the file places on nodes and primitives of their meshes.
fn points(
    document: &Document,
    scene: &Scene,
    part: &Part,
    place: &str,
) -> Result<Vec<SurfacePlace>, ImportError> {
    let words = words(document, part, place)?;
    let (points, rest) = words.as_chunks::<WORDS>();
    if !rest.is_empty() {
        let reason = format!("{} numbers: {WORDS} for each point are needed", words.len());
        return Err(document.error(place, reason));
    }
    document.charge(points.len() as u64, size_of::<SurfacePlace>(), place)?;
    let instances = scene.instances.iter().zip(0_u32..);
    let instances: BTreeMap<Origin, u32> = instances
        .filter_map(|(instance, number)| Some((instance.origin?, number)))
        .collect();
    let place_of = |&[node, primitive, triangle, u, v]: &[u32; WORDS]| {
        let origin = Origin {
            node: node as usize,
            place: None,
            primitive: primitive as usize,
        };
        let instance = *instances.get(&origin).ok_or_else(|| {
            let reason = format!("there is no primitive {primitive} of nodes[{node}] in the scene");
            document.error(place, reason)
        })?;
        Ok(SurfacePlace {
            instance,
            triangle,
            barycentrics: [u, v].map(f32::from_bits),
        })
    };
    points.iter().map(place_of).collect()
}

/// All panes, pane by pane; files have them page by page.
fn panes(document: &Document, extras: &FileExtras, clusters: u32) -> Result<Vec<u32>, ImportError> {
    let mut pages = Vec::new();
    for (number, page) in extras.pages.iter().enumerate() {
        let place = format!("extras.gpugi.{NAME}.pages[{number}]");
        let bytes = page.bytes(document, &place)?;
        // The copy that is decoded first, and what is kept.
        document.charge(bytes.len() as u64, 2, &place)?;
        let layers = decode_shared_exponent(bytes, extras.size, clusters);
        pages.push(layers.map_err(|reason| document.error(&place, reason))?);
    }
    let page_texels = (extras.size as usize).pow(2);
    let layers = (0..clusters as usize).map(|pane| pane * page_texels..(pane + 1) * page_texels);
    let panes = layers.flat_map(|layer| pages.iter().flat_map(move |page| &page[layer.clone()]));
    Ok(panes.copied().collect())
}
