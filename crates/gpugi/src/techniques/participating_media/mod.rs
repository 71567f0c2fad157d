//! Participating media: multiple scattering in fog, smoke and clouds by an illumination network (tutorial section 7.4).
//!
//! Generate: media become particles. Each looks in D directions, and finds the next particle, a surface or the sky
//! there. Light that arrives at the particles spreads along these links, some iterations per frame. Gather: rays from
//! surfaces sum what particles send there, and rays from the eye what they scatter toward it, and dim what is behind.
//! docs/techniques/participating-media.md.

mod cells;
pub(crate) mod gpu;
mod network;
mod particles;
mod phase_matrix;
mod reflecting;
mod seen;
pub(super) mod sources;
#[cfg(test)]
mod tests;

use gpugi_scene::Bounds;

use super::{
    Earlier, Generated, Info, Inspection, Layer, LightState, Map, Needs, OwnPoints, Plan, Provided,
    Purpose, Registration, Role, Technique, Unready,
};
use crate::capture::{Output, Receiver, View};
use crate::gpu::{Frame, GpuError};
use crate::light_paths::{LightClass, LightPaths};
use crate::lights::gpu::LightSample;
use crate::lights::samples::{on_emitters, punctual};
use crate::scene::{Claims, GpuScene, Inputs, RayConstants, Versions, stand_apart};
use crate::settings::SettingSet;
use crate::stage::{Stage, shaders};
use network::{Kernels, Network, Shape};
use particles::{Particles, Placements};
use reflecting::Reflecting;
use seen::{How, Passes, SeenMedia};
use sources::MediaSources;

/// Name, summary, source and light paths of the technique.
pub const INFO: Info = Info {
    name: "participating-media",
    summary: "multiple scattering in fog, smoke and clouds, by links between particles",
    source: "tutorial section 7.4; Szirmay-Kalos, Sbert and Umenhoffer 2005",
    paths: &[
        LightPaths::new(LightClass::Punctual, "LV+[DG]?E"),
        LightPaths::new(LightClass::Area, "LV+[DG]?E"),
        LightPaths::new(LightClass::Environment, "LV+[DG]?E"),
    ],
    role: Role::Media,
    needs: Needs::RAYS,
    lights_points: OwnPoints::TowardEye,
    layer: Layer::Media,
    provides: &[Provided::MediaSources],
    ..Info::BASE
};

/// Its entry in the registry.
pub const REGISTRATION: Registration = Registration {
    info: &INFO,
    fields: Settings::fields,
    make: |_, _| Ok(Box::new(ParticipatingMedia::default())),
    suits: |occasion| {
        // Media are seen from somewhere; texels are not.
        let is_seen = occasion.purpose != Purpose::Bake && !occasion.scene.media.is_empty();
        is_seen.then(|| format!("{}, and media", occasion.has_lights(INFO.paths)))
    },
    settings: |occasion| {
        // Frames in motion average what neighbours see.
        if occasion.purpose == Purpose::LiveView {
            return vec![("steps", 16.to_string()), ("shadow-rays", 2.to_string())];
        }
        // Surfaces in fog would be lit by few bright rays: dots, unless there are very many samples.
        if occasion.purpose == Purpose::StillPicture && stand_apart(occasion.scene) {
            return vec![("light-surfaces", 4.to_string())];
        }
        Vec::new()
    },
};

/// The paths without surfaces that media light.
const SEEN_ALONE: [LightPaths; 3] = [
    LightPaths::new(LightClass::Punctual, "LV+E"),
    LightPaths::new(LightClass::Area, "LV+E"),
    LightPaths::new(LightClass::Environment, "LV+E"),
];

crate::choices! {
    /// How it is found which particle another one sees.
    pub enum Visibility {
        /// By rays through the particles' spheres.
        Rays = "rays",
        /// By depth peeling of the spheres in parallel views.
        Peel = "peel",
    }
}

crate::settings! {
    /// Settings of participating-media.
    pub struct Settings {
        /// Particles of all media together.
        pub particles: u32 = 1024 => in_range(16.0, 65536.0),
        /// Directions in which each particle sees others.
        pub directions: u32 = 128 => in_range(8.0, 512.0).power_of_two(),
        /// How it is found which particle another one sees.
        pub visibility: Visibility = Visibility::Rays => any(),
        /// Pixels per side of the views in which particles are peeled.
        pub window: u32 = 64 => in_range(8.0, 256.0),
        /// Iterations of the network per frame: in each, light spreads to the next particles.
        pub iterations: u32 = 1 => in_range(1.0, 64.0),
        /// Iterations after which the light of a still scene is final; 0: single scattering of lights alone.
        pub most_iterations: u32 = 64 => in_range(0.0, 1024.0),
        /// Points on each view ray at which media are sampled.
        pub steps: u32 = 32 => in_range(1.0, 1024.0),
        /// Shadow rays per view ray and light.
        pub shadow_rays: u32 = 4 => in_range(1.0, 64.0),
        /// Rays on which each surface point finds the light that media send to it; 0: they light no surfaces.
        pub light_surfaces: u32 = 0 => in_range(0.0, 64.0),
        /// Particles see what surfaces reflect; otherwise they see surfaces black.
        pub surfaces: bool = true => any(),
        /// Sample points on all area lights together.
        pub area_samples: u32 = 16 => in_range(1.0, 4096.0),
    }
}

/// What particles are made from.
#[derive(Debug, Clone, PartialEq)]
struct ParticleKey {
    media: u64,
    /// What a medium that fills everything fills.
    bounds: Option<Bounds>,
    particles: u32,
    shape: Shape,
    /// Light samples.
    lights: usize,
}

/// Particles, their light, and how they are seen.
#[derive(Debug)]
struct Lit {
    network: Network,
    reflecting: Option<Reflecting>,
    seen: SeenMedia,
    /// What is visible, the light that arrives, by the number of samples of area lights, and what surfaces reflect.
    visible: Stage<(Versions, u64)>,
    arriving: Stage<(Versions, u32)>,
    reflected: Stage<LightState>,
}

/// Participating media.
#[derive(Debug, Default)]
pub struct ParticipatingMedia {
    settings: Settings,
    kernels: Stage<(RayConstants, Visibility), Kernels>,
    passes: Stage<(RayConstants, How), Passes>,
    placements: Placements,
    /// Nothing where no particle is seen.
    lit: Stage<ParticleKey, Option<Lit>>,
    /// Iterations so far since the light was final, and how often it became better.
    progress: u32,
    revision: u64,
}

impl Settings {
    /// The lights of the scene as samples.
    fn lights(&self, scene: &GpuScene) -> Vec<LightSample> {
        let punctual = scene.lights.iter().map(punctual);
        let area = on_emitters(&scene.emitters, self.area_samples, 0);
        punctual.chain(area).collect()
    }

    /// Whether particles see what surfaces reflect: single scattering of lights has no use for it.
    fn sees_surfaces(&self) -> bool {
        self.surfaces && self.most_iterations > 0
    }

    fn made_from(&self, scene: &GpuScene, lights: usize) -> ParticleKey {
        let fills_everything = scene
            .media
            .iter()
            .any(|medium| medium.world_from_box.is_none());
        ParticleKey {
            media: scene.versions.media,
            bounds: fills_everything.then_some(scene.bounds),
            particles: self.particles,
            shape: Shape {
                directions: self.directions,
                sees_surfaces: self.sees_surfaces(),
                window: (self.visibility == Visibility::Peel).then_some(self.window),
            },
            lights,
        }
    }
}

impl Lit {
    /// `None` where no particle is seen. `before`: what it may continue, or take over parts of.
    fn new(
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        from: &ParticleKey,
        placements: &mut Placements,
        lights: &[LightSample],
        mut before: Option<Self>,
        continues: bool,
    ) -> Result<Option<Self>, GpuError> {
        let gpu = frame.gpu;
        let particles = Particles::new(&scene.media, from.particles, &scene.bounds, placements);
        if !particles.are_seen {
            return Ok(None);
        }
        if let Some(moved) = before.as_mut().filter(|_| continues)
            && moved.network.follow(gpu, &particles, from.shape, lights)?
        {
            return Ok(before);
        }
        let before = before.as_ref().map(|before| &before.network);
        let network = Network::new(gpu, &particles, from.shape, lights, before)?;
        if let Some(before) = before.filter(|_| continues) {
            network.continue_from(frame, before);
        }
        let sees_surfaces = from.shape.sees_surfaces;
        let reflecting = sees_surfaces.then(|| Reflecting::new(gpu, &network));
        Ok(Some(Self {
            reflecting: reflecting.transpose()?,
            seen: SeenMedia::new(gpu, &network)?,
            network,
            visible: Stage::default(),
            arriving: Stage::default(),
            reflected: Stage::default(),
        }))
    }
}

impl Technique for ParticipatingMedia {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn settings(&self) -> &dyn SettingSet {
        &self.settings
    }

    fn settings_mut(&mut self) -> &mut dyn SettingSet {
        &mut self.settings
    }

    fn plan(&mut self, scene: &GpuScene, covered: &[LightPaths], _: &[Claims]) -> Plan {
        let (own, last): (&[LightPaths], _) = match self.settings.light_surfaces {
            _ if scene.media.is_empty() => return Plan::adding([], scene),
            0 => (&SEEN_ALONE, "V+"),
            _ => (INFO.paths, "V+[DG]?"),
        };
        let mut paths = own.to_vec();
        if self.settings.sees_surfaces() {
            paths.extend(covered.iter().map(|light| light.continued(last)));
        }
        let marched = scene.lights.len().min(network::MOST_MARCHED) as u32;
        Plan {
            lookups: self.settings.steps * (1 + marched) + 16 * self.settings.light_surfaces,
            ..Plan::adding(paths, scene)
        }
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        _: &View,
        earlier: &mut Earlier<'_>,
    ) -> Result<Generated, Unready> {
        let (gpu, settings) = (frame.gpu, &self.settings);
        if scene.media.is_empty() {
            self.lit.clear();
            self.placements = Placements::default();
            return Ok(Generated::FINAL);
        }
        scene.expect_rays(INFO.name)?;
        let (constants, by) = (scene.ray_constants(), settings.visibility);
        let lit = &mut self.lit;
        let kernels = self.kernels.keep((constants, by), |_| {
            lit.clear();
            Kernels::new(gpu, scene, by == Visibility::Peel)
        })?;
        let lights = settings.lights(scene);
        let from = settings.made_from(scene, lights.len());
        let most = settings.most_iterations;
        let lit = lit.keep(from.clone(), |before| {
            let placements = &mut self.placements;
            let before = before.flatten();
            Lit::new(frame, scene, &from, placements, &lights, before, most > 0)
        })?;
        let Some(lit) = lit else {
            return Ok(Generated::FINAL);
        };
        let how = How {
            steps: settings.steps,
            shadow_rays: settings.shadow_rays,
            surface_rays: settings.light_surfaces,
            has_marched_lights: lit.network.values.marched_lights > 0,
        };
        self.passes
            .keep((constants, how), |_| Passes::new(gpu, scene, how))?;
        shaders(frame)?;
        let mut is_current = true;
        let visible = (scene.versions.of(Inputs::SURFACES), scene.versions.media);
        lit.visible.ask(visible);
        lit.arriving.ask((scene.versions, settings.area_samples));
        if !lit.visible.is_current() || !lit.arriving.is_current() {
            // Seen at once, in air.
            lit.network.set_lights(gpu, &lights);
            let is_new = lit.arriving.begun().is_none();
            is_current = is_new || earlier.budget.may_step();
        }
        if is_current && lit.visible.renew(visible) {
            let rays = lit.network.look(frame, scene, kernels)?;
            earlier.budget.count(rays);
            self.progress = 0;
        }
        if is_current && lit.arriving.renew((scene.versions, settings.area_samples)) {
            let rays = lit.network.light(frame, scene, kernels)?;
            earlier.budget.count(rays);
            self.progress = 0;
        }
        if let Some(reflecting) = lit.reflecting.as_mut().filter(|_| is_current) {
            let is_noisy = earlier.light.is_noisy();
            lit.reflected.ask(earlier.light.state(scene));
            let has_some = lit.reflected.begun().is_some();
            if !lit.reflected.is_current() {
                // Without a budget, light that is not yet final is gathered once only.
                let is_due = earlier.light.is_final || earlier.budget.is_limited();
                is_current = !has_some || (is_due && earlier.budget.may_step());
                if is_current {
                    lit.reflected.begin();
                    reflecting.begin();
                }
            }
            let is_due = !has_some || earlier.budget.may_step();
            if is_current && is_due && !reflecting.is_done(is_noisy) {
                // Light that is drawn by chance is gathered again anyway, so frames share it.
                let is_whole = !has_some || !is_noisy || !earlier.budget.is_limited();
                let network = (&*kernels, &lit.network);
                reflecting.record(frame, scene, network, earlier, is_whole)?;
                self.progress = 0;
            }
            is_current &= reflecting.is_done(is_noisy);
        }
        let wanted = settings.iterations.min(most.saturating_sub(self.progress));
        let (network, progress) = (&mut lit.network, &mut self.progress);
        let iterate = |network: &mut Network| {
            *progress += 1;
            network.iterate(frame, scene, kernels)
        };
        earlier.budget.steps(wanted, network, |_| false, iterate)?;
        self.revision += u64::from(wanted > 0);
        Ok(Generated {
            revision: self.revision,
            progress: if self.progress < most {
                self.progress as f32 / most as f32
            } else if is_current {
                1.0
            } else {
                0.999
            },
            pending: None,
        })
    }

    fn behind(
        &mut self,
        frame: &mut Frame<'_>,
        receiver: &Receiver,
    ) -> Result<Option<Receiver>, GpuError> {
        match self.lit.get_mut() {
            Some(Some(lit)) if receiver.points.output == Output::RadianceToEye => {
                lit.seen.begin(frame, receiver).map(Some)
            }
            _ => Ok(None),
        }
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        match (self.lit.get_mut(), self.passes.get()) {
            (Some(Some(Lit { network, seen, .. })), Some(passes))
                if receiver.points.output == Output::RadianceToEye =>
            {
                seen.end(frame, scene, receiver, network, passes)
            }
            _ => Ok(()),
        }
    }

    fn media_sources(&self) -> Option<MediaSources> {
        let lit = self.lit.get()?.as_ref()?;
        Some(lit.network.sources())
    }

    fn inspect(&self) -> Inspection {
        let Some(Some(Lit {
            network,
            reflecting,
            ..
        })) = self.lit.get()
        else {
            return Inspection::default();
        };
        let size = [network.values.directions, network.values.particles];
        let name = |name: &str| format!("{}.{name}", INFO.name);
        let maps = vec![
            Map::of_numbers(name("visibility"), &network.visible, size, 16),
            Map::of_colors(name("emitted"), &network.emitted, size, 16),
            Map::of_colors(name("incoming"), network.latest(), size, 16),
        ];
        let shown: u64 = maps.iter().map(Map::bytes).sum();
        Inspection {
            work_bytes: network.bytes() + reflecting.as_ref().map_or(0, Reflecting::bytes) - shown,
            maps,
            warnings: Vec::new(),
        }
    }
}
