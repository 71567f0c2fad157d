//! Structural similarity: Wang, Bovik, Sheikh, Simoncelli, "Image Quality Assessment: From Error Visibility to
//! Structural Similarity", IEEE Transactions on Image Processing 13(4), 2004, equation 13 and section III-C.

use super::super::luminance;
use super::super::srgb::srgb_from_linear;
use super::comparison::{Comparison, MetricError, WINDOW, both_display_referred, mean};
use super::filter::{Plane, kernel, normalized};
use super::picture::Picture;

/// Standard deviation of the window (pixels).
const SIGMA: f32 = 1.5;
/// Stabilise the quotients of means (K1) and of variances (K2); the dynamic range is 1.
const K1: f64 = 0.01;
const K2: f64 = 0.03;

/// Mean over the windows that lie entirely inside the picture. The map holds 1 - SSIM.
pub fn similarity(test: &Picture, reference: &Picture) -> Result<Comparison, MetricError> {
    let [width, height] = test.size().map(|side| side as usize);
    if width < WINDOW || height < WINDOW {
        return Err(MetricError::TooSmall);
    }
    let mut parameters = vec![
        ("window", WINDOW as f64),
        ("sigma", f64::from(SIGMA)),
        ("k1", K1),
        ("k2", K2),
    ];
    let mut scale = 1.0;
    if !both_display_referred(test, reference) {
        let exposure = middle_grey_exposure(reference);
        parameters.push(("exposure", f64::from(exposure)));
        scale = exposure.exp2();
    }
    let luma = |picture| {
        Plane::of(picture, |rgb| {
            luminance(
                rgb.map(|value| srgb_from_linear((value * scale).clamp(0.0, 1.0)))
                    .into(),
            )
        })
    };
    let radius = WINDOW / 2;
    let window = normalized(kernel(radius, |x| (-x * x / (2.0 * SIGMA * SIGMA)).exp()));
    let blurred = |plane: &Plane| plane.convolved(&window, &window).values;
    let (a, b) = (luma(test), luma(reference));
    let (mean_a, mean_b) = (blurred(&a), blurred(&b));
    let (aa, bb, ab) = (
        blurred(&a.times(&a)),
        blurred(&b.times(&b)),
        blurred(&a.times(&b)),
    );
    let [c1, c2] = [K1, K2].map(|k| (k * k) as f32);
    // SSIM = (2 mu_a mu_b + c1)(2 sigma_ab + c2) / ((mu_a^2 + mu_b^2 + c1)(sigma_a^2 + sigma_b^2 + c2))
    let ssim = |at: usize| {
        let (ma, mb) = (mean_a[at], mean_b[at]);
        let (va, vb, cov) = (aa[at] - ma * ma, bb[at] - mb * mb, ab[at] - ma * mb);
        (2.0 * ma * mb + c1) * (2.0 * cov + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2))
    };
    let map: Vec<f32> = (0..width * height).map(|at| 1.0 - ssim(at)).collect();
    let inside = (radius..height - radius)
        .flat_map(|y| (radius..width - radius).map(move |x| y * width + x))
        .map(|at| 1.0 - f64::from(map[at]));
    Ok(Comparison {
        value: mean(inside),
        parameters,
        map,
    })
}

/// Exposure (EV) that maps the geometric mean of the luminance to middle grey, 0.18. Pixels with a luminance of 2^-20
/// or less do not count; if none count, the exposure is 0.
fn middle_grey_exposure(picture: &Picture) -> f32 {
    let logarithms = picture
        .pixels()
        .iter()
        .map(|&rgb| luminance(rgb.into()))
        .filter(|&luminance| luminance > (-20.0_f32).exp2())
        .map(|luminance| f64::from(luminance).log2());
    let exposure = 0.18_f64.log2() - mean(logarithms);
    if exposure.is_nan() {
        0.0
    } else {
        exposure as f32
    }
}
