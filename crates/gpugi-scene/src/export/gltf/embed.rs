//! Embeds the original's buffers and images: a .glb must not depend on other files.

use std::collections::HashMap;

use base64::Engine;
use serde_json::{Value, json};

use super::json::{Object, array, index};
use super::output::Output;
use crate::Resolver;
use crate::export::ExportError;
use crate::import::gltf::document::Document;
use crate::import::gltf::uri;

/// Where the content of a buffer was moved.
#[derive(Clone, Copy)]
struct Place {
    buffer: usize,
    offset: usize,
}

/// Merges all buffers of `document` that have content into the first buffer of `output`.
pub fn buffers(
    document: &Document,
    output: &mut Output,
    warnings: &mut Vec<String>,
) -> Result<(), ExportError> {
    let count = document.root.buffers.len();
    let mut merged: Option<Object> = None;
    // Buffers without content, such as the fallback of compressed views, stay separate.
    let mut others = Vec::new();
    let mut places = Vec::with_capacity(count);
    for buffer in 0..count {
        let mut json = output.json.at("buffers", buffer)?.clone();
        let Some(bytes) = document.buffer(buffer) else {
            if json.contains_key("uri") {
                warnings.push(format!(
                    "buffers[{buffer}]: nobody needs its file, to which it still refers"
                ));
            }
            others.push(Value::Object(json));
            places.push(Place {
                buffer: others.len(),
                offset: 0,
            });
            continue;
        };
        let offset = output.append(bytes)?;
        places.push(Place { buffer: 0, offset });
        json.shift_remove("uri");
        if merged.is_none() {
            merged = Some(json);
        } else if json.len() > 1 {
            warnings.push(format!(
                "buffers[{buffer}]: joins the first one, without its name and extras"
            ));
        }
    }
    if count == 0 {
        return Ok(());
    }
    if merged.is_none() && !others.is_empty() {
        // Buffer 0 is reserved for the BIN chunk.
        merged = Some(Object::new());
    }
    let mut list: Vec<Value> = merged.into_iter().map(Value::Object).collect();
    list.extend(others);
    output
        .json
        .root()
        .insert("buffers".to_owned(), Value::Array(list));
    for view in 0..document.root.buffer_views.len() {
        let view = output.json.at("bufferViews", view)?;
        relocate(view, &places)?;
        let extensions = view.get_mut("extensions").and_then(Value::as_object_mut);
        // Compressed views refer to the buffer of their packed content.
        for extension in extensions.into_iter().flat_map(Object::values_mut) {
            if let Some(extension) = extension.as_object_mut() {
                relocate(extension, &places)?;
            }
        }
    }
    Ok(())
}

/// Updates a view after its buffer has moved.
fn relocate(view: &mut Object, places: &[Place]) -> Result<(), ExportError> {
    let Some(place) = index(view, "buffer").and_then(|buffer| places.get(buffer)) else {
        return Ok(());
    };
    view.insert("buffer".to_owned(), place.buffer.into());
    if place.offset > 0 {
        let offset = index(view, "byteOffset").unwrap_or(0);
        let offset = offset
            .checked_add(place.offset)
            .ok_or_else(|| ExportError::new("bufferViews", "a byteOffset is out of range"))?;
        view.insert("byteOffset".to_owned(), offset.into());
    }
    Ok(())
}

/// Embeds the images that are separate files.
pub fn images(
    output: &mut Output,
    resolver: &dyn Resolver,
    warnings: &mut Vec<String>,
) -> Result<(), ExportError> {
    let mut views = HashMap::new();
    for image in 0..output.json.list("images").len() {
        let json = output.json.at("images", image)?;
        let Some(uri) = json.get("uri").and_then(Value::as_str) else {
            continue;
        };
        if uri.starts_with("data:") {
            continue;
        }
        let uri = uri.to_owned();
        let declared = json.get("mimeType").cloned();
        let known = views.get(&uri).cloned();
        let (view, kind) = match known {
            Some(known) => known,
            None => {
                let content = uri::read(&uri, resolver).and_then(|bytes| {
                    let kind = kind(&bytes).map(Value::from).or(declared);
                    Ok((kind.ok_or("its format is unknown")?, bytes))
                });
                match content {
                    Ok((kind, bytes)) => {
                        let view = output.view(&bytes, None)?;
                        views.insert(uri, (view, kind.clone()));
                        (view, kind)
                    }
                    Err(reason) => {
                        warnings.push(format!("images[{image}]: stays a file beside: {reason}"));
                        continue;
                    }
                }
            }
        };
        let json = output.json.at("images", image)?;
        json.shift_remove("uri");
        json.insert("bufferView".to_owned(), json!(view));
        json.insert("mimeType".to_owned(), kind);
    }
    Ok(())
}

/// Embeds the densities of media that are separate files. What many media share is copied, within the limit on copies.
pub fn densities(
    output: &mut Output,
    resolver: &dyn Resolver,
    warnings: &mut Vec<String>,
) -> Result<(), ExportError> {
    const DENSITY: &str = "/extras/gpugi/medium/density";
    for list in ["nodes", "scenes"] {
        for index in 0..output.json.list(list).len() {
            let density = output.json.list(list)[index].pointer(DENSITY);
            let uri = density.and_then(Value::as_str).map(str::to_owned);
            let Some(uri) = uri.filter(|uri| !uri.starts_with("data:")) else {
                continue;
            };
            let place = format!("{list}[{index}]");
            let bytes = match uri::read(&uri, resolver) {
                Ok(bytes) => bytes,
                Err(reason) => {
                    warnings.push(format!(
                        "{place}: its density stays a file beside: {reason}"
                    ));
                    continue;
                }
            };
            let data = base64::engine::general_purpose::STANDARD.encode(bytes);
            output.json.charge(data.len(), || place)?;
            let values = array(output.json.root(), list)?;
            if let Some(density) = values[index].pointer_mut(DENSITY) {
                *density = json!(format!("data:image/ktx2;base64,{data}"));
            }
        }
    }
    Ok(())
}

/// The image format indicated by the first bytes.
fn kind(bytes: &[u8]) -> Option<&'static str> {
    let riff = |kind: &[u8]| bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(kind);
    Some(match bytes {
        _ if bytes.starts_with(b"\x89PNG") => "image/png",
        _ if bytes.starts_with(&[0xff, 0xd8, 0xff]) => "image/jpeg",
        _ if bytes.starts_with(b"\xabKTX 20") => "image/ktx2",
        _ if bytes.starts_with(b"DDS ") => "image/vnd-ms.dds",
        _ if bytes.get(4..12) == Some(b"ftypavif") => "image/avif",
        _ if riff(b"WEBP") => "image/webp",
        _ => return None,
    })
}
