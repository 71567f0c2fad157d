//! A picture beside its reference.

use bytemuck::{Pod, Zeroable};

use super::{DisplaySettings, Exposure, Part, ToneMap};
use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Kernel};
use crate::shader;

/// `Comparison` of comparison.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct ComparisonUniform {
    pub width: u32,
    pub split: u32,
    pub shown: u32,
    pub scale: f32,
    pub pixel_count: u32,
    pub first_pixel: u32,
}

/// What a comparison shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Compared {
    /// The picture to the left of this part of its width (0 to 1), its reference to the right.
    Split(f32),
    /// Each pixel's part of rel-mse (docs/measuring.md) in colours: 1e-4 black, 1e-3 blue, 1e-2 red, 1e-1 yellow, 1
    /// white.
    Error,
    /// How much brighter than its reference each pixel is, as a part of the reference: light that is too much in red,
    /// such as that of leaks, and what is missing in blue. Equal light is black.
    Leaks,
}

/// A reference, such as a picture of the path tracer, and the pass that puts pictures of its size beside it.
#[derive(Debug)]
pub struct Comparison {
    kernel: Kernel,
    size: [u32; 2],
    reference: wgpu::Buffer,
    compared: wgpu::Buffer,
}

impl Comparison {
    /// Compares pictures of `size` pixels with a black reference at first.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the adapter cannot hold that many, [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let kernel = Kernel::new(gpu, &shader!("display.comparison"), "compare", None)?;
        Self::by(kernel, gpu, size)
    }

    /// The same for pictures of another size; it compiles nothing.
    ///
    /// # Errors
    /// As [`Comparison::new`].
    pub fn resized(&self, gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        Self::by(self.kernel.clone(), gpu, size)
    }

    fn by(kernel: Kernel, gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let bytes = u64::from(size[0]) * u64::from(size[1]) * 16;
        let storage = |label| gpu.buffer(label, bytes, wgpu::BufferUsages::STORAGE);
        Ok(Self {
            kernel,
            size,
            reference: storage("display.reference")?,
            compared: storage("display.compared")?,
        })
    }

    /// Width and height of the reference (pixels).
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The reference, for passes that write it: `vec4f` per pixel.
    pub(crate) fn reference(&self) -> &wgpu::Buffer {
        &self.reference
    }

    /// Takes the reference: mean linear radiance, three floats per pixel, row by row from the top. Pixels that are
    /// missing stay as they are.
    pub fn set_reference(&self, gpu: &Gpu, radiance: &[f32]) {
        let pixels = (self.size[0] * self.size[1]) as usize;
        let padded: Vec<[f32; 4]> = radiance
            .chunks_exact(3)
            .take(pixels)
            .map(|pixel| [pixel[0], pixel[1], pixel[2], 1.0])
            .collect();
        gpu.write(&self.reference, 0, &padded);
    }

    /// Records the pass `display.compare` over a picture whose parts sum `samples` samples. What it returns is to be
    /// displayed as one sample.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when the picture has another size.
    pub(crate) fn record(
        &self,
        frame: &mut Frame<'_>,
        parts: &[Part],
        samples: u32,
        shown: Compared,
    ) -> Result<Part, GpuError> {
        let gpu = frame.gpu;
        let all: u32 = parts.iter().map(|part| part.pixels).sum();
        let pixels = self.size[0] * self.size[1];
        if all != pixels {
            return Err(GpuError::Pass {
                pass: "display.compare".into(),
                reason: format!("the picture has {all} pixels, its reference {pixels}"),
            });
        }
        let reference = [("reference", self.reference.as_entire_binding())];
        let reference = self.kernel.bind(gpu, 2, &reference)?;
        let mut first_pixel = 0;
        for part in parts {
            let split = match shown {
                Compared::Split(split) => (split.clamp(0.0, 1.0) * self.size[0] as f32) as u32,
                Compared::Error | Compared::Leaks => 0,
            };
            let uniform = HostBuffer::new(
                gpu,
                "display.comparison",
                size_of::<ComparisonUniform>() as u64,
                wgpu::BufferUsages::UNIFORM,
            )?;
            let values = ComparisonUniform {
                width: self.size[0],
                split,
                shown: match shown {
                    Compared::Split(_) => 0,
                    Compared::Error => 1,
                    Compared::Leaks => 2,
                },
                scale: 1.0 / samples.max(1) as f32,
                pixel_count: part.pixels,
                first_pixel,
            };
            uniform.write(gpu, std::slice::from_ref(&values));
            let radiance = [("radiance", part.radiance.as_entire_binding())];
            let own = [
                ("comparison", uniform.as_entire_binding()),
                ("compared", self.compared.as_entire_binding()),
            ];
            let radiance = self.kernel.bind(gpu, 1, &radiance)?;
            let own = self.kernel.bind(gpu, 3, &own)?;
            frame.compute("display.compare", |pass| {
                let groups = [(1, &radiance), (2, &reference), (3, &own)];
                self.kernel.dispatch(pass, &groups, [part.pixels, 1, 1]);
            });
            first_pixel += part.pixels;
        }
        Ok(Part {
            radiance: self.compared.clone(),
            pixels,
        })
    }
}

impl Compared {
    /// The settings with which it is displayed: colours of errors appear as they are.
    pub(crate) fn settings(self, settings: &DisplaySettings) -> DisplaySettings {
        match self {
            Self::Split(_) => *settings,
            Self::Error | Self::Leaks => DisplaySettings {
                exposure: Exposure::Manual(0.0),
                tone_map: ToneMap::None,
                dither: false,
                ..*settings
            },
        }
    }
}
