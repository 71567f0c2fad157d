//! Errors as colours.

use colorous::MAGMA;

use super::Metric;

/// Relative errors are shown over this many factors of 10 below 1.
const DECADES: f64 = 3.0;

/// sRGB pixels with alpha of the [`map`](super::Comparison::map) of a metric, from black to the brightest colour of magma,
/// whose steps look equally large. SSIM and FLIP: 0 to 1. The others: relative errors of 0.001 to 1, a third of the
/// scale for each factor of 10.
pub fn heat_map(metric: Metric, errors: &[f32]) -> Vec<u8> {
    let place = |error: f64| match metric {
        Metric::Ssim | Metric::Flip => error,
        _ => 1.0 + error.log10() / DECADES,
    };
    errors
        .iter()
        .flat_map(|&error| {
            let color = MAGMA.eval_continuous(place(f64::from(error)).clamp(0.0, 1.0));
            [color.r, color.g, color.b, 255]
        })
        .collect()
}
