//! Environment mapping: the environment reflected by diffuse, glossy and ideal lobes, without occlusion (tutorial sections 3.2.1 and
//! 3.2.2).
//!
//! Generate: the environment's image becomes a cube map with levels; from it an irradiance cube, nine spherical harmonics, and cubes
//! whose levels hold its means over ever wider lobes. Gather: each lobe is its albedo times one lookup; ideal mirrors look at the image
//! itself, and so does glass. Beside a technique that adds diffuse and glossy light of the environment, that is left to this one on the
//! objects that it is given; on all others it adds what ideal mirrors show.
//! docs/techniques/environment-map.md.

pub mod export;
#[cfg(test)]
mod export_tests;
pub(crate) mod gpu;
pub(crate) mod maps;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

use super::{Field, Info, Lit, Map, SettingError, Technique, Texels, settings};
use crate::capture::{PerTarget, SurfacePoints, Target, View};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::light_paths::{LightClass, LightPaths, overlap};
use crate::scene::{Claims, GpuScene};
use crate::shader;
use maps::{Generator, Maps};

/// What environment mapping says of itself.
pub const INFO: Info = Info {
    name: "environment-map",
    summary: "the environment without occlusion; beside image-based-lighting in mirrors, glass and chosen objects",
    source: "tutorial sections 3.2.1 and 3.2.2; Blinn and Newell 1976; Ramamoorthi and Hanrahan 2001; Karis 2013",
    paths: &[LightPaths::new(LightClass::Environment, "L[DGS]E")],
    suits: |_| true,
    keeps_texels: false,
};

/// What is left beside a technique that adds the rest.
const MIRRORS: &[LightPaths] = &[LightPaths::new(LightClass::Environment, "LSE")];

/// How irradiance is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Irradiance {
    /// A cube map, summed directly.
    Cube,
    /// Nine spherical harmonics.
    Harmonics,
}

/// How metals with a complex refractive index reflect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Metals {
    /// Exact reflectance of unpolarised light.
    Exact,
    /// The tutorial's equation 4.
    Approximate,
}

/// Which transmissive objects refract the environment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Refraction {
    /// None: cameras see through them, straight.
    None,
    /// Those whose surface bounds a solid.
    Solids,
    /// Thin walls, too: they show the environment and nothing else behind them.
    All,
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
    /// How metals with a complex refractive index reflect.
    pub metals: Metals,
    /// Which transmissive objects refract the environment, once.
    pub refraction: Refraction,
    /// Objects that get all lobes of its light from this technique: names separated by commas, `*` for any characters. `auto`: all, or none
    /// beside image-based-lighting.
    pub objects: String,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            resolution: 256,
            irradiance: Irradiance::Cube,
            samples: 128,
            phong_cosine: true,
            metals: Metals::Exact,
            refraction: Refraction::Solids,
            objects: AUTO.to_owned(),
        }
    }
}

impl Settings {
    /// Sets the field `name` from text.
    ///
    /// # Errors
    /// [`SettingError`].
    pub fn set(&mut self, name: &str, value: &str) -> Result<(), SettingError> {
        settings::set_with_sides(self, FIELDS, name, value, |all| [all.resolution])
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
    Field {
        name: "metals",
        summary: "exact or approximate: reflectance of metals with a complex index, approximate by the tutorial's equation 4",
        range: None,
    },
    Field {
        name: "refraction",
        summary: "none, solids or all: transmissive objects that refract the environment; others are seen through",
        range: None,
    },
    Field {
        name: "objects",
        summary: "objects that get all of the environment's light from here, names with commas between and * for any letters; auto: all, or none beside image-based-lighting",
        range: None,
    },
];

/// The value of [`Settings::objects`] that leaves the choice to the other techniques.
const AUTO: &str = "auto";

/// Environment mapping.
#[derive(Debug)]
pub struct EnvironmentMap {
    settings: Settings,
    gather: Kernel,
    generator: Generator,
    /// Whether all of the environment's light is left to this technique.
    is_whole: bool,
    /// Whether any object needs more than the environment's image.
    needs_maps: bool,
    made: Option<Made>,
    bound: PerTarget<[wgpu::BindGroup; 2]>,
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
    /// Compiles the technique's passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let shader = shader!("techniques.environment_map.gather");
        Ok(Self {
            settings: Settings::default(),
            gather: Kernel::new(gpu, &shader, "main", Some(&scene.layout))?,
            generator: Generator::new(gpu, scene)?,
            is_whole: true,
            needs_maps: true,
            made: None,
            bound: PerTarget::default(),
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

    fn paths(&self) -> &[LightPaths] {
        if self.is_whole { INFO.paths } else { MIRRORS }
    }

    fn claim(&mut self, scene: &GpuScene, covered: &[LightPaths]) -> Vec<Claims> {
        self.is_whole = overlap(INFO.paths, covered).is_none();
        let objects = &scene.objects;
        if scene.environment.is_none() {
            return vec![Claims::NONE; objects.len()];
        }
        let settings = &self.settings;
        let claims = objects.iter().map(|object| {
            let refracts = match settings.refraction {
                Refraction::None => false,
                Refraction::Solids => object.is_solid,
                Refraction::All => true,
            };
            let is_mine = match settings.objects.as_str() {
                AUTO => self.is_whole,
                list => object.is_named_by(list),
            };
            let mine = if is_mine {
                Claims::ENVIRONMENT
            } else {
                Claims::NONE
            };
            let transmission = if object.is_transmissive && refracts {
                Claims::TRANSMISSION
            } else {
                Claims::NONE
            };
            mine | transmission
        });
        let claims: Vec<Claims> = claims.collect();
        self.needs_maps = objects.iter().zip(&claims).any(|(object, claims)| {
            claims.contains(Claims::ENVIRONMENT)
                || claims.contains(Claims::TRANSMISSION) && !object.is_smooth
        });
        claims
    }

    fn names(&self) -> &str {
        match self.settings.objects.as_str() {
            AUTO => "",
            list => list,
        }
    }

    fn settings(&self) -> serde_json::Value {
        settings::to_json(&self.settings)
    }

    fn fields(&self) -> &'static [Field] {
        FIELDS
    }

    fn set(&mut self, name: &str, value: &str) -> Result<(), SettingError> {
        self.settings.set(name, value)
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        _: &View,
        _: &mut Lit<'_>,
    ) -> Result<(), GpuError> {
        if scene.environment.is_none() {
            return Ok(());
        }
        let made = match self.made.take() {
            Some(made) if made.settings == self.settings => made,
            _ => Made {
                maps: Maps::new(frame.gpu, &self.generator, &self.gather, &self.settings)?,
                settings: self.settings.clone(),
                version: None,
            },
        };
        let made = self.made.insert(made);
        // Rotation and intensity are applied at lookup.
        if self.needs_maps && made.version != Some(scene.versions.environment) {
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
        let (gpu, kernel) = (frame.gpu, &self.gather);
        let [seen, added] = self.bound.of(points, target, || {
            Ok([points.bind(gpu, kernel)?, target.bind(gpu, kernel)?])
        })?;
        let mut groups = vec![(0, &scene.bind_group), (1, seen), (3, added)];
        if let Some(made) = &self.made {
            groups.push((2, &made.maps.group));
        }
        frame.compute("environment-map.gather", |pass| {
            kernel.dispatch(pass, &groups, [points.count, 1, 1]);
        });
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
                texels: Texels::Texture(texture.clone()),
            })
            .collect()
    }
}
