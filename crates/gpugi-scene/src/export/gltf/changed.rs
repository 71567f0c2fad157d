//! What exporters change of a whole file after it is written: [`Changes`].

use std::collections::HashSet;

use serde_json::{Value, json};

use super::Nothing;
use super::json::{Json, object, remove_empty};
use super::output::{ELEMENT_ARRAY_BUFFER, Output};
use super::scene::LIGHTS;
use super::{primitive, prune};
use crate::Limits;
use crate::export::{Changes, ExportError, Exported};
use crate::import::gltf::document::{DRACO, Document, MESHOPT};

/// Lumens per watt of light at 555 nm: the luminous efficacy by which programs convert.
const LUMENS_PER_WATT: f64 = 683.0;

/// See [`Exported::changed`].
pub fn changed(exported: Exported, changes: &Changes) -> Result<Exported, ExportError> {
    let mut output = Output::of_glb(&exported.glb)?;
    let mut warnings = exported.warnings;
    if changes.drops_lights {
        drop_lights(&mut output.json)?;
    } else if changes.photometric {
        to_photometric(&mut output.json);
    }
    if changes.unpacks {
        unpack(&mut output, &exported.glb)?;
    }
    if changes.prunes {
        prune::prune(&mut output, &mut warnings);
    }
    Ok(Exported {
        glb: output.glb()?,
        warnings,
    })
}

fn drop_lights(json: &mut Json) -> Result<(), ExportError> {
    for node in 0..json.list("nodes").len() {
        let node = json.at("nodes", node)?;
        if let Some(Value::Object(extensions)) = node.get_mut("extensions") {
            extensions.shift_remove(LIGHTS);
        }
        remove_empty(node, "extensions");
    }
    let root = json.root();
    if let Some(Value::Object(extensions)) = root.get_mut("extensions") {
        extensions.shift_remove(LIGHTS);
    }
    remove_empty(root, "extensions");
    json.no_longer_uses(LIGHTS);
    Ok(())
}

/// Decodes what meshoptimizer and Draco have compressed. `glb`: the same file.
fn unpack(output: &mut Output, glb: &[u8]) -> Result<(), ExportError> {
    let document = Document::read("the file", glb, &Nothing, &Limits::NONE)?;
    for number in 0..output.json.list("bufferViews").len() {
        let view = &output.json.list("bufferViews")[number];
        if view["extensions"].get(MESHOPT).is_none() {
            continue;
        }
        let (bytes, _) = document.view(number, "bufferViews")?;
        let offset = output.append(bytes)?;
        let view = output.json.at("bufferViews", number)?;
        view.insert("buffer".to_owned(), 0.into());
        view.insert("byteOffset".to_owned(), offset.into());
        view.insert("byteLength".to_owned(), bytes.len().into());
        object(view, "extensions").shift_remove(MESHOPT);
        remove_empty(view, "extensions");
    }
    let primitives = document
        .root
        .meshes
        .iter()
        .flat_map(|mesh| &mesh.primitives);
    let indices: HashSet<usize> = primitives
        .filter_map(|primitive| primitive.indices)
        .collect();
    for &number in document.decoded_accessors.keys() {
        let packed = document.packed(number, "accessors")?;
        let width = document.width(number, "accessors")?;
        let mut accessor = std::mem::take(output.json.at("accessors", number)?);
        if indices.contains(&number) {
            for member in ["sparse", "byteOffset"] {
                accessor.shift_remove(member);
            }
            let view = output.view(&packed.bytes, Some(ELEMENT_ARRAY_BUFFER))?;
            accessor.insert("bufferView".to_owned(), view.into());
        } else {
            let stride = packed.stride.next_multiple_of(4);
            let elements = packed.bytes.chunks_exact(packed.stride);
            let padding = vec![0; stride - packed.stride];
            let elements: Vec<u8> = elements.flat_map(|one| [one, &padding].concat()).collect();
            let component = document.root.accessors[number].component_type;
            let kind = (component, width, packed.stride);
            primitive::store(output, &mut accessor, &elements, kind, false)?;
        }
        *output.json.at("accessors", number)? = accessor;
    }
    for mesh in 0..output.json.list("meshes").len() {
        let primitives = output.json.at("meshes", mesh)?.get_mut("primitives");
        let primitives = primitives.and_then(Value::as_array_mut);
        let primitives = primitives.into_iter().flatten();
        primitives
            .filter_map(Value::as_object_mut)
            .for_each(primitive::forget_draco);
    }
    // Without their views, the buffers that stood for decoded bytes serve nobody.
    let views = output.json.list("bufferViews").iter();
    let last = views.filter_map(|view| view["buffer"].as_u64()).max();
    let last = last.and_then(|last| usize::try_from(last).ok());
    if let Some(Value::Array(buffers)) = output.json.root().get_mut("buffers") {
        buffers.truncate(last.map_or(buffers.len(), |last| last.saturating_add(1)));
    }
    output.json.no_longer_uses(MESHOPT);
    output.json.no_longer_uses(DRACO);
    Ok(())
}

fn to_photometric(json: &mut Json) {
    let lights = json.root().get_mut("extensions");
    let lights = lights.and_then(|extensions| extensions.get_mut(LIGHTS)?.get_mut("lights"));
    let lights = lights.and_then(Value::as_array_mut);
    for light in lights
        .into_iter()
        .flatten()
        .filter_map(Value::as_object_mut)
    {
        let intensity = light
            .get("intensity")
            .and_then(Value::as_f64)
            .unwrap_or(1.0);
        light.insert("intensity".to_owned(), json!(intensity * LUMENS_PER_WATT));
    }
}
