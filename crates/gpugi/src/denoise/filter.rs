//! The filter, over windows of a picture's rows that fit a buffer.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions, Named};
use crate::shader;

/// A pixel to be filtered: `Noisy` of denoise/noisy.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Noisy {
    pub light: [f32; 3],
    pub depth: f32,
    pub variance: [f32; 3],
    pub normal: u32,
    pub guide: [f32; 3],
    pub surface: u32,
}

pub(super) const NOISY_BYTES: u64 = size_of::<Noisy>() as u64;
/// `RADIUS` of filter.wesl.
const RADIUS: u32 = 7;
/// Rows beyond those that are written on which these depend: `RADIUS` and `PATCH`.
pub const MARGIN: u32 = 9;

/// `Rows` of denoise/filter.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Rows {
    size: [u32; 2],
    row: u32,
    padding: u32,
}

/// `Finish` of denoise/finish.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Finish {
    first: u32,
    rows: u32,
    width: u32,
    padding: u32,
}

/// Rows of a picture that are filtered at once.
#[derive(Debug, Clone, PartialEq)]
pub struct Window {
    /// Rows that the filter reads.
    pub read: Range<u32>,
    /// Rows that it writes.
    pub written: Range<u32>,
}

/// Non-local means over windows of pictures, or of texels, of one size (denoise/filter.wesl).
#[derive(Debug)]
pub struct NonLocalMeans {
    kernel: Kernel,
    size: [u32; 2],
    /// Most rows of a window.
    rows: u32,
    /// The window's pixels: `Noisy`.
    pub pixels: wgpu::Buffer,
    /// Weighted sums of light, with the weights.
    pub(super) sums: wgpu::Buffer,
}

impl NonLocalMeans {
    /// For texels: all rows in one window.
    pub(super) fn of_texels(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        Self::with_rows(gpu, size, size[1], true)
    }

    /// For pictures of `size` pixels.
    pub(super) fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        Self::in_steps(gpu, size, u32::MAX)
    }

    /// The same in windows that write about so many pixels.
    fn in_steps(gpu: &Gpu, size: [u32; 2], pixels: u32) -> Result<Self, GpuError> {
        let limits = gpu.limits();
        let largest = limits
            .max_buffer_size
            .min(limits.max_storage_buffer_binding_size);
        let width = size[0].max(1);
        let most = largest / (u64::from(width) * NOISY_BYTES);
        let rows = u64::from(pixels / width) + u64::from(2 * MARGIN);
        // One row at least is written; if its window is too large, its buffer says so.
        let rows = rows
            .min(u64::from(size[1]))
            .min(most)
            .max(u64::from(2 * MARGIN + 1));
        Self::with_rows(gpu, size, rows as u32, false)
    }

    /// The same in windows of no more than `rows` rows, which has to exceed `2 * MARGIN`.
    fn with_rows(gpu: &Gpu, size: [u32; 2], rows: u32, of_texels: bool) -> Result<Self, GpuError> {
        let options = KernelOptions {
            constants: &[("OF_TEXELS", f64::from(u8::from(of_texels)))],
            ..KernelOptions::default()
        };
        let pixels = u64::from(size[0]) * u64::from(rows);
        let storage = |label, bytes| gpu.buffer(label, pixels * bytes, wgpu::BufferUsages::STORAGE);
        Ok(Self {
            kernel: Kernel::with_options(gpu, &shader!("denoise.filter"), "main", None, &options)?,
            size,
            rows,
            pixels: storage("denoise.pixels [bytes]", NOISY_BYTES)?,
            sums: storage("denoise.sums [bytes]", 16)?,
        })
    }

    /// Width and height of the picture (pixels).
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The windows that cover a picture.
    pub fn windows(&self) -> impl Iterator<Item = Window> + use<> {
        let ([_, height], rows) = (self.size, self.rows);
        let step = match rows >= height {
            true => height.max(1),
            false => rows - 2 * MARGIN,
        };
        (0..height).step_by(step as usize).map(move |first| {
            let end = (first + step).min(height);
            Window {
                read: first.saturating_sub(MARGIN)..(end + MARGIN).min(height),
                written: first..end,
            }
        })
    }

    /// Filters all of what `pixels` holds into `sums`.
    pub(super) fn record_all(&self, frame: &mut Frame<'_>) -> Result<(), GpuError> {
        let [_, height] = self.size;
        let window = Window {
            read: 0..height,
            written: 0..height,
        };
        self.record(frame, &window)
    }

    /// Filters the window that `pixels` holds into `sums`.
    pub(super) fn record(&self, frame: &mut Frame<'_>, window: &Window) -> Result<(), GpuError> {
        let (gpu, width) = (frame.gpu, self.size[0]);
        let height = window.read.end - window.read.start;
        for row in 0..=2 * RADIUS {
            let rows = Rows {
                size: [width, height],
                row,
                padding: 0,
            };
            let rows = gpu.constant("denoise.rows", &rows)?;
            let resources: [Named<'_>; 3] = [
                ("rows", &rows),
                ("pixels", &self.pixels),
                ("sums", &self.sums),
            ];
            frame.run(
                "denoise",
                &self.kernel,
                None,
                &resources,
                [width, height, 1],
            )?;
        }
        Ok(())
    }
}

/// Filters pictures of one size, guided by what pixels see.
#[derive(Debug)]
pub struct Denoiser {
    /// The filter.
    pub means: NonLocalMeans,
    finish: Kernel,
    /// Radiance of the rows that a window writes, four floats per pixel.
    pub filtered: wgpu::Buffer,
}

impl Denoiser {
    /// For pictures of `size` pixels.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`], [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        Self::by(gpu, NonLocalMeans::new(gpu, size)?)
    }

    /// As [`Denoiser::new`], in windows that write about `pixels` pixels.
    ///
    /// # Errors
    /// As [`Denoiser::new`].
    pub fn in_steps(gpu: &Gpu, size: [u32; 2], pixels: u32) -> Result<Self, GpuError> {
        Self::by(gpu, NonLocalMeans::in_steps(gpu, size, pixels)?)
    }

    /// As [`Denoiser::new`], in windows of no more than `rows` rows, which has to exceed `2 * MARGIN`.
    #[cfg(test)]
    pub(super) fn with_rows(gpu: &Gpu, size: [u32; 2], rows: u32) -> Result<Self, GpuError> {
        Self::by(gpu, NonLocalMeans::with_rows(gpu, size, rows, false)?)
    }

    fn by(gpu: &Gpu, means: NonLocalMeans) -> Result<Self, GpuError> {
        let bytes = u64::from(means.size[0]) * u64::from(means.rows) * 16;
        let storage = wgpu::BufferUsages::STORAGE;
        Ok(Self {
            finish: Kernel::new(gpu, &shader!("denoise.finish"), "main", None)?,
            filtered: gpu.buffer("denoise.filtered [bytes]", bytes, storage)?,
            means,
        })
    }

    /// Filters the window that `means` holds into [`Denoiser::filtered`]: pass `denoise`.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(&self, frame: &mut Frame<'_>, window: &Window) -> Result<(), GpuError> {
        self.means.record(frame, window)?;
        let (gpu, width) = (frame.gpu, self.means.size[0]);
        let written = window.written.end - window.written.start;
        let finish = Finish {
            first: window.written.start - window.read.start,
            rows: written,
            width,
            padding: 0,
        };
        let finish = gpu.constant("denoise.finish", &finish)?;
        let resources: [Named<'_>; 4] = [
            ("finish", &finish),
            ("pixels", &self.means.pixels),
            ("sums", &self.means.sums),
            ("filtered", &self.filtered),
        ];
        frame.run(
            "denoise",
            &self.finish,
            None,
            &resources,
            [width, written, 1],
        )
    }
}
