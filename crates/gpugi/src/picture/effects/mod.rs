//! Effects: what happens to a picture between its film and its display, each in a folder with host code, shader,
//! settings and tests. [`Effects`] holds their settings in the order in which [`super::Picture::record`] applies them.

pub mod denoise;
pub mod depth_of_field;
pub mod encode;
pub mod exposure;
pub mod flare;
pub mod glow;
pub mod motion_blur;
pub mod temporal_antialiasing;
pub mod tone_map;
pub mod vignette;

use crate::settings::{SettingError, SettingSet};

/// What lenses scatter, as a part of what eyes scatter.
const CAMERA_GLOW: f32 = 0.1;

/// Settings of all effects, in the order in which they are applied.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Effects {
    /// What the noisy light of live pictures is averaged over. Nothing in still pictures.
    pub denoise: denoise::Settings,
    /// Averages what neighbouring frames saw of the same surfaces. Off by default: a still picture has no frame before it.
    pub temporal_antialiasing: temporal_antialiasing::Settings,
    /// What a lens does not see sharply, in live pictures. Nothing through a pinhole.
    pub depth_of_field: depth_of_field::Settings,
    /// What moves while the shutter is open, in live pictures. Nothing if it is not open for any time.
    pub motion_blur: motion_blur::Settings,
    /// What the eye scatters. Off by default.
    pub glow: glow::Settings,
    /// What the lens reflects and diffracts. Off by default.
    pub flare: flare::Settings,
    /// How a lens with an aperture darkens corners. Off by default.
    pub vignette: vignette::Settings,
    /// How bright the picture is shown.
    pub exposure: exposure::Settings,
    /// How its brightness is mapped to that of a display.
    pub tone_map: tone_map::Settings,
    /// How it is rounded to 8 bits.
    pub encode: encode::Settings,
}

impl Effects {
    /// Names of all effects, in their order.
    pub const NAMES: [&'static str; 10] = [
        "denoise",
        "temporal-antialiasing",
        "depth-of-field",
        "motion-blur",
        "glow",
        "flare",
        "vignette",
        "exposure",
        "tone-map",
        "encode",
    ];

    /// Those of frames in motion: what neighbouring frames saw is averaged.
    pub fn of_live_view() -> Self {
        Self {
            temporal_antialiasing: temporal_antialiasing::Settings {
                frames: temporal_antialiasing::LIVE_FRAMES,
                interval: 0,
            },
            ..Self::default()
        }
    }

    /// The same as a camera shows it, not an eye: with what its lens scatters and reflects, darker corners if it has an
    /// aperture, an exposure that follows the light, and the contrast of film.
    pub fn of_a_camera(mut self) -> Self {
        self.glow.strength = CAMERA_GLOW;
        self.flare.strength = 1.0;
        self.vignette.strength = 1.0;
        self.exposure.adaptation = 1.0;
        self.tone_map.operator = tone_map::ToneMap::Aces;
        self
    }

    /// The same at a fixed exposure value (EV).
    pub fn exposed(mut self, value: f32) -> Self {
        self.exposure.value = exposure::Exposure::Manual(value);
        self
    }

    /// The same without noise between 8-bit values.
    pub fn without_dither(mut self) -> Self {
        self.encode.dither = false;
        self
    }

    /// As they are, but without glow, flare, vignette, exposure, tone map and dither: for colours that mean something, such as errors.
    pub(super) fn of_colors(&self) -> Self {
        let mut effects = self.clone().exposed(0.0).without_dither();
        effects.glow = glow::Settings::default();
        effects.flare = flare::Settings::default();
        effects.vignette = vignette::Settings::default();
        effects.tone_map.operator = tone_map::ToneMap::None;
        effects
    }

    /// The settings of each effect, with its name.
    pub fn all(&self) -> [(&'static str, &dyn SettingSet); 10] {
        let [
            denoise,
            temporal,
            depth_of_field,
            motion_blur,
            glow,
            flare,
            vignette,
            exposure,
            tone_map,
            encode,
        ] = Self::NAMES;
        [
            (denoise, &self.denoise),
            (temporal, &self.temporal_antialiasing),
            (depth_of_field, &self.depth_of_field),
            (motion_blur, &self.motion_blur),
            (glow, &self.glow),
            (flare, &self.flare),
            (vignette, &self.vignette),
            (exposure, &self.exposure),
            (tone_map, &self.tone_map),
            (encode, &self.encode),
        ]
    }

    /// The settings of the effect `name`, to be changed; `None` if there is no such effect.
    pub fn of_mut(&mut self, name: &str) -> Option<&mut dyn SettingSet> {
        let index = Self::NAMES.iter().position(|effect| *effect == name)?;
        let all: [&mut dyn SettingSet; 10] = [
            &mut self.denoise,
            &mut self.temporal_antialiasing,
            &mut self.depth_of_field,
            &mut self.motion_blur,
            &mut self.glow,
            &mut self.flare,
            &mut self.vignette,
            &mut self.exposure,
            &mut self.tone_map,
            &mut self.encode,
        ];
        all.into_iter().nth(index)
    }

    /// Sets one setting of the effect `name` from text; `None` if there is no such effect.
    pub fn set(
        &mut self,
        name: &str,
        setting: &str,
        value: &str,
    ) -> Option<Result<(), SettingError>> {
        Some(self.of_mut(name)?.set(setting, value))
    }
}
