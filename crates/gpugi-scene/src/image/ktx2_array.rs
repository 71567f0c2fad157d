//! Array textures as KTX2 files in memory.

use std::io;

use half::f16;
use ktx2::{Format, Header, LevelIndex};

use super::ktx2::{Head, write_head};

/// A square RGBA array texture without mip levels: layer by layer, row by row from the top.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum ArrayTexels {
    /// VK_FORMAT_R16G16B16A16_SFLOAT.
    Half(Vec<[f16; 4]>),
    /// VK_FORMAT_R8G8B8A8_SNORM.
    Byte(Vec<[i8; 4]>),
    /// VK_FORMAT_E5B9G9R9_UFLOAT_PACK32.
    SharedExponent(Vec<u32>),
}

/// A KTX2 file of `layers` layers with `side` texels per side.
pub(crate) fn encode(side: u32, layers: u32, texels: &ArrayTexels) -> io::Result<Vec<u8>> {
    let (format, bytes): (_, &[u8]) = match texels {
        ArrayTexels::Half(texels) => (Format::R16G16B16A16_SFLOAT, bytemuck::cast_slice(texels)),
        ArrayTexels::Byte(texels) => (Format::R8G8B8A8_SNORM, bytemuck::cast_slice(texels)),
        ArrayTexels::SharedExponent(texels) => {
            (Format::E5B9G9R9_UFLOAT_PACK32, bytemuck::cast_slice(texels))
        }
    };
    let mut file = Vec::new();
    let head = Head {
        format,
        size: [side; 2],
        depth: 0,
        layers,
        faces: 1,
        level_bytes: &[bytes.len() as u64],
    };
    write_head(&mut file, &head)?;
    file.extend(bytes);
    Ok(file)
}

/// The bytes of an array texture's texels, if it has this size and format.
fn content(bytes: &[u8], side: u32, layers: u32, format: Format) -> Result<&[u8], String> {
    let header = bytes.first_chunk::<{ Header::LENGTH }>();
    let header = header.ok_or("the file ends inside its header")?;
    let header = Header::from_bytes(header).map_err(|error| error.to_string())?;
    let size = [header.pixel_width, header.pixel_height, header.layer_count];
    if header.supercompression_scheme.is_some()
        || header.format != Some(format)
        || size != [side, side, layers]
        || header.pixel_depth != 0
        || header.face_count != 1
        || header.level_count != 1
    {
        return Err(format!(
            "the texture is not an uncompressed array of {layers} layers with {side} x {side} texels of {format:?}"
        ));
    }
    let entry = bytes[Header::LENGTH..].first_chunk::<{ LevelIndex::LENGTH }>();
    let level = LevelIndex::from_bytes(entry.ok_or("the file ends inside its index")?);
    let texel = match format {
        Format::R16G16B16A16_SFLOAT => 8,
        _ => 4,
    };
    let wanted = u64::from(side) * u64::from(side) * u64::from(layers) * texel;
    let start = usize::try_from(level.byte_offset).ok();
    let length = usize::try_from(wanted).ok();
    start
        .zip(length)
        .and_then(|(start, length)| bytes.get(start..start.checked_add(length)?))
        .filter(|_| level.byte_length == wanted)
        .ok_or_else(|| format!("{wanted} bytes of texels are needed"))
}

/// Reads [`ArrayTexels::Half`] that [`encode`] wrote, if they have this size.
pub(crate) fn decode_half(bytes: &[u8], side: u32, layers: u32) -> Result<Vec<[f16; 4]>, String> {
    let content = content(bytes, side, layers, Format::R16G16B16A16_SFLOAT)?;
    let halves = content.as_chunks::<2>().0.iter();
    let halves: Vec<f16> = halves.map(|half| f16::from_le_bytes(*half)).collect();
    Ok(halves.as_chunks::<4>().0.to_vec())
}

/// Reads [`ArrayTexels::Byte`] that [`encode`] wrote, if they have this size.
pub(crate) fn decode_byte(bytes: &[u8], side: u32, layers: u32) -> Result<&[[i8; 4]], String> {
    let content = content(bytes, side, layers, Format::R8G8B8A8_SNORM)?;
    Ok(bytemuck::cast_slice::<u8, i8>(content).as_chunks::<4>().0)
}

/// Reads [`ArrayTexels::SharedExponent`] that [`encode`] wrote, if they have this size.
pub(crate) fn decode_shared_exponent(
    bytes: &[u8],
    side: u32,
    layers: u32,
) -> Result<Vec<u32>, String> {
    let content = content(bytes, side, layers, Format::E5B9G9R9_UFLOAT_PACK32)?;
    let words = content.as_chunks::<4>().0.iter();
    Ok(words.map(|word| u32::from_le_bytes(*word)).collect())
}
