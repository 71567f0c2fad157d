//! Checks of sizes, before anything of that size is allocated.

use image::{DynamicImage, ImageDecoder};

use crate::ImportError;
use crate::import::budget::ImageLimits;

/// Bytes per texel of [`Rgba32Float`](crate::Pixels::Rgba32Float).
pub(super) const RADIANCE_TEXEL: u64 = 16;

/// Rejects an image whose size is zero or exceeds the limits. `texel`: bytes per decoded texel.
pub(super) fn check_size(
    name: &str,
    (width, height): (u32, u32),
    texel: u64,
    limits: &ImageLimits,
) -> Result<(), ImportError> {
    let error = |reason: String| Err(ImportError::new(name, "header", reason));
    if width == 0 || height == 0 {
        return error(format!("{width} x {height} texels are no image"));
    }
    let side = limits.limits.image_side;
    if width > side || height > side {
        return error(format!(
            "{width} x {height} texels exceed the limit of {side} a side; --limits side=N raises it"
        ));
    }
    let size = u64::from(width) * u64::from(height) * texel;
    let checked = limits.check_bytes(size);
    checked.or_else(|reason| error(format!("{width} x {height} texels: {reason}")))
}

/// Rejects an image that claims far more texels than `given` bytes can hold.
pub(super) fn check_expansion(
    name: &str,
    (width, height): (u32, u32),
    texel: u64,
    given: usize,
    is_dense: bool,
    limits: &ImageLimits,
) -> Result<(), ImportError> {
    let size = u64::from(width) * u64::from(height) * texel;
    let checked = limits.check_file(size, given, is_dense);
    checked.map_err(|reason| {
        ImportError::new(
            name,
            "header",
            format!("{width} x {height} texels: {reason}"),
        )
    })
}

/// Limits the memory that decoders allocate. Image sides are left to [`check_size`], which has a better message.
pub(super) fn decoder_limits(limits: &ImageLimits) -> image::Limits {
    let mut decoder_limits = image::Limits::no_limits();
    decoder_limits.max_alloc = Some(limits.most());
    decoder_limits
}

/// Decodes, once the size is within the limits.
pub(super) fn finish(
    name: &str,
    mut decoder: impl ImageDecoder,
    limits: &ImageLimits,
    texel: u64,
) -> Result<DynamicImage, ImportError> {
    check_size(name, decoder.dimensions(), texel, limits)?;
    decoder
        .set_limits(decoder_limits(limits))
        .and_then(|()| DynamicImage::from_decoder(decoder))
        .map_err(|error| ImportError::new(name, "texels", error))
}
