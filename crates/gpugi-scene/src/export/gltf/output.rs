//! A .glb under construction: its JSON and the one buffer that holds all binary content.

use serde_json::{Value, json};

use super::json::Json;
use crate::export::ExportError;

/// glTF's constant for vertex attributes.
pub const ARRAY_BUFFER: u32 = 34_962;
/// glTF's constant for vertex indices.
pub const ELEMENT_ARRAY_BUFFER: u32 = 34_963;
pub const U16: u32 = 5123;
pub const U32: u32 = 5125;
pub const F32: u32 = 5126;

/// glTF requires views at multiples of 4 bytes; the content of some extensions requires 8.
const ALIGNMENT: usize = 8;
/// A .glb stores its length in 32 bits.
const MOST_BYTES: usize = u32::MAX as usize;

#[derive(Clone)]
pub struct Output {
    pub json: Json,
    /// Content of the BIN chunk, buffer 0.
    binary: Vec<u8>,
    /// Chunks that follow the BIN chunk.
    further_chunks: Vec<u8>,
}

impl Output {
    pub fn new(json: Json, further_chunks: &[u8]) -> Self {
        Self {
            json,
            binary: Vec::new(),
            further_chunks: further_chunks.to_vec(),
        }
    }

    /// That of a file which [`Output::glb`] has made.
    pub fn of_glb(glb: &[u8]) -> Result<Self, ExportError> {
        let broken = || ExportError::new("chunks", "they do not fit the file");
        let mut chunks = Vec::new();
        let mut rest = glb.get(12..).ok_or_else(broken)?;
        while !rest.is_empty() {
            let length = rest.first_chunk().copied().map(u32::from_le_bytes);
            let length = length.ok_or_else(broken)? as usize;
            let content = rest.get(8..).and_then(|rest| rest.get(..length));
            chunks.push(content.ok_or_else(broken)?);
            rest = &rest[8 + length..];
            if chunks.len() == 2 {
                break;
            }
        }
        let json = chunks.first().ok_or_else(broken)?;
        Ok(Self {
            json: Json::parse(json)?,
            binary: chunks.get(1).copied().unwrap_or_default().to_vec(),
            further_chunks: rest.to_vec(),
        })
    }

    /// Rejects content that does not fit a .glb, before it is allocated.
    pub fn reserve(&self, length: usize) -> Result<(), ExportError> {
        let total = self.binary.len().checked_add(length);
        if total.is_none_or(|total| total > MOST_BYTES - ALIGNMENT) {
            return Err(ExportError::new(
                "BIN chunk",
                format!(
                    "{length} more bytes after {} exceed the 4 GiB of a .glb",
                    self.binary.len()
                ),
            ));
        }
        Ok(())
    }

    /// Appends `bytes` to the buffer; returns their offset.
    pub fn append(&mut self, bytes: &[u8]) -> Result<usize, ExportError> {
        self.reserve(bytes.len())?;
        let offset = self.binary.len().next_multiple_of(ALIGNMENT);
        self.binary.resize(offset, 0);
        self.binary.extend(bytes);
        Ok(offset)
    }

    /// Adds a buffer view; returns its index.
    pub fn view(&mut self, bytes: &[u8], target: Option<u32>) -> Result<usize, ExportError> {
        let offset = self.append(bytes)?;
        let mut view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.json.push("bufferViews", view)
    }

    /// Adds an accessor of 32-bit floats for vertices; returns its index.
    pub fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> Result<usize, ExportError> {
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][N - 1];
        let view = self.view(
            bytemuck::cast_slice(values.as_flattened()),
            Some(ARRAY_BUFFER),
        )?;
        self.json.push(
            "accessors",
            json!({ "bufferView": view, "componentType": F32, "count": values.len(), "type": kind }),
        )
    }

    /// Adds an accessor of vertex indices, 16-bit if the number of `vertices` permits; returns its index.
    pub fn indices(&mut self, indices: &[u32], vertices: usize) -> Result<usize, ExportError> {
        // The largest value of each index type is reserved for primitive restart.
        let (component, view) = if vertices <= usize::from(u16::MAX) {
            let indices: Vec<u16> = indices.iter().map(|&index| index as u16).collect();
            let bytes = bytemuck::cast_slice(&indices);
            (U16, self.view(bytes, Some(ELEMENT_ARRAY_BUFFER))?)
        } else {
            let bytes = bytemuck::cast_slice(indices);
            (U32, self.view(bytes, Some(ELEMENT_ARRAY_BUFFER))?)
        };
        self.json.push(
            "accessors",
            json!({
                "bufferView": view, "componentType": component, "count": indices.len(), "type": "SCALAR",
            }),
        )
    }

    /// Adds a texture that uses a PNG image; returns its index.
    pub fn texture(
        &mut self,
        name: &str,
        png: &[u8],
        sampler: usize,
    ) -> Result<usize, ExportError> {
        let image = self.image(name, png, "image/png")?;
        self.json
            .push("textures", json!({ "sampler": sampler, "source": image }))
    }

    /// Adds an image of a type; returns its index.
    pub fn image(&mut self, name: &str, bytes: &[u8], kind: &str) -> Result<usize, ExportError> {
        let view = self.view(bytes, None)?;
        self.json.push(
            "images",
            json!({ "name": name, "mimeType": kind, "bufferView": view }),
        )
    }

    /// Drops the bytes that no view shows. Does nothing if views overlap so much that a copy of each would be longer.
    pub fn compact(&mut self) {
        const PACKED: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
        let mut compact = Vec::new();
        let mut moved = self.json.list("bufferViews").to_vec();
        let most = self.binary.len() + moved.len() * ALIGNMENT;
        for view in &mut moved {
            let mut ranges = Vec::new();
            if let Some(extensions) = view.get_mut("extensions").and_then(Value::as_object_mut) {
                let packed = extensions.iter_mut();
                let packed = packed.filter(|(name, _)| PACKED.contains(&name.as_str()));
                ranges.extend(packed.map(|(_, range)| range));
            }
            for range in ranges {
                if self.take(range, &mut compact, most).is_none() {
                    return;
                }
            }
            if self.take(view, &mut compact, most).is_none() {
                return;
            }
        }
        // A buffer has at least one byte.
        if !compact.is_empty() && compact.len() <= self.binary.len() {
            self.binary = compact;
            let root = self.json.root();
            root.insert("bufferViews".to_owned(), Value::Array(moved));
        }
    }

    /// Appends the bytes of a range of buffer 0 to `compact`, and moves the range there. `None` if there are no such bytes
    /// or `compact` would become longer than `most`.
    fn take(&self, range: &mut Value, compact: &mut Vec<u8>, most: usize) -> Option<()> {
        if range["buffer"] != 0 {
            return Some(());
        }
        let number = |key: &str| match range.get(key) {
            Some(value) => usize::try_from(value.as_u64()?).ok(),
            None => Some(0),
        };
        let (start, length) = (number("byteOffset")?, number("byteLength")?);
        let bytes = self.binary.get(start..start.checked_add(length)?)?;
        let offset = compact.len().next_multiple_of(ALIGNMENT);
        if offset + length > most {
            return None;
        }
        compact.resize(offset, 0);
        compact.extend(bytes);
        range["byteOffset"] = offset.into();
        Some(())
    }

    /// The finished file.
    pub fn glb(mut self) -> Result<Vec<u8>, ExportError> {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        if !self.binary.is_empty() {
            if self.json.list("buffers").is_empty() {
                self.json.push("buffers", json!({}))?;
            }
            let buffer = self.json.at("buffers", 0)?;
            buffer.insert("byteLength".to_owned(), Value::from(self.binary.len()));
        }
        let mut json = self.json.text()?;
        json.resize(json.len().next_multiple_of(4), b' ');
        let chunk = |kind: &[u8; 4], content: &[u8]| -> Result<[u8; 8], ExportError> {
            let mut header = [0; 8];
            header[..4].copy_from_slice(&short(content.len())?.to_le_bytes());
            header[4..].copy_from_slice(kind);
            Ok(header)
        };
        let json_header = chunk(b"JSON", &json)?;
        let binary_header = chunk(b"BIN\0", &self.binary)?;
        let mut parts: Vec<&[u8]> = vec![&json_header, &json];
        if !self.binary.is_empty() || !self.further_chunks.is_empty() {
            parts.extend([&binary_header as &[u8], &self.binary, &self.further_chunks]);
        }
        let length = parts
            .iter()
            .try_fold(12_usize, |length, part| length.checked_add(part.len()));
        let length = short(length.unwrap_or(usize::MAX))?;
        let mut glb = Vec::with_capacity(length as usize);
        glb.extend(b"glTF");
        glb.extend(2_u32.to_le_bytes());
        glb.extend(length.to_le_bytes());
        parts.iter().for_each(|part| glb.extend(*part));
        Ok(glb)
    }
}

fn short(length: usize) -> Result<u32, ExportError> {
    u32::try_from(length).map_err(|_| {
        ExportError::new(
            "header",
            format!("{length} bytes exceed the 4 GiB of a .glb"),
        )
    })
}
