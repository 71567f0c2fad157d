//! The filter, over windows of a picture's rows that fit a buffer.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named};
use crate::shader;

/// A pixel to be filtered: `Noisy` of denoise/noisy.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(super) struct Noisy {
    pub light: [f32; 3],
    pub depth: f32,
    pub variance: [f32; 3],
    pub normal: u32,
    pub albedo: [f32; 3],
    pub padding: u32,
}

const NOISY_BYTES: u64 = size_of::<Noisy>() as u64;
/// `RADIUS` of filter.wesl.
const RADIUS: u32 = 7;
/// Rows beyond those that are written on which these depend: `RADIUS` and `PATCH`.
const MARGIN: u32 = 9;

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

/// Filters pictures of one size: non-local means, guided by what pixels see (denoise/filter.wesl).
#[derive(Debug)]
pub struct Denoiser {
    filter: Kernel,
    finish: Kernel,
    size: [u32; 2],
    /// Most rows of a window.
    rows: u32,
    /// The window's pixels: `Noisy`.
    pub pixels: wgpu::Buffer,
    sums: wgpu::Buffer,
    /// Radiance of the rows that a window writes, four floats per pixel.
    pub filtered: wgpu::Buffer,
}

impl Denoiser {
    /// For pictures of `size` pixels.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`], [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let limits = gpu.limits();
        let largest = limits
            .max_buffer_size
            .min(limits.max_storage_buffer_binding_size);
        let most = largest / (u64::from(size[0].max(1)) * NOISY_BYTES);
        // One row at least is written; if its window is too large, its buffer says so.
        let rows = u64::from(size[1]).min(most).max(u64::from(2 * MARGIN + 1));
        Self::with_rows(gpu, size, rows as u32)
    }

    /// As [`Denoiser::new`], in windows of no more than `rows` rows, which has to exceed `2 * MARGIN`.
    pub(super) fn with_rows(gpu: &Gpu, size: [u32; 2], rows: u32) -> Result<Self, GpuError> {
        let kernel = |shader| Kernel::new(gpu, &shader, "main", None);
        let pixels = u64::from(size[0]) * u64::from(rows);
        let storage = |label, bytes| gpu.buffer(label, pixels * bytes, wgpu::BufferUsages::STORAGE);
        Ok(Self {
            filter: kernel(shader!("denoise.filter"))?,
            finish: kernel(shader!("denoise.finish"))?,
            size,
            rows,
            pixels: storage("denoise.pixels [bytes]", NOISY_BYTES)?,
            sums: storage("denoise.sums [bytes]", 16)?,
            filtered: storage("denoise.filtered [bytes]", 16)?,
        })
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

    /// Filters the window that [`Denoiser::pixels`] holds into [`Denoiser::filtered`]: pass `denoise`.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(&self, frame: &mut Frame<'_>, window: &Window) -> Result<(), GpuError> {
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
            frame.compute("denoise", |pass| {
                self.filter.run(pass, None, &resources, [width, height, 1])
            })?;
        }
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
            ("pixels", &self.pixels),
            ("sums", &self.sums),
            ("filtered", &self.filtered),
        ];
        frame.compute("denoise", |pass| {
            self.finish.run(pass, None, &resources, [width, written, 1])
        })
    }
}
