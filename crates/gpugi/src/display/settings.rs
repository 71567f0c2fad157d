//! User settings of the display.

use std::fmt;
use std::str::FromStr;

/// Operator that maps exposed radiance (0 and up) to display values from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum ToneMap {
    /// No operator: values above 1 are clipped.
    None,
    /// Reinhard 2002 on luminance, with a white point.
    Reinhard,
    /// The film industry's ACES, as fitted by Stephen Hill: high contrast, strong highlights.
    Aces,
    /// AgX by Troy Sobotka: soft; bright colours fade towards white.
    AgX,
    /// Khronos PBR Neutral. This is the default because base colours appear as the scene's author chose them and as
    /// other glTF viewers show them; only highlights are compressed.
    #[default]
    Neutral,
}

impl ToneMap {
    /// All operators.
    pub const ALL: [Self; 5] = [
        Self::None,
        Self::Reinhard,
        Self::Aces,
        Self::AgX,
        Self::Neutral,
    ];

    /// The operator's name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Reinhard => "reinhard",
            Self::Aces => "aces",
            Self::AgX => "agx",
            Self::Neutral => "neutral",
        }
    }
}

impl fmt::Display for ToneMap {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.pad(self.name())
    }
}

impl FromStr for ToneMap {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|operator| operator.name() == text)
            .ok_or_else(|| ParseError::ToneMap(text.to_owned()))
    }
}

/// How bright an image is shown: at `2^EV` times its radiance.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Exposure {
    /// This exposure value (EV). 0 maps radiance 1 to 1, and each step up doubles the brightness. Limited to -100..100.
    Manual(f32),
    /// The value that maps the image's trimmed log-average luminance to middle grey, 0.18.
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
            .ok_or_else(|| ParseError::Exposure(text.to_owned()))
    }
}

/// An invalid display setting.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ParseError {
    /// No tone map has this name.
    #[error("no tone map is named {0:?}; there are none, reinhard, aces, agx and neutral")]
    ToneMap(String),
    /// Neither a number nor `auto`.
    #[error("{0:?} is no exposure; give an exposure value such as -1.5, or auto")]
    Exposure(String),
}

/// User settings of the display.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DisplaySettings {
    /// Exposure. Default: automatic.
    pub exposure: Exposure,
    /// Tone map. Default: neutral.
    pub tone_map: ToneMap,
    /// Exposed luminance that [`ToneMap::Reinhard`] maps to 1; the other operators ignore it. Default: 4.
    pub white_point: f32,
    /// Whether to hide the steps between 8-bit values with noise of at most one step. Default: yes.
    pub dither: bool,
    /// Seed of the dither. The same seed produces the same noise.
    pub seed: u32,
}

impl Default for DisplaySettings {
    fn default() -> Self {
        Self {
            exposure: Exposure::default(),
            tone_map: ToneMap::default(),
            white_point: 4.0,
            dither: true,
            seed: 0,
        }
    }
}
