//! Radiosity: diffuse light that was reflected by diffuse surfaces before, kept in the texels of an atlas (tutorial section 6.1).
//!
//! Generate: the techniques before it light the atlas's texels; from that direct light a stochastic iteration finds the indirect one, a few steps a
//! frame, as the average of the iterates. Gather: looks the irradiance up where a point lies in the atlas. docs/techniques/radiosity.md.

mod choosing;
pub(crate) mod gpu;
mod shooting;
mod solution;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use gpugi_scene::Atlas;
use serde::{Deserialize, Serialize};

use super::{Field, Info, Lit, Map, SettingError, Technique, settings};
use crate::capture::atlas::TexelGather;
use crate::capture::{SurfacePoints, Target, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::light_paths::{LightClass, LightPaths, overlap};
use crate::scene::{Claims, GpuScene, Versions};
use crate::shader;
use shooting::Batch;
use solution::Kernels;
pub use solution::Solution;

/// What radiosity says of itself.
pub const INFO: Info = Info {
    name: "radiosity",
    summary: "indirect light between diffuse surfaces, kept in the texels of an atlas",
    source: "tutorial section 6.1; Szirmay-Kalos 1999; Barsi et al. 2005",
    paths: &[
        LightPaths::new(LightClass::Punctual, INDIRECT),
        LightPaths::new(LightClass::Area, INDIRECT),
        LightPaths::new(LightClass::Environment, INDIRECT),
    ],
    // Unwrapping may take minutes: nobody should wait for that unasked.
    suits: |_| false,
    keeps_texels: true,
};

/// Texels that one dispatch works at, so that none keeps a GPU busy for long.
const MOST_TEXELS: u32 = 1 << 20;

/// What it adds to the direct light of others, and what it adds alone.
const INDIRECT: &str = "LDD+E";
const ALL: &str = "LD+E";

/// How an iterate is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Every texel follows rays.
    Rays,
    /// Some texels shoot the power of all through hemicubes.
    Shooting,
}

/// Settings of radiosity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// How an iterate is made.
    pub mode: Mode,
    /// Side of the atlas's pages (texels).
    pub resolution: u32,
    /// Texels per metre (1/m), in as many pages as it takes; 0: as many as one page holds.
    pub density: f32,
    /// Rays of a texel in a step.
    pub rays: u32,
    /// Rays, besides, that are aimed at texels chosen by their power, at most as many as those; 0: none.
    pub aimed_rays: u32,
    /// Texels that shoot in a step.
    pub shooters: u32,
    /// Side of their hemicubes (texels).
    pub hemicube_resolution: u32,
    /// Steps of the iteration in a frame.
    pub steps: u32,
    /// Steps after which a still scene's light is final.
    pub iterations: u32,
    /// First steps that are dropped: light has spread so often before iterates count.
    pub burn_in: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            mode: Mode::Rays,
            resolution: 512,
            density: 0.0,
            rays: 4,
            aimed_rays: 1,
            shooters: 16,
            hemicube_resolution: 256,
            steps: 1,
            iterations: 256,
            burn_in: 8,
        }
    }
}

const FIELDS: &[Field] = &[
    Field {
        name: "mode",
        summary: "rays: every texel follows rays; shooting: some texels shoot the power of all through hemicubes",
        range: None,
    },
    Field {
        name: "resolution",
        summary: "side of the atlas's pages [texels]",
        range: Some((16.0, 8192.0)),
    },
    Field {
        name: "density",
        summary: "texels per metre, in as many pages as it takes; 0: as many as one page holds [1/m]",
        range: Some((0.0, 1e6)),
    },
    Field {
        name: "rays",
        summary: "rays of a texel in a step, of mode=rays",
        range: Some((1.0, 64.0)),
    },
    Field {
        name: "aimed-rays",
        summary: "rays, besides, that are aimed at texels chosen by their power, at most as many as those; 0: none, of mode=rays",
        range: Some((0.0, 64.0)),
    },
    Field {
        name: "shooters",
        summary: "texels that shoot in a step, of mode=shooting",
        range: Some((1.0, 256.0)),
    },
    Field {
        name: "hemicube-resolution",
        summary: "side of their hemicubes [texels]",
        range: Some((16.0, 1024.0)),
    },
    Field {
        name: "steps",
        summary: "steps of the iteration in a frame",
        range: Some((1.0, 256.0)),
    },
    Field {
        name: "iterations",
        summary: "steps after which a still scene's light is final",
        range: Some((1.0, 65_536.0)),
    },
    Field {
        name: "burn-in",
        summary: "first steps that are dropped, so that light has spread so often before iterates count",
        range: Some((0.0, 256.0)),
    },
];

/// Direct light that nobody before radiosity adds, so that it begins in texels itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Own {
    emission: bool,
    environment: bool,
}

/// Radiosity.
#[derive(Debug)]
pub struct Radiosity {
    settings: Settings,
    paths: Vec<LightPaths>,
    own: Own,
    made: Option<Made>,
    most_texels: u32,
}

/// The light of a scene, and what it was found for.
#[derive(Debug)]
struct Made {
    atlas: Arc<Atlas>,
    /// [`GpuScene::passages`].
    passages: [bool; 2],
    kernels: Kernels,
    solution: Solution,
    gather: TexelGather,
    lit: Option<LitAs>,
    refinements: u64,
}

/// What [`Technique::save`] gives.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Saved {
    /// How often the direct light had become finer.
    refinements_of_light: u64,
    /// How often this light had.
    refinements: u64,
    iterates: u32,
    light: Vec<u32>,
}

/// What direct light and its reflections depend on.
#[derive(Debug, Clone, PartialEq)]
struct LitAs {
    versions: Versions,
    settings: u64,
    refinements: u64,
    own: Own,
}

/// Of what was saved for something else.
fn unfit(reason: impl std::fmt::Display) -> GpuError {
    GpuError::Pass {
        pass: INFO.name.into(),
        reason: format!("what was saved does not fit: {reason}"),
    }
}

impl Default for Radiosity {
    fn default() -> Self {
        Self {
            settings: Settings::default(),
            paths: INFO.paths.to_vec(),
            own: Own::default(),
            made: None,
            most_texels: MOST_TEXELS,
        }
    }
}

impl Radiosity {
    /// The light in texels, once generated.
    pub fn solution(&self) -> Option<&Solution> {
        self.made.as_ref().map(|made| &made.solution)
    }

    fn make(&self, gpu: &Gpu, scene: &GpuScene, atlas: Arc<Atlas>) -> Result<Made, GpuError> {
        let kernels = Kernels::new(gpu, scene)?;
        let solution = Solution::new(gpu, scene, &kernels, &atlas, self.most_texels)?;
        let kept = [
            ("atlas", solution.lookup.words.as_entire_binding()),
            (
                "irradiance",
                solution.irradiance.radiance.as_entire_binding(),
            ),
        ];
        let gather = shader!("techniques.radiosity.gather");
        Ok(Made {
            atlas,
            passages: scene.passages(),
            gather: TexelGather::new(gpu, scene, &gather, &[], &kept)?,
            kernels,
            solution,
            lit: None,
            refinements: 0,
        })
    }
}

impl Technique for Radiosity {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn paths(&self) -> &[LightPaths] {
        &self.paths
    }

    fn claim(&mut self, scene: &GpuScene, covered: &[LightPaths]) -> Vec<Claims> {
        let is_covered = |class| overlap(covered, &[LightPaths::new(class, "LDE")]).is_some();
        self.own = Own {
            emission: !is_covered(LightClass::Area),
            // Hemicubes hold no sky.
            environment: self.settings.mode == Mode::Rays && !is_covered(LightClass::Environment),
        };
        self.paths.clear();
        for (class, is_own) in [
            (LightClass::Punctual, false),
            (LightClass::Area, self.own.emission),
            (LightClass::Environment, self.own.environment),
        ] {
            if is_own {
                self.paths.push(LightPaths::new(class, ALL));
            } else if is_covered(class) {
                self.paths.push(LightPaths::new(class, INDIRECT));
            }
        }
        vec![Claims::NONE; scene.objects.len()]
    }

    fn refinements(&self) -> u64 {
        self.made.as_ref().map_or(0, |made| made.refinements)
    }

    fn progress(&self) -> f32 {
        let done = self.made.as_ref().map_or(0, |made| made.solution.iterates);
        done as f32 / (self.settings.burn_in + self.settings.iterations) as f32
    }

    fn save(&self, gpu: &Gpu) -> Result<Option<Vec<u8>>, GpuError> {
        let Some(made) = &self.made else {
            return Ok(None);
        };
        let Some(lit) = &made.lit else {
            return Ok(None);
        };
        let saved = Saved {
            refinements_of_light: lit.refinements,
            refinements: made.refinements,
            iterates: made.solution.iterates,
            light: made.solution.light(gpu)?,
        };
        postcard::to_allocvec(&saved).map(Some).map_err(unfit)
    }

    fn resume(&mut self, gpu: &Gpu, saved: &[u8]) -> Result<bool, GpuError> {
        let saved: Saved = postcard::from_bytes(saved).map_err(unfit)?;
        let Some(made) = &mut self.made else {
            return Ok(false);
        };
        let light = made.lit.as_ref().map(|lit| lit.refinements);
        if light != Some(saved.refinements_of_light) {
            return Ok(false);
        }
        // The first frame drops iterates and makes one that counts.
        let Settings {
            burn_in,
            iterations,
            ..
        } = self.settings;
        if !(burn_in + 1..=burn_in + iterations).contains(&saved.iterates) {
            return Err(unfit("another number of iterates"));
        }
        let solution = &mut made.solution;
        if !solution.resume(gpu, &made.kernels, saved.iterates, &saved.light)? {
            return Err(unfit("another number of texels"));
        }
        made.refinements = saved.refinements;
        Ok(true)
    }

    fn lights_own_points(&self) -> bool {
        true
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
        view: &View,
        lit: &mut Lit<'_>,
    ) -> Result<(), GpuError> {
        let Settings {
            resolution,
            density,
            ..
        } = self.settings;
        let atlas = scene.atlas(frame.gpu, INFO.name, resolution, density, gpu::TEXEL_BYTES)?;
        let is_made =
            |made: &Made| made.passages == scene.passages() && Arc::ptr_eq(&made.atlas, &atlas);
        let mut made = match self.made.take().filter(is_made) {
            Some(made) => made,
            None => self.make(frame.gpu, scene, atlas)?,
        };
        made.solution.capture(frame, scene)?;
        let lit_as = LitAs {
            versions: scene.versions,
            settings: lit.version,
            refinements: lit.refinements(),
            own: self.own,
        };
        let Settings {
            steps,
            iterations,
            burn_in,
            ..
        } = self.settings;
        let is_fresh = made.lit.as_ref() != Some(&lit_as);
        if is_fresh {
            made.lit = Some(lit_as);
            for (points, direct) in made.solution.direct() {
                lit.gather(frame, scene, points, direct, self.own.emission)?;
            }
            let work = gpu::Work {
                rays: self.settings.rays,
                aimed: self.settings.aimed_rays,
                burn_in,
                seed: view.uniform.seed,
                with_environment: u32::from(self.own.environment && scene.environment.is_some()),
                ..bytemuck::Zeroable::zeroed()
            };
            let batch = Batch {
                shooters: self.settings.shooters,
                side: self.settings.hemicube_resolution,
            };
            let batch = (self.settings.mode == Mode::Shooting).then_some(batch);
            let solution = &mut made.solution;
            solution.begin(frame, scene, &made.kernels, &work, batch)?;
        }
        let all = burn_in + iterations;
        if made.solution.iterates < all {
            let first = if is_fresh { burn_in } else { 0 };
            let now = (first + steps).min(all - made.solution.iterates);
            made.solution.iterate(frame, scene, &made.kernels, now)?;
            // Whoever shows the light need not follow every step.
            let counted = made.solution.iterates - burn_in;
            let was = counted - now.min(counted);
            let is_step =
                counted.ilog2() > was.checked_ilog2().unwrap_or(0) || made.solution.iterates == all;
            made.refinements += u64::from(is_step && !is_fresh);
        }
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
        let Some(made) = &mut self.made else {
            return Ok(());
        };
        let (name, texels) = ("radiosity.gather", &made.solution.texels);
        made.gather
            .record(frame, name, scene, texels, points, target)
    }

    fn maps(&self) -> Vec<Map> {
        self.solution().map_or(Vec::new(), Solution::maps)
    }

    fn work_bytes(&self) -> u64 {
        self.solution().map_or(0, Solution::work_bytes)
    }
}
