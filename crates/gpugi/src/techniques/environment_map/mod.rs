//! Environment mapping: the environment reflected by diffuse, glossy and ideal lobes, without occlusion (tutorial sections 3.2.1 and
//! 3.2.2).
//!
//! Generate: the environment's image becomes a cube map with levels; from it an irradiance cube, nine spherical harmonics, and cubes
//! whose levels hold its means over ever wider lobes. Gather: each lobe is its albedo times one lookup; ideal mirrors look at the image
//! itself. Beside a technique that adds diffuse and glossy light of the environment, only ideal mirrors are left to this one.
//! docs/techniques/environment-map.md.

pub(crate) mod gpu;
mod maps;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

use super::{Field, Info, Map, SettingError, Technique, settings};
use crate::capture::{SurfacePoints, Target, View};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::light_paths::{LightClass, LightPaths, overlap};
use crate::scene::GpuScene;
use crate::shader;
use maps::{Generator, Maps};

/// What environment mapping says of itself.
pub const INFO: Info = Info {
    name: "environment-map",
    summary: "the environment without occlusion; beside image-based-lighting only in ideal mirrors",
    source: "tutorial sections 3.2.1 and 3.2.2; Blinn and Newell 1976; Ramamoorthi and Hanrahan 2001; Karis 2013",
    paths: &[LightPaths {
        class: LightClass::Environment,
        pattern: "L[DGS]E",
    }],
};

/// What is left beside a technique that adds the rest.
const MIRRORS: &[LightPaths] = &[LightPaths {
    class: LightClass::Environment,
    pattern: "LSE",
}];

/// How irradiance is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Irradiance {
    /// A cube map, summed directly.
    Cube,
    /// Nine spherical harmonics.
    Harmonics,
}

/// Settings of environment mapping.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// Side of the radiance cube and of the finest level of the glossy maps (texels): a power of two.
    pub resolution: u32,
    /// How irradiance is kept.
    pub irradiance: Irradiance,
    /// Directions a texel of the glossy maps' first blurred level; of each coarser level twice as many.
    pub samples: u32,
    /// Whether Phong lobes keep the surface's cosine; without as the tutorial has it.
    pub phong_cosine: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            resolution: 256,
            irradiance: Irradiance::Cube,
            samples: 128,
            phong_cosine: true,
        }
    }
}

const FIELDS: &[Field] = &[
    Field {
        name: "resolution",
        summary: "side of the radiance cube, a power of two [texels]",
        range: Some((8.0, 2048.0)),
    },
    Field {
        name: "irradiance",
        summary: "cube or harmonics: diffuse light from a cube map, or from nine spherical harmonics",
        range: None,
    },
    Field {
        name: "samples",
        summary: "directions a texel of the glossy maps' first blurred level, twice as many in each coarser one",
        range: Some((1.0, 1024.0)),
    },
    Field {
        name: "phong-cosine",
        summary: "true or false: whether Phong lobes keep the surface's cosine, which the tutorial drops",
        range: None,
    },
];

/// Environment mapping.
#[derive(Debug)]
pub struct EnvironmentMap {
    settings: Settings,
    gather: Kernel,
    /// None where only ideal mirrors are left to this technique.
    generator: Option<Generator>,
    made: Option<Made>,
    bound: Option<(wgpu::Buffer, wgpu::Buffer, [wgpu::BindGroup; 2])>,
}

/// Maps, and what they were made of.
#[derive(Debug)]
struct Made {
    maps: Maps,
    settings: Settings,
    /// The scene's count of environments when they were filled.
    version: Option<u64>,
}

impl EnvironmentMap {
    /// Compiles the technique's passes. `covered`: the light that others add.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, covered: &[LightPaths]) -> Result<Self, GpuError> {
        let is_whole = overlap(INFO.paths, covered).is_none();
        let shader = if is_whole {
            shader!("techniques.environment_map.gather")
        } else {
            shader!("techniques.environment_map.mirrors")
        };
        Ok(Self {
            settings: Settings::default(),
            gather: Kernel::new(gpu, &shader, "main", Some(&scene.layout))?,
            generator: is_whole.then(|| Generator::new(gpu, scene)).transpose()?,
            made: None,
            bound: None,
        })
    }

    /// Radiance of the environment in spherical harmonics, 9 x 4 floats in the order of shared/spherical_harmonics.wesl, once generated;
    /// without rotation and intensity.
    pub fn harmonics(&self) -> Option<&wgpu::Buffer> {
        self.made.as_ref().map(|made| &made.maps.harmonics)
    }
}

impl Technique for EnvironmentMap {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn paths(&self) -> &'static [LightPaths] {
        match self.generator {
            Some(_) => INFO.paths,
            None => MIRRORS,
        }
    }

    fn settings(&self) -> serde_json::Value {
        settings::to_json(&self.settings)
    }

    fn fields(&self) -> &'static [Field] {
        FIELDS
    }

    fn set(&mut self, name: &str, value: &str) -> Result<(), SettingError> {
        let mut changed = self.settings.clone();
        settings::set(&mut changed, FIELDS, name, value)?;
        if !changed.resolution.is_power_of_two() {
            return Err(SettingError::Value {
                name: name.to_owned(),
                value: value.to_owned(),
                reason: "a power of two is needed".into(),
            });
        }
        self.settings = changed;
        Ok(())
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        _: &View,
    ) -> Result<(), GpuError> {
        let Some(generator) = &self.generator else {
            return Ok(());
        };
        if scene.environment.is_none() {
            return Ok(());
        }
        let made = match self.made.take() {
            Some(made) if made.settings == self.settings => made,
            _ => Made {
                maps: Maps::new(frame.gpu, generator, &self.gather, &self.settings)?,
                settings: self.settings.clone(),
                version: None,
            },
        };
        let made = self.made.insert(made);
        // Rotation and intensity are applied at lookup.
        if made.version != Some(scene.versions.environment) {
            made.maps.record(frame, scene);
            made.version = Some(scene.versions.environment);
        }
        Ok(())
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        points: &SurfacePoints,
        target: &Target,
    ) -> Result<(), GpuError> {
        if scene.environment.is_none() {
            return Ok(());
        }
        let fresh = self.bound.as_ref().is_some_and(|(bound, radiance, _)| {
            *bound == points.points && *radiance == target.radiance
        });
        if !fresh {
            let groups = [
                self.gather.bind(
                    frame.gpu,
                    1,
                    &[
                        ("seen", points.view.as_entire_binding()),
                        ("points", points.points.as_entire_binding()),
                    ],
                )?,
                self.gather.bind(
                    frame.gpu,
                    3,
                    &[("radiance", target.radiance.as_entire_binding())],
                )?,
            ];
            self.bound = Some((points.points.clone(), target.radiance.clone(), groups));
        }
        if let Some((_, _, [seen, added])) = &self.bound {
            let mut groups = vec![(0, &scene.bind_group), (1, seen), (3, added)];
            if let Some(made) = &self.made {
                groups.push((2, &made.maps.group));
            }
            frame.compute("environment-map.gather", |pass| {
                self.gather.dispatch(pass, &groups, [points.count, 1, 1]);
            });
        }
        Ok(())
    }

    fn maps(&self) -> Vec<Map> {
        let textures = self.made.iter().flat_map(|made| made.maps.textures());
        let names = ["radiance", "irradiance", "ggx", "phong", "albedo"];
        names
            .iter()
            .zip(textures)
            .map(|(name, texture)| Map {
                name: format!("environment-map.{name}"),
                texture: texture.clone(),
            })
            .collect()
    }
}
