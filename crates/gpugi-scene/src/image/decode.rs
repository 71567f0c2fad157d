//! Decodes image files. Sizes are checked against [`Limits`] before anything of that size is allocated.

use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, codecs};

use super::heights::Heights;
use super::size::{RADIANCE_TEXEL, check_expansion, decoder_limits, finish};
use super::srgb::linear_from_srgb;
use super::{exr, hdr, ktx2};
use crate::import::budget::ImageLimits;
use crate::{Image, ImportError, Limits, Pixels};

/// Bytes per texel of [`Pixels::Rgba8`].
const COLOR_TEXEL: u64 = 4;
/// Decodes a material texture (PNG, JPEG, WebP, 8-bit KTX2, Basis Universal) to [`Pixels::Rgba8`]; 16-bit channels are rounded to 8.
///
/// Files that hold radiance (HDR, EXR, KTX2 with floats) are rejected, because 8 bits cannot represent their values.
pub fn decode_color(name: &str, bytes: &[u8], limits: &Limits) -> Result<Image, ImportError> {
    decode_color_within(name, bytes, &ImageLimits::alone(limits))
}

/// Like [`decode_color`], for an image of a scene.
pub(crate) fn decode_color_within(
    name: &str,
    bytes: &[u8],
    limits: &ImageLimits,
) -> Result<Image, ImportError> {
    let format = recognise(name, bytes)?;
    let decoded = match format {
        Format::Ktx2 => return ktx2::decode_color(name, bytes, limits),
        Format::OpenExr | Format::Hdr => {
            return Err(ImportError::new(
                name,
                "header",
                "this file holds radiance; a material texture is a PNG, a JPEG, a WebP or a KTX2 of 8 bits",
            ));
        }
        Format::Other(format) => decode(name, bytes, format, limits, COLOR_TEXEL)?,
    };
    let texels = decoded.into_rgba8();
    Ok(Image {
        name: name.to_owned(),
        width: texels.width(),
        height: texels.height(),
        pixels: Pixels::Rgba8(texels.into_raw()),
    })
}

/// Decodes a height map of a scene (PNG, JPEG and WebP, KTX2, EXR, HDR).
pub(crate) fn decode_heights_within(
    name: &str,
    bytes: &[u8],
    limits: &ImageLimits,
) -> Result<Heights, ImportError> {
    let image = match recognise(name, bytes)? {
        Format::Ktx2 => ktx2::decode_color(name, bytes, limits)?,
        Format::OpenExr => exr::decode(name, bytes, limits)?,
        Format::Hdr => hdr::decode(name, bytes, limits)?,
        Format::Other(format) => {
            let decoded = decode(name, bytes, format, limits, COLOR_TEXEL)?;
            let texels = decoded.to_luma32f();
            let (width, height) = texels.dimensions();
            return Ok(Heights::new(width, height, texels.into_raw()));
        }
    };
    check_finite(&image)?;
    Ok(Heights::of(&image))
}

/// Bytes of the texels that a PNG, JPEG, WebP or KTX2 claims to have, as material textures; 0 for others.
pub(crate) fn claimed_bytes(bytes: &[u8]) -> u64 {
    if bytes.starts_with(&::ktx2::MAGIC) {
        return ktx2::claimed_texels(bytes).saturating_mul(COLOR_TEXEL);
    }
    let format = image::guess_format(bytes);
    let Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)) = format else {
        return 0;
    };
    let size = ImageReader::with_format(Cursor::new(bytes), format).into_dimensions();
    size.map_or(0, |(width, height)| {
        u64::from(width) * u64::from(height) * COLOR_TEXEL
    })
}

/// Decodes an image that holds radiance (HDR, EXR, KTX2; PNG and JPEG are linearised from sRGB) to
/// [`Pixels::Rgba32Float`] with alpha 1. A texel that is not finite is an error. Negative radiance becomes 0, with a
/// warning in the log.
pub fn decode_radiance(name: &str, bytes: &[u8], limits: &Limits) -> Result<Image, ImportError> {
    let (mut image, _) = decode_linear(name, bytes, limits)?;
    remove_negative(&mut image);
    Ok(image)
}

/// Like [`decode_radiance`], but keeps negative values. Also returns whether the file was sRGB-encoded for display.
pub(super) fn decode_linear(
    name: &str,
    bytes: &[u8],
    limits: &Limits,
) -> Result<(Image, bool), ImportError> {
    let limits = &ImageLimits::alone(limits);
    let (image, encoded_as_srgb) = match recognise(name, bytes)? {
        Format::Ktx2 => (ktx2::decode_radiance(name, bytes, limits)?, false),
        Format::OpenExr => (exr::decode(name, bytes, limits)?, false),
        Format::Hdr => (hdr::decode(name, bytes, limits)?, false),
        Format::Other(format) => {
            let decoded = decode(name, bytes, format, limits, RADIANCE_TEXEL)?;
            let mut texels = decoded.into_rgba32f();
            for texel in texels.pixels_mut() {
                texel.0 = texel.0.map(linear_from_srgb);
                texel.0[3] = 1.0;
            }
            let image = Image {
                name: name.to_owned(),
                width: texels.width(),
                height: texels.height(),
                pixels: Pixels::Rgba32Float(texels.into_raw()),
            };
            (image, true)
        }
    };
    check_finite(&image)?;
    Ok((image, encoded_as_srgb))
}

/// Reads the file at `path` as [`decode_radiance`] does.
pub fn load_radiance(path: &Path, limits: &Limits) -> Result<Image, ImportError> {
    let name = path.display().to_string();
    let bytes = crate::import::read_limited(path, limits.file_bytes)
        .map_err(|reason| ImportError::new(&name, "open", reason))?;
    decode_radiance(&name, &bytes, limits)
}

/// A file format that gpugi reads.
enum Format {
    Ktx2,
    OpenExr,
    Hdr,
    Other(ImageFormat),
}

/// Detects the format from the first bytes, because file names and media types are often wrong.
fn recognise(name: &str, bytes: &[u8]) -> Result<Format, ImportError> {
    if bytes.is_empty() {
        return Err(ImportError::new(name, "header", "the file is empty"));
    }
    if bytes.starts_with(&::ktx2::MAGIC) {
        return Ok(Format::Ktx2);
    }
    if bytes.starts_with(hdr::SIGNATURE) {
        return Ok(Format::Hdr);
    }
    match image::guess_format(bytes) {
        Ok(ImageFormat::OpenExr) => Ok(Format::OpenExr),
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)) => {
            Ok(Format::Other(format))
        }
        Ok(format) => Err(ImportError::new(
            name,
            "header",
            format!("{format:?} is not supported; gpugi reads PNG, JPEG, WebP, HDR, EXR and KTX2"),
        )),
        Err(_) => Err(ImportError::new(
            name,
            "header",
            "this is no image that gpugi knows (PNG, JPEG, WebP, HDR, EXR, KTX2)",
        )),
    }
}

/// Encoders write about ten scans.
const MOST_SCANS: usize = 100;

/// The first picture of a JPEG up to its end, and the number of its scans. Cameras append others, and films.
fn first_picture(bytes: &[u8]) -> (&[u8], usize) {
    let mut at = 2;
    // Segments up to the first scan. They have lengths, and may hold anything, such as a small picture.
    loop {
        let is_marker = |byte: &u8| !matches!(byte, 0 | 0xff);
        let rest = bytes.get(at..).unwrap_or_default();
        let Some(start) = rest.iter().position(|&byte| byte == 0xff) else {
            return (bytes, 0);
        };
        let Some(fill) = rest[start..].iter().position(is_marker) else {
            return (bytes, 0);
        };
        at += start + fill;
        if bytes[at] == 0xda {
            break;
        }
        let length = bytes.get(at + 1..).and_then(|rest| rest.first_chunk());
        at += 1 + length.map_or(0, |&length| usize::from(u16::from_be_bytes(length)));
    }
    // Compressed data holds neither of the two markers.
    let end = bytes[at..].windows(2).position(|pair| pair == [0xff, 0xd9]);
    let end = end.map_or(bytes.len(), |end| at + end + 2);
    let scans = bytes[at..end]
        .windows(2)
        .filter(|pair| *pair == [0xff, 0xda]);
    (&bytes[..end], 1 + scans.count())
}

/// Width and height in the header of the picture of a WebP file.
fn webp_picture(bytes: &[u8]) -> Option<(u32, u32)> {
    // "RIFF", the length, "WEBP"; then chunks of a name, a length and as many bytes, to an even number.
    let mut rest = bytes.get(12..)?;
    loop {
        let length = u32::from_le_bytes(*rest.get(4..)?.first_chunk()?) as usize;
        let content = rest.get(8..)?;
        match rest.get(..4)? {
            b"VP8 " => {
                let sizes = content.get(6..)?.first_chunk::<4>()?;
                let side = |low: usize| u32::from(sizes[low]) | u32::from(sizes[low + 1]) << 8;
                return Some((side(0) & 0x3fff, side(2) & 0x3fff));
            }
            b"VP8L" => {
                let sizes = u32::from_le_bytes(*content.get(1..)?.first_chunk()?);
                return Some(((sizes & 0x3fff) + 1, (sizes >> 14 & 0x3fff) + 1));
            }
            _ => rest = content.get(length.checked_next_multiple_of(2)?..)?,
        }
    }
}

fn decode(
    name: &str,
    bytes: &[u8],
    format: ImageFormat,
    limits: &ImageLimits,
    texel: u64,
) -> Result<DynamicImage, ImportError> {
    let reader = Cursor::new(bytes);
    let header_error = |reason: String| ImportError::new(name, "header", reason);
    let header = |error: image::ImageError| header_error(error.to_string());
    match format {
        ImageFormat::Png => {
            let decoder = codecs::png::PngDecoder::with_limits(reader, decoder_limits(limits));
            let decoder = decoder.map_err(header)?;
            check_expansion(name, decoder.dimensions(), texel, bytes.len(), true, limits)?;
            finish(name, decoder, limits, texel)
        }
        ImageFormat::Jpeg => {
            // Each scan visits every block, in as few as two bytes per 32,767 of them.
            let (picture, scans) = first_picture(bytes);
            if scans > MOST_SCANS {
                let reason = format!("{scans} scans, where {MOST_SCANS} are the most");
                return Err(header_error(reason));
            }
            let decoder = codecs::jpeg::JpegDecoder::new(Cursor::new(picture));
            let decoder = decoder.map_err(header)?;
            // Each block of texels takes some bits, also of one colour.
            check_expansion(
                name,
                decoder.dimensions(),
                texel,
                picture.len(),
                false,
                limits,
            )?;
            finish(name, decoder, limits, texel)
        }
        ImageFormat::WebP => {
            let decoder = codecs::webp::WebPDecoder::new(reader).map_err(header)?;
            if decoder.has_animation() {
                return Err(header_error("a film is no image".to_owned()));
            }
            // The decoder decodes the picture whole before it compares the two.
            if webp_picture(bytes) != Some(decoder.dimensions()) {
                let reason = "the picture is not as large as the file says".to_owned();
                return Err(header_error(reason));
            }
            check_expansion(name, decoder.dimensions(), texel, bytes.len(), true, limits)?;
            finish(name, decoder, limits, texel)
        }
        _ => unreachable!("no other format is recognised"),
    }
}

/// Rejects texels that are not finite.
fn check_finite(image: &Image) -> Result<(), ImportError> {
    let Pixels::Rgba32Float(values) = &image.pixels else {
        return Ok(());
    };
    let broken = |texel: &[f32]| texel.iter().any(|value| !value.is_finite());
    match values.chunks_exact(4).enumerate().find(|(_, t)| broken(t)) {
        Some((at, texel)) => Err(ImportError::new(
            &image.name,
            place(image.width, at),
            format!("{:?} is no radiance: it is not finite", &texel[..3]),
        )),
        None => Ok(()),
    }
}

/// Sets negative radiance to 0 and logs a warning. Most measured environments that were resized with a sharp filter
/// have some around their brightest lights, where it stands for no light.
fn remove_negative(image: &mut Image) {
    let Pixels::Rgba32Float(values) = &mut image.pixels else {
        return;
    };
    let mut negative = None;
    for (at, value) in values.iter_mut().enumerate() {
        if *value < 0.0 {
            negative.get_or_insert((at / 4, *value));
            *value = 0.0;
        }
    }
    if let Some((at, value)) = negative {
        tracing::warn!(
            "{}: {}: negative radiance ({value}, the first of its kind) is taken as 0",
            image.name,
            place(image.width, at)
        );
    }
}

/// Names a texel by its coordinates, for messages.
fn place(width: u32, at: usize) -> String {
    let width = width as usize;
    format!("texel ({}, {})", at % width, at / width)
}
