//! The transfer function of sRGB.

/// The sRGB transfer function (IEC 61966-2-1) from encoded to linear; 0..1 maps to 0..1.
pub(crate) fn linear_from_srgb(encoded: f32) -> f32 {
    if encoded <= 0.04045 {
        encoded / 12.92
    } else {
        ((encoded + 0.055) / 1.055).powf(2.4)
    }
}

/// The inverse of [`linear_from_srgb`].
pub(crate) fn srgb_from_linear(linear: f32) -> f32 {
    if linear <= 0.0031308 {
        linear * 12.92
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}
