//! Settings of the path tracer.

use crate::light_paths::{LightClass, Part, PathFilter, PatternError};
use crate::settings::{SettingError, SettingSet};

crate::settings! {
    /// Settings of the path tracer.
    pub struct Settings {
        /// Maximum number of vertices between light and eye; 1 is direct light only.
        pub max_bounces: u32 = 64 => in_range(0.0, 4096.0),
        /// Vertex from which on Russian roulette may end a path.
        pub roulette_after: u32 = 4 => in_range(1.0, 4096.0),
        /// Light paths to keep: a regular expression over L light, D diffuse, G glossy, S specular, V medium, E eye.
        pub paths: String = "L.*E".to_owned() => any(),
        /// Light classes, separated by commas: punctual, area, environment.
        pub lights: String = "punctual,area,environment".to_owned() => any(),
        /// Radius within which photons light what mirrors and glass show, in pixels; it shrinks from sample to sample. 0: caustics of points, spots and directions are missing there.
        pub merge_radius: f64 = 2.0 => in_range(0.0, 64.0),
        /// Stop when the estimated relative mean squared error falls to this value; 0 never.
        pub noise: f64 = 0.0 => in_range(0.0, 1e6),
    }
}

impl Settings {
    /// Settings that render one part of an image's light. Paths are no longer than the longest path of the part.
    ///
    /// # Errors
    /// The error of the pattern's compiler.
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
    /// [`SettingError`] if there is no such field, or if the value is not a valid light path pattern, light class or
    /// number in range.
    pub fn set(&mut self, name: &str, text: &str) -> Result<(), SettingError> {
        let mut changed = self.clone();
        SettingSet::set(&mut changed, name, text)?;
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
    /// The error of the pattern's compiler.
    pub fn filter(&self) -> Result<PathFilter, PatternError> {
        PathFilter::new(&self.paths)
    }

    /// The light classes.
    ///
    /// # Errors
    /// A sentence about the first word that is not a light class.
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
