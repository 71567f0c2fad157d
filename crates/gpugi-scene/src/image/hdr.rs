//! Radiance HDR. The header is read here: programs write lines, names and orientations in it that the decoder of the
//! texels does not know.
//!
//! Format: Ward, "Real Pixels", Graphics Gems II, 1991; <https://radsite.lbl.gov/radiance/refer/filefmts.pdf>

use std::io::Read;

use glam::{DMat3, DVec3};
use image::codecs::hdr::HdrDecoder;

use super::primaries::{Chromaticities, XYZ, rec709_from};
use super::size::{RADIANCE_TEXEL, check_expansion, finish};
use crate::import::budget::ImageLimits;
use crate::import::quoted;
use crate::{Image, ImportError, Pixels};

/// The first bytes; the name of a program follows.
pub(super) const SIGNATURE: &[u8] = b"#?";

/// Decodes to [`Pixels::Rgba32Float`] with alpha 1.
pub(super) fn decode(name: &str, bytes: &[u8], limits: &ImageLimits) -> Result<Image, ImportError> {
    let header = Header::parse(bytes).map_err(|reason| ImportError::new(name, "header", reason))?;
    let [first, second] = &header.axes;
    // The decoder wants its own first line, and lines from the top, left to right.
    let usual = format!(
        "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {} +X {}\n",
        first.length, second.length
    );
    let decoder = HdrDecoder::new(usual.as_bytes().chain(header.texels))
        .map_err(|error| ImportError::new(name, "header", error))?;
    let size = (second.length, first.length);
    check_expansion(name, size, RADIANCE_TEXEL, bytes.len(), false, limits)?;
    let stored = finish(name, decoder, limits, RADIANCE_TEXEL)?.into_rgb32f();

    let (width, height) = if first.is_x {
        (first.length, second.length)
    } else {
        size
    };
    let rec709_from_file = header.rec709_from_file(name);
    let mut texels = vec![1.0; stored.len() / 3 * 4];
    for (column, row, texel) in stored.enumerate_pixels() {
        let (along_first, along_second) = (first.place(row), second.place(column));
        let (x, y) = if first.is_x {
            (along_first, along_second)
        } else {
            (along_second, along_first)
        };
        let radiance = rec709_from_file * DVec3::from(texel.0.map(f64::from));
        let at = (y as usize * width as usize + x as usize) * 4;
        texels[at..at + 3].copy_from_slice(&radiance.as_vec3().to_array());
    }
    Ok(Image {
        name: name.to_owned(),
        width,
        height,
        pixels: Pixels::Rgba32Float(texels),
    })
}

/// A direction in which texels are stored.
struct Axis {
    is_x: bool,
    /// From the right to the left, or from the bottom to the top.
    is_reversed: bool,
    length: u32,
}

impl Axis {
    fn parse(axis: &str, length: &str) -> Option<Self> {
        let (is_x, is_reversed) = match axis {
            "+X" => (true, false),
            "-X" => (true, true),
            "-Y" => (false, false),
            "+Y" => (false, true),
            _ => return None,
        };
        let length = length.parse().ok()?;
        Some(Self {
            is_x,
            is_reversed,
            length,
        })
    }

    /// The column from the left, or the row from the top, of what is stored at `index`.
    fn place(&self, index: u32) -> u32 {
        if self.is_reversed {
            self.length - 1 - index
        } else {
            index
        }
    }
}

struct Header<'a> {
    /// From scan line to scan line, and within one.
    axes: [Axis; 2],
    /// What the radiance was multiplied by.
    exposure: DVec3,
    chromaticities: Option<Chromaticities>,
    texels: &'a [u8],
}

impl<'a> Header<'a> {
    fn parse(bytes: &'a [u8]) -> Result<Self, String> {
        let mut rest = bytes;
        let mut line = || {
            let end = rest.iter().position(|&byte| byte == b'\n')?;
            let line = String::from_utf8_lossy(&rest[..end]);
            rest = &rest[end + 1..];
            Some(line.trim().to_owned())
        };
        let cut = "the file ends inside its header";
        let mut exposure = DVec3::ONE;
        let mut chromaticities = None;
        loop {
            let line = line().ok_or(cut)?;
            if line.is_empty() {
                break;
            }
            let Some((key, value)) = line.split_once('=') else {
                continue;
            };
            let wrong = || format!("{key}: \"{}\" cannot be read", quoted(value));
            match key.trim() {
                "EXPOSURE" => {
                    let [factor] = numbers(value).ok_or_else(wrong)?;
                    exposure *= factor;
                }
                "COLORCORR" => exposure *= DVec3::from(numbers(value).ok_or_else(wrong)?),
                "PRIMARIES" => {
                    let values: [f64; 8] = numbers(value).ok_or_else(wrong)?;
                    chromaticities = Some(bytemuck::cast(values));
                }
                "FORMAT" => match value.trim() {
                    "32-bit_rle_rgbe" => {}
                    "32-bit_rle_xyze" => chromaticities = Some(XYZ),
                    _ => return Err(wrong()),
                },
                _ => {}
            }
        }
        if !(exposure.is_finite() && exposure.cmpgt(DVec3::ZERO).all()) {
            return Err(format!("an exposure of {exposure} is no factor"));
        }
        let size = line().ok_or(cut)?;
        let words: Vec<&str> = size.split_whitespace().collect();
        let axes = match words[..] {
            [first, lines, second, length] => {
                Axis::parse(first, lines).zip(Axis::parse(second, length))
            }
            _ => None,
        };
        let axes = axes.filter(|(first, second)| first.is_x != second.is_x);
        let (first, second) = axes
            .ok_or_else(|| format!("\"{}\" is no size, such as -Y 512 +X 1024", quoted(&size)))?;
        Ok(Self {
            axes: [first, second],
            exposure,
            chromaticities,
            texels: rest,
        })
    }

    fn rec709_from_file(&self, name: &str) -> DMat3 {
        let matrix = self
            .chromaticities
            .map_or(DMat3::IDENTITY, |chromaticities| {
                rec709_from(&chromaticities).unwrap_or_else(|| {
                    tracing::warn!("{name}: PRIMARIES make no colours: those of Rec. 709 are used");
                    DMat3::IDENTITY
                })
            });
        matrix * DMat3::from_diagonal(self.exposure.recip())
    }
}

fn numbers<const COUNT: usize>(text: &str) -> Option<[f64; COUNT]> {
    let numbers: Option<Vec<f64>> = text
        .split_whitespace()
        .map(|word| word.parse().ok())
        .collect();
    numbers?.try_into().ok()
}
