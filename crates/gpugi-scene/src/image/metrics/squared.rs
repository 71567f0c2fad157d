//! Metrics based on squared differences.

use super::super::srgb::srgb_from_linear;
use super::comparison::{Comparison, both_display_referred, mean};
use super::picture::Picture;

/// Added to the squared reference in relative errors, so that black pixels do not dominate. At a reference of 0.1, an
/// error has half the weight that it would have without it.
pub const EPSILON: f64 = 0.01;

/// Side of the blocks of rel-mse-4 (pixels).
const BLOCK: usize = 4;

/// Mean of (a - b)^2 / (b^2 + [`EPSILON`]) over pairs of a value and its reference; NaN if there are no pairs.
pub fn rel_mse(pairs: impl IntoIterator<Item = (f32, f32)>) -> f64 {
    mean(pairs.into_iter().map(|(a, b)| relative_error(a, b)))
}

fn relative_error(a: f32, b: f32) -> f64 {
    let (a, b) = (f64::from(a), f64::from(b));
    (a - b) * (a - b) / (b * b + EPSILON)
}

/// rel-mse. The map holds the square root of each pixel's rel-mse: its relative error.
pub fn relative(test: &Picture, reference: &Picture) -> Comparison {
    relative_result(test.pixels(), reference.pixels())
}

/// rel-mse-4. Blocks cut by the right or lower edge average the pixels that they have, and count as much as the others.
pub fn relative_of_blocks(test: &Picture, reference: &Picture) -> Comparison {
    let mut result = relative_result(&block_means(test), &block_means(reference));
    let [width, height] = test.size().map(|side| side as usize);
    let across = width.div_ceil(BLOCK);
    let blocks = std::mem::take(&mut result.map);
    result.map = (0..width * height)
        .map(|at| blocks[at / width / BLOCK * across + at % width / BLOCK])
        .collect();
    result
}

fn relative_result(test: &[[f32; 3]], reference: &[[f32; 3]]) -> Comparison {
    let pairs = |pixel: (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c| (pixel.0[c], pixel.1[c]));
    let pixels = || test.iter().zip(reference).map(pairs);
    Comparison {
        value: rel_mse(pixels().flatten()),
        parameters: vec![("epsilon", EPSILON)],
        map: pixels().map(|pixel| rel_mse(pixel).sqrt() as f32).collect(),
    }
}

fn block_means(picture: &Picture) -> Vec<[f32; 3]> {
    let [width, height] = picture.size().map(|side| side as usize);
    let mut means = Vec::new();
    for top in (0..height).step_by(BLOCK) {
        for left in (0..width).step_by(BLOCK) {
            let (right, bottom) = ((left + BLOCK).min(width), (top + BLOCK).min(height));
            let pixels = |channel: usize| {
                (top..bottom)
                    .flat_map(move |y| (left..right).map(move |x| y * width + x))
                    .map(move |at| f64::from(picture.pixels()[at][channel]))
            };
            means.push([0, 1, 2].map(|channel| mean(pixels(channel)) as f32));
        }
    }
    means
}

/// rmse. The map holds the rmse of each pixel relative to the peak.
pub fn root_mean(test: &Picture, reference: &Picture) -> Comparison {
    let encoded = both_display_referred(test, reference);
    let value = |linear: f32| {
        f64::from(if encoded {
            srgb_from_linear(linear)
        } else {
            linear
        })
    };
    let squared = || {
        let pairs = test.rgb().iter().zip(reference.rgb());
        pairs.map(|(&a, &b)| (value(a) - value(b)).powi(2))
    };
    let peak = peak(test, reference);
    let squares: Vec<f64> = squared().collect();
    Comparison {
        value: mean(squares.iter().copied()).sqrt(),
        parameters: Vec::new(),
        map: squares
            .chunks_exact(3)
            .map(|pixel| (mean(pixel.iter().copied()).sqrt() / peak) as f32)
            .collect(),
    }
}

/// psnr. The map is that of rmse.
pub fn peak_signal_to_noise(test: &Picture, reference: &Picture) -> Comparison {
    let difference = root_mean(test, reference);
    let peak = peak(test, reference);
    Comparison {
        value: 20.0 * (peak / difference.value).log10(),
        parameters: vec![("peak", peak)],
        ..difference
    }
}

/// 1 for display-referred pictures, otherwise the largest channel of the reference (1 if the reference is black).
fn peak(test: &Picture, reference: &Picture) -> f64 {
    if both_display_referred(test, reference) {
        return 1.0;
    }
    let largest = reference.rgb().iter().copied().fold(0.0, f32::max);
    if largest > 0.0 {
        f64::from(largest)
    } else {
        1.0
    }
}
