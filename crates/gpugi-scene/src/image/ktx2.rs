//! Reads and writes KTX2 files with uncompressed texels.

use std::io::{self, Write};
use std::path::Path;

use half::f16;
use ktx2::dfd::{Basic, Block};
use ktx2::{Format, Header, Index, LevelIndex};

use super::{basis, replace_file};

use super::size::check_size;
use super::srgb::linear_from_srgb;
use crate::import::budget::ImageLimits;
use crate::{Image, ImportError, Pixels};

/// An RGBA texture of half floats: a 2D texture, a 3D texture or a cube map.
#[derive(Debug, Clone, PartialEq)]
pub struct HalfTexture {
    /// Width and height of level 0 (texels).
    pub size: [u32; 2],
    /// Slices of a 3D texture, which has one level; otherwise 1.
    pub depth: u32,
    /// 1, or 6 for a cube map: +X, -X, +Y, -Y, +Z, -Z in KTX2's left-handed axes.
    pub faces: u32,
    /// Mip levels, finest first, each with half the width and height of the one before. Within a level: face by face,
    /// or slice by slice, row by row from the top.
    pub levels: Vec<Vec<[f16; 4]>>,
}

/// Writes a texture as KTX2: VK_FORMAT_R16G16B16A16_SFLOAT, linear Rec. 709, without supercompression.
pub fn save_ktx2(path: &Path, texture: &HalfTexture) -> io::Result<()> {
    replace_file(path, |file| write_ktx2(file, texture))
}

fn write_ktx2(file: &mut impl Write, texture: &HalfTexture) -> io::Result<()> {
    check_levels(texture)?;
    let levels: Vec<u64> = texture
        .levels
        .iter()
        .map(|level| (level.len() * 8) as u64)
        .collect();
    let head = Head {
        format: Format::R16G16B16A16_SFLOAT,
        size: texture.size,
        depth: if texture.depth > 1 { texture.depth } else { 0 },
        layers: 0,
        faces: texture.faces,
        level_bytes: &levels,
    };
    write_head(file, &head)?;
    for texel in texture.levels.iter().rev().flatten() {
        file.write_all(texel.map(f16::to_le_bytes).as_flattened())?;
    }
    Ok(())
}

/// What stands before the texels.
pub(super) struct Head<'a> {
    pub format: Format,
    pub size: [u32; 2],
    /// Slices of a 3D texture, otherwise 0.
    pub depth: u32,
    /// Layers of an array, otherwise 0.
    pub layers: u32,
    pub faces: u32,
    /// Bytes of the levels, finest first: multiples of 8, but for the coarsest.
    pub level_bytes: &'a [u64],
}

/// Writes everything up to the texels, which have to follow: the coarsest level first.
pub(super) fn write_head(file: &mut impl Write, head: &Head) -> io::Result<()> {
    let (basic, type_size) = Basic::from_format(head.format).map_err(io::Error::other)?;
    let block = Block::Basic(basic).to_vec();
    let descriptor = [&(block.len() as u32 + 4).to_le_bytes()[..], &block].concat();
    // Sorted by key, each padded to a multiple of four bytes.
    let mut values = Vec::new();
    let writer = concat!("gpugi ", env!("CARGO_PKG_VERSION"));
    let orientation = if head.depth > 0 { "rdi" } else { "rd" };
    for (key, value) in [("KTXorientation", orientation), ("KTXwriter", writer)] {
        let pair = format!("{key}\0{value}\0");
        values.extend((pair.len() as u32).to_le_bytes());
        values.extend(pair.as_bytes());
        values.resize(values.len().next_multiple_of(4), 0);
    }
    let descriptor_at = Header::LENGTH + head.level_bytes.len() * LevelIndex::LENGTH;
    let values_at = descriptor_at + descriptor.len();
    let values_end = values_at + values.len();
    let header = Header {
        format: Some(head.format),
        type_size,
        pixel_width: head.size[0],
        pixel_height: head.size[1],
        pixel_depth: head.depth,
        layer_count: head.layers,
        face_count: head.faces,
        level_count: head.level_bytes.len() as u32,
        supercompression_scheme: None,
        index: Index {
            dfd_byte_offset: descriptor_at as u32,
            dfd_byte_length: descriptor.len() as u32,
            kvd_byte_offset: values_at as u32,
            kvd_byte_length: values.len() as u32,
            sgd_byte_offset: 0,
            sgd_byte_length: 0,
        },
    };
    // The coarsest level comes first in the file, and each level starts at a multiple of eight bytes.
    let mut at = values_end.next_multiple_of(8) as u64;
    let mut index = Vec::new();
    for &byte_length in head.level_bytes.iter().rev() {
        let entry = LevelIndex {
            byte_offset: at,
            byte_length,
            uncompressed_byte_length: byte_length,
        };
        index.push(entry.as_bytes());
        at += byte_length;
    }
    index.reverse();
    file.write_all(&header.as_bytes())?;
    file.write_all(index.as_flattened())?;
    file.write_all(&descriptor)?;
    file.write_all(&values)?;
    file.write_all(&[0; 8][..values_end.next_multiple_of(8) - values_end])
}

/// Rejects levels whose size does not match the header that will be written.
fn check_levels(texture: &HalfTexture) -> io::Result<()> {
    let [width, height] = texture.size;
    let refuse = |reason: String| Err(io::Error::new(io::ErrorKind::InvalidInput, reason));
    let most = width
        .max(height)
        .checked_ilog2()
        .map_or(0, |level| level + 1);
    let is_cube = texture.faces == 6 && width == height;
    let is_solid = texture.depth > 1 && texture.faces == 1 && texture.levels.len() == 1;
    if texture.levels.is_empty()
        || texture.levels.len() > most as usize
        || height == 0
        || !(texture.faces == 1 || is_cube)
        || !(texture.depth == 1 || is_solid)
    {
        return refuse(format!(
            "{} levels of {width} x {height} texels and {} faces are no texture",
            texture.levels.len(),
            texture.faces
        ));
    }
    for (level, texels) in texture.levels.iter().enumerate() {
        let side = |side: u32| u64::from((side >> level).max(1));
        let wanted =
            side(width) * side(height) * u64::from(texture.faces) * u64::from(texture.depth);
        if texels.len() as u64 != wanted {
            return refuse(format!(
                "level {level} has {} texels where {wanted} are needed",
                texels.len()
            ));
        }
    }
    Ok(())
}

/// Storage format of a channel.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Channel {
    Byte { srgb: bool },
    Half,
    Float,
}

impl Channel {
    /// Bytes per texel.
    pub fn size(self) -> usize {
        match self {
            Self::Byte { .. } => 1,
            Self::Half => 2,
            Self::Float => 4,
        }
    }
}

/// Reads an 8-bit KTX2 image.
pub(super) fn decode_color(
    name: &str,
    bytes: &[u8],
    limits: &ImageLimits,
) -> Result<Image, ImportError> {
    if let Some(header) = basis_header(bytes) {
        return basis::decode(name, bytes, &header, limits);
    }
    decode(name, bytes, limits, 4, |layout, texels| {
        if !matches!(layout.channel, Channel::Byte { .. }) {
            return Err(ImportError::new(
                name,
                "header",
                "this file holds floats; a material texture needs 8 bits a channel",
            ));
        }
        let texels = texels.chunks_exact(layout.channels);
        Ok(Pixels::Rgba8(
            texels.flat_map(|texel| four(texel, 255)).collect(),
        ))
    })
}

/// Reads a KTX2 image as linear radiance.
pub(super) fn decode_radiance(
    name: &str,
    bytes: &[u8],
    limits: &ImageLimits,
) -> Result<Image, ImportError> {
    decode(name, bytes, limits, 16, |layout, texels| {
        let value = |bytes: &[u8]| match layout.channel {
            Channel::Byte { srgb: true } => linear_from_srgb(f32::from(bytes[0]) / 255.0),
            Channel::Byte { srgb: false } => f32::from(bytes[0]) / 255.0,
            Channel::Half => f16::from_le_bytes([bytes[0], bytes[1]]).to_f32(),
            Channel::Float => f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
        };
        let size = layout.channel.size();
        let texels = texels.chunks_exact(layout.channels * size);
        let pixels = texels.flat_map(|texel| {
            let mut values = [0.0; 4];
            for (value_out, bytes) in values.iter_mut().zip(texel.chunks_exact(size)) {
                *value_out = value(bytes);
            }
            let [red, green, blue, _] = four(&values[..layout.channels], 1.0);
            [red, green, blue, 1.0]
        });
        Ok(Pixels::Rgba32Float(pixels.collect()))
    })
}

/// Expands a texel to four channels: a single channel is grey, a missing blue is 0 and a missing alpha is `one`.
fn four<T: Copy + Default>(channels: &[T], one: T) -> [T; 4] {
    match *channels {
        [grey] => [grey, grey, grey, one],
        [red, green] => [red, green, T::default(), one],
        [red, green, blue] => [red, green, blue, one],
        [red, green, blue, alpha, ..] => [red, green, blue, alpha],
        [] => [T::default(); 4],
    }
}

/// The parts of the header that matter here.
struct Layout {
    size: (u32, u32),
    channels: usize,
    channel: Channel,
}

/// Texels of the first level that a file claims to have; 0 if its header is none.
pub(super) fn claimed_texels(bytes: &[u8]) -> u64 {
    let header = bytes.first_chunk::<{ Header::LENGTH }>();
    let header = header.and_then(|header| Header::from_bytes(header).ok());
    header.map_or(0, |header| {
        u64::from(header.pixel_width) * u64::from(header.pixel_height)
    })
}

/// The header of a file of one 2D image without a Vulkan format: Basis Universal.
fn basis_header(bytes: &[u8]) -> Option<Header> {
    let header = Header::from_bytes(bytes.first_chunk::<{ Header::LENGTH }>()?).ok()?;
    let is_image = header.pixel_depth == 0 && header.layer_count <= 1 && header.face_count == 1;
    (header.format.is_none() && is_image).then_some(header)
}

/// Where a level lies.
pub(super) fn level_index(bytes: &[u8], level: usize) -> Option<LevelIndex> {
    let entry = bytes.get(Header::LENGTH + level * LevelIndex::LENGTH..)?;
    let entry = entry.first_chunk()?;
    Some(LevelIndex::from_bytes(entry))
}

/// The content of level 0, if it lies within the file.
pub(super) fn finest_level(bytes: &[u8]) -> Option<&[u8]> {
    let level = level_index(bytes, 0)?;
    let start = usize::try_from(level.byte_offset).ok()?;
    let length = usize::try_from(level.byte_length).ok()?;
    bytes.get(start..start.checked_add(length)?)
}

/// The header of a file without supercompression, and the channels of its texels.
pub(super) fn stored_texels(
    name: &str,
    bytes: &[u8],
) -> Result<(Header, usize, Channel), ImportError> {
    let error = |reason: String| ImportError::new(name, "header", reason);
    // Without the crate's reader, which also reads the descriptor, and panics at some.
    let header = bytes.first_chunk::<{ Header::LENGTH }>();
    let header = header.ok_or_else(|| error("the file ends inside its header".to_owned()))?;
    let stored = Header::from_bytes(header).map_err(|reason| error(reason.to_string()))?;
    if let Some(scheme) = stored.supercompression_scheme {
        return Err(error(format!(
            "supercompression {scheme:?} is not supported; store the texels as they are"
        )));
    }
    let byte = |srgb| Channel::Byte { srgb };
    let (channels, channel) = match stored.format {
        Some(Format::R8_UNORM) => (1, byte(false)),
        Some(Format::R8_SRGB) => (1, byte(true)),
        Some(Format::R8G8_UNORM) => (2, byte(false)),
        Some(Format::R8G8_SRGB) => (2, byte(true)),
        Some(Format::R8G8B8_UNORM) => (3, byte(false)),
        Some(Format::R8G8B8_SRGB) => (3, byte(true)),
        Some(Format::R8G8B8A8_UNORM) => (4, byte(false)),
        Some(Format::R8G8B8A8_SRGB) => (4, byte(true)),
        Some(Format::R16_SFLOAT) => (1, Channel::Half),
        Some(Format::R16G16_SFLOAT) => (2, Channel::Half),
        Some(Format::R16G16B16_SFLOAT) => (3, Channel::Half),
        Some(Format::R16G16B16A16_SFLOAT) => (4, Channel::Half),
        Some(Format::R32_SFLOAT) => (1, Channel::Float),
        Some(Format::R32G32_SFLOAT) => (2, Channel::Float),
        Some(Format::R32G32B32_SFLOAT) => (3, Channel::Float),
        Some(Format::R32G32B32A32_SFLOAT) => (4, Channel::Float),
        Some(other) => {
            return Err(error(format!(
                "format {other:?} is not supported; gpugi reads 8-bit, 16- and 32-bit float texels"
            )));
        }
        None => {
            return Err(error(
                "Basis Universal texels are read as images of materials only; store 8-bit or float texels".to_owned(),
            ));
        }
    };
    Ok((stored, channels, channel))
}

/// `texel`: bytes per decoded texel.
fn decode(
    name: &str,
    bytes: &[u8],
    limits: &ImageLimits,
    texel: u64,
    convert: impl Fn(&Layout, &[u8]) -> Result<Pixels, ImportError>,
) -> Result<Image, ImportError> {
    let (stored, channels, channel) = stored_texels(name, bytes)?;
    if stored.pixel_depth > 1 || stored.layer_count > 1 || stored.face_count != 1 {
        return Err(ImportError::new(
            name,
            "header",
            "volumes, arrays and cube maps are no 2D image",
        ));
    }
    let layout = Layout {
        size: (stored.pixel_width, stored.pixel_height.max(1)),
        channels,
        channel,
    };
    check_size(name, layout.size, texel, limits)?;
    let wanted = u64::from(layout.size.0)
        * u64::from(layout.size.1)
        * (layout.channels * layout.channel.size()) as u64;
    let texels = finest_level(bytes).unwrap_or_default();
    if (texels.len() as u64) < wanted {
        return Err(ImportError::new(
            name,
            "level 0",
            format!("{} bytes of texels where {wanted} are needed", texels.len()),
        ));
    }
    let pixels = convert(&layout, &texels[..wanted as usize])?;
    Ok(Image {
        name: name.to_owned(),
        width: layout.size.0,
        height: layout.size.1,
        pixels,
    })
}
