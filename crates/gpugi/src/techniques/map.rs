//! The maps that techniques keep, and how people get to see them.

use gpugi_scene::image::unpack_rgb9e5;
use half::f16;
use wgpu::TextureFormat;

use crate::gpu::TextureAspect::{All, DepthOnly};
use crate::gpu::{Gpu, GpuError, ReadBack, begin_read_buffer, begin_read_texture};

/// Bytes of a BC6H block.
const BLOCK_BYTES: u64 = 16;

/// A map that a technique keeps for its gather.
#[derive(Debug, Clone)]
pub struct Map {
    /// The name, such as `shadow-map.atlas`.
    pub name: String,
    /// The storage of its texels.
    pub texels: Texels,
}

/// Storage of a map's texels.
#[derive(Debug, Clone)]
pub enum Texels {
    /// A texture.
    Texture(wgpu::Texture),
    /// A buffer, row by row.
    Buffer {
        /// The buffer.
        buffer: wgpu::Buffer,
        /// Width and height (texels).
        size: [u32; 2],
        /// Distance from texel to texel (bytes).
        stride: u64,
        /// Whether a texel begins with one unsigned 32-bit integer instead of a colour: three floats, rgb9e5 where the
        /// stride is 4, or three 16-bit floats where it is 8.
        is_number: bool,
    },
    /// A buffer of BC6H blocks of 4 x 4 texels, row by row.
    Blocks {
        /// The buffer.
        buffer: wgpu::Buffer,
        /// Width and height (texels); the height is that of whole blocks.
        size: [u32; 2],
    },
}

/// Texels on their way to the host.
#[derive(Debug)]
pub struct MapRead {
    /// Width and height (texels).
    pub size: [u32; 2],
    words: ReadBack<Vec<u32>>,
    /// Words from texel to texel.
    stride: usize,
    encoding: Encoding,
}

/// How words hold a texel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Encoding {
    /// An unsigned integer.
    Number,
    /// A float, such as a depth.
    Depth,
    /// Three floats.
    Floats,
    /// Three 16-bit floats.
    Halves,
    /// rgb9e5.
    SharedExponent,
    /// BC6H.
    Blocks,
}

impl Map {
    /// A texture.
    pub fn of_texture(name: impl Into<String>, texture: &wgpu::Texture) -> Self {
        Self {
            name: name.into(),
            texels: Texels::Texture(texture.clone()),
        }
    }

    /// A buffer of `size` colours, `stride` bytes apart.
    pub fn of_colors(
        name: impl Into<String>,
        buffer: &wgpu::Buffer,
        size: [u32; 2],
        stride: u64,
    ) -> Self {
        Self {
            name: name.into(),
            texels: Texels::Buffer {
                buffer: buffer.clone(),
                size,
                stride,
                is_number: false,
            },
        }
    }

    /// The same of numbers.
    pub fn of_numbers(
        name: impl Into<String>,
        buffer: &wgpu::Buffer,
        size: [u32; 2],
        stride: u64,
    ) -> Self {
        let mut map = Self::of_colors(name, buffer, size, stride);
        if let Texels::Buffer { is_number, .. } = &mut map.texels {
            *is_number = true;
        }
        map
    }

    /// The texture, if it is one.
    pub fn texture(&self) -> Option<&wgpu::Texture> {
        match &self.texels {
            Texels::Texture(texture) => Some(texture),
            Texels::Buffer { .. } | Texels::Blocks { .. } => None,
        }
    }

    /// Size on the GPU (bytes).
    pub fn bytes(&self) -> u64 {
        match &self.texels {
            Texels::Texture(texture) => texture
                .format()
                .theoretical_memory_footprint(texture.size()),
            Texels::Buffer { buffer, .. } | Texels::Blocks { buffer, .. } => buffer.size(),
        }
    }

    /// Number of layers: faces of a cube, pages of an atlas.
    pub fn layers(&self) -> u32 {
        self.texture()
            .map_or(1, wgpu::Texture::depth_or_array_layers)
    }

    /// Number of mip levels.
    pub fn levels(&self) -> u32 {
        self.texture().map_or(1, wgpu::Texture::mip_level_count)
    }

    /// Copies a level of a layer to the host, after all work submitted so far.
    ///
    /// # Errors
    /// As [`begin_read_buffer`].
    pub fn begin_read(&self, gpu: &Gpu, layer: u32, level: u32) -> Result<MapRead, GpuError> {
        let texture = match &self.texels {
            Texels::Texture(texture) => texture,
            Texels::Buffer {
                buffer,
                size,
                stride,
                is_number,
            } => {
                let count = u64::from(size[0]) * u64::from(size[1]);
                return Ok(MapRead {
                    size: *size,
                    words: begin_read_buffer(gpu, buffer, count * stride)?,
                    stride: *stride as usize / 4,
                    encoding: match *stride {
                        _ if *is_number => Encoding::Number,
                        4 => Encoding::SharedExponent,
                        8 => Encoding::Halves,
                        _ => Encoding::Floats,
                    },
                });
            }
            Texels::Blocks { buffer, size } => {
                let bytes = u64::from(size[0].div_ceil(4)) * u64::from(size[1] / 4) * BLOCK_BYTES;
                return Ok(MapRead {
                    size: *size,
                    words: begin_read_buffer(gpu, buffer, bytes)?,
                    stride: BLOCK_BYTES as usize / 4,
                    encoding: Encoding::Blocks,
                });
            }
        };
        let format = texture.format();
        let (aspect, stride, encoding) = match format {
            format if format.is_depth_stencil_format() => (DepthOnly, 1, Encoding::Depth),
            TextureFormat::R32Float => (All, 1, Encoding::Depth),
            format if format.block_copy_size(None) == Some(4) => (All, 1, Encoding::Number),
            _ => (All, 2, Encoding::Halves),
        };
        let extent = texture.size().mip_level_size(level, texture.dimension());
        Ok(MapRead {
            size: [extent.width, extent.height],
            words: begin_read_texture(gpu, texture, aspect, layer, level)?,
            stride,
            encoding,
        })
    }
}

impl MapRead {
    /// Three numbers per texel, row by row, once they have arrived: linear colours, or one number three times. Never
    /// blocks.
    pub fn get(&self) -> Option<Result<Vec<f32>, GpuError>> {
        let words = self.words.get()?;
        Some(words.map(|words| self.decoded(&words)))
    }

    /// The blocking twin of [`MapRead::get`].
    ///
    /// # Errors
    /// As [`ReadBack::wait`].
    pub fn wait(self) -> Result<Vec<f32>, GpuError> {
        let (stride, encoding, width) = (self.stride, self.encoding, self.size[0]);
        let words = self.words.wait()?;
        Ok(decoded(&words, stride, encoding, width))
    }

    fn decoded(&self, words: &[u32]) -> Vec<f32> {
        decoded(words, self.stride, self.encoding, self.size[0])
    }
}

/// Texels of rows of BC6H blocks.
fn of_blocks(words: &[u32], width: u32) -> Vec<f32> {
    let columns = width.div_ceil(4) as usize;
    let mut colors = Vec::new();
    let mut wide = vec![0.0; 4 * 3 * 4 * columns];
    for row in words.chunks_exact(4 * columns) {
        for (column, block) in row.chunks_exact(4).enumerate() {
            let texels = &mut wide[column * 12..];
            bcdec_rs::bc6h_float(bytemuck::cast_slice(block), texels, 12 * columns, false);
        }
        for line in wide.chunks_exact(12 * columns) {
            colors.extend_from_slice(&line[..3 * width as usize]);
        }
    }
    colors
}

fn decoded(words: &[u32], stride: usize, encoding: Encoding, width: u32) -> Vec<f32> {
    if encoding == Encoding::Blocks {
        return of_blocks(words, width);
    }
    let texels = words.chunks_exact(stride);
    let colors = texels.flat_map(|texel| match (encoding, texel) {
        (Encoding::Number, [number, ..]) => [*number as f32; 3],
        (Encoding::Depth, [depth, ..]) => [f32::from_bits(*depth); 3],
        (Encoding::Floats, [r, g, b, ..]) => [*r, *g, *b].map(f32::from_bits),
        (Encoding::Halves, [rg, ba, ..]) => {
            [*rg, *rg >> 16, *ba].map(|word| f16::from_bits(word as u16).to_f32())
        }
        (Encoding::SharedExponent, [word, ..]) => unpack_rgb9e5(*word).to_array(),
        _ => [0.0; 3],
    });
    colors.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_texels() {
        let floats = [0.5_f32, 2.0, -1.0, 9.0].map(f32::to_bits);
        assert_eq!(decoded(&floats, 4, Encoding::Floats, 1), [0.5, 2.0, -1.0]);
        let half = |value: f32| u32::from(f16::from_f32(value).to_bits());
        let halves = [half(1.0) | half(2.0) << 16, half(0.25) | half(7.0) << 16];
        assert_eq!(decoded(&halves, 2, Encoding::Halves, 1), [1.0, 2.0, 0.25]);
        assert_eq!(
            decoded(&[7, 0, 8, 0], 2, Encoding::Number, 1),
            [7.0, 7.0, 7.0, 8.0, 8.0, 8.0]
        );
        assert_eq!(
            decoded(&[0.5_f32.to_bits()], 1, Encoding::Depth, 1),
            [0.5; 3]
        );
        let shared = 24 << 27 | 3 | 5 << 9 | 511 << 18;
        assert_eq!(
            decoded(&[shared], 1, Encoding::SharedExponent, 1),
            [3.0, 5.0, 511.0]
        );
    }
}
