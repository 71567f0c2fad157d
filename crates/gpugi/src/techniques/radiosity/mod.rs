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

use gpugi_scene::Atlas;
use serde::{Deserialize, Serialize};

use super::{
    Cost, Earlier, Generated, Info, Inspection, LightState, Needs, OwnPoints, Plan, Registration,
    Resume, Role, Slice, Technique, Unready, atlas,
};
use crate::capture::{Receiver, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::light_paths::{LightClass, LightPaths, caustic_depth, overlap};
use crate::scene::{Claims, GpuScene};
use crate::settings::SettingSet;
use crate::stage::{Same, Stage};
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
struct OwnLight {
    emission: bool,
    environment: bool,
}

/// Radiosity.
#[derive(Debug)]
pub struct Radiosity {
    settings: Settings,
    own: OwnLight,
    /// In an atlas, by what of the scene the passes are compiled for.
    texels: Stage<(Same<Atlas>, [bool; 6]), LitTexels>,
    most_texels: u32,
}

/// What of a scene decides how the passes are compiled.
fn features(scene: &GpuScene) -> [bool; 6] {
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

/// The light of a scene in texels.
#[derive(Debug)]
struct LitTexels {
    kernels: Kernels,
    solution: Solution,
    /// Of what other techniques and [`OwnLight`] light the iterates are.
    light: Stage<(LightState, OwnLight)>,
    /// Parts of the atlas whose direct light is that.
    lit_parts: usize,
    /// Whether iterates were averaged once, so that the light can be gathered.
    is_averaged: bool,
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

impl Default for Radiosity {
    fn default() -> Self {
        Self {
            settings: Settings::default(),
            own: OwnLight::default(),
            texels: Stage::default(),
            most_texels: MOST_TEXELS,
        }
    }
}

impl Radiosity {
    /// The light in texels, once generated.
    pub fn solution(&self) -> Option<&Solution> {
        self.texels.get().map(|texels| &texels.solution)
    }
}

impl Settings {
    /// Number and resolution of shooters; `None` to trace rays.
    fn batch(&self) -> Option<Batch> {
        let batch = Batch {
            shooters: self.shooters,
            side: self.hemicube_resolution,
        };
        (self.mode == Mode::Shooting).then_some(batch)
    }
}

impl LitTexels {
    fn new(gpu: &Gpu, scene: &GpuScene, atlas: &Atlas, most_texels: u32) -> Result<Self, GpuError> {
        Ok(Self {
            kernels: Kernels::new(gpu, scene)?,
            solution: Solution::new(gpu, scene, atlas, most_texels)?,
            light: Stage::default(),
            lit_parts: 0,
            is_averaged: false,
        })
    }

    /// Whether all direct light is up to date.
    fn is_lit(&self) -> bool {
        self.lit_parts == self.solution.parts()
    }

    /// Finds the texels' points. Only the first time in slices: while objects move, points would never be tested.
    fn capture(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        budget: &mut Slice,
    ) -> Result<(), Unready> {
        let is_sliced = budget.is_limited() && !self.is_averaged;
        match self
            .solution
            .capture(frame, scene, is_sliced.then_some(budget))?
        {
            true => Ok(()),
            false => Err(Unready::waits_for("the texels")),
        }
    }

    /// Begins again for the light `now`. But small budgets would never see first light if changes came faster than
    /// `burn_in` iterates, and to begin at each improvement of other light, before it `is_final`, would waste work.
    fn follow(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        now: (LightState, OwnLight),
        is_final: bool,
        settings: &Settings,
    ) -> Result<(), Unready> {
        self.light.ask(now);
        let before = self.light.begun();
        let has_only_improved = before.is_some_and(|(light, own)| {
            (light.however_refined(), *own) == (now.0.however_refined(), now.1)
        });
        let has_first = self.is_lit() && self.solution.iterates > settings.burn_in;
        let may_begin = has_first && (is_final || !has_only_improved);
        if self.light.is_current() || (before.is_some() && !may_begin) {
            return Ok(());
        }
        self.solution.shoot(frame, scene, settings.batch())?;
        // Where other light led must not show in the light of a still scene, or budgets would.
        if before.is_some_and(|(light, _)| light.revision != now.0.revision) {
            self.solution.forget(frame);
        }
        self.light.begin();
        self.lit_parts = 0;
        self.solution.iterates = 0;
        Ok(())
    }

    /// Lights the texels by other techniques, part by part, and then begins the iteration: `work`.
    fn light(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        earlier: &mut Earlier<'_>,
        own: OwnLight,
        work: &gpu::Work,
    ) -> Result<(), GpuError> {
        while !self.is_lit() && earlier.budget.may_step() {
            let fits = |points| earlier.light.work(points, false) <= earlier.budget.left();
            let Some((receiver, parts)) = self.solution.next_direct(self.lit_parts, fits) else {
                break;
            };
            earlier.gather(frame, scene, &receiver, own.emission)?;
            self.lit_parts += parts;
            if self.is_lit() {
                self.solution.begin(frame, &self.kernels, work)?;
            }
        }
        Ok(())
    }

    /// Takes steps of the iteration, and averages what counts.
    fn iterate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        budget: &mut Slice,
        settings: &Settings,
    ) -> Result<(), GpuError> {
        let Settings {
            steps,
            iterations,
            burn_in,
            ..
        } = *settings;
        let before = self.solution.iterates;
        let most = (before.max(burn_in) + steps).min(burn_in + iterations);
        let mut is_first = true;
        while self.is_lit() && self.solution.iterates < most && budget.may_step() {
            let solution = &mut self.solution;
            let part = solution.next_part(budget.left());
            let is_whole = part.len() as u32 == solution.texel_count();
            if !is_whole && !is_first {
                break;
            }
            budget.count(solution.iterate(frame, scene, &self.kernels, part)?);
            if !is_whole {
                break;
            }
            is_first = false;
        }
        // Dropped iterates do not count.
        let [before, counted] =
            [before, self.solution.iterates].map(|count| count.saturating_sub(burn_in));
        if counted > before {
            self.solution.average(frame, &self.kernels)?;
            self.is_averaged = true;
            // Dependents need not follow every step.
            if before == 0 || counted.ilog2() > before.ilog2() || counted == iterations {
                self.light.improve();
            }
        }
        Ok(())
    }
}

impl Technique for Radiosity {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn plan(&mut self, scene: &GpuScene, covered: &[LightPaths], _: &[Claims]) -> Plan {
        let is_covered = |class| overlap(covered, &[LightPaths::new(class, "LDE")]).is_some();
        self.own = OwnLight {
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
    ) -> Result<Generated, Unready> {
        let (gpu, settings, own) = (frame.gpu, &self.settings, self.own);
        let size = (settings.resolution, settings.density);
        let atlas = atlas(gpu, scene, INFO.name, size, gpu::TEXEL_BYTES)?;
        let key = (Same(atlas.clone()), features(scene));
        let texels = self.texels.compiled(frame, key, |_| {
            LitTexels::new(gpu, scene, &atlas, self.most_texels)
        })?;
        texels.capture(frame, scene, &mut earlier.budget)?;
        let light = earlier.light.state(scene);
        texels.follow(frame, scene, (light, own), earlier.light.is_final, settings)?;
        let work = gpu::Work {
            rays: settings.rays,
            light_sampled: settings.light_sampled_rays,
            burn_in: settings.burn_in,
            seed: view.uniform.seed,
            with_environment: u32::from(own.environment && scene.environment.is_some()),
            with_emission: u32::from(own.emission),
            ..bytemuck::Zeroable::zeroed()
        };
        texels.light(frame, scene, earlier, own, &work)?;
        texels.iterate(frame, scene, &mut earlier.budget, settings)?;
        let all = settings.burn_in + settings.iterations;
        Ok(Generated {
            revision: texels.light.revision(),
            progress: texels.light.progress(texels.solution.iterates, all),
            pending: (!texels.is_averaged).then_some("the first light between surfaces"),
        })
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        let Some(solution) = self.solution() else {
            return Ok(());
        };
        let (name, texels) = ("radiosity.gather", &solution.texels);
        let found = (Some(&texels.capture), &texels.lookup.words);
        solution
            .irradiance
            .gather(frame, name, scene, receiver, found)
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
        let Some(texels) = self.texels.get() else {
            return Ok(None);
        };
        // Dropped iterates are soon made again.
        let has_light = texels.solution.iterates > self.settings.burn_in;
        let Some((light, _)) = texels.light.begun().filter(|_| has_light) else {
            return Ok(None);
        };
        let saved = Saved {
            revision_of_light: light.revision,
            revision: texels.light.revision(),
            iterates: texels.solution.iterates,
            light: texels.solution.light(gpu)?,
        };
        postcard::to_allocvec(&saved)
            .map(Some)
            .map_err(|error| INFO.unfit(error))
    }

    fn resume(&mut self, gpu: &Gpu, saved: &[u8]) -> Result<bool, GpuError> {
        let saved: Saved = postcard::from_bytes(saved).map_err(|error| INFO.unfit(error))?;
        let Some(texels) = self.texels.get_mut() else {
            return Ok(false);
        };
        let light = texels.light.begun().map(|(light, _)| light.revision);
        if light != Some(saved.revision_of_light) || !texels.is_lit() {
            return Ok(false);
        }
        let Settings {
            burn_in,
            iterations,
            ..
        } = self.settings;
        if !(burn_in + 1..=burn_in + iterations).contains(&saved.iterates) {
            return Err(INFO.unfit("another number of iterates"));
        }
        let solution = &mut texels.solution;
        if !solution.resume(gpu, saved.iterates, &saved.light) {
            return Err(INFO.unfit("other texels, or light that is not finite"));
        }
        let mut frame = Frame::new(gpu, false);
        solution.average(&mut frame, &texels.kernels)?;
        frame.submit()?;
        texels.is_averaged = true;
        texels.light.set_revision(saved.revision);
        Ok(true)
    }
}
