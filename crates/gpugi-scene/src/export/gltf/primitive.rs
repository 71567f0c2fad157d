//! Adds the atlas's texture coordinates to a primitive. Vertices at cuts of the atlas are duplicated; the copies are
//! bitwise identical in everything else.

use std::collections::{BTreeMap, HashMap};

use glam::Vec2;
use serde_json::{Value, json};

use super::json::{Object, object, remove_empty};
use super::output::{ARRAY_BUFFER, Output};
use crate::export::ExportError;
use crate::import::gltf::document::{DRACO, Document};
use crate::import::gltf::schema::Primitive;

/// The triangles of a primitive, with vertices as stored in the file.
pub struct Triangles {
    /// Number of vertices.
    pub vertices: usize,
    /// The vertex of each corner, three per triangle.
    pub corners: Vec<u32>,
}

/// The set of texture coordinates that maps a primitive to its page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct PageSet {
    pub set: u32,
    /// The set with which it changed places, if the file had other coordinates under this number.
    pub swapped: Option<u32>,
}

/// Gives the primitive (mesh, number) of `output`, a copy of `source`, the texture coordinates `uvs` at its corners, as
/// set `wanted` if it is given, else as the first free one.
pub fn add_uvs(
    document: &Document,
    output: &mut Output,
    (mesh, primitive): (usize, usize),
    source: &Primitive,
    triangles: &Triangles,
    (uvs, wanted): (&[Vec2], Option<u32>),
) -> Result<PageSet, ExportError> {
    let place = format!("meshes[{mesh}].primitives[{primitive}]");
    let mut sets = 0;
    let mut held = None;
    while let Some(&accessor) = source.attributes.get(&name_of(sets)) {
        if held.is_none() && holds(document, accessor, triangles, uvs) {
            held = Some(sets);
        }
        sets += 1;
    }
    // Where there are gaps, which glTF forbids, nothing is lost either.
    let last = source
        .attributes
        .keys()
        .filter_map(|name| name.strip_prefix("TEXCOORD_"));
    let last = last.filter_map(|set| set.parse::<u32>().ok()).max();
    let next = last.map_or(0, |last| last.saturating_add(1));
    let set = wanted.unwrap_or_else(|| held.unwrap_or(sets));
    let mut attributes = source.attributes.clone();
    let mut targets = source.targets.clone();
    // What is compressed lacks the coordinates: its attributes are written anew, as they were decoded.
    let is_packed = attributes
        .values()
        .any(|accessor| document.decoded_accessors.contains_key(accessor));
    if held == Some(set) {
        return Ok(PageSet { set, swapped: None });
    }
    if let Some(held) = held.filter(|_| !is_packed) {
        // The same vertices: sets change places, or the coordinates serve as two sets.
        let swapped = (set < sets).then_some(held);
        match swapped {
            Some(other) => std::iter::once(&mut attributes)
                .chain(&mut targets)
                .for_each(|list| swap(list, set, other)),
            None => {
                attributes.insert(name_of(set), attributes[&name_of(held)]);
            }
        }
        let json = output.json.primitive(mesh, primitive)?;
        write_all(json, &attributes, &targets);
        forget_draco(json);
        return Ok(PageSet { set, swapped });
    }
    let split = Split::new(triangles, uvs);
    let mut indices = source.indices;
    let is_new = is_packed || split.changes(triangles);
    if is_new {
        let mut copies = HashMap::new();
        let lists = std::iter::once(&mut attributes).chain(&mut targets);
        for (name, accessor) in lists.flatten() {
            // glTF requires bounds for positions.
            let is_bounded = name == "POSITION";
            let key = (*accessor, is_bounded);
            *accessor = match copies.get(&key) {
                Some(&copy) => copy,
                None => {
                    let copy = select(document, output, key, &split, triangles, &place)?;
                    copies.insert(key, copy);
                    copy
                }
            };
        }
        indices = Some(output.indices(&split.indices, split.sources.len())?);
    }
    let uvs: Vec<[f32; 2]> = split.uvs.iter().map(Vec2::to_array).collect();
    let uvs = output.floats(&uvs)?;
    // What was there becomes the last set.
    let swapped = attributes.contains_key(&name_of(set)).then_some(next);
    if let Some(other) = swapped {
        let lists = std::iter::once(&mut attributes).chain(&mut targets);
        lists.for_each(|list| swap(list, set, other));
    }
    // Sets are numbered from 0 without gaps.
    for number in sets..set {
        attributes.insert(name_of(number), uvs);
    }
    attributes.insert(name_of(set), uvs);

    let json = output.json.primitive(mesh, primitive)?;
    write_all(json, &attributes, &targets);
    if is_new {
        json.shift_remove("mode");
    }
    if let Some(indices) = indices {
        json.insert("indices".to_owned(), indices.into());
    }
    forget_draco(json);
    Ok(PageSet { set, swapped })
}

/// Removes a primitive's compressed data, which lacks new coordinates and names the others as they were.
pub fn forget_draco(json: &mut Object) {
    if let Some(Value::Object(extensions)) = json.get_mut("extensions") {
        extensions.shift_remove(DRACO);
    }
    remove_empty(json, "extensions");
}

fn name_of(set: u32) -> String {
    format!("TEXCOORD_{set}")
}

/// Lets two sets of texture coordinates change places, as far as a list has them.
fn swap(attributes: &mut BTreeMap<String, usize>, one: u32, other: u32) {
    let [one, other] = [one, other].map(name_of);
    let accessors = [&one, &other].map(|name| attributes.remove(name));
    for (name, accessor) in [other, one].into_iter().zip(accessors) {
        accessor.map(|accessor| attributes.insert(name, accessor));
    }
}

/// Writes the attributes of a primitive, and those of its morph targets.
fn write_all(
    json: &mut Object,
    attributes: &BTreeMap<String, usize>,
    targets: &[BTreeMap<String, usize>],
) {
    write(object(json, "attributes"), attributes);
    if let Some(list) = json.get_mut("targets").and_then(Value::as_array_mut) {
        for (json, target) in list.iter_mut().zip(targets) {
            json.as_object_mut()
                .into_iter()
                .for_each(|json| write(json, target));
        }
    }
}

fn write(json: &mut Object, attributes: &BTreeMap<String, usize>) {
    json.retain(|name, _| !name.starts_with("TEXCOORD_") || attributes.contains_key(name));
    for (name, &accessor) in attributes {
        json.insert(name.clone(), accessor.into());
    }
}

/// Whether a texture coordinate set of the file holds exactly these coordinates.
fn holds(document: &Document, accessor: usize, triangles: &Triangles, uvs: &[Vec2]) -> bool {
    let Ok(set) = document.floats::<2>(accessor, "") else {
        return false;
    };
    let mut corners = triangles.corners.iter().zip(uvs);
    corners.all(|(&vertex, uv)| set.get(vertex as usize) == Some(&uv.to_array()))
}

/// Splits vertices whose corners need different texture coordinates.
struct Split {
    /// The old vertex of each new one.
    sources: Vec<u32>,
    uvs: Vec<Vec2>,
    /// New vertices, three per triangle.
    indices: Vec<u32>,
    /// Whether old vertices keep their numbers, with the copies after them.
    keeps_numbers: bool,
}

impl Split {
    fn new(triangles: &Triangles, uvs: &[Vec2]) -> Self {
        const NONE: u32 = u32::MAX;
        let count = triangles.vertices;
        let mut is_used = vec![false; count];
        for &vertex in &triangles.corners {
            is_used[vertex as usize] = true;
        }
        let used = is_used.iter().filter(|used| **used).count();
        // Many primitives may share one long list of vertices of which each needs only a few.
        let keeps_numbers = used * 2 >= count;
        let mut split = Self {
            sources: Vec::new(),
            uvs: Vec::new(),
            indices: Vec::with_capacity(triangles.corners.len()),
            keeps_numbers,
        };
        if keeps_numbers {
            split.sources = (0..count as u32).collect();
            split.uvs = vec![Vec2::ZERO; count];
        }
        // The first new vertex of each old one; additional ones are few.
        let mut first = vec![NONE; count];
        let mut others = HashMap::new();
        for (&vertex, &uv) in triangles.corners.iter().zip(uvs) {
            let bits = |uv: Vec2| uv.to_array().map(f32::to_bits);
            let known = first[vertex as usize];
            let new = if known == NONE {
                let new = if keeps_numbers {
                    vertex
                } else {
                    split.append(vertex, uv)
                };
                split.uvs[new as usize] = uv;
                first[vertex as usize] = new;
                new
            } else if bits(split.uvs[known as usize]) == bits(uv) {
                known
            } else {
                *others
                    .entry((vertex, bits(uv)))
                    .or_insert_with(|| split.append(vertex, uv))
            };
            split.indices.push(new);
        }
        split
    }

    /// Adds a copy of the old `vertex`; returns its number.
    fn append(&mut self, vertex: u32, uv: Vec2) -> u32 {
        self.sources.push(vertex);
        self.uvs.push(uv);
        self.sources.len() as u32 - 1
    }

    /// Whether the primitive needs a different vertex list.
    fn changes(&self, triangles: &Triangles) -> bool {
        !self.keeps_numbers || self.sources.len() != triangles.vertices
    }
}

/// Copies the elements of an accessor that `split` selects. Adds `min` and `max` if the accessor has them or
/// `is_bounded` is set. Returns the index of the copy.
fn select(
    document: &Document,
    output: &mut Output,
    (accessor, is_bounded): (usize, bool),
    split: &Split,
    triangles: &Triangles,
    place: &str,
) -> Result<usize, ExportError> {
    let count = document.count(accessor, place)?;
    if count != triangles.vertices as u64 {
        return Err(ExportError::new(
            place,
            format!(
                "accessors[{accessor}] has {count} elements for {} vertices",
                triangles.vertices
            ),
        ));
    }
    let packed = document.packed(accessor, place)?;
    let size = packed.stride;
    // glTF requires vertex attributes at multiples of 4 bytes.
    let stride = size.next_multiple_of(4);
    let length = split.sources.len().checked_mul(stride);
    let length = length.ok_or_else(|| ExportError::new(place, "the primitive is too large"))?;
    output.reserve(length)?;
    let mut bytes = vec![0; length];
    for (element, &source) in bytes.chunks_exact_mut(stride).zip(&split.sources) {
        let start = source as usize * size;
        element[..size].copy_from_slice(&packed.bytes[start..start + size]);
    }
    let mut json = output.json.copy("accessors", accessor)?;
    json.insert("count".to_owned(), split.sources.len().into());
    let component = document.root.accessors[accessor].component_type;
    let kind = (component, document.width(accessor, place)?, size);
    store(output, &mut json, &bytes, kind, is_bounded)?;
    output.json.push("accessors", Value::Object(json))
}

/// Stores the elements of a vertex attribute, as many bytes apart as the next multiple of 4, and lets its accessor say
/// where they are and, if it did so or `is_bounded` is set, what bounds them. `component`, `width`, `size`: glTF's constant,
/// the number of components and the bytes of an element.
pub fn store(
    output: &mut Output,
    accessor: &mut Object,
    elements: &[u8],
    (component, width, size): (u32, usize, usize),
    is_bounded: bool,
) -> Result<(), ExportError> {
    let stride = size.next_multiple_of(4);
    let view = output.view(elements, Some(ARRAY_BUFFER))?;
    if stride != size {
        let view = output.json.at("bufferViews", view)?;
        view.insert("byteStride".to_owned(), stride.into());
    }
    for member in ["sparse", "byteOffset"] {
        accessor.shift_remove(member);
    }
    accessor.insert("bufferView".to_owned(), view.into());
    let mut range = range(component, width, elements, stride, size).unwrap_or_default();
    for bound in ["min", "max"] {
        if is_bounded || accessor.contains_key(bound) {
            match range.shift_remove(bound) {
                Some(value) => accessor.insert(bound.to_owned(), value),
                None => accessor.shift_remove(bound),
            };
        }
    }
    Ok(())
}

/// `min` and `max` of elements with `width` components, in stored values. `None` if they are not finite, and for
/// matrices with padded columns.
fn range(component: u32, width: usize, bytes: &[u8], stride: usize, size: usize) -> Option<Object> {
    let bounds = |component_size: usize, read: &dyn Fn(&[u8]) -> f64| {
        let mut bounds = vec![(f64::INFINITY, f64::NEG_INFINITY); size / component_size];
        for element in bytes.chunks_exact(stride) {
            let components = element.chunks_exact(component_size);
            for (bounds, component) in bounds.iter_mut().zip(components) {
                let value = read(component);
                *bounds = (bounds.0.min(value), bounds.1.max(value));
            }
        }
        bounds
    };
    macro_rules! bounds {
        ($type:ty, $json:ty) => {{
            const WIDTH: usize = size_of::<$type>();
            let read = |bytes: &[u8]| {
                let bytes = bytes.first_chunk::<WIDTH>().copied().unwrap_or_default();
                f64::from(<$type>::from_le_bytes(bytes))
            };
            let bounds = bounds(WIDTH, &read);
            let is_finite = |(min, max): &(f64, f64)| min.is_finite() && max.is_finite();
            (bounds.len() == width && bounds.iter().all(is_finite)).then(|| {
                let min: Vec<$json> = bounds.iter().map(|bounds| bounds.0 as $json).collect();
                let max: Vec<$json> = bounds.iter().map(|bounds| bounds.1 as $json).collect();
                (json!(min), json!(max))
            })
        }};
    }
    let (min, max) = match component {
        5120 => bounds!(i8, i64),
        5121 => bounds!(u8, i64),
        5122 => bounds!(i16, i64),
        5123 => bounds!(u16, i64),
        5125 => bounds!(u32, i64),
        5126 => bounds!(f32, f64),
        _ => None,
    }?;
    Some(Object::from_iter([
        ("min".to_owned(), min),
        ("max".to_owned(), max),
    ]))
}
