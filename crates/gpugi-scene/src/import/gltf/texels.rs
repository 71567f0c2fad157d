//! What files say of the texels of an atlas for which `gpugi bake` stored something: `extras.gpugi.NAME` of the file and
//! of its materials, and buffer views with checksums.

use std::collections::HashMap;

use glam::Vec2;
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::document::Document;
use super::geometry;
use crate::atlas::{InstanceUvs, LARGEST_PAGE, NO_CHART};
use crate::{Atlas, ImportError, Origin, Scene};

/// Stored bytes.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Part {
    buffer_view: usize,
    blake3: String,
}

impl Part {
    /// The bytes, if their checksum is right.
    pub fn bytes<'d>(&self, document: &'d Document, place: &str) -> Result<&'d [u8], ImportError> {
        let (bytes, _) = document.view(self.buffer_view, place)?;
        if blake3::hash(bytes).to_hex().as_str() != self.blake3 {
            let reason = "what is stored is damaged: its checksum is wrong; bake it again";
            return Err(document.error(place, reason));
        }
        Ok(bytes)
    }
}

/// Extras of a material.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct MaterialExtras {
    page: u32,
    tex_coord: u32,
}

/// `extras.gpugi.NAME` of the file, if it has that.
pub fn extras<T: DeserializeOwned>(
    document: &Document,
    name: &str,
) -> Result<Option<T>, ImportError> {
    let own = document.root.extras.get("gpugi");
    let Some(value) = own.and_then(|own| own.get(name)) else {
        return Ok(None);
    };
    let error = |reason: serde_json::Error| document.error(format!("extras.gpugi.{name}"), reason);
    T::deserialize(value).map(Some).map_err(error)
}

/// Checks the version of what is stored.
pub fn check_version(found: u32, read: u32) -> Result<(), String> {
    if found == read {
        return Ok(());
    }
    Err(format!("version {found} is not read, {read} is"))
}

/// Checks that there are pages, of a possible size.
pub fn check_size(size: u32, pages: usize) -> Result<(), String> {
    if (1..=LARGEST_PAGE).contains(&size) && pages > 0 {
        return Ok(());
    }
    Err(format!(
        "{pages} pages of {size} texels a side: at least one, of 1 to {LARGEST_PAGE}"
    ))
}

/// A hash that the member `name` has.
pub fn hash(name: &str, text: &str) -> Result<[u8; 32], String> {
    let hash = blake3::Hash::from_hex(text);
    let hash = hash.map_err(|reason| format!("{name}: {reason}"))?;
    Ok(*hash.as_bytes())
}

/// The atlas that the materials' extras of this name describe: page and texture coordinates of each instance.
pub fn atlas(
    document: &Document,
    scene: &Scene,
    name: &str,
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
                let uvs = of_primitive(document, name, (mesh, primitive), pages)?;
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
    name: &str,
    (mesh, primitive): (usize, usize),
    pages: u32,
) -> Result<Option<InstanceUvs>, ImportError> {
    let root = &document.root;
    let source = &root.meshes[mesh].primitives[primitive];
    let Some(material) = source.material else {
        return Ok(None);
    };
    let place = format!("materials[{material}].extras.gpugi.{name}");
    let extras = &root.materials[material].extras;
    let Some(value) = extras.get("gpugi").and_then(|own| own.get(name)) else {
        return Ok(None);
    };
    let error = |reason: String| document.error(&place, reason);
    let extras = MaterialExtras::deserialize(value).map_err(|reason| error(reason.to_string()))?;
    if extras.page >= pages {
        return Err(error(format!("page {} of {pages}", extras.page)));
    }
    let place = format!("meshes[{mesh}].primitives[{primitive}]");
    let uv_set = format!("TEXCOORD_{}", extras.tex_coord);
    let accessor = source.attributes.get(&uv_set);
    let accessor =
        *accessor.ok_or_else(|| document.error(&place, format!("there is no {uv_set}")))?;
    let (count, vertices) = geometry::triangle_corners(document, source, &place)?;
    document.charge(count, size_of::<Vec2>(), &place)?;
    let uvs = document.floats::<2>(accessor, &place)?;
    if uvs.len() as u64 != count {
        let reason = format!("{uv_set} has {} elements for {count} vertices", uvs.len());
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
