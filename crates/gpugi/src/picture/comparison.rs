//! A picture beside its reference.

use bytemuck::{Pod, Zeroable};

use super::Effects;
use super::film::radiance_32;
use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Kernel, Named};
use crate::shader;

/// `Comparison` of comparison.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct ComparisonUniform {
    pub size: [u32; 2],
    pub split: u32,
    pub shown: u32,
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
    compared: wgpu::TextureView,
    uniform: HostBuffer,
}

impl Comparison {
    /// Compares pictures of `size` pixels with a black reference at first.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the adapter cannot hold that many, [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let kernel = Kernel::new(gpu, &shader!("picture.comparison"), "compare", None)?;
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
        let uniform = size_of::<ComparisonUniform>() as u64;
        Ok(Self {
            kernel,
            size,
            reference: gpu.buffer("picture.reference", bytes, wgpu::BufferUsages::STORAGE)?,
            compared: radiance_32(gpu, size)?,
            uniform: HostBuffer::new(gpu, "comparison", uniform, wgpu::BufferUsages::UNIFORM)?,
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

    /// Records the pass `picture.compare` over mean radiance of `size` pixels. What it returns is to be displayed with
    /// [`Compared::effects`].
    ///
    /// # Errors
    /// [`GpuError::Pass`] when the picture has another size.
    pub(super) fn record(
        &self,
        frame: &mut Frame<'_>,
        radiance: &wgpu::TextureView,
        size: [u32; 2],
        shown: Compared,
    ) -> Result<&wgpu::TextureView, GpuError> {
        let gpu = frame.gpu;
        if size != self.size {
            let [[a, b], [c, d]] = [size, self.size];
            return Err(GpuError::Pass {
                pass: "picture.compare".into(),
                reason: format!("the picture has {a}x{b} pixels, its reference {c}x{d}"),
            });
        }
        let uniform = ComparisonUniform {
            size,
            split: match shown {
                Compared::Split(split) => (split.clamp(0.0, 1.0) * size[0] as f32) as u32,
                Compared::Error | Compared::Leaks => 0,
            },
            shown: match shown {
                Compared::Split(_) => 0,
                Compared::Error => 1,
                Compared::Leaks => 2,
            },
        };
        self.uniform.write(gpu, &[uniform]);
        let resources: [Named<'_>; 4] = [
            ("radiance_unfilterable", radiance),
            ("reference", &self.reference),
            ("comparison", &self.uniform),
            ("compared", &self.compared),
        ];
        frame.compute("picture.compare", |pass| {
            self.kernel
                .run(pass, None, &resources, [size[0], size[1], 1])
        })?;
        Ok(&self.compared)
    }
}

impl Compared {
    /// The effects with which it is displayed: colours of errors appear as they are.
    pub(super) fn effects(self, effects: &Effects) -> Effects {
        match self {
            Self::Split(_) => effects.clone(),
            Self::Error | Self::Leaks => effects.of_colors(),
        }
    }
}
