//! The last effect: exposes, tone-maps, sRGB-encodes, dithers and packs radiance, 8 bits per channel.
//! docs/effects/display.md.

use bytemuck::{Pod, Zeroable};

use super::Effects;
use super::vignette::VignetteUniform;
use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Kernel, Named};
use crate::picture::Optics;
use crate::shader;

crate::settings! {
    /// Settings of the encoding.
    #[derive(Copy)]
    pub struct Settings {
        /// Whether to hide the steps between 8-bit values with noise of at most one step.
        pub dither: bool = true => any(),
        /// Seed of the dither. The same seed produces the same noise.
        pub seed: u32 = 0 => any(),
    }
}

/// `Encoding` of encode.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct EncodingUniform {
    size: [u32; 2],
    tone_map: u32,
    white_point: f32,
    seed: u32,
    dither: u32,
    padding: [u32; 2],
    vignette: VignetteUniform,
}

/// The pass, and the pixels of the last frame.
#[derive(Debug, Clone)]
pub(in crate::picture) struct Pass {
    kernel: Kernel,
    encoding: HostBuffer,
    /// RGBA8, red in the lowest byte, in rows from top to bottom.
    pub pixels: wgpu::Buffer,
}

/// Four bytes per pixel.
fn pixels(gpu: &Gpu, size: [u32; 2]) -> Result<wgpu::Buffer, GpuError> {
    let bytes = u64::from(size[0]) * u64::from(size[1]) * 4;
    gpu.buffer("picture.pixels", bytes, wgpu::BufferUsages::STORAGE)
}

impl Pass {
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let shader = shader!("picture.effects.encode.encode");
        let bytes = size_of::<EncodingUniform>() as u64;
        let uniform = wgpu::BufferUsages::UNIFORM;
        Ok(Self {
            kernel: Kernel::new(gpu, &shader, "encode", None)?,
            encoding: HostBuffer::new(gpu, "picture.encoding", bytes, uniform)?,
            pixels: pixels(gpu, size)?,
        })
    }

    /// The same for pictures of another size; it compiles nothing.
    pub fn resized(&self, gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        Ok(Self {
            pixels: pixels(gpu, size)?,
            ..self.clone()
        })
    }

    /// Records the pass `picture.encode` for a picture of `size` pixels by `camera`, at an `exposure` value (EV, one
    /// float).
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        radiance: &wgpu::TextureView,
        size: [u32; 2],
        camera: Optics,
        exposure: &wgpu::Buffer,
        effects: &Effects,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let encoding = EncodingUniform {
            size,
            tone_map: effects.tone_map.operator as u32,
            white_point: effects.tone_map.white_point.max(1e-3),
            seed: effects.encode.seed,
            dither: effects.encode.dither.into(),
            padding: [0; 2],
            vignette: VignetteUniform::new(&effects.vignette, size, camera),
        };
        self.encoding.write(gpu, &[encoding]);
        let resources: [Named<'_>; 4] = [
            ("radiance_unfilterable", radiance),
            ("encoding", &self.encoding),
            ("exposure", exposure),
            ("pixels", &self.pixels),
        ];
        frame.compute("picture.encode", |pass| {
            self.kernel
                .run(pass, None, &resources, [size[0], size[1], 1])
        })
    }
}
