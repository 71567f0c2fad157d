//! The file as a whole: its JSON, buffers, buffer views and extensions, and how much of the limits it has used.

use std::borrow::Cow;
use std::cell::RefCell;

use super::{draco, schema, uri};
use crate::import::budget::Budget;
use crate::import::quoted;
use crate::import::replaced::Replaced;
use crate::import::text::without_mark;
use crate::{ImportError, Limits, Resolver};

/// Supported extensions. `EXT_meshopt_compression` is also supported with the cargo feature `meshopt`.
const SUPPORTED: [&str; 17] = [
    DRACO,
    "EXT_texture_webp",
    INSTANCING,
    "KHR_lights_punctual",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "KHR_xmp_json_ld",
];
pub const INSTANCING: &str = "EXT_mesh_gpu_instancing";
pub const MESHOPT: &str = "EXT_meshopt_compression";
pub const DRACO: &str = "KHR_draco_mesh_compression";

/// A parsed file with its buffers.
pub struct Document<'a> {
    pub root: schema::Root,
    pub limits: Limits,
    pub budget: Budget,
    /// The JSON from which `root` was parsed.
    pub json: &'a [u8],
    /// The bytes after the BIN chunk of a binary file.
    pub further_chunks: &'a [u8],
    name: &'a str,
    buffers: Vec<Option<Cow<'a, [u8]>>>,
    /// Content of the compressed buffer views, decoded.
    decoded_views: Vec<Option<Vec<u8>>>,
    /// Content of the accessors of compressed primitives, decoded.
    pub decoded_accessors: draco::Accessors,
    warnings: RefCell<Vec<String>>,
    /// Values that no surface can have.
    pub replaced: RefCell<Replaced>,
}

impl<'a> Document<'a> {
    /// Parses `bytes` and reads the buffers to which they refer.
    pub fn read(
        name: &'a str,
        bytes: &'a [u8],
        resolver: &dyn Resolver,
        limits: &Limits,
    ) -> Result<Self, ImportError> {
        let Parts {
            json,
            binary,
            further_chunks,
        } = split(name, bytes)?;
        let budget = Budget::new(limits, bytes.len());
        (budget.charge(parsed_size(json), 1))
            .map_err(|reason| ImportError::new(name, "JSON", reason))?;
        let root = parse(name, json)?;
        let mut document = Self {
            root,
            limits: *limits,
            budget,
            json,
            further_chunks,
            name,
            buffers: Vec::new(),
            decoded_views: Vec::new(),
            decoded_accessors: draco::Accessors::new(),
            warnings: RefCell::default(),
            replaced: RefCell::default(),
        };
        document.check_version()?;
        document.check_extensions()?;
        document.read_buffers(binary, resolver)?;
        document.decode_views()?;
        document.decoded_accessors = document.decode_primitives()?;
        Ok(document)
    }

    /// An error at a place in this file.
    pub fn error(&self, place: impl Into<String>, reason: impl std::fmt::Display) -> ImportError {
        ImportError::new(self.name, place, reason)
    }

    /// Records a feature that the file uses and the importer does not provide.
    pub fn warn(&self, place: &str, what: impl std::fmt::Display) {
        self.warnings.borrow_mut().push(format!("{place}: {what}"));
    }

    /// The warnings so far.
    pub fn into_warnings(self) -> Vec<String> {
        let mut warnings = self.warnings.into_inner();
        warnings.extend(self.replaced.into_inner().notes());
        warnings
    }

    /// The element of `list` at `index`; the error names `place`, which contains the index.
    pub fn get<'t, T>(
        &self,
        list: &'t [T],
        what: &str,
        index: usize,
        place: &str,
    ) -> Result<&'t T, ImportError> {
        list.get(index).ok_or_else(|| {
            self.error(
                place,
                format!("{what} {index} is out of range: there are {}", list.len()),
            )
        })
    }

    /// Counts a file that this one refers to; a data URI is part of this one.
    pub fn given(&self, uri: &str, bytes: usize) {
        if !uri.starts_with("data:") {
            self.budget.give(uri, bytes);
        }
    }

    /// Charges `count` things of `size` bytes to the budget, before they are allocated.
    pub fn charge(&self, count: u64, size: usize, place: &str) -> Result<(), ImportError> {
        let charged = self.budget.charge(count, size);
        charged.map_err(|reason| self.error(place, reason))
    }

    /// The bytes of a buffer view, and its stride if it has one.
    pub fn view(&self, index: usize, place: &str) -> Result<(&[u8], Option<u64>), ImportError> {
        let view = self.get(&self.root.buffer_views, "bufferView", index, place)?;
        let bytes = match self.decoded_views.get(index) {
            Some(Some(decoded)) => decoded.as_slice(),
            _ => self.slice(
                view.buffer,
                view.byte_offset,
                view.byte_length,
                &format!("bufferViews[{index}]"),
            )?,
        };
        Ok((bytes, view.byte_stride))
    }

    /// The content of a buffer; `None` if it has none or its content is not needed.
    pub fn buffer(&self, index: usize) -> Option<&[u8]> {
        self.buffers.get(index)?.as_deref()
    }

    /// A range of a buffer.
    pub fn slice(
        &self,
        buffer: usize,
        offset: u64,
        length: u64,
        place: &str,
    ) -> Result<&[u8], ImportError> {
        let bytes = self.get(&self.buffers, "buffer", buffer, place)?;
        let bytes = bytes
            .as_deref()
            .ok_or_else(|| self.error(place, format!("buffers[{buffer}] has no content")))?;
        range(bytes, offset, length).ok_or_else(|| {
            self.error(
                place,
                format!(
                    "{length} bytes at {offset} exceed the {} bytes of buffers[{buffer}]",
                    bytes.len()
                ),
            )
        })
    }

    fn check_version(&self) -> Result<(), ImportError> {
        let asset = &self.root.asset;
        let version = asset.min_version.as_ref().unwrap_or(&asset.version);
        let is_read = match asset.min_version {
            Some(_) => version == "2.0",
            None => version.starts_with("2."),
        };
        if is_read {
            return Ok(());
        }
        Err(self.error(
            "asset.version",
            format!("gpugi reads glTF 2.0, not \"{}\"", quoted(version)),
        ))
    }

    fn check_extensions(&self) -> Result<(), ImportError> {
        let is_supported = |extension: &str| {
            SUPPORTED.contains(&extension) || (cfg!(feature = "meshopt") && extension == MESHOPT)
        };
        let required = &self.root.extensions_required;
        if let Some((index, extension)) = required
            .iter()
            .enumerate()
            .find(|(_, extension)| !is_supported(extension))
        {
            let hint = if extension == MESHOPT {
                " (build it with the cargo feature meshopt)"
            } else {
                ""
            };
            return Err(self.error(
                format!("extensionsRequired[{index}]"),
                format!(
                    "the file needs {}, which gpugi does not support{hint}",
                    quoted(extension)
                ),
            ));
        }
        for extension in &self.root.extensions_used {
            if !is_supported(extension) {
                self.warn(
                    "extensionsUsed",
                    format!(
                        "{} is not supported; the picture may lack what it describes",
                        quoted(extension)
                    ),
                );
            }
        }
        Ok(())
    }

    fn read_buffers(
        &mut self,
        binary: Option<&'a [u8]>,
        resolver: &dyn Resolver,
    ) -> Result<(), ImportError> {
        let mut total = 0_u64;
        let mut buffers = Vec::with_capacity(self.root.buffers.len());
        for (index, buffer) in self.root.buffers.iter().enumerate() {
            let place = format!("buffers[{index}]");
            let bytes = match (&buffer.uri, binary) {
                // Compressed buffer views never read their fallback.
                _ if cfg!(feature = "meshopt") && buffer.extensions.meshopt.fallback => None,
                (Some(uri), _) => {
                    Some(Cow::from(uri::read(uri, resolver).map_err(|reason| {
                        self.error(format!("{place}.uri"), reason)
                    })?))
                }
                (None, Some(binary)) if index == 0 => Some(Cow::from(binary)),
                (None, _) => None,
            };
            if let Some(bytes) = &bytes {
                if (bytes.len() as u64) < buffer.byte_length {
                    return Err(self.error(
                        place,
                        format!(
                            "{} bytes where byteLength says {}",
                            bytes.len(),
                            buffer.byte_length
                        ),
                    ));
                }
                let buffer_size = bytes.len() as u64;
                total += buffer_size;
                self.check_bytes(total, &place)?;
                if let Some(uri) = &buffer.uri {
                    self.given(uri, bytes.len());
                    self.charge(buffer_size, 1, &place)?;
                }
            }
            buffers.push(bytes);
        }
        self.buffers = buffers;
        Ok(())
    }

    #[cfg(feature = "meshopt")]
    fn decode_views(&mut self) -> Result<(), ImportError> {
        let mut total = 0_u64;
        let mut decoded = Vec::with_capacity(self.root.buffer_views.len());
        for (index, view) in self.root.buffer_views.iter().enumerate() {
            let Some(compressed) = &view.extensions.meshopt else {
                decoded.push(None);
                continue;
            };
            let place = format!("bufferViews[{index}].extensions.{MESHOPT}");
            let bytes = self.slice(
                compressed.buffer,
                compressed.byte_offset,
                compressed.byte_length,
                &place,
            )?;
            total = total.saturating_add(compressed.count.saturating_mul(compressed.byte_stride));
            self.check_bytes(total, &place)?;
            self.charge(compressed.count, compressed.byte_stride as usize, &place)?;
            let view = super::meshopt::decode(compressed, bytes)
                .map_err(|reason| self.error(place, reason))?;
            decoded.push(Some(view));
        }
        self.decoded_views = decoded;
        Ok(())
    }

    #[cfg(not(feature = "meshopt"))]
    fn decode_views(&mut self) -> Result<(), ImportError> {
        Ok(())
    }

    fn check_bytes(&self, total: u64, place: &str) -> Result<(), ImportError> {
        if total > self.limits.file_bytes {
            return Err(self.error(
                place,
                format!(
                    "the buffers together exceed the limit of {} bytes",
                    self.limits.file_bytes
                ),
            ));
        }
        Ok(())
    }
}

/// `length` bytes at `offset`, if they exist.
pub fn range(bytes: &[u8], offset: u64, length: u64) -> Option<&[u8]> {
    let end = usize::try_from(offset.checked_add(length)?).ok()?;
    bytes.get(usize::try_from(offset).ok()?..end)
}

/// The parts of a file.
#[derive(Default)]
struct Parts<'a> {
    json: &'a [u8],
    /// The BIN chunk of a binary file.
    binary: Option<&'a [u8]>,
    further_chunks: &'a [u8],
}

/// At most how many bytes the parsed JSON takes: each object at most as many as the largest struct, each further entry
/// of a list or an object as many as one of any type, and names and strings as many as the text.
fn parsed_size(json: &[u8]) -> u64 {
    const OBJECT: u64 = size_of::<schema::Material>() as u64;
    const ENTRY: u64 = 2 * size_of::<serde_json::Value>() as u64;
    let sizes = json.iter().map(|byte| match byte {
        b'{' => OBJECT,
        b',' | b'[' => ENTRY,
        _ => 1,
    });
    sizes.sum()
}

/// Parses the JSON; an error names the path in the document.
fn parse(name: &str, json: &[u8]) -> Result<schema::Root, ImportError> {
    let mut source = serde_json::Deserializer::from_slice(json);
    let parsed = serde_path_to_error::deserialize(&mut source).map_err(|error| {
        let path = error.path().to_string();
        let place = if path == "." { "JSON".to_owned() } else { path };
        let reason = quoted_reason(&error.into_inner().to_string());
        ImportError::new(name, quoted(&place), reason)
    });
    let root = parsed?;
    let end = source.end();
    end.map_err(|error| ImportError::new(name, "JSON", quoted_reason(&error.to_string())))?;
    Ok(root)
}

/// A message of serde without the text that it quotes beyond its beginning: it may hold a whole file.
fn quoted_reason(reason: &str) -> String {
    const MOST: usize = 200;
    if reason.chars().nth(MOST).is_none() {
        return reason.to_owned();
    }
    let start: String = reason.chars().take(60).collect();
    let end = reason.rfind("expected").map_or("", |at| &reason[at..]);
    format!("{start}... {}", quoted(end))
}

fn split<'a>(name: &str, bytes: &'a [u8]) -> Result<Parts<'a>, ImportError> {
    let error = |place: &str, reason: String| ImportError::new(name, place, reason);
    if bytes.is_empty() {
        return Err(error("header", "the file is empty".to_owned()));
    }
    let Some(rest) = bytes.strip_prefix(b"glTF") else {
        return Ok(Parts {
            json: without_mark(bytes).map_err(|reason| error("JSON", reason))?,
            ..Parts::default()
        });
    };
    let truncated = || error("header", "the file ends inside its header".to_owned());
    let (version, rest) = take_u32(rest).ok_or_else(truncated)?;
    let (length, rest) = take_u32(rest).ok_or_else(truncated)?;
    if version != 2 {
        return Err(error(
            "header",
            format!("gpugi reads version 2 of binary glTF, not {version}"),
        ));
    }
    if u64::from(length) > bytes.len() as u64 {
        return Err(error(
            "header",
            format!(
                "the file is truncated: {} of {length} bytes are left",
                bytes.len()
            ),
        ));
    }
    let (json, rest) = chunk(rest, *b"JSON").map_err(|reason| error("JSON chunk", reason))?;
    if rest.len() < 8 {
        return Ok(Parts {
            json,
            ..Parts::default()
        });
    }
    let (binary, further_chunks) =
        chunk(rest, *b"BIN\0").map_err(|reason| error("BIN chunk", reason))?;
    Ok(Parts {
        json,
        binary: Some(binary),
        further_chunks,
    })
}

/// The content of the first chunk in `bytes`, and the bytes after that chunk.
fn chunk(bytes: &[u8], kind: [u8; 4]) -> Result<(&[u8], &[u8]), String> {
    let truncated = "the file ends inside the chunk's header";
    let (length, rest) = take_u32(bytes).ok_or(truncated)?;
    let (found, rest) = rest.split_first_chunk::<4>().ok_or(truncated)?;
    if *found != kind {
        return Err(format!(
            "a chunk of type {:?} stands in its place",
            String::from_utf8_lossy(found)
        ));
    }
    rest.split_at_checked(length as usize).ok_or_else(|| {
        format!(
            "the file is truncated: {} of {length} bytes are left",
            rest.len()
        )
    })
}

fn take_u32(bytes: &[u8]) -> Option<(u32, &[u8])> {
    let (number, rest) = bytes.split_first_chunk::<4>()?;
    Some((u32::from_le_bytes(*number), rest))
}
