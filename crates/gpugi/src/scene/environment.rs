//! The environment's texture, and checks of the environment's values.

use gpugi_scene::{Environment, Image, Pixels};

use crate::gpu::{Gpu, GpuError};

/// Rejects values that would make the whole image infinite or subtract light.
pub(crate) fn check_environment(environment: Option<&Environment>) -> Result<(), GpuError> {
    let Some(environment) = environment else {
        return Ok(());
    };
    let (intensity, rotation) = (environment.intensity, environment.rotation);
    if intensity.is_finite() && intensity >= 0.0 && rotation.is_normalized() {
        return Ok(());
    }
    Err(GpuError::Input {
        what: format!(
            "the environment's intensity {intensity} must be a finite number of at least 0, its rotation {rotation} a unit quaternion"
        ),
    })
}

/// An environment's texels on the GPU.
#[derive(Debug, Clone)]
pub(super) struct EnvironmentTexels {
    pub view: wgpu::TextureView,
    /// Radiance per unit of the texels: a power of two.
    pub scale: f32,
}

/// The environment as a half-float texture; one black texel if there is none. The sun of a clear sky exceeds the largest
/// half float: then all texels are scaled down. Infinite values count as 65,504; negative values and NaN become 0.
pub(super) fn environment_texels(
    gpu: &Gpu,
    environment: Option<&Environment>,
) -> Result<EnvironmentTexels, GpuError> {
    let black = Image {
        name: String::new(),
        width: 1,
        height: 1,
        pixels: Pixels::Rgba32Float(vec![0.0; 4]),
    };
    let image = environment.map_or(&black, |environment| &environment.image);
    let scale = texel_scale(image);
    let halves: Vec<u16> = match &image.pixels {
        Pixels::Rgba32Float(values) => values
            .iter()
            .map(|&value| {
                let value = shown(value, scale) / scale;
                half::f16::from_f32(value).to_bits()
            })
            .collect(),
        Pixels::Rgba8(values) => values
            .iter()
            .map(|&value| half::f16::from_f32(f32::from(value) / 255.0).to_bits())
            .collect(),
    };
    let format = wgpu::TextureFormat::Rgba16Float;
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
    let sides = [image.width, image.height, 1];
    let texture = gpu.texture_2d("environment", sides, format, usage)?;
    gpu.write_texture(
        texture.as_image_copy(),
        bytemuck::cast_slice(&halves),
        image.width * 8,
        texture.size(),
    );
    Ok(EnvironmentTexels {
        view: texture.create_view(&Default::default()),
        scale,
    })
}

/// The largest finite half float.
const LARGEST_HALF: f32 = 65504.0;

/// Radiance per unit of the texels of an environment's texture: a power of two from 1 to 2^14, by which its brightest
/// finite texel fits half floats. Darker texels keep their digits down to a millionth of the sun.
pub(crate) fn texel_scale(image: &Image) -> f32 {
    let brightest = match &image.pixels {
        Pixels::Rgba32Float(values) => {
            let texels = values.chunks_exact(4).flat_map(|texel| &texel[..3]);
            let finite = texels.copied().filter(|value| value.is_finite());
            finite.fold(0.0, f32::max)
        }
        Pixels::Rgba8(_) => 1.0,
    };
    let octaves = (brightest / LARGEST_HALF).log2().ceil();
    octaves.clamp(0.0, 14.0).exp2()
}

/// The value of a texel as the GPU shows it.
pub(crate) fn shown(value: f32, scale: f32) -> f32 {
    match value.is_infinite() {
        true if value > 0.0 => LARGEST_HALF,
        _ if value > 0.0 => value.min(LARGEST_HALF * scale),
        _ => 0.0,
    }
}
