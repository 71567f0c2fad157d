//! The registry of techniques.

use super::{
    Info, Technique, caustics, distance_impostor, environment_map, final_gather,
    image_based_lighting, light_path_map, obscurances, participating_media, radiance_transfer,
    radiosity, ray_tracing, shadow_map,
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
}

/// Techniques in the order of the frame: those that light the maps of others come first.
#[derive(Debug, Clone)]
pub struct Registry(Vec<Registration>);

impl Default for Registry {
    /// gpugi's own techniques.
    fn default() -> Self {
        Self(vec![
            Registration {
                info: &shadow_map::INFO,
                fields: shadow_map::Settings::fields,
                make: |gpu, scene| Ok(Box::new(shadow_map::ShadowMap::new(gpu, scene)?)),
            },
            Registration {
                info: &image_based_lighting::INFO,
                fields: image_based_lighting::Settings::fields,
                make: |gpu, scene| {
                    Ok(Box::new(image_based_lighting::ImageBasedLighting::new(
                        gpu, scene,
                    )?))
                },
            },
            Registration {
                info: &participating_media::INFO,
                fields: participating_media::Settings::fields,
                make: |_, _| Ok(Box::new(participating_media::ParticipatingMedia::default())),
            },
            Registration {
                info: &radiance_transfer::INFO,
                fields: radiance_transfer::Settings::fields,
                make: |_, _| Ok(Box::new(radiance_transfer::RadianceTransfer::default())),
            },
            Registration {
                info: &caustics::INFO,
                fields: caustics::Settings::fields,
                make: |gpu, scene| Ok(Box::new(caustics::Caustics::new(gpu, scene)?)),
            },
            Registration {
                info: &obscurances::INFO,
                fields: obscurances::Settings::fields,
                make: |_, _| Ok(Box::new(obscurances::Obscurances::default())),
            },
            Registration {
                info: &environment_map::INFO,
                fields: environment_map::Settings::fields,
                make: |gpu, scene| Ok(Box::new(environment_map::EnvironmentMap::new(gpu, scene)?)),
            },
            Registration {
                info: &light_path_map::INFO,
                fields: light_path_map::Settings::fields,
                make: |_, _| Ok(Box::new(light_path_map::LightPathMap::default())),
            },
            Registration {
                info: &radiosity::INFO,
                fields: radiosity::Settings::fields,
                make: |_, _| Ok(Box::new(radiosity::Radiosity::default())),
            },
            Registration {
                info: &final_gather::INFO,
                fields: final_gather::Settings::fields,
                make: |_, _| Ok(Box::new(final_gather::FinalGather::default())),
            },
            Registration {
                info: &ray_tracing::INFO,
                fields: ray_tracing::Settings::fields,
                make: |_, _| Ok(Box::new(ray_tracing::RayTracing::default())),
            },
            Registration {
                info: &distance_impostor::INFO,
                fields: distance_impostor::Settings::fields,
                make: |gpu, scene| {
                    Ok(Box::new(distance_impostor::DistanceImpostor::new(
                        gpu, scene,
                    )?))
                },
            },
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
        self.0.iter().find(|one| one.info.name == name)
    }

    /// The names, separated by commas.
    pub fn names(&self) -> String {
        let names: Vec<&str> = self.0.iter().map(|one| one.info.name).collect();
        names.join(", ")
    }

    /// Inserts a technique before the technique named `before`, whose points it lights; at the end if no technique has
    /// that name.
    pub fn insert_before(&mut self, before: &str, registration: Registration) {
        let at = self.0.iter().position(|one| one.info.name == before);
        self.0.insert(at.unwrap_or(self.0.len()), registration);
    }
}
