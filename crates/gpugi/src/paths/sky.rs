//! The grid from which environment directions are sampled.

use gpugi_scene::image::LUMINANCE;
use gpugi_scene::{Image, Pixels};

use super::alias;
use crate::gpu::{Gpu, GpuError};
use crate::scene::{shown, texel_scale};

/// Maximum number of cells along each axis. A grid of this size takes 96 MiB and is finer than most maps.
const MOST_CELLS: [usize; 2] = [4096, 2048];

/// `Sky` of paths/sky.wesl, and the amount of light in it.
#[derive(Debug)]
pub struct Sky {
    /// Width and height; then a threshold, an alias and a probability per cell.
    pub words: Vec<u32>,
    /// Integral of the image's luminance over the sphere [W/sr/m^2 sr].
    pub luminance: f64,
}

impl Sky {
    /// A grid that gives every direction probability 0.
    pub fn none() -> Self {
        Self {
            words: vec![1, 1, 0, 0, 0],
            luminance: 0.0,
        }
    }

    /// The grid on the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn upload(&self, gpu: &Gpu) -> Result<wgpu::Buffer, GpuError> {
        gpu.storage("path-tracer.sky [bytes]", &self.words)
    }

    /// The grid of an environment's image, however it is turned and scaled. A cell's weight is the light that the map, interpolated between texels, emits from
    /// the cell's solid angle. No direction that emits light has probability 0.
    pub fn new(image: &Image) -> Self {
        let (width, height) = (image.width as usize, image.height as usize);
        let scale = texel_scale(image);
        let luminance: Vec<f64> = (0..width * height)
            .map(|texel| texel_luminance(&image.pixels, texel, scale))
            .collect();
        // The integral of linear interpolation over a texel weights the texel and its two neighbours along each axis by
        // 1/8, 3/4 and 1/8.
        let at = |x: usize, y: usize| luminance[y * width + x];
        let across: Vec<f64> = (0..width * height)
            .map(|texel| {
                let (x, y) = (texel % width, texel / width);
                (at((x + width - 1) % width, y) + 6.0 * at(x, y) + at((x + 1) % width, y)) / 8.0
            })
            .collect();
        let step = [
            width.div_ceil(MOST_CELLS[0]).max(1),
            height.div_ceil(MOST_CELLS[1]).max(1),
        ];
        let cells = [width.div_ceil(step[0]), height.div_ceil(step[1])];
        let mut weights = vec![0.0; cells[0] * cells[1]];
        for y in 0..height {
            let (above, below) = (y.saturating_sub(1), (y + 1).min(height - 1));
            let (top, bottom) = (row_angle(y, height), row_angle(y + 1, height));
            let solid_angle = std::f64::consts::TAU / width as f64 * (top.cos() - bottom.cos());
            for x in 0..width {
                let mean = (across[above * width + x]
                    + 6.0 * across[y * width + x]
                    + across[below * width + x])
                    / 8.0;
                // A texel that overlaps several cells counts in each, so that none of them has probability 0.
                let last_column = ((x + 1) * cells[0] - 1) / width;
                let last_row = ((y + 1) * cells[1] - 1) / height;
                for row in y * cells[1] / height..=last_row {
                    for column in x * cells[0] / width..=last_column {
                        weights[row * cells[0] + column] += mean * solid_angle;
                    }
                }
            }
        }
        let table = alias::table(&weights);
        if table.is_empty() {
            return Self::none();
        }
        let mut words = vec![cells[0] as u32, cells[1] as u32];
        for entry in table {
            words.extend([
                entry.threshold.to_bits(),
                entry.alias,
                entry.probability.to_bits(),
            ]);
        }
        Self {
            words,
            luminance: weights.iter().sum(),
        }
    }
}

fn row_angle(row: usize, height: usize) -> f64 {
    std::f64::consts::PI * row as f64 / height as f64
}

/// Luminance of a texel as the GPU shows it, in half floats of `scale`.
fn texel_luminance(pixels: &Pixels, texel: usize, scale: f32) -> f64 {
    let rgb: [f64; 3] = match pixels {
        Pixels::Rgba32Float(values) => {
            std::array::from_fn(|c| f64::from(shown(values[texel * 4 + c], scale)))
        }
        Pixels::Rgba8(values) => std::array::from_fn(|c| f64::from(values[texel * 4 + c]) / 255.0),
    };
    rgb.iter()
        .zip(LUMINANCE.to_array())
        .map(|(c, weight)| c * f64::from(weight))
        .sum()
}
