//! The image so far, with its noise filtered out.

use std::collections::VecDeque;

use bytemuck::{Pod, Zeroable};

use super::PathTracer;
use crate::denoise::{Denoiser, Window};
use crate::gpu::{Frame, GpuError, Kernel, KernelOptions, Named};
use crate::lighting::LightingError;
use crate::picture::Comparison;
use crate::shader;

/// `Window` of reference/noisy.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct WindowUniform {
    first: u32,
    rows: u32,
}

/// The filter over a path tracer's image, window by window.
#[derive(Debug)]
pub struct ImageFilter {
    kernel: Kernel,
    denoiser: Denoiser,
    /// Windows that are left.
    windows: VecDeque<Window>,
}

impl ImageFilter {
    fn new(tracer: &PathTracer, denoiser: Denoiser) -> Result<Self, GpuError> {
        let flag = f64::from(u8::from(tracer.photons.is_some()));
        let options = KernelOptions {
            constants: &[("HAS_LIGHT_TRACER", flag)],
            ..Default::default()
        };
        let shader = shader!("reference.noisy");
        Ok(Self {
            kernel: Kernel::with_options(&tracer.gpu, &shader, "main", None, &options)?,
            windows: denoiser.means.windows().collect(),
            denoiser,
        })
    }

    /// Filters a window of the tracer's image. Its rows are the first of `Denoiser::filtered` then.
    fn record(
        &self,
        frame: &mut Frame<'_>,
        tracer: &PathTracer,
        window: &Window,
    ) -> Result<(), GpuError> {
        let rows = WindowUniform {
            first: window.read.start,
            rows: window.read.end - window.read.start,
        };
        let rows = frame.gpu.constant("denoise.window", &rows)?;
        for tile in &tracer.tiles {
            let features = tile.features.as_ref().ok_or_else(|| GpuError::Input {
                what: "the path tracer keeps no features for the denoiser".into(),
            })?;
            let photons = tile
                .photons
                .as_ref()
                .map_or(&tile.film, |film| &film.pixels);
            let resources: [Named<'_>; 6] = [
                ("place", &tile.place),
                ("pixels", &tile.film),
                ("light_film", photons),
                ("features", features),
                ("window", &rows),
                ("target_pixels", &self.denoiser.means.pixels),
            ];
            let invocations = [tile.size[0], tile.size[1], 1];
            frame.compute("path-tracer.noisy", |pass| {
                self.kernel.run(pass, None, &resources, invocations)
            })?;
        }
        self.denoiser.record(frame, window)
    }

    /// Filters the next rows of the tracer's image so far into the reference of a comparison, without the host. Returns
    /// whether rows are left.
    ///
    /// # Errors
    /// [`LightingError::Gpu`]; [`GpuError::Input`] if features are not kept, or if the picture has another size.
    pub fn show_next(
        &mut self,
        tracer: &PathTracer,
        comparison: &Comparison,
    ) -> Result<bool, LightingError> {
        let size = self.denoiser.means.size();
        if [tracer.size, comparison.size()] != [size; 2] {
            return Err(LightingError::Gpu(GpuError::Input {
                what: "the picture to be filtered has another size".into(),
            }));
        }
        if let Some(window) = self.windows.pop_front() {
            let mut frame = Frame::new(&tracer.gpu, false);
            self.record(&mut frame, tracer, &window)?;
            let of_rows = |rows: u32| u64::from(rows) * u64::from(size[0]) * 16;
            let (first, rows) = (
                window.written.start,
                window.written.end - window.written.start,
            );
            let place = [of_rows(first), of_rows(rows)];
            frame.copy(&self.denoiser.filtered, comparison.reference(), place);
            frame.submit()?;
        }
        Ok(!self.windows.is_empty())
    }
}

impl PathTracer {
    /// Mean linear radiance as [`PathTracer::radiance`] gives it, filtered by its variance and by what the pixels see
    /// ([`crate::denoise`]). The fewer samples, the more the filter blurs; of many it changes next to nothing. It needs
    /// [`PathTracer::keep_features`], and two samples or more.
    ///
    /// # Errors
    /// [`LightingError::Gpu`]; [`GpuError::Input`] if features are not kept.
    pub fn denoised(&self) -> Result<Vec<f32>, LightingError> {
        let [width, height] = self.size;
        let mut filter = ImageFilter::new(self, Denoiser::new(&self.gpu, self.size)?)?;
        let mut radiance = Vec::with_capacity(3 * width as usize * height as usize);
        while let Some(window) = filter.windows.pop_front() {
            let mut frame = Frame::new(&self.gpu, false);
            filter.record(&mut frame, self, &window)?;
            let bytes =
                u64::from(window.written.end - window.written.start) * u64::from(width) * 16;
            let filtered = frame.read_back::<[f32; 4]>(&filter.denoiser.filtered, bytes)?;
            frame.submit()?;
            let filtered = filtered.wait()?.into_iter();
            radiance.extend(filtered.flat_map(|[r, g, b, _]| [r, g, b]));
        }
        Ok(radiance)
    }

    /// The filter of [`PathTracer::denoised`] in steps of about `pixels` pixels, for pictures that are shown while they are
    /// traced.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn filter_in_steps(&self, pixels: u32) -> Result<ImageFilter, GpuError> {
        ImageFilter::new(self, Denoiser::in_steps(&self.gpu, self.size, pixels)?)
    }
}
