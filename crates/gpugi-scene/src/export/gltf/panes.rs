//! Panes of light path maps as array textures in buffer views, and what they mean in `extras` (docs/panes.md).

use serde_json::json;

use super::material::own_extras;
use super::output::Output;
use super::texels;
use crate::Resolver;
use crate::export::ExportError;
use crate::image::{ArrayTexels, encode_array};
use crate::import::gltf::panes::{NAME, VERSION};
use crate::panes::{LightPathPanes, SurfacePlace};
use crate::transfer::geometry;

/// Adds the textures and points, and the extras of the file, whose materials know already where the texels are. `carriers`:
/// node and primitive of each instance.
pub fn add(
    output: &mut Output,
    panes: &LightPathPanes,
    carriers: &[Option<(usize, usize)>],
    resolver: &dyn Resolver,
) -> Result<(), ExportError> {
    let (scene, atlas) = texels::imported(output, resolver, NAME, &panes.atlas)?;
    let mut points = Vec::new();
    for place in panes.entries.iter().chain(&panes.samples) {
        let SurfacePlace {
            instance,
            triangle,
            barycentrics: [u, v],
        } = *place;
        let carrier = carriers.get(instance as usize).copied().flatten();
        let (node, primitive) = carrier.ok_or_else(|| {
            let reason = "there is a point on it, but it is not in the atlas";
            ExportError::new(format!("instances[{instance}]"), reason)
        })?;
        points.extend([
            node as u32,
            primitive as u32,
            triangle,
            u.to_bits(),
            v.to_bits(),
        ]);
    }
    let bytes =
        |words: &[u32]| -> Vec<u8> { words.iter().flat_map(|word| word.to_le_bytes()).collect() };
    let clusters = bytes(&[&panes.firsts[..], &panes.first_samples].concat());
    let clusters = texels::part(output, &clusters)?;
    let points = texels::part(output, &bytes(&points))?;
    let (size, page) = (panes.atlas.size, panes.texels_per_page());
    let mut pages = Vec::new();
    for number in 0..panes.atlas.pages as usize {
        let all = panes.panes.chunks(page).skip(number);
        let of_page = all.step_by(panes.atlas.pages as usize).flatten();
        let of_page = ArrayTexels::SharedExponent(of_page.copied().collect());
        let file = encode_array(size, panes.clusters() as u32, &of_page)
            .map_err(|reason| ExportError::new(format!("pages[{number}]"), reason))?;
        pages.push(texels::part(output, &file)?);
    }
    let extras = json!({
        "version": VERSION,
        "depth": panes.depth,
        "size": size,
        "entries": panes.entries.len(),
        "clusters": clusters,
        "points": points,
        "geometry": texels::hex(geometry(&scene, &atlas)),
        "materials": texels::hex(scene.material_digest()),
        "pages": pages,
    });
    own_extras(output.json.root()).insert(NAME.to_owned(), extras);
    Ok(())
}
