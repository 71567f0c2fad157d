//! Tone mapping: maps exposed radiance (0 and up) to display values from 0 to 1. The pass `picture.encode` applies it.
//! docs/effects/display.md has the operators' curves.

#[cfg(test)]
pub(in crate::picture) mod twin;

use std::fmt;

crate::choices! {
    /// Operator that maps exposed radiance to display values.
    #[derive(Default)]
    pub enum ToneMap {
        /// No operator: values above 1 are clipped.
        None = "none",
        /// Reinhard 2002 on luminance, with a white point.
        Reinhard = "reinhard",
        /// The film industry's ACES, as fitted by Stephen Hill: high contrast, strong highlights.
        Aces = "aces",
        /// AgX by Troy Sobotka: soft; bright colours fade towards white.
        AgX = "agx",
        /// Khronos PBR Neutral. This is the default because base colours appear as the scene's author chose them and as
        /// other glTF viewers show them; only highlights are compressed.
        #[default]
        Neutral = "neutral",
    }
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

crate::settings! {
    /// Settings of the tone map.
    #[derive(Copy)]
    pub struct Settings {
        /// Operator: none clips; reinhard, aces, agx and neutral compress highlights.
        pub operator: ToneMap = ToneMap::Neutral => any(),
        /// Exposed luminance that reinhard maps to 1; the other operators ignore it.
        pub white_point: f32 = 4.0 => in_range(0.001, 1e6),
    }
}
