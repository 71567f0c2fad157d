//! Image-based lighting: the environment as directional lights with shadows (tutorial section 3.2.3).
//!
//! The environment is cut into N directional domains; the light of each is a parallel light with a depth map that covers the scene,
//! gathered by the same pass as shadow-map's lights.

mod domains;
pub(crate) mod gpu;
#[cfg(test)]
mod tests;

use glam::{Mat3, Vec3};
use serde::{Deserialize, Serialize};

pub use domains::{Decomposition, Domain};

use super::shadow_map::lights::LightList;
use super::shadow_map::shadows::Shadows;
use super::{Field, Info, Map, SettingError, Technique, settings, shadow_map};
use crate::capture::{SurfacePoints, Target, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::light_paths::{LightClass, LightPaths};
use crate::scene::{GpuScene, Versions};

/// What image-based lighting says of itself.
pub const INFO: Info = Info {
    name: "image-based-lighting",
    summary: "direct light of the environment with shadows",
    source: "tutorial section 3.2.3; Lloyd 1982; Agarwal et al. 2003",
    paths: &[LightPaths {
        class: LightClass::Environment,
        pattern: "L[DG]E",
    }],
};

/// How relaxation spreads directions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Spread {
    /// In the end as densely as there is power: centroids weighted by the square of the radiance.
    Power,
    /// In the end as densely as the root of the power: centroids weighted by the radiance.
    Root,
}

/// Settings of image-based lighting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// Directions.
    pub samples: u32,
    /// Most steps of relaxation.
    pub iterations: u32,
    /// What relaxation tends to.
    pub spread: Spread,
    /// Side of each direction's depth map (texels).
    pub resolution: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            samples: 128,
            iterations: 4,
            spread: Spread::Root,
            resolution: 512,
        }
    }
}

const FIELDS: &[Field] = &[
    Field {
        name: "samples",
        summary: "directions drawn from the environment",
        range: Some((1.0, 2048.0)),
    },
    Field {
        name: "iterations",
        summary: "most steps of Lloyd's relaxation",
        range: Some((0.0, 256.0)),
    },
    Field {
        name: "spread",
        summary: "relaxed directions lie as densely as the power, or as its root: power or root",
        range: None,
    },
    Field {
        name: "resolution",
        summary: "side of a direction's depth map [texels]",
        range: Some((16.0, 4096.0)),
    },
];

/// Image-based lighting.
#[derive(Debug)]
pub struct ImageBasedLighting {
    settings: Settings,
    decomposition: Decomposition,
    /// Of the environment's texels at a version, with settings.
    domains: Option<(u64, Settings, Vec<Domain>)>,
    shadows: Shadows,
    made: Option<(Versions, Settings)>,
}

impl ImageBasedLighting {
    /// Compiles the technique's passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        Ok(Self {
            settings: Settings::default(),
            decomposition: Decomposition::new(gpu, scene)?,
            domains: None,
            shadows: Shadows::new(gpu, scene)?,
            made: None,
        })
    }

    /// The domains, decomposed anew only when texels or settings changed: a rotation or another intensity leaves them.
    fn domains(&mut self, frame: &mut Frame<'_>, scene: &GpuScene) -> Result<&[Domain], GpuError> {
        let (version, settings) = (scene.versions.environment, &self.settings);
        let kept = self
            .domains
            .take()
            .filter(|(at, of, _)| *at == version && of == settings);
        let domains = match kept {
            Some((_, _, domains)) => domains,
            None => self.decomposition.decompose(frame, scene, settings)?,
        };
        let (_, _, domains) = self.domains.insert((version, settings.clone(), domains));
        Ok(domains)
    }

    /// A parallel light for each domain that has any.
    fn lights(&mut self, frame: &mut Frame<'_>, scene: &GpuScene) -> Result<LightList, GpuError> {
        let resolution = self.settings.resolution;
        let mut list = LightList::default();
        if let Some(environment) = &scene.environment {
            let world_from_map = Mat3::from_rotation_y(environment.rotation);
            for domain in self.domains(frame, scene)? {
                let irradiance = domain.flux_density * environment.intensity;
                if irradiance != Vec3::ZERO {
                    let toward = world_from_map * domain.toward;
                    list.add_direction(-toward, irradiance, 0.0, resolution, &scene.bounds);
                }
            }
        }
        Ok(list)
    }
}

impl Technique for ImageBasedLighting {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn settings(&self) -> serde_json::Value {
        settings::to_json(&self.settings)
    }

    fn fields(&self) -> &'static [Field] {
        FIELDS
    }

    fn set(&mut self, name: &str, value: &str) -> Result<(), SettingError> {
        settings::set(&mut self.settings, FIELDS, name, value)
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        _: &View,
    ) -> Result<(), GpuError> {
        let made = (scene.versions, self.settings.clone());
        if self.made.as_ref() == Some(&made) {
            return Ok(());
        }
        let list = self.lights(frame, scene)?;
        let gather = shadow_map::gpu::GatherSettings {
            // Many directions smooth the shadow together: few comparisons each, turned from pixel to pixel.
            taps: 4,
            // A direction's texels are coarse: see DepthViewSpec::second_depth.
            second_depth: 0,
            ..shadow_map::Settings::default().gather()
        };
        self.shadows.generate(
            frame,
            scene,
            "image-based-lighting.generate",
            &list.samples,
            list.views,
            &gather,
        )?;
        self.made = Some(made);
        Ok(())
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        points: &SurfacePoints,
        target: &Target,
    ) -> Result<(), GpuError> {
        self.shadows
            .gather(frame, scene, "image-based-lighting.gather", points, target)
    }

    fn maps(&self) -> Vec<Map> {
        let atlas = self.shadows.atlas().map(|atlas| &atlas.texture);
        [
            ("image-based-lighting.atlas", atlas),
            ("image-based-lighting.domains", self.decomposition.owners()),
        ]
        .into_iter()
        .filter_map(|(name, texture)| {
            Some(Map {
                name: name.into(),
                texture: texture?.clone(),
            })
        })
        .collect()
    }
}
