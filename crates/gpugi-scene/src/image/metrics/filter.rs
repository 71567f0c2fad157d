//! Single-channel images and separable convolution.

use super::Picture;

/// One value per pixel, row by row from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    pub width: usize,
    pub values: Vec<f32>,
}

impl Plane {
    /// Evaluates `value` for each linear pixel.
    pub fn of(picture: &Picture, value: impl Fn([f32; 3]) -> f32) -> Self {
        Self {
            width: picture.size()[0] as usize,
            values: picture.pixels().iter().map(|&rgb| value(rgb)).collect(),
        }
    }

    /// The pixelwise product of two planes of equal size.
    pub fn times(&self, other: &Self) -> Self {
        let pairs = self.values.iter().zip(&other.values);
        Self {
            width: self.width,
            values: pairs.map(|(a, b)| a * b).collect(),
        }
    }

    /// out(x, y) = sum over i, j of along_x[i] along_y[j] plane(x + i - radius, y + j - radius). Outside the plane, the
    /// nearest edge value counts. Kernels have odd lengths.
    pub fn convolved(&self, along_x: &[f32], along_y: &[f32]) -> Self {
        let width = self.width;
        let height = self.values.len() / width;
        let radius = along_x.len() / 2;
        let mut rows = vec![0.0; self.values.len()];
        let mut padded = vec![0.0; width + 2 * radius];
        for (row, out) in self
            .values
            .chunks_exact(width)
            .zip(rows.chunks_exact_mut(width))
        {
            padded[..radius].fill(row[0]);
            padded[radius..][..width].copy_from_slice(row);
            padded[radius + width..].fill(row[width - 1]);
            for (tap, &weight) in along_x.iter().enumerate() {
                add_scaled(out, &padded[tap..], weight);
            }
        }
        let radius = along_y.len() / 2;
        let mut values = vec![0.0; self.values.len()];
        for (y, out) in values.chunks_exact_mut(width).enumerate() {
            for (tap, &weight) in along_y.iter().enumerate() {
                let from = (y + tap).saturating_sub(radius).min(height - 1);
                add_scaled(out, &rows[from * width..], weight);
            }
        }
        Self { width, values }
    }
}

fn add_scaled(out: &mut [f32], values: &[f32], weight: f32) {
    for (out, value) in out.iter_mut().zip(values) {
        *out += weight * value;
    }
}

/// A kernel that samples `function` at -radius..=radius.
pub fn kernel(radius: usize, function: impl Fn(f32) -> f32) -> Vec<f32> {
    (0..=2 * radius)
        .map(|at| function(at as f32 - radius as f32))
        .collect()
}

/// Scales the kernel's positive weights to a sum of 1 and its negative weights to a sum of -1.
pub fn normalized(mut kernel: Vec<f32>) -> Vec<f32> {
    let positive: f32 = kernel.iter().filter(|&&weight| weight > 0.0).sum();
    let negative: f32 = kernel.iter().filter(|&&weight| weight < 0.0).sum();
    for weight in &mut kernel {
        *weight /= if *weight > 0.0 {
            positive
        } else {
            negative.abs().max(f32::MIN_POSITIVE)
        };
    }
    kernel
}
