//! KTX2 with uncompressed texels.

use half::f16;
use ktx2::{Format, Reader};

use super::decode::{check_size, linear_from_srgb};
use crate::{Image, ImportError, Limits, Pixels};

/// How one channel is stored.
#[derive(Clone, Copy, PartialEq)]
enum Channel {
    Byte { srgb: bool },
    Half,
    Float,
}

impl Channel {
    fn size(self) -> usize {
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
    limits: &Limits,
) -> Result<Image, ImportError> {
    decode(name, bytes, limits, 4, |header, texels| {
        if !matches!(header.channel, Channel::Byte { .. }) {
            return Err(ImportError::new(
                name,
                "header",
                "this file holds floats; a material texture needs 8 bits a channel",
            ));
        }
        let texels = texels.chunks_exact(header.channels);
        Ok(Pixels::Rgba8(
            texels.flat_map(|texel| four(texel, 255)).collect(),
        ))
    })
}

/// Reads a KTX2 image as linear radiance.
pub(super) fn decode_radiance(
    name: &str,
    bytes: &[u8],
    limits: &Limits,
) -> Result<Image, ImportError> {
    decode(name, bytes, limits, 16, |header, texels| {
        let value = |bytes: &[u8]| match header.channel {
            Channel::Byte { srgb: true } => linear_from_srgb(f32::from(bytes[0]) / 255.0),
            Channel::Byte { srgb: false } => f32::from(bytes[0]) / 255.0,
            Channel::Half => f16::from_le_bytes([bytes[0], bytes[1]]).to_f32(),
            Channel::Float => f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
        };
        let size = header.channel.size();
        let texels = texels.chunks_exact(header.channels * size);
        let pixels = texels.flat_map(|texel| {
            let mut values = [0.0; 4];
            for (value_out, bytes) in values.iter_mut().zip(texel.chunks_exact(size)) {
                *value_out = value(bytes);
            }
            let [red, green, blue, _] = four(&values[..header.channels], 1.0);
            [red, green, blue, 1.0]
        });
        Ok(Pixels::Rgba32Float(pixels.collect()))
    })
}

/// One channel is grey; a missing blue is 0 and a missing alpha is `one`.
fn four<T: Copy + Default>(channels: &[T], one: T) -> [T; 4] {
    match *channels {
        [grey] => [grey, grey, grey, one],
        [red, green] => [red, green, T::default(), one],
        [red, green, blue] => [red, green, blue, one],
        [red, green, blue, alpha, ..] => [red, green, blue, alpha],
        [] => [T::default(); 4],
    }
}

/// What of the header matters here.
struct Header {
    size: (u32, u32),
    channels: usize,
    channel: Channel,
}

/// `texel`: bytes a texel once decoded.
fn decode(
    name: &str,
    bytes: &[u8],
    limits: &Limits,
    texel: u64,
    convert: impl Fn(&Header, &[u8]) -> Result<Pixels, ImportError>,
) -> Result<Image, ImportError> {
    let error = |reason: String| ImportError::new(name, "header", reason);
    let reader = Reader::new(bytes).map_err(|reason| error(reason.to_string()))?;
    let stored = reader.header();
    if let Some(scheme) = stored.supercompression_scheme {
        return Err(error(format!(
            "supercompression {scheme:?} is not supported; store the texels as they are"
        )));
    }
    if stored.pixel_depth > 1 || stored.layer_count > 1 || stored.face_count != 1 {
        return Err(error(
            "volumes, arrays and cube maps are no 2D image".to_owned(),
        ));
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
                "Basis Universal texels are not supported; store 8-bit or float texels".to_owned(),
            ));
        }
    };
    let header = Header {
        size: (stored.pixel_width, stored.pixel_height.max(1)),
        channels,
        channel,
    };
    check_size(name, header.size, texel, limits)?;
    let wanted = u64::from(header.size.0)
        * u64::from(header.size.1)
        * (header.channels * header.channel.size()) as u64;
    let texels = reader
        .levels()
        .next()
        .map(|level| level.data)
        .unwrap_or_default();
    if (texels.len() as u64) < wanted {
        return Err(ImportError::new(
            name,
            "level 0",
            format!("{} bytes of texels where {wanted} are needed", texels.len()),
        ));
    }
    let pixels = convert(&header, &texels[..wanted as usize])?;
    Ok(Image {
        name: name.to_owned(),
        width: header.size.0,
        height: header.size.1,
        pixels,
    })
}
