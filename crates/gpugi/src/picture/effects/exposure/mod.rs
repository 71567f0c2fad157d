//! Exposure: a picture shows `2^EV` times its radiance. EV 0 maps radiance 1 to 1, and a higher EV is brighter. Automatic
//! exposure maps the log-average luminance to middle grey. The average comes from a histogram and leaves out its darkest
//! and brightest tenth. It may adapt over time, as the eye does. docs/effects/display.md has the equations.

#[cfg(test)]
mod tests;

use std::fmt;
use std::str::FromStr;

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

use super::Effects;
use super::vignette::VignetteUniform;
use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Kernel, Named};
use crate::picture::Optics;
use crate::settings::{Kind, SettingValue};
use crate::shader;

/// How bright a picture is shown: at `2^EV` times its radiance. Written as `auto` or as a number.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Exposure {
    /// This exposure value (EV). 0 maps radiance 1 to 1, and each step up doubles the brightness. Limited to -100..100.
    Manual(f32),
    /// The value that maps the picture's trimmed log-average luminance to middle grey, 0.18.
    #[default]
    Auto,
}

impl fmt::Display for Exposure {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Manual(value) => value.fmt(formatter),
            Self::Auto => formatter.pad("auto"),
        }
    }
}

/// Neither a number nor `auto`.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no exposure; give an exposure value such as -1.5, or auto")]
pub struct ParseError(String);

impl FromStr for Exposure {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        text.parse()
            .ok()
            .filter(|value: &f32| value.is_finite())
            .map(Self::Manual)
            .ok_or_else(|| ParseError(text.to_owned()))
    }
}

impl TryFrom<String> for Exposure {
    type Error = ParseError;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse()
    }
}

impl From<Exposure> for String {
    fn from(exposure: Exposure) -> Self {
        exposure.to_string()
    }
}

impl SettingValue for Exposure {
    const KIND: Kind = Kind::NumberOr("auto");
}

crate::settings! {
    /// Settings of the exposure.
    #[derive(Copy)]
    pub struct Settings {
        /// Exposure value (EV), such as -1.5, or auto: the picture is shown at 2^EV times its radiance.
        pub value: Exposure = Exposure::Auto => any().unit("EV"),
        /// Time in which automatic exposure follows the picture, in times of the eye: 0.1 s where it becomes brighter,
        /// 0.4 s where it becomes darker; 0: at once.
        pub adaptation: f32 = 0.0 => in_range(0.0, 100.0),
    }
}

/// Times after which the eye's cones and rods have adapted but for 1/e (s): where light becomes brighter, and where it
/// becomes darker. Durand, Dorsey, "Interactive Tone Mapping", 2000.
const ADAPTATION_SECONDS: [f32; 2] = [0.1, 0.4];

/// Time constants after which a step of 10 EV has come to 1/300 EV.
const SETTLED: f32 = 8.0;

impl Settings {
    /// Time after which what is shown of a picture at rest no longer changes (s).
    pub fn settling_seconds(&self) -> f32 {
        match self.value {
            Exposure::Manual(_) => 0.0,
            Exposure::Auto => SETTLED * ADAPTATION_SECONDS[1] * self.adaptation,
        }
    }

    /// Shares of the difference to the picture before that are left after so many seconds.
    fn left(&self, seconds: f32) -> [f32; 2] {
        if seconds > 0.0 && self.adaptation > 0.0 {
            ADAPTATION_SECONDS.map(|eye| (-seconds / (eye * self.adaptation)).exp())
        } else {
            [0.0; 2]
        }
    }
}

/// Size of the histogram (bytes): the pixel counts of 256 bins, and the sums of the pixels' positions within each bin.
const HISTOGRAM_BYTES: u64 = 256 * 2 * 4;

/// Pixels that one invocation of the histogram reads.
const PIXELS_PER_INVOCATION: u32 = 16;

/// `Picture` of average.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct PictureUniform {
    size: [u32; 2],
    /// Shares that are left, where the picture becomes brighter and where it becomes darker.
    left_to_bright: f32,
    left_to_dark: f32,
    vignette: VignetteUniform,
    is_new: u32,
    padding: [u32; 3],
}

/// The passes of automatic exposure, and the exposure of the last frame.
#[derive(Debug, Clone)]
pub(in crate::picture) struct Pass {
    histogram: Kernel,
    average: Kernel,
    bins: wgpu::Buffer,
    picture: HostBuffer,
    /// The exposure value (EV), and that of the picture before: two floats.
    pub value: wgpu::Buffer,
    memory: Memory,
}

/// What is known of earlier pictures.
#[derive(Debug, Clone, Copy, Default)]
struct Memory {
    /// Whether this picture is recorded, or any before it.
    is_any: bool,
    /// Whether there was a picture before this one.
    is_before: bool,
    /// Whether this picture is not recorded yet.
    is_new: bool,
}

impl Pass {
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let shader = shader!("picture.effects.exposure.average");
        let storage = |label, bytes| gpu.buffer(label, bytes, wgpu::BufferUsages::STORAGE);
        let (uniform, bytes) = (
            wgpu::BufferUsages::UNIFORM,
            size_of::<PictureUniform>() as u64,
        );
        Ok(Self {
            histogram: Kernel::new(gpu, &shader, "histogram", None)?,
            average: Kernel::new(gpu, &shader, "average", None)?,
            bins: storage("picture.histogram", HISTOGRAM_BYTES)?,
            picture: HostBuffer::new(gpu, "picture to expose", bytes, uniform)?,
            value: storage("picture.exposure", 2 * size_of::<f32>() as u64)?,
            memory: Memory::default(),
        })
    }

    /// Forgets earlier pictures: the next one is exposed for itself.
    pub fn forget(&mut self) {
        self.memory = Memory::default();
    }

    /// Begins another picture.
    pub fn advance(&mut self) {
        self.memory.is_new = self.memory.is_any;
        self.memory.is_before = self.memory.is_any;
    }

    /// Brings the exposure value up to date for a picture of `size` pixels by `camera`: passes `picture.exposure`, if it is
    /// automatic.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        radiance: &wgpu::TextureView,
        size: [u32; 2],
        camera: Optics,
        effects: &Effects,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let settings = &effects.exposure;
        if let Exposure::Manual(value) = settings.value {
            // What it shows, such as errors in colours, says nothing about the next picture.
            self.memory = Memory::default();
            let finite = if value.is_nan() {
                0.0
            } else {
                value.clamp(-100.0, 100.0)
            };
            gpu.write(&self.value, 0, &[finite]);
            return Ok(());
        }
        self.memory.is_any = true;
        let [left_to_bright, left_to_dark] = match self.memory.is_before {
            true => settings.left(camera.seconds),
            false => [0.0; 2],
        };
        let uniform = PictureUniform {
            size,
            left_to_bright,
            left_to_dark,
            vignette: VignetteUniform::new(&effects.vignette, size, camera),
            is_new: std::mem::take(&mut self.memory.is_new).into(),
            padding: [0; 3],
        };
        self.picture.write(gpu, &[uniform]);
        let resources: [Named<'_>; 4] = [
            ("radiance_unfilterable", radiance),
            ("picture", &self.picture),
            ("histogram_bins", &self.bins),
            ("exposure", &self.value),
        ];
        frame.clear(&self.bins);
        frame.compute("picture.exposure", |pass| {
            let invocations = (size[0] * size[1]).div_ceil(PIXELS_PER_INVOCATION);
            self.histogram
                .run(pass, None, &resources, [invocations, 1, 1])?;
            self.average.run(pass, None, &resources, [1, 1, 1])
        })
    }
}
