//! A picture is lit in strips where its points exceed a buffer.

use std::ops::Range;

use crate::capture::{Capture, Receiver, SURFACE_POINT_BYTES, Target, noisy};
use crate::denoise::OfPoints;
use crate::gpu::{Frame, Gpu, GpuError};
use crate::lighting::Lighting;
use crate::picture::Strip;

/// As many rows of the picture as fit one buffer of surface points.
#[derive(Debug)]
pub(super) struct LitStrip {
    pub rows: Range<u32>,
    pub capture: Capture,
    pub receiver: Receiver,
    /// Samples that its radiance sums.
    pub samples: u32,
    /// What its pixels see of surfaces, if that is kept.
    pub features: Option<wgpu::Buffer>,
}

impl LitStrip {
    /// Lets techniques tell which part of their light is noisy, if that is wanted. `begins`: of a picture that begins.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn expect_noise(
        &mut self,
        frame: &mut Frame<'_>,
        is_wanted: bool,
        begins: bool,
    ) -> Result<(), GpuError> {
        let Receiver { points, target, .. } = &mut self.receiver;
        if is_wanted && !target.is_noisy() {
            target.noisy = noisy(frame.gpu, points.count)?;
        } else if begins && target.is_noisy() {
            frame.clear(&target.noisy);
        }
        Ok(())
    }

    pub fn strip(&self) -> Strip<'_> {
        Strip {
            receiver: &self.receiver,
            rows: self.rows.clone(),
            samples: self.samples,
        }
    }
}

/// The fewest strips of whole rows whose points and radiance fit the adapter's buffers, of no more than `most_points`
/// pixels each.
pub(super) fn strips(
    gpu: &Gpu,
    lighting: &Lighting,
    size: [u32; 2],
    most_points: u32,
) -> Result<Vec<LitStrip>, GpuError> {
    let limits = gpu.limits();
    let bytes = limits
        .max_buffer_size
        .min(limits.max_storage_buffer_binding_size);
    let most_points = (bytes / SURFACE_POINT_BYTES).min(u64::from(most_points));
    let most_rows =
        (most_points / u64::from(size[0].max(1))).min(u64::from(limits.max_texture_dimension_2d));
    // A row at least: if that is too large, its buffer says so.
    let count = u64::from(size[1]).div_ceil(most_rows.max(1)).max(1) as u32;
    let kernels = lighting.capture_kernels();
    (0..count)
        .map(|index| {
            let row =
                |index: u32| (u64::from(size[1]) * u64::from(index) / u64::from(count)) as u32;
            let rows = row(index)..row(index + 1);
            let capture = Capture::of_camera(gpu, kernels, [size[0], rows.end - rows.start])?;
            let target = Target::of_pixels(gpu, capture.points.count)?;
            Ok(LitStrip {
                receiver: Receiver::new(&capture.points, &target),
                samples: 0,
                features: None,
                capture,
                rows,
            })
        })
        .collect()
}

/// Keeps what the pixels of `strips` see of surfaces.
pub(super) fn keep_features(gpu: &Gpu, strips: &mut [LitStrip]) -> Result<(), GpuError> {
    for strip in strips {
        strip.features = Some(OfPoints::film(gpu, strip.receiver.points.count)?);
    }
    Ok(())
}
