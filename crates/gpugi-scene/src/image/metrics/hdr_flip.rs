//! HDR-FLIP: Andersson, Nilsson, Shirley, Akenine-Möller, "Visualizing Errors in Rendered High Dynamic Range Images",
//! Eurographics 2021. The error of a pixel is its largest FLIP over a range of exposures that show the reference's
//! brightest to its median values.

use glam::Vec3;

use super::super::luminance;
use super::comparison::{Comparison, mean};
use super::flip::{Evaluator, PIXELS_PER_DEGREE};
use super::picture::Picture;

/// Narkowicz's fit of the ACES tone curve, (a x^2 + b x) / (c x^2 + d x + e), with the paper's pre-exposure of 0.6.
const ACES: [f32; 5] = [0.36 * 2.51, 0.6 * 0.03, 0.36 * 2.43, 0.6 * 0.59, 0.14];
/// The first exposure maps the brightest luminance to this tone-mapped value, the last one the median.
const SHOWN: f32 = 0.85;

/// FLIP of radiance. Negative values are displayed as black.
pub fn compare(test: &Picture, reference: &Picture) -> Comparison {
    let evaluator = Evaluator::new();
    let exposures = exposures(reference);
    let mut map = vec![0.0_f32; reference.pixels().len()];
    for &exposure in &exposures {
        let seen = |picture| evaluator.seen(picture, |rgb| tone_mapped(rgb * exposure.exp2()));
        let errors = evaluator.difference(&seen(test), &seen(reference));
        for (largest, error) in map.iter_mut().zip(errors) {
            *largest = largest.max(error);
        }
    }
    Comparison {
        value: mean(map.iter().map(|&error| f64::from(error))),
        parameters: vec![
            ("pixels_per_degree", f64::from(PIXELS_PER_DEGREE)),
            ("start_exposure", f64::from(exposures[0])),
            ("stop_exposure", f64::from(exposures[exposures.len() - 1])),
            ("exposures", exposures.len() as f64),
        ],
        map,
    }
}

/// Section 3.2: evenly spaced exposures (EV) from log2(x / brightest) to log2(x / median), where tone mapping takes x
/// to [`SHOWN`]. Their number is the length of that range rounded up, but at least 2. If the median is black, the
/// median of the other pixels counts. If all pixels are black, the only exposure is 0.
fn exposures(reference: &Picture) -> Vec<f32> {
    let mut sorted: Vec<f32> = reference
        .pixels()
        .iter()
        .map(|&color| luminance(color.into()))
        .collect();
    sorted.sort_unstable_by(f32::total_cmp);
    let median = match middle(&sorted) {
        median if median > 0.0 => median,
        _ => middle(&sorted[sorted.partition_point(|&luminance| luminance <= 0.0)..]),
    };
    let brightest = sorted[sorted.len() - 1];
    if brightest <= 0.0 {
        return vec![0.0];
    }
    // The larger root of (a - t c) x^2 + (b - t d) x - t e = 0.
    let [a, b, c, d, e] = ACES;
    let [a, b, c] = [a - SHOWN * c, b - SHOWN * d, -SHOWN * e];
    let shown = (-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * a);
    let (start, stop) = ((shown / brightest).log2(), (shown / median).log2());
    let count = ((stop - start).ceil() as usize).max(2);
    let step = (stop - start) / (count - 1) as f32;
    (0..count).map(|at| start + at as f32 * step).collect()
}

/// The median of ascending values; 0 if there are none.
fn middle(sorted: &[f32]) -> f32 {
    match sorted.len() {
        0 => 0.0,
        count => 0.5 * (sorted[(count - 1) / 2] + sorted[count / 2]),
    }
}

fn tone_mapped(rgb: Vec3) -> Vec3 {
    // The curve saturates long before its squares overflow.
    let x = rgb.clamp(Vec3::ZERO, Vec3::splat(1e6));
    let [a, b, c, d, e] = ACES.map(Vec3::splat);
    ((x * (a * x + b)) / (x * (c * x + d) + e)).clamp(Vec3::ZERO, Vec3::ONE)
}
