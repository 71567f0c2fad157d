//! The image so far, with its noise filtered out.

use bytemuck::{Pod, Zeroable};

use super::PathTracer;
use crate::denoise::Denoiser;
use crate::gpu::{Frame, GpuError, Kernel, KernelOptions, Named};
use crate::lighting::LightingError;
use crate::shader;

/// `Window` of reference/noisy.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct WindowUniform {
    first: u32,
    rows: u32,
}

impl PathTracer {
    /// Mean linear radiance as [`PathTracer::radiance`] gives it, filtered by its variance and by what the pixels see
    /// ([`crate::denoise`]). The fewer samples, the more the filter blurs; of many it changes next to nothing. It needs
    /// [`PathTracer::keep_features`], and two samples or more.
    ///
    /// # Errors
    /// [`LightingError::Gpu`]; [`GpuError::Input`] if features are not kept.
    pub fn denoised(&self) -> Result<Vec<f32>, LightingError> {
        let gpu = &self.gpu;
        let [width, height] = self.size;
        let denoiser = Denoiser::new(gpu, self.size)?;
        let flag = f64::from(u8::from(self.photons.is_some()));
        let options = KernelOptions {
            constants: &[("HAS_LIGHT_TRACER", flag)],
            ..Default::default()
        };
        let kernel =
            Kernel::with_options(gpu, &shader!("reference.noisy"), "main", None, &options)?;
        let mut radiance = Vec::with_capacity(3 * width as usize * height as usize);
        for window in denoiser.means.windows() {
            let mut frame = Frame::new(gpu, false);
            let rows = WindowUniform {
                first: window.read.start,
                rows: window.read.end - window.read.start,
            };
            let rows = gpu.constant("denoise.window", &rows)?;
            for tile in &self.tiles {
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
                    ("target_pixels", &denoiser.means.pixels),
                ];
                let invocations = [tile.size[0], tile.size[1], 1];
                frame.compute("path-tracer.noisy", |pass| {
                    kernel.run(pass, None, &resources, invocations)
                })?;
            }
            denoiser.record(&mut frame, &window)?;
            let bytes =
                u64::from(window.written.end - window.written.start) * u64::from(width) * 16;
            let filtered = frame.read_back::<[f32; 4]>(&denoiser.filtered, bytes)?;
            frame.submit()?;
            radiance.extend(
                filtered
                    .wait()?
                    .into_iter()
                    .flat_map(|[r, g, b, _]| [r, g, b]),
            );
        }
        Ok(radiance)
    }
}
