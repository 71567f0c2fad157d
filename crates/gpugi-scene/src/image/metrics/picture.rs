//! The pictures that metrics compare.

use std::path::Path;

use super::super::decode::decode_linear;
use super::super::srgb::linear_from_srgb;
use crate::{ImportError, Limits, Pixels};

/// Linear Rec. 709 values of a picture, all of them finite.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    width: u32,
    height: u32,
    /// Three values per pixel, row by row from the top.
    rgb: Vec<f32>,
    display_referred: bool,
}

impl Picture {
    /// A picture of radiance. `rgb`: width x height x 3 linear values, row by row from the top.
    ///
    /// # Errors
    /// A message that names the first pixel that is not finite.
    ///
    /// # Panics
    /// If the number of values does not match the size, or the picture is empty.
    pub fn of_radiance(width: u32, height: u32, rgb: Vec<f32>) -> Result<Self, String> {
        assert_eq!(
            rgb.len() as u64,
            u64::from(width) * u64::from(height) * 3,
            "a picture of {width} x {height}"
        );
        assert!(!rgb.is_empty(), "a picture without pixels");
        if let Some(at) = rgb.iter().position(|value| !value.is_finite()) {
            let at = at as u64 / 3;
            let (x, y) = (at % u64::from(width), at / u64::from(width));
            return Err(format!("pixel ({x}, {y}) is not finite"));
        }
        Ok(Self {
            width,
            height,
            rgb,
            display_referred: false,
        })
    }

    /// A picture as a display shows it. `rgba`: four bytes per pixel, sRGB-encoded, row by row from the top; alpha is
    /// ignored.
    ///
    /// # Panics
    /// As [`Picture::of_radiance`].
    pub fn of_pixels(width: u32, height: u32, rgba: &[u8]) -> Self {
        let pixels = rgba.as_chunks::<4>().0.iter();
        let linear = |value: u8| linear_from_srgb(f32::from(value) / 255.0);
        let rgb = pixels.flat_map(|&[r, g, b, _]| [r, g, b].map(linear));
        Self {
            display_referred: true,
            // Bytes are always finite.
            ..Self::of_radiance(width, height, rgb.collect())
                .unwrap_or_else(|error| panic!("{error}"))
        }
    }

    /// Width and height (pixels).
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Whether the picture was encoded for a display, like a PNG. Its values then lie in 0..1.
    pub fn is_display_referred(&self) -> bool {
        self.display_referred
    }

    /// Linear values, three per pixel, row by row from the top.
    pub fn rgb(&self) -> &[f32] {
        &self.rgb
    }

    /// Linear pixels.
    pub(super) fn pixels(&self) -> &[[f32; 3]] {
        self.rgb.as_chunks().0
    }
}

/// Decodes a picture for comparison. PNG and JPEG are display-referred and linearised from sRGB; HDR, EXR and KTX2 are
/// radiance. Alpha is ignored and negative values stay. A value that is not finite is an error.
pub fn decode_picture(name: &str, bytes: &[u8], limits: &Limits) -> Result<Picture, ImportError> {
    let (image, display_referred) = decode_linear(name, bytes, limits)?;
    let Pixels::Rgba32Float(texels) = image.pixels else {
        unreachable!("linear values are floats")
    };
    let (texels, _) = texels.as_chunks::<4>();
    Ok(Picture {
        width: image.width,
        height: image.height,
        rgb: texels.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect(),
        display_referred,
    })
}

/// Reads the file at `path` as [`decode_picture`] does.
pub fn load_picture(path: &Path, limits: &Limits) -> Result<Picture, ImportError> {
    let name = path.display().to_string();
    let bytes = crate::import::read_limited(path, limits.file_bytes)
        .map_err(|reason| ImportError::new(&name, "open", reason))?;
    decode_picture(&name, &bytes, limits)
}
