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

use std::sync::Arc;

use gpugi_scene::Bounds;

use super::{
    Earlier, Generated, Info, Inspection, Layer, Map, Needs, OwnPoints, Plan, Provided, Purpose,
    Registration, Role, Technique, Texels,
};
use crate::capture::{Output, Receiver, View};
use crate::gpu::{Frame, GpuError};
use crate::light_paths::{LightClass, LightPaths};
use crate::lights::gpu::LightSample;
use crate::lights::samples::{on_emitters, punctual};
use crate::scene::{Claims, GpuScene, RayConstants, Versions, stand_apart};
use crate::settings::SettingSet;
use network::{Kernels, Network, Shape};
use particles::{Particles, Placements};
use reflecting::Reflecting;
use seen::{How, Passes, Seen};
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
struct MadeFrom {
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
struct Made {
    from: MadeFrom,
    network: Network,
    reflecting: Option<Reflecting>,
    seen: Option<Seen>,
    /// What visibility and light were computed for.
    looked: Option<[u64; 2]>,
    lit: Option<(Versions, u32)>,
    /// Versions, settings and revision of the light that surfaces reflect.
    reflected: Option<(Versions, [u64; 2])>,
}

/// Participating media.
#[derive(Debug, Default)]
pub struct ParticipatingMedia {
    settings: Settings,
    kernels: Option<(RayConstants, Visibility, Kernels)>,
    passes: Option<Arc<Passes>>,
    placements: Placements,
    made: Option<Made>,
    /// Iterations so far since the light was final, and how often it became better.
    progress: u32,
    revision: u64,
}

impl ParticipatingMedia {
    /// The lights of the scene as samples.
    fn lights(&self, scene: &GpuScene) -> Vec<LightSample> {
        let punctual = scene.lights.iter().map(punctual);
        let area = on_emitters(&scene.emitters, self.settings.area_samples, 0);
        punctual.chain(area).collect()
    }

    /// Whether particles see what surfaces reflect: single scattering of lights has no use for it.
    fn sees_surfaces(&self) -> bool {
        self.settings.surfaces && self.settings.most_iterations > 0
    }

    fn made_from(&self, scene: &GpuScene, lights: usize) -> MadeFrom {
        let fills_everything = scene.media.iter().any(|one| one.world_from_box.is_none());
        MadeFrom {
            media: scene.versions.media,
            bounds: fills_everything.then_some(scene.bounds),
            particles: self.settings.particles,
            shape: Shape {
                directions: self.settings.directions,
                sees_surfaces: self.sees_surfaces(),
                window: (self.settings.visibility == Visibility::Peel)
                    .then_some(self.settings.window),
            },
            lights,
        }
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
        if self.sees_surfaces() {
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
    ) -> Result<Generated, GpuError> {
        let gpu = frame.gpu;
        if scene.media.is_empty() {
            self.made = None;
            self.placements = Placements::default();
            return Ok(Generated::FINAL);
        }
        if !scene.has_rays() {
            return Err(GpuError::Pass {
                pass: INFO.name.into(),
                reason: "the scene was uploaded without rays: use GpuScene::with_texels".into(),
            });
        }
        let constants = scene.ray_constants();
        let by = self.settings.visibility;
        let kernels = self.kernels.as_ref();
        if kernels.is_none_or(|(of, made_by, _)| *of != constants || *made_by != by) {
            let kernels = Kernels::new(gpu, scene, by == Visibility::Peel)?;
            self.kernels = Some((constants, by, kernels));
            self.passes = None;
            self.made = None;
        }
        let Some((_, _, kernels)) = &self.kernels else {
            return Ok(Generated::FINAL);
        };
        let lights = self.lights(scene);
        let from = self.made_from(scene, lights.len());
        if self.made.as_ref().is_none_or(|made| made.from != from) {
            let particles = Particles::new(
                &scene.media,
                from.particles,
                &scene.bounds,
                &mut self.placements,
            );
            let before = self.made.take();
            if particles.are_seen {
                let network = Network::new(
                    gpu,
                    kernels,
                    &particles,
                    from.shape,
                    &lights,
                    before.as_ref().map(|before| &before.network),
                )?;
                if let Some(before) = before.filter(|_| self.settings.most_iterations > 0) {
                    network.continue_from(frame, &before.network);
                }
                let reflecting = from
                    .shape
                    .sees_surfaces
                    .then(|| Reflecting::new(gpu, kernels, &network));
                self.made = Some(Made {
                    from,
                    network,
                    reflecting: reflecting.transpose()?,
                    seen: None,
                    looked: None,
                    lit: None,
                    reflected: None,
                });
            }
        }
        let Some(made) = &mut self.made else {
            return Ok(Generated::FINAL);
        };
        let how = How {
            steps: self.settings.steps,
            shadow_rays: self.settings.shadow_rays,
            surface_rays: self.settings.light_surfaces,
            has_marched_lights: made.network.values.marched_lights > 0,
        };
        let passes = match self.passes.take().filter(|passes| passes.how == how) {
            Some(passes) => passes,
            None => Arc::new(Passes::new(gpu, scene, how)?),
        };
        if made.seen.as_ref().is_none_or(|seen| !seen.is_by(&passes)) {
            made.seen = Some(Seen::new(gpu, &made.network, &passes)?);
        }
        self.passes = Some(passes);
        if frame.awaits_shaders() {
            return Ok(Generated::WITHOUT_SHADERS);
        }
        let Versions {
            geometry,
            materials,
            ..
        } = scene.versions;
        if made.looked != Some([geometry, materials]) {
            earlier.count(made.network.look(frame, scene, kernels));
            made.looked = Some([geometry, materials]);
            self.progress = 0;
        }
        let lit = (scene.versions, self.settings.area_samples);
        if made.lit != Some(lit) {
            made.network.set_lights(gpu, &lights);
            earlier.count(made.network.light(frame, scene, kernels));
            made.lit = Some(lit);
            self.progress = 0;
        }
        let reflected = (scene.versions, [earlier.settings_version, earlier.revision]);
        let mut is_current = true;
        if let Some(reflecting) = &made.reflecting
            && made.reflected != Some(reflected)
        {
            // Without a budget, light that is not yet final is gathered once only.
            let is_due = earlier.is_final || earlier.is_limited();
            is_current = made.reflected.is_none() || (is_due && earlier.may_step());
            if is_current {
                reflecting.record(frame, scene, kernels, &made.network, earlier)?;
                made.reflected = Some(reflected);
                self.progress = 0;
            }
        }
        let most = self.settings.most_iterations;
        let wanted = self
            .settings
            .iterations
            .min(most.saturating_sub(self.progress));
        for _ in 0..wanted {
            if !earlier.may_step() {
                break;
            }
            earlier.count(made.network.iterate(frame, scene, kernels));
            self.progress += 1;
        }
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
        if receiver.points.output != Output::RadianceToEye {
            return Ok(None);
        }
        match &mut self.made {
            Some(Made {
                network,
                seen: Some(seen),
                ..
            }) => seen.begin(frame, receiver, network).map(Some),
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
        match &mut self.made {
            Some(Made {
                network,
                seen: Some(seen),
                ..
            }) if receiver.points.output == Output::RadianceToEye => {
                seen.end(frame, scene, receiver, network)
            }
            _ => Ok(()),
        }
    }

    fn media_sources(&self) -> Option<MediaSources> {
        self.made.as_ref().map(|made| made.network.sources())
    }

    fn inspect(&self) -> Inspection {
        let Some(Made {
            network,
            reflecting,
            ..
        }) = &self.made
        else {
            return Inspection::default();
        };
        let size = [network.values.directions, network.values.particles];
        let map = |name: &str, buffer: &wgpu::Buffer, is_number| Map {
            name: format!("participating-media.{name}"),
            texels: Texels::Buffer {
                buffer: buffer.clone(),
                size,
                stride: 16,
                is_number,
            },
        };
        let maps = vec![
            map("visibility", &network.visible, true),
            map("emitted", &network.emitted, false),
            map("incoming", network.latest(), false),
        ];
        let shown: u64 = maps.iter().map(Map::bytes).sum();
        Inspection {
            work_bytes: network.bytes() + reflecting.as_ref().map_or(0, Reflecting::bytes) - shown,
            maps,
            warnings: Vec::new(),
        }
    }
}
