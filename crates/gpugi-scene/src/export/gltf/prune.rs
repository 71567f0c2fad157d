//! Leaves out what nothing shows: meshes, materials, textures, images, accessors and their bytes, attributes that no
//! material reads, and names of extensions.

use std::collections::HashSet;

use serde_json::Value;

use super::json::Object;
use super::material;
use super::output::Output;
use crate::import::gltf::{panes, transfer};

/// The lists that are pruned. Elements refer to those of later lists only.
const LISTS: [&str; 7] = [
    "meshes",
    "materials",
    "textures",
    "images",
    "samplers",
    "accessors",
    "bufferViews",
];
/// Lists that stay whole, and refer to those.
const ROOTS: [&str; 3] = ["nodes", "skins", "animations"];
/// Extensions whose indices are known here, besides those of `KHR_materials_`: others may refer to anything.
const KNOWN: [&str; 16] = [
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_avif",
    "EXT_texture_webp",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_variants",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "KHR_xmp_json_ld",
    "MOZ_lightmap",
    "MOZ_texture_rgbe",
    "MSFT_texture_dds",
];
/// An extension without an object of its own: files only declare it.
const SILENT: &str = "KHR_mesh_quantization";

/// Prunes a file; `warnings` say why not, if so.
pub fn prune(output: &mut Output, warnings: &mut Vec<String>) {
    let root = output.json.root();
    let mut written = HashSet::new();
    extensions_of(root, &mut written);
    let is_known =
        |name: &&String| KNOWN.contains(&name.as_str()) || name.starts_with("KHR_materials_");
    let mut unknown: Vec<&String> = written.iter().filter(|name| !is_known(name)).collect();
    unknown.sort();
    if let Some(name) = unknown.first() {
        warnings.push(format!(
            "not pruned: {name} is unknown here, and may refer to what looks unused"
        ));
        return;
    }
    let stored = root.get("extras").and_then(|extras| extras.get("gpugi"));
    if stored.is_some_and(|own| own.get(transfer::NAME).is_some() || own.get(panes::NAME).is_some())
    {
        warnings.push("not pruned: the file holds what relights it".to_owned());
        return;
    }
    drop_attributes(root);
    drop_elements(root);
    output.compact();
    let root = output.json.root();
    let mut written = HashSet::new();
    extensions_of(root, &mut written);
    for list in ["extensionsUsed", "extensionsRequired"] {
        let Some(names) = root.get_mut(list).and_then(Value::as_array_mut) else {
            continue;
        };
        names.retain(|name| {
            let name = name.as_str().unwrap_or_default();
            written.contains(name) || name == SILENT
        });
        if names.is_empty() {
            root.shift_remove(list);
        }
    }
}

/// Collects the names of the extensions of an object and of all that it holds.
fn extensions_of(object: &Object, found: &mut HashSet<String>) {
    fn collect(value: &Value, found: &mut HashSet<String>) {
        match value {
            Value::Object(object) => extensions_of(object, found),
            Value::Array(values) => values.iter().for_each(|value| collect(value, found)),
            _ => {}
        }
    }
    for (key, value) in object {
        if let ("extensions", Some(extensions)) = (key.as_str(), value.as_object()) {
            found.extend(extensions.keys().cloned());
        }
        if key != "extras" {
            collect(value, found);
        }
    }
}

/// Drops the last sets of texture coordinates and tangents, where no material reads them.
fn drop_attributes(root: &mut Object) {
    let materials = root.get("materials").and_then(Value::as_array);
    let reads: Vec<Reads> = materials
        .into_iter()
        .flatten()
        .map(|json| reads(json, ""))
        .collect();
    for primitive in primitives(root) {
        let mut read = Reads::default();
        refer_of_primitive(primitive, &mut |list, index| {
            let material = index
                .as_u64()
                .and_then(|index| reads.get(usize::try_from(index).ok()?));
            if let ("materials", Some(material)) = (list, material) {
                read = read.and(*material);
            }
        });
        let serves = |name: &String| match name.strip_prefix("TEXCOORD_") {
            Some(set) => set.parse().is_ok_and(|set: u64| set < read.sets),
            None => read.tangents || name != "TANGENT",
        };
        // A morph target has at least one attribute, and none that its primitive lacks.
        let targets = primitive.get("targets").and_then(Value::as_array);
        let mut targets = targets.into_iter().flatten().filter_map(Value::as_object);
        if targets.any(|target| !target.keys().any(serves)) {
            continue;
        }
        let packed = ["extensions", "KHR_draco_mesh_compression", "attributes"];
        for path in [&["attributes"][..], &["targets", "*"], &packed] {
            at(primitive, path, &mut |list| {
                if let Some(list) = list.as_object_mut() {
                    list.retain(|name, _| serves(name));
                }
            });
        }
    }
}

/// What a material needs of vertices: the first sets of coordinates, and tangents.
#[derive(Debug, Clone, Copy, Default)]
struct Reads {
    sets: u64,
    tangents: bool,
}

impl Reads {
    fn and(self, other: Self) -> Self {
        Self {
            sets: self.sets.max(other.sets),
            tangents: self.tangents || other.tangents,
        }
    }
}

/// Of a part of a material that the member `name` holds.
fn reads(json: &Value, name: &str) -> Reads {
    match json {
        Value::Object(object) => {
            let own = Reads {
                sets: material::set_read(object, name).map_or(0, |set| set.saturating_add(1)),
                tangents: false,
            };
            // Programs derive tangents from the first set.
            let own = match name {
                "KHR_materials_anisotropy" => own.and(Reads {
                    sets: 1,
                    tangents: true,
                }),
                _ if name.to_lowercase().ends_with("normaltexture") => own.and(Reads {
                    sets: 0,
                    tangents: true,
                }),
                _ => own,
            };
            let members = object.iter().map(|(name, json)| match name.as_str() {
                "extras" => json
                    .get("gpugi")
                    .map_or(Reads::default(), |own| reads(own, "gpugi")),
                name => reads(json, name),
            });
            members.fold(own, Reads::and)
        }
        Value::Array(values) => {
            let values = values.iter().map(|json| reads(json, name));
            values.fold(Reads::default(), Reads::and)
        }
        _ => Reads::default(),
    }
}

fn primitives(root: &mut Object) -> impl Iterator<Item = &mut Value> {
    let meshes = root.get_mut("meshes").and_then(Value::as_array_mut);
    meshes.into_iter().flatten().flat_map(|mesh| {
        let primitives = mesh.get_mut("primitives").and_then(Value::as_array_mut);
        primitives.into_iter().flatten()
    })
}

/// Drops elements to which nothing refers, and numbers the others anew.
fn drop_elements(root: &mut Object) {
    let mut used: Vec<HashSet<u64>> = vec![HashSet::new(); LISTS.len()];
    let number = |list: &str| LISTS.iter().position(|other| *other == list);
    let mark = |list: &'static str, index: &mut Value, used: &mut Vec<HashSet<u64>>| {
        if let (Some(list), Some(index)) = (number(list), index.as_u64()) {
            used[list].insert(index);
        }
    };
    for list in ROOTS.into_iter().chain(LISTS) {
        let elements = root.get_mut(list).and_then(Value::as_array_mut);
        for (index, element) in elements.into_iter().flatten().enumerate() {
            let is_used = number(list).is_none_or(|list| used[list].contains(&(index as u64)));
            if is_used {
                refer(list, element, &mut |list, index| {
                    mark(list, index, &mut used)
                });
            }
        }
    }
    let mut renumbered: Vec<Vec<Option<u64>>> = Vec::new();
    for (list, used) in LISTS.iter().zip(&used) {
        let mut next = 0;
        let mut numbers = Vec::new();
        if let Some(elements) = root.get_mut(*list).and_then(Value::as_array_mut) {
            let mut index = 0;
            elements.retain(|_| {
                let stays = used.contains(&index);
                index += 1;
                numbers.push(stays.then_some(next));
                next += u64::from(stays);
                stays
            });
            if elements.is_empty() {
                root.shift_remove(*list);
            }
        }
        renumbered.push(numbers);
    }
    for list in ROOTS.into_iter().chain(LISTS) {
        let elements = root.get_mut(list).and_then(Value::as_array_mut);
        for element in elements.into_iter().flatten() {
            refer(list, element, &mut |list, index| {
                let Some(numbers) = number(list).map(|list| &renumbered[list]) else {
                    return;
                };
                let old = index.as_u64().and_then(|old| usize::try_from(old).ok());
                if let Some(Some(new)) = old.and_then(|old| numbers.get(old)) {
                    *index = (*new).into();
                }
            });
        }
    }
}

/// Calls `visit` with each index in an element of `list`, and the list that it is of.
fn refer(list: &str, element: &mut Value, visit: &mut dyn FnMut(&'static str, &mut Value)) {
    match list {
        "nodes" => {
            at(element, &["mesh"], &mut |index| visit("meshes", index));
            let attributes = ["extensions", "EXT_mesh_gpu_instancing", "attributes", "*"];
            at(element, &attributes, &mut |index| visit("accessors", index));
        }
        "skins" => at(element, &["inverseBindMatrices"], &mut |index| {
            visit("accessors", index);
        }),
        "animations" => {
            for end in ["input", "output"] {
                let path = ["samplers", "*", end];
                at(element, &path, &mut |index| visit("accessors", index));
            }
        }
        "meshes" => {
            at(element, &["primitives", "*"], &mut |primitive| {
                refer_of_primitive(primitive, visit);
            });
        }
        "materials" => refer_of_material(element, visit),
        "textures" => {
            at(element, &["sampler"], &mut |index| visit("samplers", index));
            for path in [&["source"][..], &["extensions", "*", "source"]] {
                at(element, path, &mut |index| visit("images", index));
            }
        }
        "images" => at(element, &["bufferView"], &mut |index| {
            visit("bufferViews", index);
        }),
        "accessors" => {
            for path in [&["bufferView"][..], &["sparse", "*", "bufferView"]] {
                at(element, path, &mut |index| visit("bufferViews", index));
            }
        }
        _ => {}
    }
}

fn refer_of_primitive(primitive: &mut Value, visit: &mut dyn FnMut(&'static str, &mut Value)) {
    for path in [
        &["attributes", "*"][..],
        &["targets", "*", "*"],
        &["indices"],
    ] {
        at(primitive, path, &mut |index| visit("accessors", index));
    }
    let variants = [
        "extensions",
        "KHR_materials_variants",
        "mappings",
        "*",
        "material",
    ];
    for path in [&["material"][..], &variants] {
        at(primitive, path, &mut |index| visit("materials", index));
    }
    let packed = ["extensions", "KHR_draco_mesh_compression", "bufferView"];
    at(primitive, &packed, &mut |index| visit("bufferViews", index));
}

/// What has an index in a material is a texture.
fn refer_of_material(value: &mut Value, visit: &mut dyn FnMut(&'static str, &mut Value)) {
    match value {
        Value::Object(object) => {
            for (key, value) in object {
                match key.as_str() {
                    "index" => visit("textures", value),
                    "extras" => {
                        let own = value.get_mut("gpugi");
                        own.into_iter()
                            .for_each(|own| refer_of_material(own, visit));
                    }
                    _ => refer_of_material(value, visit),
                }
            }
        }
        Value::Array(values) => {
            for value in values {
                refer_of_material(value, visit);
            }
        }
        _ => {}
    }
}

/// Calls `visit` with what lies at a path in a value; `*` stands for all members.
fn at(value: &mut Value, path: &[&str], visit: &mut dyn FnMut(&mut Value)) {
    match (path, value) {
        ([], value) => visit(value),
        (["*", rest @ ..], Value::Object(object)) => {
            object.values_mut().for_each(|value| at(value, rest, visit));
        }
        (["*", rest @ ..], Value::Array(values)) => {
            values.iter_mut().for_each(|value| at(value, rest, visit));
        }
        ([key, rest @ ..], Value::Object(object)) => {
            if let Some(value) = object.get_mut(*key) {
                at(value, rest, visit);
            }
        }
        _ => {}
    }
}
