//! Height maps: images whose grey is the height of a surface.

use glam::{DVec2, Vec2, Vec3};

use super::{Image, Pixels, luminance};

/// Heights, row by row from the top: 0 for black, 1 for white. Images of floats may exceed that.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Heights {
    width: u32,
    height: u32,
    values: Vec<f32>,
    /// The lowest and the highest.
    range: [f32; 2],
}

impl Heights {
    /// `values` are width x height finite numbers; both sides are at least 1.
    pub fn new(width: u32, height: u32, values: Vec<f32>) -> Self {
        let lowest = values.iter().copied().fold(f32::INFINITY, f32::min);
        let highest = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        Self {
            width,
            height,
            values,
            range: [lowest, highest],
        }
    }

    /// The luminance of the values as they are stored: height maps are linear, whatever their format says.
    pub fn of(image: &Image) -> Self {
        let grey = |[red, green, blue]: [f32; 3]| luminance(Vec3::new(red, green, blue));
        let values = match &image.pixels {
            Pixels::Rgba8(texels) => {
                let texels = texels.as_chunks::<4>().0.iter();
                let rgb = |&[r, g, b, _]: &[u8; 4]| [r, g, b].map(|value| f32::from(value) / 255.0);
                texels.map(|texel| grey(rgb(texel))).collect()
            }
            Pixels::Rgba32Float(texels) => {
                let texels = texels.as_chunks::<4>().0.iter();
                texels.map(|&[r, g, b, _]| grey([r, g, b])).collect()
            }
        };
        Self::new(image.width, image.height, values)
    }

    /// Width and height (texels).
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// The lowest and the highest.
    pub fn range(&self) -> [f32; 2] {
        self.range
    }

    /// Bytes in memory.
    pub fn byte_size(&self) -> usize {
        size_of_val(&self.values[..])
    }

    /// These heights, and means of ever larger squares: each level has half as many texels a side, the last only one.
    pub fn into_levels(self) -> Vec<Self> {
        let mut levels = vec![self];
        while let Some(last) = levels.last().filter(|last| last.size() != [1, 1]) {
            levels.push(last.halved());
        }
        levels
    }

    /// The height at texture coordinates with v downward, between the four texels around. `clamp`: the border goes on
    /// outside; otherwise the image repeats.
    pub fn at(&self, uv: DVec2, clamp: bool) -> f32 {
        let between = |at: f64, size: u32| {
            let at = if !at.is_finite() {
                0.0
            } else if clamp {
                at.clamp(0.0, 1.0)
            } else {
                at - at.floor()
            };
            let at = at * f64::from(size) - 0.5;
            let texels = [0, 1].map(|step| wrapped(at.floor() as i64 + step, size, clamp));
            (texels, (at - at.floor()) as f32)
        };
        let ([left, right], x) = between(uv.x, self.width);
        let ([top, bottom], y) = between(uv.y, self.height);
        let row = |row: usize| {
            let texel = |column: usize| self.values[row * self.width as usize + column];
            texel(left) * (1.0 - x) + texel(right) * x
        };
        row(top) * (1.0 - y) + row(bottom) * y
    }

    fn halved(&self) -> Self {
        let [width, height] = self.size().map(|side| (side / 2).max(1));
        let texel = |x: u32, y: u32| {
            let (x, y) = (x.min(self.width - 1), y.min(self.height - 1));
            self.values[y as usize * self.width as usize + x as usize]
        };
        let mean = |x: u32, y: u32| {
            let [top, bottom] = [2 * y, 2 * y + 1].map(|y| texel(2 * x, y) + texel(2 * x + 1, y));
            (top + bottom) / 4.0
        };
        let all = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        Self::new(width, height, all.map(|(x, y)| mean(x, y)).collect())
    }

    /// Height per texel along u and along the image's upward direction, by Sobel's kernel.
    fn slope(&self, x: u32, y: u32, clamp: bool) -> Vec2 {
        let columns = [-1, 0, 1].map(|step| wrapped(i64::from(x) + step, self.width, clamp));
        let rows = [-1, 0, 1].map(|step| wrapped(i64::from(y) + step, self.height, clamp));
        let [above, here, below] = rows.map(|row| {
            let row = &self.values[row * self.width as usize..][..self.width as usize];
            columns.map(|column| row[column])
        });
        let right = |row: [f32; 3]| row[2] - row[0];
        let sum = |row: [f32; 3]| row[0] + 2.0 * row[1] + row[2];
        let along_u = right(above) + 2.0 * right(here) + right(below);
        Vec2::new(along_u, sum(above) - sum(below)) / 8.0
    }

    /// A tangent-space normal map, green upward, whose steepest texel slopes by 45 degrees; and the height per texel
    /// there. That slope times a strength is the map's scale. `None` if all heights are equal. `clamp`: as in
    /// [`Heights::at`]. `mirrored`: the image runs against u, or against v.
    pub fn normal_map(
        &self,
        name: String,
        clamp: bool,
        mirrored: [bool; 2],
    ) -> Option<(Image, f32)> {
        let texels = || (0..self.height).flat_map(|y| (0..self.width).map(move |x| (x, y)));
        let slopes = || texels().map(|(x, y)| self.slope(x, y, clamp));
        let steepest = slopes().map(Vec2::length).fold(0.0, f32::max);
        if !(steepest.is_normal() && steepest.is_finite()) {
            return None;
        }
        let sign = Vec2::from(mirrored.map(|mirrored| if mirrored { 1.0 } else { -1.0 }));
        let mut pixels = Vec::with_capacity(4 * self.values.len());
        for slope in slopes() {
            let normal = (slope * sign / steepest).extend(1.0).normalize();
            let encoded = (normal * 0.5 + 0.5) * 255.0;
            pixels.extend(encoded.to_array().map(|value| value.round() as u8));
            pixels.push(255);
        }
        let image = Image {
            name,
            width: self.width,
            height: self.height,
            pixels: Pixels::Rgba8(pixels),
        };
        Some((image, steepest))
    }
}

/// A texel next to a border, or past it.
fn wrapped(at: i64, size: u32, clamp: bool) -> usize {
    let size = i64::from(size);
    if clamp {
        at.clamp(0, size - 1) as usize
    } else {
        at.rem_euclid(size) as usize
    }
}

/// Whether an image holds tangent-space normals, not heights: on average red and green lie from 0.35 to 0.65 and blue
/// above 0.7, and three quarters of the texels, as vectors, have lengths from 0.8 to 1.2. No grey image does.
pub(crate) fn holds_normals(image: &Image) -> bool {
    let Pixels::Rgba8(texels) = &image.pixels else {
        return false;
    };
    let texels = texels.as_chunks::<4>().0;
    let mut sums = [0_u64; 3];
    let mut unit = 0;
    for &[red, green, blue, _] in texels {
        let rgb = [red, green, blue];
        sums = std::array::from_fn(|channel| sums[channel] + u64::from(rgb[channel]));
        let vector = Vec3::from(rgb.map(|value| f32::from(value) / 127.5 - 1.0));
        unit += usize::from((0.8..=1.2).contains(&vector.length()));
    }
    let [red, green, blue] = sums.map(|sum| sum as f64 / (255.0 * texels.len() as f64));
    let is_level = |mean: f64| (0.35..=0.65).contains(&mean);
    is_level(red) && is_level(green) && blue > 0.7 && 4 * unit >= 3 * texels.len()
}
