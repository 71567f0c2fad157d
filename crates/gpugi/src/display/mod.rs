//! The last step of a frame: summed radiance, exposed, tone-mapped and encoded as sRGB, 8 bits a channel.
//!
//! Exposure multiplies: a pixel shows `2^EV` times its radiance, so EV 0 maps radiance 1 to 1 and a higher EV is
//! brighter. Automatic exposure takes the log-average luminance of a histogram, its darkest and brightest tenth left
//! out, to middle grey. `docs/techniques/display.md` has the equations and the operators' curves.

mod settings;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod twin;

pub use settings::{DisplaySettings, Exposure, ParseError, ToneMap};

use crate::gpu::{Frame, Gpu, GpuError, Kernel, read_buffer};
use crate::shader;
use std::sync::{Mutex, PoisonError};

/// Bytes of the histogram: pixels of each of 256 bins, and sums of their places within the bin.
const HISTOGRAM_BYTES: u64 = 256 * 2 * 4;

/// Pixels that [`Display::picture`] handles at once: 64 MiB of radiance.
const PART_PIXELS: u32 = 1 << 22;

/// Pixels that one invocation of the histogram reads.
const PIXELS_PER_INVOCATION: u32 = 16;

/// `Parameters` of `picture.wesl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Parameters {
    pixel_count: u32,
    scale: f32,
    tone_map: u32,
    white_point: f32,
    seed: u32,
    dither: u32,
}

/// Turns radiance into pixels. One instance serves pictures of one size, once a frame.
#[derive(Debug)]
pub struct Display {
    pixel_count: u32,
    histogram: Kernel,
    average: Kernel,
    encode: Kernel,
    parameters: wgpu::Buffer,
    histogram_bins: wgpu::Buffer,
    exposure: wgpu::Buffer,
    pixels: wgpu::Buffer,
    exposure_group: wgpu::BindGroup,
    encode_group: wgpu::BindGroup,
    radiance: Mutex<Option<Radiance>>,
}

/// The buffer that was displayed last, bound for both passes.
#[derive(Debug, Clone)]
struct Radiance {
    buffer: wgpu::Buffer,
    exposure_group: wgpu::BindGroup,
    encode_group: wgpu::BindGroup,
}

impl Display {
    /// A display for pictures of `size` pixels: width, height.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the adapter cannot hold that many, [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let bytes = u64::from(size[0]) * u64::from(size[1]) * 4;
        let pixels = gpu.buffer("display.pixels", bytes, wgpu::BufferUsages::STORAGE)?;
        let pixel_count = size[0] * size[1];

        let exposure_shader = shader!("display.exposure");
        let histogram = Kernel::new(gpu, &exposure_shader, "histogram", None)?;
        let average = Kernel::new(gpu, &exposure_shader, "average", None)?;
        let encode = Kernel::new(gpu, &shader!("display.encode"), "encode", None)?;

        let storage = |label, bytes| gpu.buffer(label, bytes, wgpu::BufferUsages::STORAGE);
        let parameters = gpu.buffer(
            "display.parameters",
            size_of::<Parameters>() as u64,
            wgpu::BufferUsages::UNIFORM,
        )?;
        let histogram_bins = storage("display.histogram", HISTOGRAM_BYTES)?;
        let exposure = storage("display.exposure", size_of::<f32>() as u64)?;

        let exposure_group = histogram.bind(
            gpu,
            3,
            &[
                ("parameters", parameters.as_entire_binding()),
                ("histogram_bins", histogram_bins.as_entire_binding()),
                ("exposure", exposure.as_entire_binding()),
            ],
        )?;
        let encode_group = encode.bind(
            gpu,
            3,
            &[
                ("parameters", parameters.as_entire_binding()),
                ("exposure", exposure.as_entire_binding()),
                ("pixels", pixels.as_entire_binding()),
            ],
        )?;
        Ok(Self {
            pixel_count,
            histogram,
            average,
            encode,
            parameters,
            histogram_bins,
            exposure,
            pixels,
            exposure_group,
            encode_group,
            radiance: Mutex::new(None),
        })
    }

    /// Records the passes `display.exposure` (automatic exposure only) and `display.encode`.
    ///
    /// `radiance` holds a `vec4f` a pixel, row by row from the top: linear Rec. 709 radiance summed over `samples`
    /// samples; the fourth component is ignored. Negative radiance shows as 0, infinite as white, not-a-number as black.
    /// At most one recording a frame, because the settings reach the GPU when the frame is submitted.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when `radiance` is smaller than the picture or is no storage buffer.
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        radiance: &wgpu::Buffer,
        samples: u32,
        settings: &DisplaySettings,
    ) -> Result<(), GpuError> {
        let radiance = self.bound(frame.gpu, radiance)?;
        self.set_parameters(frame.gpu, self.pixel_count, samples, settings);
        match settings.exposure {
            Exposure::Manual(value) => self.set_exposure(frame.gpu, value),
            Exposure::Auto => {
                frame.clear(&self.histogram_bins);
                frame.compute("display.exposure", |pass| {
                    self.count(pass, &radiance, self.pixel_count);
                    self.average(pass, &radiance);
                });
            }
        }
        frame.compute("display.encode", |pass| {
            self.encode(pass, &radiance, self.pixel_count);
        });
        Ok(())
    }

    /// Pixels, as [`Display::pixels`] gives them, of a picture of any size that lies on the host: three floats of mean radiance a pixel.
    /// What is too large for one buffer passes through the GPU in parts.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::Lost`].
    pub fn picture(
        gpu: &Gpu,
        radiance: &[f32],
        settings: &DisplaySettings,
    ) -> Result<Vec<u8>, GpuError> {
        Self::picture_in_parts(gpu, radiance, settings, PART_PIXELS)
    }

    fn picture_in_parts(
        gpu: &Gpu,
        radiance: &[f32],
        settings: &DisplaySettings,
        part_pixels: u32,
    ) -> Result<Vec<u8>, GpuError> {
        let parts = radiance.chunks((part_pixels * 3) as usize);
        let largest = radiance.len().min((part_pixels * 3) as usize) as u32 / 3;
        let display = Self::new(gpu, [largest, 1])?;
        let buffer = gpu.buffer(
            "display.radiance [bytes]",
            u64::from(largest) * 16,
            wgpu::BufferUsages::STORAGE,
        )?;
        let bound = display.bound(gpu, &buffer)?;
        let upload = |part: &[f32], seed: u32| {
            let padded: Vec<[f32; 4]> = part
                .chunks_exact(3)
                .map(|pixel| [pixel[0], pixel[1], pixel[2], 1.0])
                .collect();
            gpu.queue
                .write_buffer(&buffer, 0, bytemuck::cast_slice(&padded));
            let part_settings = DisplaySettings { seed, ..*settings };
            let count = padded.len() as u32;
            display.set_parameters(gpu, count, 1, &part_settings);
            count
        };
        match settings.exposure {
            Exposure::Manual(value) => display.set_exposure(gpu, value),
            Exposure::Auto => {
                for part in parts.clone() {
                    let count = upload(part, settings.seed);
                    let mut frame = Frame::new(gpu, false);
                    frame.compute("display.exposure", |pass| {
                        display.count(pass, &bound, count)
                    });
                    frame.submit()?;
                }
                let mut frame = Frame::new(gpu, false);
                frame.compute("display.exposure", |pass| display.average(pass, &bound));
                frame.submit()?;
            }
        }
        let mut pixels = Vec::with_capacity(radiance.len() / 3 * 4);
        for (part, seed) in parts.zip(settings.seed..) {
            let count = upload(part, seed);
            let mut frame = Frame::new(gpu, false);
            frame.compute("display.encode", |pass| display.encode(pass, &bound, count));
            frame.submit()?;
            pixels.extend(read_buffer::<u8>(
                gpu,
                &display.pixels,
                u64::from(count) * 4,
            )?);
        }
        Ok(pixels)
    }

    fn set_parameters(&self, gpu: &Gpu, count: u32, samples: u32, settings: &DisplaySettings) {
        let parameters = Parameters {
            pixel_count: count,
            scale: 1.0 / samples.max(1) as f32,
            tone_map: settings.tone_map as u32,
            white_point: settings.white_point.max(1e-3),
            seed: settings.seed,
            dither: settings.dither.into(),
        };
        gpu.queue
            .write_buffer(&self.parameters, 0, bytemuck::bytes_of(&parameters));
    }

    fn set_exposure(&self, gpu: &Gpu, value: f32) {
        let finite = if value.is_nan() {
            0.0
        } else {
            value.clamp(-100.0, 100.0)
        };
        gpu.queue
            .write_buffer(&self.exposure, 0, bytemuck::bytes_of(&finite));
    }

    /// Adds pixels to the histogram.
    fn count(&self, pass: &mut wgpu::ComputePass<'_>, radiance: &Radiance, count: u32) {
        let groups = [(1, &radiance.exposure_group), (3, &self.exposure_group)];
        let invocations = count.div_ceil(PIXELS_PER_INVOCATION);
        self.histogram.dispatch(pass, &groups, [invocations, 1, 1]);
    }

    /// Turns the histogram into the exposure.
    fn average(&self, pass: &mut wgpu::ComputePass<'_>, radiance: &Radiance) {
        let groups = [(1, &radiance.exposure_group), (3, &self.exposure_group)];
        self.average.dispatch(pass, &groups, [1, 1, 1]);
    }

    fn encode(&self, pass: &mut wgpu::ComputePass<'_>, radiance: &Radiance, count: u32) {
        let groups = [(1, &radiance.encode_group), (3, &self.encode_group)];
        self.encode.dispatch(pass, &groups, [count, 1, 1]);
    }

    /// The pixels of the last submitted frame: RGBA, 8 bits a channel, sRGB-encoded, alpha 255, row by row from the top.
    ///
    /// # Errors
    /// As [`read_buffer`].
    pub fn pixels(&self, gpu: &Gpu) -> Result<Vec<u8>, GpuError> {
        read_buffer(gpu, &self.pixels, u64::from(self.pixel_count) * 4)
    }

    /// The exposure value (EV) of the last submitted frame: what was asked for, or what automatic exposure found.
    ///
    /// # Errors
    /// As [`read_buffer`].
    pub fn exposure_value(&self, gpu: &Gpu) -> Result<f32, GpuError> {
        let value: Vec<f32> = read_buffer(gpu, &self.exposure, size_of::<f32>() as u64)?;
        Ok(value[0])
    }

    /// The bind groups of `buffer`: those of the last frame when it is the same.
    fn bound(&self, gpu: &Gpu, buffer: &wgpu::Buffer) -> Result<Radiance, GpuError> {
        let mut last = self.radiance.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(bound) = last.as_ref().filter(|bound| bound.buffer == *buffer) {
            return Ok(bound.clone());
        }
        let needed = u64::from(self.pixel_count) * 16;
        if buffer.size() < needed {
            return Err(GpuError::Pass {
                pass: "display.encode".into(),
                reason: format!(
                    "the radiance has {} bytes, {needed} are needed",
                    buffer.size()
                ),
            });
        }
        let resources = [("radiance", buffer.as_entire_binding())];
        let bound = Radiance {
            buffer: buffer.clone(),
            exposure_group: self.histogram.bind(gpu, 1, &resources)?,
            encode_group: self.encode.bind(gpu, 1, &resources)?,
        };
        Ok(last.insert(bound).clone())
    }
}
