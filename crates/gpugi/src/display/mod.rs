//! The last step of a frame: converts summed radiance to 8-bit sRGB by exposure, tone mapping and encoding.
//!
//! Exposure multiplies: a pixel shows `2^EV` times its radiance. EV 0 maps radiance 1 to 1, and a higher EV is
//! brighter. Automatic exposure maps the log-average luminance to middle grey. The average comes from a histogram and
//! leaves out its darkest and brightest tenth. `docs/techniques/display.md` has the equations and the operators'
//! curves.

mod comparison;
mod present;
mod settings;
mod surfaces;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod twin;

pub use comparison::{Compared, Comparison};
pub use present::Present;
pub use settings::{DisplaySettings, Exposure, ParseError, ToneMap};
pub use surfaces::{Quantity, Surfaces};

use crate::gpu::{
    Frame, Gpu, GpuError, HostBuffer, Kernel, ReadBack, begin_read_buffer, read_buffer,
};
use crate::shader;
use std::sync::{Mutex, PoisonError};

/// Size of the histogram (bytes): the pixel counts of 256 bins, and the sums of the pixels' positions within each bin.
const HISTOGRAM_BYTES: u64 = 256 * 2 * 4;

/// Pixels that [`Display::picture`] processes at once; their radiance takes 64 MiB.
const PART_PIXELS: u32 = 1 << 22;

/// Maximum number of parts whose bind groups are kept.
const MOST_PARTS: usize = 64;

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
    first_pixel: u32,
}

/// A part of an image: summed radiance of consecutive pixels, one `vec4f` each (linear Rec. 709; the fourth component
/// is ignored).
#[derive(Debug, Clone)]
pub struct Part {
    /// The sums.
    pub radiance: wgpu::Buffer,
    /// Number of pixels.
    pub pixels: u32,
}

/// Converts radiance to pixels. One instance serves images of one size, once per frame.
#[derive(Debug)]
pub struct Display {
    pixel_count: u32,
    histogram: Kernel,
    average: Kernel,
    encode: Kernel,
    histogram_bins: wgpu::Buffer,
    exposure: wgpu::Buffer,
    pixels: wgpu::Buffer,
    parts: Mutex<Vec<BoundPart>>,
}

/// Four bytes per pixel.
fn pixels(gpu: &Gpu, size: [u32; 2]) -> Result<wgpu::Buffer, GpuError> {
    let bytes = u64::from(size[0]) * u64::from(size[1]) * 4;
    gpu.buffer("display.pixels", bytes, wgpu::BufferUsages::STORAGE)
}

/// A part that was displayed, with its parameters and the bind groups 1 and 3 of both passes.
#[derive(Debug, Clone)]
struct BoundPart {
    radiance: wgpu::Buffer,
    parameters: HostBuffer,
    exposure_groups: [wgpu::BindGroup; 2],
    encode_groups: [wgpu::BindGroup; 2],
}

impl Display {
    /// A display for images of `size` pixels (width, height).
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the adapter cannot hold that many, [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let storage = |label, bytes| gpu.buffer(label, bytes, wgpu::BufferUsages::STORAGE);
        let exposure_shader = shader!("display.exposure");
        Ok(Self {
            pixel_count: size[0] * size[1],
            pixels: pixels(gpu, size)?,
            histogram: Kernel::new(gpu, &exposure_shader, "histogram", None)?,
            average: Kernel::new(gpu, &exposure_shader, "average", None)?,
            encode: Kernel::new(gpu, &shader!("display.encode"), "encode", None)?,
            histogram_bins: storage("display.histogram", HISTOGRAM_BYTES)?,
            exposure: storage("display.exposure", size_of::<f32>() as u64)?,
            parts: Mutex::default(),
        })
    }

    /// The same display for images of another size; it compiles nothing.
    ///
    /// # Errors
    /// As [`Display::new`].
    pub fn resized(&self, gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        Ok(Self {
            pixel_count: size[0] * size[1],
            pixels: pixels(gpu, size)?,
            histogram: self.histogram.clone(),
            average: self.average.clone(),
            encode: self.encode.clone(),
            histogram_bins: self.histogram_bins.clone(),
            exposure: self.exposure.clone(),
            parts: Mutex::default(),
        })
    }

    /// Records the passes `display.exposure` (automatic exposure only) and `display.encode`.
    ///
    /// `parts` follow each other in the image, row by row from the top; their radiance is summed over `samples`
    /// samples. Negative radiance shows as 0, infinite radiance as white, NaN as black. Record at most once per frame,
    /// because the settings reach the GPU when the frame is submitted.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when the parts have fewer pixels than the image, or when a buffer is too small or is not a
    /// storage buffer.
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        parts: &[Part],
        samples: u32,
        settings: &DisplaySettings,
    ) -> Result<(), GpuError> {
        let all: u32 = parts.iter().map(|part| part.pixels).sum();
        if all != self.pixel_count {
            return Err(mismatch(format!(
                "the parts have {all} pixels, the image has {}",
                self.pixel_count
            )));
        }
        let mut first_pixel = 0;
        let mut bound = Vec::new();
        for part in parts {
            let one = self.bound(frame.gpu, part)?;
            one.set_parameters(frame.gpu, first_pixel, part.pixels, samples, settings);
            first_pixel += part.pixels;
            bound.push((one, part.pixels));
        }
        match settings.exposure {
            Exposure::Manual(value) => self.set_exposure(frame.gpu, value),
            Exposure::Auto => {
                frame.clear(&self.histogram_bins);
                frame.compute("display.exposure", |pass| {
                    for (part, pixels) in &bound {
                        self.count(pass, part, *pixels);
                    }
                    if let Some((part, _)) = bound.first() {
                        self.average(pass, part);
                    }
                });
            }
        }
        frame.compute("display.encode", |pass| {
            for (part, pixels) in &bound {
                self.encode(pass, part, *pixels);
            }
        });
        Ok(())
    }

    /// Converts an image of any size on the host, given as three floats of mean radiance per pixel. The pixels have the
    /// format of [`Display::pixels`]. An image too large for one buffer passes through the GPU in parts.
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
        let bound = display.bound(
            gpu,
            &Part {
                radiance: buffer.clone(),
                pixels: largest,
            },
        )?;
        let upload = |part: &[f32], seed: u32| {
            let padded: Vec<[f32; 4]> = part
                .chunks_exact(3)
                .map(|pixel| [pixel[0], pixel[1], pixel[2], 1.0])
                .collect();
            gpu.write(&buffer, 0, &padded);
            let part_settings = DisplaySettings { seed, ..*settings };
            let count = padded.len() as u32;
            bound.set_parameters(gpu, 0, count, 1, &part_settings);
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

    fn set_exposure(&self, gpu: &Gpu, value: f32) {
        let finite = if value.is_nan() {
            0.0
        } else {
            value.clamp(-100.0, 100.0)
        };
        gpu.write(&self.exposure, 0, std::slice::from_ref(&finite));
    }

    /// Adds pixels to the histogram.
    fn count(&self, pass: &mut wgpu::ComputePass<'_>, part: &BoundPart, count: u32) {
        let [radiance, own] = &part.exposure_groups;
        let invocations = count.div_ceil(PIXELS_PER_INVOCATION);
        self.histogram
            .dispatch(pass, &[(1, radiance), (3, own)], [invocations, 1, 1]);
    }

    /// Turns the histogram into the exposure.
    fn average(&self, pass: &mut wgpu::ComputePass<'_>, part: &BoundPart) {
        let [radiance, own] = &part.exposure_groups;
        self.average
            .dispatch(pass, &[(1, radiance), (3, own)], [1, 1, 1]);
    }

    fn encode(&self, pass: &mut wgpu::ComputePass<'_>, part: &BoundPart, count: u32) {
        let [radiance, own] = &part.encode_groups;
        self.encode
            .dispatch(pass, &[(1, radiance), (3, own)], [count, 1, 1]);
    }

    /// The pixels of the last submitted frame: RGBA, 8 bits per channel, sRGB-encoded, alpha 255, in rows from top to
    /// bottom.
    ///
    /// # Errors
    /// The errors of [`read_buffer`].
    pub fn pixels(&self, gpu: &Gpu) -> Result<Vec<u8>, GpuError> {
        self.begin_pixels(gpu)?.wait()
    }

    /// The future of [`Display::pixels`].
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn begin_pixels(&self, gpu: &Gpu) -> Result<ReadBack<Vec<u8>>, GpuError> {
        begin_read_buffer(gpu, &self.pixels, u64::from(self.pixel_count) * 4)
    }

    /// The exposure value (EV) of the last submitted frame: the manual value, or the result of automatic exposure.
    ///
    /// # Errors
    /// The errors of [`read_buffer`].
    pub fn exposure_value(&self, gpu: &Gpu) -> Result<f32, GpuError> {
        let value: Vec<f32> = read_buffer(gpu, &self.exposure, size_of::<f32>() as u64)?;
        Ok(value[0])
    }

    /// The cached bind groups of the part, or new ones.
    fn bound(&self, gpu: &Gpu, part: &Part) -> Result<BoundPart, GpuError> {
        let mut parts = self.parts.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(bound) = parts.iter().find(|bound| bound.radiance == part.radiance) {
            return Ok(bound.clone());
        }
        let needed = u64::from(part.pixels) * 16;
        if part.radiance.size() < needed {
            let has = part.radiance.size();
            return Err(mismatch(format!(
                "the radiance has {has} bytes, {needed} are needed"
            )));
        }
        let bytes = size_of::<Parameters>() as u64;
        let usage = wgpu::BufferUsages::UNIFORM;
        let parameters = HostBuffer::new(gpu, "display.parameters", bytes, usage)?;
        let radiance = [("radiance", part.radiance.as_entire_binding())];
        let of_exposure = [
            ("parameters", parameters.as_entire_binding()),
            ("histogram_bins", self.histogram_bins.as_entire_binding()),
            ("exposure", self.exposure.as_entire_binding()),
        ];
        let of_encode = [
            ("parameters", parameters.as_entire_binding()),
            ("exposure", self.exposure.as_entire_binding()),
            ("pixels", self.pixels.as_entire_binding()),
        ];
        let bound = BoundPart {
            exposure_groups: [
                self.histogram.bind(gpu, 1, &radiance)?,
                self.histogram.bind(gpu, 3, &of_exposure)?,
            ],
            encode_groups: [
                self.encode.bind(gpu, 1, &radiance)?,
                self.encode.bind(gpu, 3, &of_encode)?,
            ],
            radiance: part.radiance.clone(),
            parameters,
        };
        if parts.len() >= MOST_PARTS {
            parts.remove(0);
        }
        parts.push(bound.clone());
        Ok(bound)
    }
}

impl BoundPart {
    fn set_parameters(
        &self,
        gpu: &Gpu,
        first_pixel: u32,
        count: u32,
        samples: u32,
        settings: &DisplaySettings,
    ) {
        let parameters = Parameters {
            pixel_count: count,
            scale: 1.0 / samples.max(1) as f32,
            tone_map: settings.tone_map as u32,
            white_point: settings.white_point.max(1e-3),
            seed: settings.seed,
            dither: settings.dither.into(),
            first_pixel,
        };
        self.parameters
            .write(gpu, std::slice::from_ref(&parameters));
    }
}

fn mismatch(reason: String) -> GpuError {
    GpuError::Pass {
        pass: "display".into(),
        reason,
    }
}
