//! The environment's texture, and checks of the environment's values.

use gpugi_scene::{Environment, Image, Pixels};

use crate::gpu::{Gpu, GpuError};

/// Rejects values that would make the whole image infinite or subtract light.
pub(crate) fn check_environment(environment: Option<&Environment>) -> Result<(), GpuError> {
    let Some(environment) = environment else {
        return Ok(());
    };
    let (intensity, rotation) = (environment.intensity, environment.rotation);
    if intensity.is_finite() && intensity >= 0.0 && rotation.is_finite() {
        return Ok(());
    }
    Err(GpuError::Input {
        what: format!(
            "the environment's intensity {intensity} must be a finite number of at least 0, its rotation {rotation} a finite angle"
        ),
    })
}

/// The environment as a half-float texture; one black texel if there is none. Values above 65,504, including infinity,
/// are clamped; negative values and NaN become 0.
pub(super) fn environment_texture(
    gpu: &Gpu,
    environment: Option<&Environment>,
) -> Result<wgpu::TextureView, GpuError> {
    let black = Image {
        name: String::new(),
        width: 1,
        height: 1,
        pixels: Pixels::Rgba32Float(vec![0.0; 4]),
    };
    let image = environment.map_or(&black, |environment| &environment.image);
    let halves: Vec<u16> = match &image.pixels {
        Pixels::Rgba32Float(values) => values
            .iter()
            .map(|&value| {
                half::f16::from_f32(if value > 0.0 { value.min(65504.0) } else { 0.0 }).to_bits()
            })
            .collect(),
        Pixels::Rgba8(values) => values
            .iter()
            .map(|&value| half::f16::from_f32(f32::from(value) / 255.0).to_bits())
            .collect(),
    };
    let size = wgpu::Extent3d {
        width: image.width,
        height: image.height,
        depth_or_array_layers: 1,
    };
    let texture = gpu.texture(&wgpu::TextureDescriptor {
        label: Some("environment"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })?;
    gpu.write_texture(
        texture.as_image_copy(),
        bytemuck::cast_slice(&halves),
        image.width * 8,
        size,
    );
    Ok(texture.create_view(&Default::default()))
}
