//! The noise of an atlas's texels: how far samples spread, and the filter that takes it out.

use bytemuck::{Pod, Zeroable};

use super::filter::{NOISY_BYTES, NonLocalMeans};
use crate::capture::SurfacePoints;
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, read_buffer};
use crate::shader;

/// GPU memory per texel while samples are taken (bytes).
pub const SPREAD_BYTES: u64 = size_of::<Spread>() as u64;
/// The same while texels are filtered: `Noisy`, sums, and the squares on their way to the GPU.
pub const FILTER_BYTES: u64 = NOISY_BYTES + 32;

/// `Spread` of denoise/spread.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Spread {
    before: [f32; 3],
    padding: u32,
    squares: [f32; 3],
    padding_2: u32,
}

/// Sums of squares of the samples at some points.
#[derive(Debug)]
pub struct Spreads {
    kernel: Kernel,
    buffer: wgpu::Buffer,
    count: u32,
}

impl Spreads {
    /// For `count` points, which have no sample yet.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(gpu: &Gpu, count: u32) -> Result<Self, GpuError> {
        let bytes = u64::from(count) * SPREAD_BYTES;
        Ok(Self {
            kernel: Kernel::new(gpu, &shader!("denoise.spread"), "main", None)?,
            buffer: gpu.buffer("denoise.spread [bytes]", bytes, wgpu::BufferUsages::STORAGE)?,
            count,
        })
    }

    /// Goes on from sums of samples and of their squares.
    pub fn resume(&self, gpu: &Gpu, sums: &[[f32; 4]], squares: &[[f32; 3]]) {
        let both = sums.iter().zip(squares);
        let spread = |(&[r, g, b, _], &squares): (&[f32; 4], &[f32; 3])| Spread {
            before: [r, g, b],
            padding: 0,
            squares,
            padding_2: 0,
        };
        gpu.write(&self.buffer, 0, &both.map(spread).collect::<Vec<_>>());
    }

    /// Takes notice of a sample that `radiance`, a sum of samples, has gained: pass `denoise.spread`.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(&self, frame: &mut Frame<'_>, radiance: &wgpu::Buffer) -> Result<(), GpuError> {
        let resources: [Named<'_>; 2] = [("radiance", radiance), ("spreads", &self.buffer)];
        frame.run(
            "denoise.spread",
            &self.kernel,
            None,
            &resources,
            [self.count, 1, 1],
        )
    }

    /// The sums of squares. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn squares(&self, gpu: &Gpu) -> Result<Vec<[f32; 3]>, GpuError> {
        let spreads = read_buffer::<Spread>(gpu, &self.buffer, self.buffer.size())?;
        Ok(spreads.iter().map(|spread| spread.squares).collect())
    }

    /// Frees memory at once.
    pub fn destroy(&self) {
        self.buffer.destroy();
    }
}

/// Filters the texels of rows of an atlas: non-local means (denoise/filter.wesl), within what lies on one surface.
#[derive(Debug)]
pub struct TexelDenoiser {
    means: NonLocalMeans,
    fill: Kernel,
    finish: Kernel,
}

impl TexelDenoiser {
    /// For so many texels per row, and rows.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let kernel = |entry| Kernel::new(gpu, &shader!("denoise.of_texels"), entry, None);
        Ok(Self {
            means: NonLocalMeans::of_texels(gpu, size)?,
            fill: kernel("fill")?,
            finish: kernel("finish")?,
        })
    }

    /// Replaces `radiance`, sums of two or more samples at texels, by one filtered sample per texel: pass `denoise`. Empty
    /// texels stay as they are. `squares`: sums of the samples' squares, four floats per texel.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        points: &SurfacePoints,
        [radiance, squares]: [&wgpu::Buffer; 2],
    ) -> Result<(), GpuError> {
        let resources: [Named<'_>; 6] = [
            ("seen", &points.view),
            ("points", &points.points),
            ("radiance", radiance),
            ("squares", squares),
            ("pixels", &self.means.pixels),
            ("sums", &self.means.sums),
        ];
        let invocations = [points.count, 1, 1];
        frame.run("denoise", &self.fill, None, &resources, invocations)?;
        self.means.record_all(frame)?;
        frame.run("denoise", &self.finish, None, &resources, invocations)
    }
}
