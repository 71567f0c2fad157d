//! FLIP: Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild, "FLIP: A Difference Evaluator for
//! Alternating Images", Proceedings of the ACM on Computer Graphics and Interactive Techniques 3(2), 2020.
//!
//! Implemented here because the existing library takes 8-bit values: HDR-FLIP on top of it would report its rounding as
//! differences.

use std::f32::consts::{FRAC_1_SQRT_2, PI};

use glam::{Mat3, Vec3, vec3};

use super::comparison::{Comparison, mean};
use super::filter::{Plane, kernel, normalized};
use super::picture::Picture;

/// Observer: a screen 0.7 m wide with 3840 pixels, viewed from 0.7 m.
pub const PIXELS_PER_DEGREE: f32 = 0.7 * 3840.0 / 0.7 * PI / 180.0;

/// Contrast sensitivity to achromatic, red-green and blue-yellow patterns (section 4.1.1, table 1): sums of Gaussians a
/// sqrt(pi / b) exp(-(pi x)^2 / b), x in degrees.
const ACHROMATIC: [[f32; 2]; 1] = [[1.0, 0.0047]];
const RED_GREEN: [[f32; 2]; 1] = [[1.0, 0.0053]];
const BLUE_YELLOW: [[f32; 2]; 2] = [[34.1, 0.04], [13.5, 0.025]];
/// The widest Gaussian determines the radius of the filters.
const WIDEST: f32 = 0.04;

/// Exponent of colour differences (section 4.1.2).
const COLOR_EXPONENT: f32 = 0.7;
/// This fraction of the largest colour difference maps to [`KNEE_VALUE`] (section 4.1.3).
const KNEE: f32 = 0.4;
const KNEE_VALUE: f32 = 0.95;
/// Width of the feature detectors (degrees), and the exponent of feature differences (section 4.2).
const FEATURE_WIDTH: f32 = 0.082;
const FEATURE_EXPONENT: f32 = 0.5;

/// FLIP of display-referred pictures.
pub fn compare(test: &Picture, reference: &Picture) -> Comparison {
    let evaluator = Evaluator::new();
    let seen = |picture| evaluator.seen(picture, |rgb| rgb.clamp(Vec3::ZERO, Vec3::ONE));
    let map = evaluator.difference(&seen(test), &seen(reference));
    Comparison {
        value: mean(map.iter().map(|&error| f64::from(error))),
        parameters: vec![("pixels_per_degree", f64::from(PIXELS_PER_DEGREE))],
        map,
    }
}

/// A picture as the observer perceives it.
pub struct Perceived {
    /// L*a*b* after the eye's blur, with the Hunt effect.
    color: Vec<Vec3>,
    /// Strength of edges and of points, per pixel.
    features: Vec<[f32; 2]>,
}

/// The filters and constants of FLIP.
pub struct Evaluator {
    xyz_from_rgb: Mat3,
    rgb_from_xyz: Mat3,
    /// Gaussians of the eye's blur, each with its weight.
    blur_y: Vec<(f32, Vec<f32>)>,
    blur_cx: Vec<(f32, Vec<f32>)>,
    blur_cz: Vec<(f32, Vec<f32>)>,
    gaussian: Vec<f32>,
    first_derivative: Vec<f32>,
    second_derivative: Vec<f32>,
    largest_color_difference: f32,
}

impl Evaluator {
    pub fn new() -> Self {
        let xyz_from_rgb = xyz_from_rgb();
        let radius = (3.0 * (WIDEST / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as usize;
        let sigma = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
        let feature = |function: fn(f32) -> f32| {
            let gaussian = move |x: f32| (-0.5 * x * x).exp() * function(x);
            normalized(kernel((3.0 * sigma).ceil() as usize, |x| {
                gaussian(x / sigma)
            }))
        };
        Self {
            xyz_from_rgb,
            rgb_from_xyz: xyz_from_rgb.inverse(),
            blur_y: gaussians(radius, &ACHROMATIC),
            blur_cx: gaussians(radius, &RED_GREEN),
            blur_cz: gaussians(radius, &BLUE_YELLOW),
            gaussian: feature(|_| 1.0),
            first_derivative: feature(|x| -x),
            second_derivative: feature(|x| x * x - 1.0),
            largest_color_difference: color_difference(
                hunt(lab(xyz_from_rgb * Vec3::Y)),
                hunt(lab(xyz_from_rgb * Vec3::Z)),
            ),
        }
    }

    /// Computes how the observer perceives a picture. `display` maps a linear pixel to what the display shows, linear
    /// in 0..1.
    pub fn seen(&self, picture: &Picture, display: impl Fn(Vec3) -> Vec3) -> Perceived {
        let opponent: Vec<Vec3> = picture
            .pixels()
            .iter()
            .map(|&rgb| ycxcz(self.xyz_from_rgb * display(Vec3::from(rgb))))
            .collect();
        let plane = |channel: usize| Plane {
            width: picture.size()[0] as usize,
            values: opponent.iter().map(|color| color[channel]).collect(),
        };
        let mut y = plane(0);
        let blurred = [
            blur(&y, &self.blur_y),
            blur(&plane(1), &self.blur_cx),
            blur(&plane(2), &self.blur_cz),
        ];
        let color = (0..opponent.len())
            .map(|at| {
                let color = vec3(blurred[0][at], blurred[1][at], blurred[2][at]);
                let rgb = self.rgb_from_xyz * xyz_from_ycxcz(color);
                hunt(lab(self.xyz_from_rgb * rgb.clamp(Vec3::ZERO, Vec3::ONE)))
            })
            .collect();
        for value in &mut y.values {
            *value = (*value + 16.0) / 116.0;
        }
        let gradient = |derivative: &[f32]| {
            let along_x = y.convolved(derivative, &self.gaussian).values;
            let along_y = y.convolved(&self.gaussian, derivative).values;
            along_x.into_iter().zip(along_y).map(|(x, y)| x.hypot(y))
        };
        let edges = gradient(&self.first_derivative);
        let points = gradient(&self.second_derivative);
        Perceived {
            color,
            features: edges.zip(points).map(<[f32; 2]>::from).collect(),
        }
    }

    /// The error of each pixel, from 0 to 1: E = E_color^(1 - E_feature) (equation 6).
    pub fn difference(&self, test: &Perceived, reference: &Perceived) -> Vec<f32> {
        let colors = test.color.iter().zip(&reference.color);
        let features = test.features.iter().zip(&reference.features);
        colors
            .zip(features)
            .map(|((&test_color, &reference_color), (test, reference))| {
                let color = self.redistributed(color_difference(test_color, reference_color));
                let [edge, point] = [0, 1].map(|kind| (test[kind] - reference[kind]).abs());
                let feature = (FRAC_1_SQRT_2 * edge.max(point)).powf(FEATURE_EXPONENT);
                color.powf(1.0 - feature)
            })
            .collect()
    }

    /// Section 4.1.3: small differences occupy most of the range.
    fn redistributed(&self, difference: f32) -> f32 {
        let knee = KNEE * self.largest_color_difference;
        if difference < knee {
            difference * KNEE_VALUE / knee
        } else {
            let above = (difference - knee) / (self.largest_color_difference - knee);
            KNEE_VALUE + above * (1.0 - KNEE_VALUE)
        }
    }
}

/// XYZ from linear sRGB (white point D65), with each coordinate divided by that of white, so that white is (1, 1, 1).
fn xyz_from_rgb() -> Mat3 {
    let color = |x: f32, y: f32| vec3(x / y, 1.0, (1.0 - x - y) / y);
    let white = color(0.3127, 0.329);
    let primaries = Mat3::from_cols(color(0.64, 0.33), color(0.3, 0.6), color(0.15, 0.06));
    Mat3::from_diagonal(white.recip())
        * primaries
        * Mat3::from_diagonal(primaries.inverse() * white)
}

/// Opponent space YCxCz from XYZ relative to white (section 4.1.1).
fn ycxcz(xyz: Vec3) -> Vec3 {
    vec3(
        116.0 * xyz.y - 16.0,
        500.0 * (xyz.x - xyz.y),
        200.0 * (xyz.y - xyz.z),
    )
}

fn xyz_from_ycxcz(color: Vec3) -> Vec3 {
    let y = (color.x + 16.0) / 116.0;
    vec3(y + color.y / 500.0, y, y - color.z / 200.0)
}

/// CIE L*a*b* from XYZ relative to white.
fn lab(xyz: Vec3) -> Vec3 {
    const DELTA: f32 = 6.0 / 29.0;
    let f = xyz.to_array().map(|t| {
        if t > DELTA * DELTA * DELTA {
            t.cbrt()
        } else {
            t / (3.0 * DELTA * DELTA) + 4.0 / 29.0
        }
    });
    vec3(
        116.0 * f[1] - 16.0,
        500.0 * (f[0] - f[1]),
        200.0 * (f[1] - f[2]),
    )
}

/// The Hunt effect: brighter colours look more colourful (section 4.1.2).
fn hunt(lab: Vec3) -> Vec3 {
    vec3(lab.x, 0.01 * lab.x * lab.y, 0.01 * lab.x * lab.z)
}

/// (|dL| + sqrt(da^2 + db^2))^0.7: the HyAB distance for large differences (section 4.1.2).
fn color_difference(a: Vec3, b: Vec3) -> f32 {
    let difference = a - b;
    (difference.x.abs() + difference.y.hypot(difference.z)).powf(COLOR_EXPONENT)
}

/// The normalized Gaussians of a contrast sensitivity, each with its weight. The weights sum to 1 over the
/// two-dimensional filter.
fn gaussians(radius: usize, terms: &[[f32; 2]]) -> Vec<(f32, Vec<f32>)> {
    let mut kernels: Vec<_> = terms
        .iter()
        .map(|&[a, b]| {
            let along = kernel(radius, |x| {
                (-(PI * x / PIXELS_PER_DEGREE).powi(2) / b).exp()
            });
            let sum: f32 = along.iter().sum();
            (a * (PI / b).sqrt() * sum * sum, normalized(along))
        })
        .collect();
    let total: f32 = kernels.iter().map(|(weight, _)| weight).sum();
    for (weight, _) in &mut kernels {
        *weight /= total;
    }
    kernels
}

fn blur(plane: &Plane, gaussians: &[(f32, Vec<f32>)]) -> Vec<f32> {
    let mut sum = vec![0.0; plane.values.len()];
    for (weight, gaussian) in gaussians {
        let blurred = plane.convolved(gaussian, gaussian).values;
        for (sum, value) in sum.iter_mut().zip(blurred) {
            *sum += weight * value;
        }
    }
    sum
}
