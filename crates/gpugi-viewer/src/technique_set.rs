//! Which techniques light the scene, and with which settings.

use std::collections::BTreeMap;

use gpugi::gpu::{Gpu, GpuError};
use gpugi::reference;
use gpugi::{LightingError, Purpose, Renderer, Techniques};
use gpugi_scene::Scene;

/// The name of the path tracer, which takes the place of all techniques.
pub const PATH_TRACER: &str = reference::INFO.name;

/// The techniques that people chose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Preset {
    /// The scene's default set for frames in motion.
    #[default]
    Live,
    /// The scene's default set for a still picture.
    Still,
}

impl Preset {
    /// What its light is for.
    pub fn purpose(self) -> Purpose {
        match self {
            Self::Live => Purpose::LiveView,
            Self::Still => Purpose::StillPicture,
        }
    }
}

/// Techniques and the settings that differ from those of the preset, or from their defaults.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TechniqueSet {
    /// What applies where no techniques are named.
    pub preset: Preset,
    /// The names of the techniques, if people chose them.
    pub names: Option<Vec<String>>,
    /// Values by technique and setting.
    pub settings: BTreeMap<String, BTreeMap<String, String>>,
}

impl TechniqueSet {
    /// The path tracer alone, with settings of this set.
    pub fn path_tracer(&self) -> Self {
        Self {
            names: Some(vec![PATH_TRACER.to_owned()]),
            ..self.clone()
        }
    }

    /// Whether the path tracer takes the place of all techniques.
    pub fn is_path_tracer(&self) -> bool {
        self.names
            .as_ref()
            .is_some_and(|names| names == &[PATH_TRACER])
    }

    /// Samples per pixel of a picture at rest, if people chose no other number.
    pub fn default_samples(&self) -> u32 {
        if self.is_path_tracer() { 1024 } else { 64 }
    }

    /// Settings of the path tracer.
    ///
    /// # Errors
    /// [`LightingError::Setting`].
    pub fn path_tracer_settings(&self) -> Result<reference::Settings, LightingError> {
        let mut settings = reference::Settings::default();
        for (name, value) in self.settings.get(PATH_TRACER).into_iter().flatten() {
            let done = settings.set(name, value);
            done.map_err(|source| LightingError::Setting {
                technique: PATH_TRACER.to_owned(),
                source,
            })?;
        }
        Ok(settings)
    }

    /// A renderer of `scene` with these techniques; with none if the path tracer takes their place. Settings of techniques that are not in use wait.
    ///
    /// # Errors
    /// [`LightingError`].
    pub fn renderer(
        &self,
        gpu: &Gpu,
        scene: &Scene,
        size: [u32; 2],
    ) -> Result<Renderer, LightingError> {
        self.path_tracer_settings()?;
        let techniques = match &self.names {
            Some(_) if self.is_path_tracer() => Techniques::NONE,
            Some(names) if names.iter().any(|name| name == PATH_TRACER) => {
                let what = format!("{PATH_TRACER} computes all light by itself; name it alone");
                return Err(GpuError::Input { what }.into());
            }
            Some(names) => Techniques::Named(names.clone()),
            None => Techniques::Default(self.preset.purpose()),
        };
        let mut renderer = Renderer::new(gpu, scene, size, techniques)?;
        let techniques = renderer.techniques().iter();
        let in_use: Vec<&str> = techniques.map(|technique| technique.info().name).collect();
        for (technique, settings) in &self.settings {
            if in_use.contains(&technique.as_str()) {
                for (name, value) in settings {
                    renderer.set(technique, name, value)?;
                }
            }
        }
        Ok(renderer)
    }

    /// The set with one technique more or less than those `in_use`.
    pub fn toggled(&self, in_use: &[&str], technique: &str) -> Self {
        let mut names: Vec<String> = in_use.iter().map(|&name| name.to_owned()).collect();
        names.retain(|name| name != PATH_TRACER);
        if in_use.contains(&technique) {
            names.retain(|name| name != technique);
        } else {
            names.push(technique.to_owned());
        }
        Self {
            names: Some(names),
            ..self.clone()
        }
    }

    /// Remembers a setting.
    pub fn set(&mut self, technique: &str, name: &str, value: &str) {
        let settings = self.settings.entry(technique.to_owned()).or_default();
        settings.insert(name.to_owned(), value.to_owned());
    }

    /// Forgets the settings of a technique.
    pub fn reset(&mut self, technique: &str) {
        self.settings.remove(technique);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_path_tracer_gives_way_to_techniques() {
        let mut set = TechniqueSet::default();
        set.set(PATH_TRACER, "max-bounces", "3");
        let alone = set.path_tracer();
        assert!(alone.is_path_tracer() && !set.is_path_tracer());
        assert_eq!(alone.path_tracer_settings().unwrap().max_bounces, 3);
        let less = alone.toggled(&[PATH_TRACER], "radiosity");
        assert_eq!(less.names.unwrap(), ["radiosity"]);
        set.set(PATH_TRACER, "paths", "L(");
        assert!(set.path_tracer_settings().is_err());
    }

    #[test]
    fn toggling_names_the_techniques_and_keeps_their_settings() {
        let mut set = TechniqueSet::default();
        set.set("radiosity", "resolution", "64");
        let more = set.toggled(&["shadow-map"], "radiosity");
        assert_eq!(more.names.as_deref().unwrap(), ["shadow-map", "radiosity"]);
        assert_eq!(more.settings, set.settings);
        let less = more.toggled(&["shadow-map", "radiosity"], "shadow-map");
        assert_eq!(less.names.unwrap(), ["radiosity"]);
        set.reset("radiosity");
        assert_eq!(set, TechniqueSet::default());
    }
}
