//! Cube maps, and views of their layers.

use crate::gpu::{Gpu, GpuError};

/// A texture of `cubes` cube maps, with six layers per cube map.
///
/// # Errors
/// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
pub fn cube_texture(
    gpu: &Gpu,
    label: &str,
    format: wgpu::TextureFormat,
    side: u32,
    levels: u32,
    cubes: u32,
) -> Result<wgpu::Texture, GpuError> {
    let size = [side, side, 6 * cubes];
    let usage = wgpu::TextureUsages::TEXTURE_BINDING
        | wgpu::TextureUsages::STORAGE_BINDING
        | wgpu::TextureUsages::COPY_SRC;
    gpu.texture_with_levels(label, size, levels, format, usage)
}

/// All levels of a texture's layers.
pub(super) fn layers(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

/// The layers of one level.
pub fn layers_of_level(texture: &wgpu::Texture, level: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        base_mip_level: level,
        mip_level_count: Some(1),
        ..Default::default()
    })
}

/// The six layers of cube map `cube`, at the finest level.
pub fn layers_of_cube(texture: &wgpu::Texture, cube: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        mip_level_count: Some(1),
        base_array_layer: 6 * cube,
        array_layer_count: Some(6),
        ..Default::default()
    })
}

/// The layers as one cube map.
pub(super) fn cube(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::Cube),
        ..Default::default()
    })
}

/// The layers as cube maps.
pub fn cubes(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::CubeArray),
        ..Default::default()
    })
}
