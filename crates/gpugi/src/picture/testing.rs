//! Films of given radiance, for tests of effects.

use half::f16;

use super::film::texture;
use crate::gpu::{Gpu, read_texture};

/// A still picture's format.
pub const FLOATS: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;
/// A live picture's format.
pub const HALVES: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// A film of this radiance.
pub fn film(
    gpu: &Gpu,
    size: [u32; 2],
    format: wgpu::TextureFormat,
    picture: &[[f32; 3]],
) -> wgpu::TextureView {
    let film = texture(gpu, "film", format, size).unwrap();
    // Alpha of a live picture is a number of frames.
    let texels = picture.iter().map(|&[r, g, b]| [r, g, b, 7.0]);
    let bytes: Vec<u8> = match format {
        HALVES => {
            let halves = texels.map(|texel| texel.map(f16::from_f32));
            bytemuck::cast_slice(&halves.collect::<Vec<_>>()).to_vec()
        }
        _ => bytemuck::cast_slice(&texels.collect::<Vec<_>>()).to_vec(),
    };
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(bytes.len() as u32 / size[1]),
        rows_per_image: None,
    };
    let texture = film.texture();
    let whole = texture.size();
    gpu.queue
        .write_texture(texture.as_image_copy(), &bytes, layout, whole);
    film
}

/// The radiance of a film.
pub fn radiance(gpu: &Gpu, film: &wgpu::TextureView) -> Vec<[f32; 3]> {
    let (texture, all) = (film.texture(), wgpu::TextureAspect::All);
    let rgb = |[r, g, b, _]: [f32; 4]| [r, g, b];
    if texture.format() == FLOATS {
        let texels: Vec<[f32; 4]> = read_texture(gpu, texture, all, 0, 0).unwrap();
        return texels.into_iter().map(rgb).collect();
    }
    let texels: Vec<[f16; 4]> = read_texture(gpu, texture, all, 0, 0).unwrap();
    let texels = texels.into_iter().map(|texel| rgb(texel.map(f16::to_f32)));
    texels.collect()
}
