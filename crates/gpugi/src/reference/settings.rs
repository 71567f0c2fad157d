//! What can be set on the path tracer.

use serde::{Deserialize, Serialize};

use crate::light_paths::{LightClass, Part, PathFilter, PatternError};
use crate::techniques::{Field, SettingError, settings};

/// Settings of the path tracer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// Most vertices between light and eye: 1 is direct light only.
    pub max_bounces: u32,
    /// Vertices after which paths end by chance (Russian roulette).
    pub roulette_after: u32,
    /// Light paths, a regular expression over L, D, G, S, E.
    pub paths: String,
    /// Classes of lights, separated by commas.
    pub lights: String,
    /// Stop when the estimated relative mean squared error falls to this; 0: at the number of samples only.
    pub noise: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            max_bounces: 64,
            roulette_after: 4,
            paths: "L.*E".to_owned(),
            lights: "punctual,area,environment".to_owned(),
            noise: 0.0,
        }
    }
}

/// The fields of [`Settings`].
pub const FIELDS: &[Field] = &[
    Field {
        name: "max-bounces",
        summary: "most vertices between light and eye; 1 is direct light only",
        range: Some((0.0, 4096.0)),
    },
    Field {
        name: "roulette-after",
        summary: "vertices after which paths end by chance",
        range: Some((1.0, 4096.0)),
    },
    Field {
        name: "paths",
        summary: "light paths, a regular expression over L light, D diffuse, G glossy, S specular, E eye",
        range: None,
    },
    Field {
        name: "lights",
        summary: "classes of lights, separated by commas: punctual, area, environment",
        range: None,
    },
    Field {
        name: "noise",
        summary: "stop when the estimated relative mean squared error falls to this; 0 never",
        range: Some((0.0, 1e6)),
    },
];

impl Settings {
    /// The settings that render a part of a picture's light, following no path further than the part's longest.
    ///
    /// # Errors
    /// As the pattern's compiler says.
    pub fn of_part(part: &Part) -> Result<Self, PatternError> {
        let default = Self::default();
        let longest = PathFilter::new(&part.pattern)?.automaton().most_vertices();
        let classes: Vec<String> = part.classes.iter().map(LightClass::to_string).collect();
        Ok(Self {
            max_bounces: longest.map_or(default.max_bounces, |most| most.min(default.max_bounces)),
            paths: part.pattern.clone(),
            lights: classes.join(","),
            ..default
        })
    }

    /// Sets one field from text.
    ///
    /// # Errors
    /// [`SettingError`] when there is no such field, or the value is no light path pattern, class or number in range.
    pub fn set(&mut self, name: &str, text: &str) -> Result<(), SettingError> {
        let mut changed = self.clone();
        settings::set(&mut changed, FIELDS, name, text)?;
        let fail = |reason: String| SettingError::Value {
            name: name.to_owned(),
            value: text.to_owned(),
            reason,
        };
        changed.filter().map_err(|error| fail(error.to_string()))?;
        changed.classes().map_err(fail)?;
        *self = changed;
        Ok(())
    }

    /// The light paths as an automaton.
    ///
    /// # Errors
    /// As the pattern's compiler says.
    pub fn filter(&self) -> Result<PathFilter, PatternError> {
        PathFilter::new(&self.paths)
    }

    /// The classes of lights.
    ///
    /// # Errors
    /// A sentence about the first word that is none.
    pub fn classes(&self) -> Result<Vec<LightClass>, String> {
        self.lights
            .split(',')
            .map(|word| {
                LightClass::ALL
                    .into_iter()
                    .find(|class| class.to_string() == word.trim())
                    .ok_or_else(|| {
                        format!(
                            "{word:?} is no class of lights; there are: punctual, area, environment"
                        )
                    })
            })
            .collect()
    }
}
