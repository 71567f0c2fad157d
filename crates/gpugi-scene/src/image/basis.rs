//! Transcodes Basis Universal textures (KHR_texture_basisu): KTX2 files of ETC1S or UASTC blocks.

use basisu::{DecodeFlags, TargetFormat, Transcoder};
use ktx2::{Header, SupercompressionScheme};

use super::ktx2::level_index;
use super::size::{check_expansion, check_size};
use crate::import::budget::ImageLimits;
use crate::{Image, ImportError, Pixels};

/// Colour models of the data format descriptor.
const ETC1S: u8 = 163;
const UASTC: u8 = 166;
/// Bytes of a descriptor with one sample: block header and sample.
const DESCRIPTOR_BYTES: u64 = 44;
/// Where the header has the length of keys and values.
const KEY_VALUE_LENGTH: usize = 60;
/// More than the transcoder takes.
const MOST_LEVELS: u32 = 32;
/// UASTC stores blocks of 4 x 4 texels in 16 bytes.
const BLOCK: u64 = 4;
const BLOCK_BYTES: u64 = 16;
const TEXEL_BYTES: u64 = 4;

/// The first level of a file without a Vulkan format, as 8-bit RGBA.
pub(super) fn decode(
    name: &str,
    bytes: &[u8],
    header: &Header,
    limits: &ImageLimits,
) -> Result<Image, ImportError> {
    let error = |reason: &str| ImportError::new(name, "header", reason);
    let size = (header.pixel_width, header.pixel_height);
    check_size(name, size, TEXEL_BYTES, limits)?;
    check_expansion(name, size, TEXEL_BYTES, bytes.len(), true, limits)?;
    // What the transcoder takes for granted, or allocates unasked.
    let is_within = |offset: u64, length: u64| {
        (offset.checked_add(length)).is_some_and(|end| end <= bytes.len() as u64)
    };
    let number = |at: usize| {
        let four = bytes.get(at..).and_then(|rest| rest.first_chunk());
        u64::from(four.copied().map_or(u32::MAX, u32::from_le_bytes))
    };
    let (descriptor, codebooks) = (header.index.dfd_byte_offset, header.index.sgd_byte_offset);
    let has_levels = (0..header.level_count.clamp(1, MOST_LEVELS)).all(|number| {
        level_index(bytes, number as usize)
            .is_some_and(|level| is_within(level.byte_offset, level.byte_length))
    });
    let has_codebooks = header.index.sgd_byte_length == 0
        || is_within(codebooks, 0) && {
            let lengths = [4, 8, 12].map(|at| number(codebooks as usize + at));
            is_within(codebooks, lengths.iter().sum())
        };
    let has_descriptor = is_within(descriptor.into(), DESCRIPTOR_BYTES);
    if !(has_levels && has_codebooks && has_descriptor) {
        return Err(error("its parts do not lie within the file"));
    }
    let level = level_index(bytes, 0).ok_or_else(|| error("it has no levels"))?;
    let model = bytes[descriptor as usize + 12];
    let blocks = [size.0, size.1].map(|side| u64::from(side).div_ceil(BLOCK));
    let is_zstd = header.supercompression_scheme == Some(SupercompressionScheme::Zstandard);
    match model {
        ETC1S => {}
        UASTC if !is_zstd => {}
        UASTC if level.uncompressed_byte_length == blocks[0] * blocks[1] * BLOCK_BYTES => {}
        UASTC => return Err(error("its level has not as many bytes as texels need")),
        _ => {
            return Err(error(
                "its texels are neither ETC1S nor UASTC, the kinds of Basis Universal that glTF has",
            ));
        }
    }
    // Keys and values say nothing of the texels; damaged ones make it count beyond their end.
    let mut bytes = bytes.to_vec();
    bytes[KEY_VALUE_LENGTH..KEY_VALUE_LENGTH + 4].fill(0);
    let transcoder = Transcoder::new(&bytes)
        .map_err(|_| error("it is damaged, or no Basis Universal texture of glTF"))?;
    let pixels = transcoder
        .transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE)
        .map_err(|_| ImportError::new(name, "level 0", "its blocks are damaged"))?;
    Ok(Image {
        name: name.to_owned(),
        width: size.0,
        height: size.1,
        pixels: Pixels::Rgba8(pixels),
    })
}
