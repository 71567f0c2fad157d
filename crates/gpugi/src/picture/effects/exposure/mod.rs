//! Exposure: a picture shows `2^EV` times its radiance. EV 0 maps radiance 1 to 1, and a higher EV is brighter. Automatic
//! exposure maps the log-average luminance to middle grey. The average comes from a histogram and leaves out its darkest
//! and brightest tenth. docs/effects/display.md has the equations.

use std::fmt;
use std::str::FromStr;

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Kernel, Named};
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
}

/// The passes of automatic exposure, and the exposure of the last frame.
#[derive(Debug, Clone)]
pub(in crate::picture) struct Pass {
    histogram: Kernel,
    average: Kernel,
    bins: wgpu::Buffer,
    picture: HostBuffer,
    /// The exposure value (EV): one float.
    pub value: wgpu::Buffer,
}

impl Pass {
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let shader = shader!("picture.effects.exposure.average");
        let storage = |label, bytes| gpu.buffer(label, bytes, wgpu::BufferUsages::STORAGE);
        let uniform = wgpu::BufferUsages::UNIFORM;
        Ok(Self {
            histogram: Kernel::new(gpu, &shader, "histogram", None)?,
            average: Kernel::new(gpu, &shader, "average", None)?,
            bins: storage("picture.histogram", HISTOGRAM_BYTES)?,
            picture: HostBuffer::new(gpu, "picture to expose", 8, uniform)?,
            value: storage("picture.exposure", size_of::<f32>() as u64)?,
        })
    }

    /// Brings the exposure value up to date for a picture of `size` pixels: passes `picture.exposure`, if it is automatic.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        radiance: &wgpu::TextureView,
        size: [u32; 2],
        settings: &Settings,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        if let Exposure::Manual(value) = settings.value {
            let finite = if value.is_nan() {
                0.0
            } else {
                value.clamp(-100.0, 100.0)
            };
            gpu.write(&self.value, 0, &[finite]);
            return Ok(());
        }
        self.picture.write(gpu, &[PictureUniform { size }]);
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
