//! The registry of techniques.

use super::{
    Info, Occasion, Provided, Technique, Values, caustics, distance_impostor, environment_map,
    final_gather, image_based_lighting, light_path_map, obscurances, participating_media,
    path_tracing, radiance_transfer, radiosity, ray_tracing, shadow_map,
};
use crate::gpu::{Gpu, GpuError};
use crate::scene::GpuScene;
use crate::settings::Field;

/// Creates a technique.
type Make = fn(&Gpu, &GpuScene) -> Result<Box<dyn Technique>, GpuError>;

/// A technique that can be selected by name.
#[derive(Debug, Clone, Copy)]
pub struct Registration {
    /// The technique's description.
    pub info: &'static Info,
    /// Its settings.
    pub fields: fn() -> &'static [Field],
    /// Creates the technique for a scene.
    pub make: Make,
    /// Why the technique suits an occasion whose scene has light of its paths, as a clause; `None` if it does not. So it
    /// takes part in default sets ([`crate::default_set()`]).
    pub suits: fn(&Occasion<'_>) -> Option<String>,
    /// Its settings for an occasion that it suits.
    pub settings: fn(&Occasion<'_>) -> Values,
}

/// Techniques in the order of the frame: those that light the maps of others come first. Of those that one set holds for
/// all others of their role, the first are the better ones.
#[derive(Debug, Clone)]
pub struct Registry(Vec<Registration>);

impl Default for Registry {
    /// gpugi's own techniques.
    fn default() -> Self {
        Self(vec![
            shadow_map::REGISTRATION,
            image_based_lighting::REGISTRATION,
            radiance_transfer::REGISTRATION,
            caustics::REGISTRATION,
            obscurances::REGISTRATION,
            light_path_map::REGISTRATION,
            radiosity::REGISTRATION,
            final_gather::REGISTRATION,
            path_tracing::REGISTRATION,
            participating_media::REGISTRATION,
            environment_map::REGISTRATION,
            ray_tracing::REGISTRATION,
            distance_impostor::REGISTRATION,
        ])
    }
}

impl Registry {
    /// The techniques, in the order of the frame.
    pub fn all(&self) -> &[Registration] {
        &self.0
    }

    /// The technique of this name.
    pub fn find(&self, name: &str) -> Option<&Registration> {
        self.0
            .iter()
            .find(|registration| registration.info.name == name)
    }

    /// The names, separated by commas.
    pub fn names(&self) -> String {
        let names: Vec<&str> = self
            .0
            .iter()
            .map(|registration| registration.info.name)
            .collect();
        names.join(", ")
    }

    /// The names of those that provide something to others, separated by "or".
    pub fn providers(&self, provided: Provided) -> String {
        let infos = self.0.iter().map(|registration| registration.info);
        let providers = infos.filter(|info| info.provides.contains(&provided));
        let names: Vec<&str> = providers.map(|info| info.name).collect();
        names.join(" or ")
    }

    /// Inserts a technique before the technique named `before`, whose points it lights; at the end if no technique has
    /// that name.
    pub fn insert_before(&mut self, before: &str, registration: Registration) {
        let at = self
            .0
            .iter()
            .position(|registration| registration.info.name == before);
        self.0.insert(at.unwrap_or(self.0.len()), registration);
    }
}
