//! Maps errors to colours.

use colorous::MAGMA;

use super::comparison::Metric;

/// The colour scale of relative errors covers this many factors of 10 below 1.
const DECADES: f64 = 3.0;

/// Converts the [`map`](super::Comparison::map) of a metric to sRGB pixels with alpha. Colours range from black to the
/// brightest colour of magma, which is perceptually uniform. SSIM and FLIP: errors from 0 to 1. The others:
/// relative errors from 0.001 to 1 on a logarithmic scale, a third of it for each factor of 10.
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
