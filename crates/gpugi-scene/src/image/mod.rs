//! Images in memory, and reading and writing of image files.

mod basis;
mod decode;
mod encode;
mod exr;
mod hdr;
mod heights;
mod ktx2;
mod ktx2_array;
mod ktx2_volume;
pub mod metrics;
mod nanovdb;
mod primaries;
mod size;
mod srgb;

use glam::Vec3;
use serde::{Deserialize, Serialize};

pub(crate) use decode::{claimed_bytes, decode_color_within, decode_heights_within};
pub use decode::{decode_color, decode_radiance, load_radiance};
pub use encode::{
    replace_file, save_exr, save_exr_layers, save_hdr, save_png, write_exr, write_png,
};
pub(crate) use heights::{Heights, holds_normals};
pub use ktx2::{HalfTexture, save_ktx2};
pub(crate) use ktx2_array::{
    ArrayTexels, decode_byte, decode_half, decode_shared_exponent, encode as encode_array,
};
pub(crate) use ktx2_volume::{decode_volume, encode_volume};
pub(crate) use nanovdb::{decode_nanovdb, is_nanovdb};
pub(crate) use srgb::{linear_from_srgb, srgb_from_linear};

/// Weights of red, green and blue in the relative luminance of linear Rec. 709 (ITU-R BT.709-6, item 3.2).
pub const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// Relative luminance of a linear Rec. 709 colour, in its unit.
pub fn luminance(color: Vec3) -> f32 {
    color.dot(LUMINANCE)
}

/// Red, green and blue of a word with a shared exponent: 9 bits of mantissa each, red in the lowest ones, and 5 of
/// exponent, bias 15 (WebGPU's rgb9e5ufloat).
pub fn unpack_rgb9e5(word: u32) -> Vec3 {
    let scale = 2.0_f32.powi((word >> 27) as i32 - 24);
    Vec3::from_array([0, 9, 18].map(|shift| (word >> shift & 511) as f32)) * scale
}

/// Texels, row by row from the top, four channels per texel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Pixels {
    /// 8 bits per channel; the use decides whether RGB is sRGB or linear.
    Rgba8(#[serde(with = "crate::plain")] Vec<u8>),
    /// Linear 32-bit floats.
    Rgba32Float(#[serde(with = "crate::plain")] Vec<f32>),
}

/// An image in memory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Image {
    /// File name or label, for error messages.
    pub name: String,
    /// Width in texels, at least 1.
    pub width: u32,
    /// Height in texels, at least 1.
    pub height: u32,
    /// width x height x 4 values.
    pub pixels: Pixels,
}

impl Image {
    /// Size of the texels in bytes.
    pub fn byte_size(&self) -> usize {
        match &self.pixels {
            Pixels::Rgba8(data) => data.len(),
            Pixels::Rgba32Float(data) => data.len() * 4,
        }
    }
}
