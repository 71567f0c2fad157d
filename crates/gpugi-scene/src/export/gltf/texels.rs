//! What files say of the texels of an atlas for which something is stored: the counterpart of
//! [`crate::import::gltf::texels`].

use serde_json::{Value, json};

use super::json::{Json, Object};
use super::output::Output;
use crate::export::ExportError;
use crate::import::gltf::document::Document;
use crate::import::gltf::{self, panes, texels, transfer};
use crate::{Atlas, Limits, Resolver, Scene};

/// Removes what an earlier bake said of what it stored.
pub fn remove(json: &mut Json) -> Result<(), ExportError> {
    let forget = |parent: &mut Object| {
        let own = parent
            .get_mut("extras")
            .and_then(|extras| extras.get_mut("gpugi"));
        if let Some(own) = own.and_then(Value::as_object_mut) {
            own.shift_remove(transfer::NAME);
            own.shift_remove(panes::NAME);
        }
    };
    forget(json.root());
    for material in 0..json.list("materials").len() {
        forget(json.at("materials", material)?);
    }
    Ok(())
}

/// The scene as importers of the file see it, which may hold more than was baked and write transforms in another way, and
/// the atlas that the extras `name` of its materials describe.
pub fn imported(
    output: &Output,
    resolver: &dyn Resolver,
    name: &str,
    atlas: &Atlas,
) -> Result<(Scene, Atlas), ExportError> {
    let glb = output.clone().glb()?;
    let scene = gltf::import("baked.glb", &glb, resolver, &Limits::NONE)?;
    let document = Document::read("baked.glb", &glb, resolver, &Limits::NONE)?;
    let atlas = texels::atlas(&document, &scene, name, atlas.size, atlas.pages)?;
    Ok((scene, atlas))
}

/// Stores bytes in a view of their own; returns what the extras say of it.
pub fn part(output: &mut Output, bytes: &[u8]) -> Result<Value, ExportError> {
    let view = output.view(bytes, None)?;
    Ok(json!({ "bufferView": view, "blake3": hex(*blake3::hash(bytes).as_bytes()) }))
}

/// A hash as text.
pub fn hex(hash: [u8; 32]) -> String {
    blake3::Hash::from_bytes(hash).to_hex().to_string()
}
