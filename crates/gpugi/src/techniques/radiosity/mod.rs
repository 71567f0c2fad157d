//! Radiosity: light that diffuse surfaces reflect after other diffuse surfaces did, stored in the texels of an atlas
//! (tutorial section 6.1).
//!
//! Generate: earlier techniques light the atlas's texels; from that direct light a stochastic iteration, a few steps
//! per frame, finds the indirect light as the average of its iterates. Gather: looks up the irradiance at a point's
//! place in the atlas. docs/techniques/radiosity.md.

mod choosing;
mod default_set;
pub(crate) mod gpu;
mod shooting;
mod solution;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use gpugi_scene::Atlas;
use serde::{Deserialize, Serialize};

use super::{
    Cost, Earlier, Generated, Info, Inspection, Needs, OwnPoints, Plan, Registration, Resume, Role,
    Technique,
};
use crate::capture::atlas::TexelGather;
use crate::capture::{Receiver, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::light_paths::{LightClass, LightPaths, caustic_depth, overlap};
use crate::scene::{Claims, GpuScene, Versions};
use crate::settings::SettingSet;
use crate::shader;
use shooting::Batch;
use solution::Kernels;
pub use solution::Solution;

/// Name, summary, source and light paths of the technique.
pub const INFO: Info = Info {
    name: "radiosity",
    summary: "indirect light between diffuse surfaces, kept in the texels of an atlas",
    source: "tutorial section 6.1; Szirmay-Kalos 1999; Barsi et al. 2005",
    paths: &[
        LightPaths::new(LightClass::Punctual, "LS*D[DGS]*DE"),
        LightPaths::new(LightClass::Area, "LS*D[DGS]*DE"),
        LightPaths::new(LightClass::Environment, BETWEEN_ALL[0]),
    ],
    role: Role::Indirect,
    needs: Needs::TEXELS,
    cost: Cost::Picture,
    lights_points: OwnPoints::TowardEye,
    ..Info::BASE
};

/// Its entry in the registry.
pub const REGISTRATION: Registration = Registration {
    info: &INFO,
    fields: Settings::fields,
    make: |_, _| Ok(Box::new(Radiosity::default())),
    suits: default_set::suits,
    settings: default_set::settings,
};

/// Most texels per dispatch, so that none keeps a GPU busy for long.
const MOST_TEXELS: u32 = 1 << 20;

/// Light paths that it adds beside the direct light of other techniques, and those that it adds alone: between diffuse
/// surfaces only, and by way of mirrors, glass and gloss, over which rays are followed.
const BETWEEN_DIFFUSE: [&str; 2] = ["LDD+E", "LD+E"];
const BETWEEN_ALL: [&str; 2] = ["LD[DGS]*DE", "L(D[DGS]*)?DE"];

crate::choices! {
    /// How an iterate is computed.
    pub enum Mode {
        /// Every texel traces rays.
        Rays = "rays",
        /// Some texels shoot the power of all texels through hemicubes.
        Shooting = "shooting",
    }
}

crate::settings! {
    /// Settings of radiosity.
    pub struct Settings {
        /// How an iterate is computed: rays, every texel traces rays; shooting, some texels shoot the power of all
        /// texels through hemicubes.
        pub mode: Mode = Mode::Rays => any(),
        /// Side of the atlas's pages.
        pub resolution: u32 = 512 => in_range(16.0, 8192.0).unit("texels"),
        /// Texels per metre, on as many pages as needed; 0: as many texels as fit on one page.
        pub density: f32 = 0.0 => in_range(0.0, 1e6).unit("1/m"),
        /// Rays per texel and step, for mode=rays.
        pub rays: u32 = 4 => in_range(1.0, 64.0),
        /// Additional light-sampled rays per texel and step, aimed at texels chosen by their power, at most as many as
        /// rays; 0: none; for mode=rays.
        pub light_sampled_rays: u32 = 1 => in_range(0.0, 64.0),
        /// Texels that shoot per step, for mode=shooting.
        pub shooters: u32 = 16 => in_range(1.0, 256.0),
        /// Side of their hemicubes.
        pub hemicube_resolution: u32 = 256 => in_range(16.0, 1024.0).unit("texels"),
        /// Steps of the iteration per frame.
        pub steps: u32 = 1 => in_range(1.0, 256.0),
        /// Steps that count; a still scene's light is final after these and the dropped ones.
        pub iterations: u32 = 256 => in_range(1.0, 65_536.0),
        /// First steps, which are dropped, so that light has spread this often before iterates count.
        pub burn_in: u32 = 8 => in_range(0.0, 256.0),
    }
}

/// Direct light that no technique before radiosity adds, so that it starts in the texels themselves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Own {
    emission: bool,
    environment: bool,
}

/// Radiosity.
#[derive(Debug)]
pub struct Radiosity {
    settings: Settings,
    own: Own,
    made: Option<LitTexels>,
    most_texels: u32,
}

/// What of a scene decides how the passes are compiled.
fn compiled_for(scene: &GpuScene) -> [bool; 6] {
    let [has_alpha, transmits, has_spheres] = scene.ray_features();
    let is_see_through = scene.has_see_through(Claims::SHADOW);
    let has_media = !scene.media.is_empty();
    [
        has_alpha,
        transmits,
        has_spheres,
        scene.has_gloss(),
        is_see_through,
        has_media,
    ]
}

/// The light of a scene, and what it was computed for.
#[derive(Debug)]
struct LitTexels {
    atlas: Arc<Atlas>,
    /// What of the scene the passes were compiled for.
    compiled_for: [bool; 6],
    kernels: Kernels,
    solution: Solution,
    gather: TexelGather,
    lit: Option<LitAs>,
    /// What the latest frame's light was, whose iteration may have yet to begin.
    seen: Option<LitAs>,
    /// Parts of the atlas whose direct light is that of `lit`.
    lit_parts: usize,
    /// Whether iterates were averaged once, so that the light can be gathered.
    is_averaged: bool,
    revision: u64,
}

/// What [`Technique::save`] stores.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Saved {
    /// Revision of the direct light.
    revision_of_light: u64,
    /// Revision of this light.
    revision: u64,
    iterates: u32,
    light: Vec<u32>,
}

/// Everything that direct light and its reflections depend on.
#[derive(Debug, Clone, PartialEq)]
struct LitAs {
    versions: Versions,
    settings: u64,
    revision: u64,
    own: Own,
}

/// Error for saved progress that does not fit.
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

    /// Begins the iteration from the present direct light.
    fn begin(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        view: &View,
        solution: &mut Solution,
        kernels: &Kernels,
    ) -> Result<(), GpuError> {
        let work = gpu::Work {
            rays: self.settings.rays,
            light_sampled: self.settings.light_sampled_rays,
            burn_in: self.settings.burn_in,
            seed: view.uniform.seed,
            with_environment: u32::from(self.own.environment && scene.environment.is_some()),
            with_emission: u32::from(self.own.emission),
            ..bytemuck::Zeroable::zeroed()
        };
        solution.begin(frame, kernels, &work)
    }

    /// Number and resolution of shooters; `None` to trace rays.
    fn batch(&self) -> Option<Batch> {
        let batch = Batch {
            shooters: self.settings.shooters,
            side: self.settings.hemicube_resolution,
        };
        (self.settings.mode == Mode::Shooting).then_some(batch)
    }

    fn make(&self, gpu: &Gpu, scene: &GpuScene, atlas: Arc<Atlas>) -> Result<LitTexels, GpuError> {
        let kernels = Kernels::new(gpu, scene)?;
        let solution = Solution::new(gpu, scene, &kernels, &atlas, self.most_texels)?;
        let kept = [
            ("atlas", solution.lookup.words.as_entire_binding()),
            (
                "irradiance",
                solution.irradiance.radiance.as_entire_binding(),
            ),
        ];
        let gather = shader!("capture.atlas.gather");
        Ok(LitTexels {
            atlas,
            compiled_for: compiled_for(scene),
            gather: TexelGather::new(gpu, scene, &gather, &[], &kept)?,
            kernels,
            solution,
            lit: None,
            seen: None,
            lit_parts: 0,
            is_averaged: false,
            revision: 0,
        })
    }
}

impl LitTexels {
    /// Whether all direct light is up to date.
    fn is_lit(&self) -> bool {
        self.lit_parts == self.solution.parts()
    }

    /// Whether the iteration begins again because of the light `now`. `has_first`: its first light was averaged;
    /// `is_final`: light of earlier techniques is.
    fn begins(&self, now: &LitAs, has_first: bool, is_final: bool) -> bool {
        let Some(lit) = &self.lit else { return true };
        let revision = lit.revision;
        // Small budgets would never see first light if changes came faster. And to begin at each improvement of other
        // light would waste work.
        let has_only_improved = LitAs {
            revision,
            ..now.clone()
        } == *lit;
        lit != now && has_first && (is_final || !has_only_improved)
    }
}

impl Technique for Radiosity {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn plan(&mut self, scene: &GpuScene, covered: &[LightPaths], _: &[Claims]) -> Plan {
        let is_covered = |class| overlap(covered, &[LightPaths::new(class, "LDE")]).is_some();
        self.own = Own {
            emission: !is_covered(LightClass::Area),
            // Hemicubes do not contain the sky.
            environment: self.settings.mode == Mode::Rays && !is_covered(LightClass::Environment),
        };
        // Hemicubes find no way over mirrors.
        let [indirect, all] = match self.settings.mode {
            Mode::Rays if scene.has_gloss() => BETWEEN_ALL,
            Mode::Rays | Mode::Shooting => BETWEEN_DIFFUSE,
        };
        let mut paths = Vec::new();
        for (class, is_own) in [
            (LightClass::Punctual, false),
            (LightClass::Area, self.own.emission),
            (LightClass::Environment, self.own.environment),
        ] {
            if is_own {
                paths.push(LightPaths::new(class, all));
            } else if is_covered(class) {
                paths.push(LightPaths::new(class, indirect));
            }
            let caustics = caustic_depth(covered, class);
            if caustics > 0 {
                let light = LightPaths::new(class, indirect);
                paths.push(light.after(&format!("S{{1,{caustics}}}")));
            }
        }
        Plan::adding(paths, scene)
    }

    fn settings(&self) -> &dyn SettingSet {
        &self.settings
    }

    fn settings_mut(&mut self) -> &mut dyn SettingSet {
        &mut self.settings
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        view: &View,
        earlier: &mut Earlier<'_>,
    ) -> Result<Generated, GpuError> {
        let Settings {
            resolution,
            density,
            ..
        } = self.settings;
        let atlas = scene.atlas(frame.gpu, INFO.name, resolution, density, gpu::TEXEL_BYTES)?;
        let Some(atlas) = atlas else {
            return Ok(Generated::without_atlas(scene));
        };
        let is_made = |made: &LitTexels| {
            made.compiled_for == compiled_for(scene) && Arc::ptr_eq(&made.atlas, &atlas)
        };
        let mut made = match self.made.take().filter(is_made) {
            Some(made) => made,
            None => {
                let made = self.make(frame.gpu, scene, atlas)?;
                if frame.awaits_shaders() {
                    self.made = Some(made);
                    return Ok(Generated::WITHOUT_SHADERS);
                }
                made
            }
        };
        // Only the first time: while objects move, points would never be tested.
        let is_sliced = earlier.is_limited() && !made.is_averaged;
        let budget = is_sliced.then_some(&mut *earlier);
        if !made.solution.capture(frame, scene, budget)? {
            self.made = Some(made);
            return Ok(Generated {
                revision: 0,
                progress: 0.0,
                pending: Some("the texels"),
            });
        }
        let lit_as = LitAs {
            versions: scene.versions,
            settings: earlier.settings_version,
            revision: earlier.revision,
            own: self.own,
        };
        let Settings {
            steps,
            iterations,
            burn_in,
            ..
        } = self.settings;
        let is_fresh = made.seen.as_ref() != Some(&lit_as);
        if is_fresh {
            made.seen = Some(lit_as.clone());
        }
        let has_first = made.is_lit() && made.solution.iterates > burn_in;
        if made.begins(&lit_as, has_first, earlier.is_final) {
            made.solution.shoot(frame.gpu, scene, self.batch())?;
            if frame.awaits_shaders() {
                self.made = Some(made);
                return Ok(Generated::WITHOUT_SHADERS);
            }
            // Where other light led must not show in the light of a still scene, or budgets would.
            let before = made.lit.as_ref().map(|lit| lit.revision);
            if before.is_some_and(|before| before != lit_as.revision) {
                made.solution.forget(frame);
            }
            made.lit = Some(lit_as.clone());
            made.lit_parts = 0;
            made.solution.iterates = 0;
        }
        while !made.is_lit() && earlier.may_step() {
            let fits = |points| earlier.gather_work(points) <= earlier.left();
            let Some((receiver, parts)) = made.solution.next_direct(made.lit_parts, fits) else {
                break;
            };
            earlier.gather(frame, scene, &receiver, self.own.emission)?;
            made.lit_parts += parts;
            if made.is_lit() {
                self.begin(frame, scene, view, &mut made.solution, &made.kernels)?;
            }
        }
        let all = burn_in + iterations;
        let before = made.solution.iterates;
        let most = (before.max(burn_in) + steps).min(all);
        let mut is_first = true;
        while made.is_lit() && made.solution.iterates < most && earlier.may_step() {
            let solution = &mut made.solution;
            let part = solution.next_part(earlier.left());
            let is_whole = part.len() as u32 == solution.texel_count();
            if !is_whole && !is_first {
                break;
            }
            earlier.count(solution.iterate(frame, scene, &made.kernels, part));
            if !is_whole {
                break;
            }
            is_first = false;
        }
        // Dropped iterates do not count.
        let [before, counted] =
            [before, made.solution.iterates].map(|one| one.saturating_sub(burn_in));
        if counted > before {
            made.solution.average(frame, &made.kernels)?;
            made.is_averaged = true;
            // Dependents need not follow every step.
            let is_step = before == 0 || counted.ilog2() > before.ilog2() || counted == iterations;
            made.revision += u64::from(is_step && !is_fresh);
        }
        let is_stale = made.lit.as_ref() != Some(&lit_as);
        let generated = Generated {
            revision: made.revision,
            // Below 1 while it is of other light.
            progress: made.solution.iterates as f32 / (all + u32::from(is_stale)) as f32,
            pending: (!made.is_averaged).then_some("the first light between surfaces"),
        };
        self.made = Some(made);
        Ok(generated)
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        let Some(made) = &mut self.made else {
            return Ok(());
        };
        let (name, texels) = ("radiosity.gather", &made.solution.texels);
        made.gather
            .record(frame, name, scene, Some(texels), receiver)
    }

    fn inspect(&self) -> Inspection {
        self.solution()
            .map_or_else(Inspection::default, |solution| Inspection {
                maps: solution.maps(),
                work_bytes: solution.work_bytes(),
                warnings: Vec::new(),
            })
    }

    fn resumable(&mut self) -> Option<&mut dyn Resume> {
        Some(self)
    }
}

impl Resume for Radiosity {
    fn save(&self, gpu: &Gpu) -> Result<Option<Vec<u8>>, GpuError> {
        let Some(made) = &self.made else {
            return Ok(None);
        };
        // Dropped iterates are soon made again.
        let has_light = made.solution.iterates > self.settings.burn_in;
        let Some(lit) = made.lit.as_ref().filter(|_| has_light) else {
            return Ok(None);
        };
        let saved = Saved {
            revision_of_light: lit.revision,
            revision: made.revision,
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
        let light = made.lit.as_ref().map(|lit| lit.revision);
        if light != Some(saved.revision_of_light) || !made.is_lit() {
            return Ok(false);
        }
        let Settings {
            burn_in,
            iterations,
            ..
        } = self.settings;
        if !(burn_in + 1..=burn_in + iterations).contains(&saved.iterates) {
            return Err(unfit("another number of iterates"));
        }
        let solution = &mut made.solution;
        if !solution.resume(gpu, saved.iterates, &saved.light) {
            return Err(unfit("other texels, or light that is not finite"));
        }
        let mut frame = Frame::new(gpu, false);
        solution.average(&mut frame, &made.kernels)?;
        frame.submit()?;
        made.is_averaged = true;
        // A file may hold any number, and counters are added to it.
        made.revision = saved.revision.min(u32::MAX.into());
        Ok(true)
    }
}
