//! Image-based lighting: the environment as directional lights with shadows (tutorial section 3.2.3).
//!
//! Generate: the environment is cut into N directional domains (domains.rs), each with a depth map that covers the scene; maps lie in batches, an
//! atlas each (batches.rs). Gather: sums over the domains visibility times light times average reflectivity.
//! docs/techniques/image-based-lighting.md.

mod batches;
mod delaunay;
mod domains;
pub(crate) mod gpu;
mod prefiltered;
#[cfg(test)]
mod tests;

use glam::{Mat3, Vec3};
use serde::{Deserialize, Serialize};

use batches::{Batches, DepthMaps, GUTTER};
pub use domains::{Decomposition, Domain};
use prefiltered::Prefiltered;

use super::{Field, Info, Lit, Map, SettingError, Technique, Texels, settings};
use crate::capture::depth::{ATLAS_SIDE, DepthDrawing, DepthViewSpec, Rasterizer};
use crate::capture::{SurfacePoints, Target, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::light_paths::{LightClass, LightPaths};
use crate::scene::{GpuScene, Versions};

/// What image-based lighting says of itself.
pub const INFO: Info = Info {
    name: "image-based-lighting",
    summary: "direct light of the environment with shadows",
    source: "tutorial section 3.2.3; Lloyd 1982; Agarwal et al. 2003",
    paths: &[LightPaths::new(LightClass::Environment, "L[DG]E")],
    suits: |_| true,
    keeps_texels: false,
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

/// How the average reflectivity of a domain is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Reflectivity {
    /// That of the domain's direction.
    Sample = 0,
    /// Glossy lobes blurred by the solid angle that the domain's light comes from.
    Lobe = 1,
    /// Environment-map's prefiltered light of each lobe, times the part of it that the domains see.
    Ratio = 2,
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
    /// How the average reflectivity of a domain is found.
    pub reflectivity: Reflectivity,
    /// Side of each direction's depth map (texels).
    pub resolution: u32,
    /// Memory for depth maps (MiB). Maps that do not fit together are drawn and gathered batch by batch, every frame anew.
    pub memory: u32,
    /// Who draws depth maps.
    pub rasterizer: Rasterizer,
    /// Part of the casters' triangles in depth maps.
    pub caster_detail: f32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            samples: 128,
            iterations: 4,
            spread: Spread::Root,
            reflectivity: Reflectivity::Lobe,
            resolution: 512,
            memory: 1024,
            rasterizer: Rasterizer::Auto,
            caster_detail: 1.0,
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
        name: "reflectivity",
        summary: "of a domain: sample, its direction's; lobe, its average; ratio, prefiltered light times what is seen",
        range: None,
    },
    Field {
        name: "resolution",
        summary: "side of a direction's depth map [texels]",
        range: Some((16.0, 4096.0)),
    },
    Field {
        name: "memory",
        summary: "for depth maps; those beyond it are drawn anew every frame, batch by batch [MiB]",
        range: Some((16.0, 65536.0)),
    },
    Field {
        name: "rasterizer",
        summary: "who draws depth maps: hardware, compute (for small triangles), or auto",
        range: None,
    },
    Field {
        name: "caster-detail",
        summary: "part of the casters' triangles in depth maps: below 1, meshes are simplified",
        range: Some((0.0, 1.0)),
    },
];

/// Image-based lighting.
#[derive(Debug)]
pub struct ImageBasedLighting {
    settings: Settings,
    decomposition: Decomposition,
    /// Of the environment's texels at a version, with settings.
    domains: Option<(u64, Settings, Vec<Domain>)>,
    batches: Batches,
    /// Largest side of an atlas (texels).
    atlas_side: u32,
    /// For [`Reflectivity::Ratio`], once it was asked for.
    prefiltered: Option<Prefiltered>,
    made: Option<(Versions, Settings)>,
}

impl ImageBasedLighting {
    /// Compiles the technique's passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let settings = Settings::default();
        Ok(Self {
            decomposition: Decomposition::new(gpu, scene)?,
            domains: None,
            batches: Batches::new(gpu, scene, settings.reflectivity)?,
            atlas_side: ATLAS_SIDE,
            prefiltered: None,
            settings,
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

    /// Each domain that has light, in world space, and what its depth map sees.
    fn directions(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
    ) -> Result<(Vec<gpu::Direction>, Vec<DepthViewSpec>), GpuError> {
        let side = self.settings.resolution;
        let Some(environment) = &scene.environment else {
            return Ok(Default::default());
        };
        let world_from_map = Mat3::from_rotation_y(environment.rotation);
        let domains = self.domains(frame, scene)?;
        let lit = domains.iter().filter_map(|domain| {
            let flux_density = domain.flux_density * environment.intensity;
            let toward = world_from_map * domain.toward;
            (flux_density != Vec3::ZERO).then(|| {
                let view = DepthViewSpec::fitted(-toward, &scene.bounds, side, GUTTER);
                let direction = gpu::Direction {
                    toward: toward.to_array(),
                    solid_angle: domain.lit_solid_angle,
                    flux_density: flux_density.to_array(),
                    texel: view.texel,
                };
                (direction, view)
            })
        });
        Ok(lit.unzip())
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
        _: &mut Lit<'_>,
    ) -> Result<(), GpuError> {
        let versions = Versions {
            lights: 0,
            ..scene.versions
        };
        let made = (versions, self.settings.clone());
        if self.made.as_ref() == Some(&made) {
            return Ok(());
        }
        let reflectivity = self.settings.reflectivity;
        if self.batches.reflectivity != reflectivity {
            self.batches = Batches::new(frame.gpu, scene, reflectivity)?;
        }
        if reflectivity != Reflectivity::Ratio {
            self.prefiltered = None;
        } else {
            let prefiltered = match self.prefiltered.take() {
                Some(prefiltered) => prefiltered,
                None => Prefiltered::new(frame.gpu, scene)?,
            };
            self.prefiltered.insert(prefiltered).generate(frame, scene);
        }
        let (directions, views) = self.directions(frame, scene)?;
        let maps = DepthMaps {
            atlas_side: self.atlas_side,
            memory: u64::from(self.settings.memory) << 20,
            drawing: DepthDrawing {
                rasterizer: self.settings.rasterizer,
                caster_detail: self.settings.caster_detail,
            },
        };
        self.batches
            .generate(frame, scene, &directions, &views, &maps)?;
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
        let Some(prefiltered) = &mut self.prefiltered else {
            return self.batches.gather(frame, scene, points, target);
        };
        let sums = prefiltered.begin(frame, points, target)?;
        self.batches.gather(frame, scene, points, &sums)?;
        prefiltered.apply(frame, scene, points, target)?;
        Ok(())
    }

    fn maps(&self) -> Vec<Map> {
        let atlas = self.batches.atlas().map(|atlas| &atlas.texture);
        [
            ("image-based-lighting.atlas", atlas),
            ("image-based-lighting.domains", self.decomposition.owners()),
        ]
        .into_iter()
        .filter_map(|(name, texture)| {
            Some(Map {
                name: name.into(),
                texels: Texels::Texture(texture?.clone()),
            })
        })
        .collect()
    }
}
