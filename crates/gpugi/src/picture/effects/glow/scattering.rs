//! How the eye scatters light, and how much of each image of a pyramid makes the same.

use std::f64::consts::PI;

/// Radii that are fitted, in texels of the coarsest image.
const REACH: f64 = 1.25;
/// Factor between radii that are fitted.
const RADIUS_STEP: f64 = 1.15;
/// Directions in which radii are fitted. The others are the same, mirrored.
const DIRECTIONS: [f64; 3] = [0.0, PI / 8.0, PI / 4.0];
/// Sweeps over the weights, after which they no longer change.
const SWEEPS: u32 = 400;
/// Points per row and column of a pixel, over which the function is averaged.
const POINTS: u32 = 4;

/// Point spread function of an eye that is adapted to daylight, per steradian, at an angle of `degrees` from the light.
/// Its integral over the half space is 1. Spencer, Shirley, Zimmerman, Greenberg, "Physically-Based Glare Effects for
/// Digital Images", SIGGRAPH 1995: with t in degrees,
///
/// P(t) = 0.384 f0 + 0.478 f1 + 0.138 f2, f0 = 2.61e6 exp(-(t / 0.02)^2), f1 = 20.91 / (t + 0.02)^3,
/// f2 = 72.37 / (t + 0.02)^2.
pub fn point_spread(degrees: f64) -> f64 {
    let shifted = degrees + 0.02;
    let core = 2.61e6 * (-(degrees / 0.02).powi(2)).exp();
    0.384 * core + 0.478 * 20.91 / shifted.powi(3) + 0.138 * 72.37 / shifted.powi(2)
}

/// Share of the light of the pixel in the middle of a picture that falls on the one `x` columns and `y` rows away.
/// `pixel`: width of a pixel at the distance 1 from the eye. A pixel at the angle t covers pixel^2 cos^3 t steradians.
/// The mean over `points` x `points` points.
pub fn share_of_pixel(pixel: f64, [x, y]: [u32; 2], points: u32) -> f64 {
    let offsets = || (0..points).map(|index| (f64::from(index) + 0.5) / f64::from(points) - 0.5);
    let places = offsets().flat_map(|dx| offsets().map(move |dy| (dx, dy)));
    let shares = places.map(|(dx, dy)| {
        let angle = (pixel * (f64::from(x) + dx).hypot(f64::from(y) + dy)).atan();
        point_spread(angle.to_degrees()) * angle.cos().powi(3)
    });
    shares.sum::<f64>() * pixel * pixel / f64::from(points * points)
}

/// Weights of a picture itself and of its blurred images. Their sum is 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    /// Of the picture itself.
    pub own: f64,
    /// Of the mean of 3 x 3 pixels.
    pub near: f64,
    /// Of the images of the pyramid, from fine to coarse.
    pub levels: Vec<f64>,
}

/// One axis of what the image `level` makes of a pixel, averaged over the places of the pixel: from the middle on, to one
/// side. The sixfold convolution of a box of 2^level pixels: three for making the image smaller, three for making it
/// larger (glow.wesl). Level 0 is the mean of 3 x 3 pixels.
pub fn kernel(level: u32) -> Vec<f64> {
    if level == 0 {
        return vec![0.5, 0.25];
    }
    let width = 1_usize << level;
    let mut kernel = vec![1.0];
    for _ in 0..6 {
        let mut sum = 0.0;
        let next = (0..kernel.len() + width - 1).map(|end| {
            sum += kernel.get(end).copied().unwrap_or_default();
            if end >= width {
                sum -= kernel[end - width];
            }
            sum / width as f64
        });
        kernel = next.collect();
    }
    kernel.split_off(kernel.len() / 2)
}

/// Weights with which a picture and its images come closest to the point spread function: least squares of the relative
/// errors at pixels from 1 to `REACH` 2^`levels` away, by coordinate descent, because no weight may be negative. What is
/// scattered farther stays where it is. `pixel`: width of a pixel at the distance 1 from the eye.
pub fn weights(pixel: f64, levels: u32) -> Weights {
    let kernels: Vec<Vec<f64>> = (0..=levels).map(kernel).collect();
    let largest = REACH * f64::from(levels).exp2();
    let radii = std::iter::successors(Some(1.0), |radius| Some(radius * RADIUS_STEP));
    let radii = radii.take_while(|radius| *radius <= largest);
    let pixels = radii.flat_map(|radius| {
        DIRECTIONS.map(|angle| [angle.cos(), angle.sin()].map(|part| (radius * part).round()))
    });
    // Rows of the equations A w = 1, and then A^T A w = A^T 1.
    let count = kernels.len();
    let mut products = vec![vec![0.0; count]; count];
    let mut sums = vec![0.0; count];
    for [x, y] in pixels.map(|pixel| pixel.map(|part| part as u32)) {
        let share = share_of_pixel(pixel, [x, y], POINTS);
        let row: Vec<f64> = (kernels.iter())
            .map(|kernel| {
                let at = |part: u32| kernel.get(part as usize).copied().unwrap_or_default();
                at(x) * at(y) / share
            })
            .collect();
        for (a, products) in row.iter().zip(&mut products) {
            for (b, product) in row.iter().zip(products) {
                *product += a * b;
            }
        }
        for (a, sum) in row.iter().zip(&mut sums) {
            *sum += a;
        }
    }
    let mut weights = vec![0.0_f64; count];
    for _ in 0..SWEEPS {
        for (index, row) in products.iter().enumerate() {
            let so_far: f64 = row.iter().zip(&weights).map(|(a, w)| a * w).sum();
            weights[index] = (weights[index] + (sums[index] - so_far) / row[index]).max(0.0);
        }
    }
    // By the error of the fit, more than all light might be scattered.
    let scattered: f64 = weights.iter().sum();
    let scale = 1.0 / scattered.max(1.0);
    let near = weights.remove(0) * scale;
    Weights {
        own: (1.0 - scattered).max(0.0),
        near,
        levels: weights.iter().map(|weight| weight * scale).collect(),
    }
}
