//! The light of a scene: a set of techniques and what they share. [`Lighting::prepare`] brings their maps up to date,
//! [`Lighting::gather`] lights a receiver: a camera's pixels, texels of an atlas, probes. The renderer and the bake are
//! thin loops around these two.

mod schedule;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use gpugi_scene::Scene;
use gpugi_scene::names::check_names;

use crate::capture::{CaptureKernels, Emission, Receiver, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::light_paths::{LightClass, LightPaths, left_out, overlap};
use crate::scene::{Claims, GpuScene};
use crate::settings::SettingError;
pub use crate::techniques::Budget;
use crate::techniques::{
    Earlier, EarlierLight, Figure, Inspection, Map, Needs, OwnPoints, Plan, Registry, Role, Shared,
    Technique, Unready, are_noisy,
};
use schedule::Schedule;

/// Lighting that cannot do what it was asked.
#[derive(Debug, Clone, thiserror::Error, PartialEq)]
pub enum LightingError {
    /// The GPU failed, or the scene does not fit it.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A setting does not fit.
    #[error("{technique}: {source}")]
    Setting {
        /// Technique.
        technique: String,
        /// Why.
        source: SettingError,
    },
    /// There is no such technique.
    #[error("there is no technique {name:?}; there are: {known}")]
    UnknownTechnique {
        /// The name asked for.
        name: String,
        /// The names there are.
        known: String,
    },
    /// Two techniques would add the same light twice.
    #[error("{first} and {second} both add light of path {path} ({class}): choose one of them")]
    Overlap {
        /// One technique.
        first: String,
        /// The other.
        second: String,
        /// A path that both add.
        path: String,
        /// Its class of lights.
        class: LightClass,
    },
    /// A technique needs what none before it provides.
    #[error("{technique}.{setting} needs {needed}, which is not in use: add it to the techniques")]
    Needs {
        /// The technique.
        technique: String,
        /// The setting that asks for it.
        setting: String,
        /// The techniques that provide it.
        needed: String,
    },
}

/// How far the maps are after [`Lighting::prepare`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Readiness {
    /// The maps of this still scene are final.
    Ready,
    /// The maps can be gathered and become better with every frame. Until the last of them is made again, some may show
    /// the scene as it was before its last change.
    Refining {
        /// Share of the work that is done (0 to 1).
        progress: f32,
    },
    /// What is gathered now lacks light.
    Pending {
        /// Share of the work that is done (0 to 1).
        progress: f32,
        /// What is waited for.
        what: &'static str,
    },
}

impl Readiness {
    /// Share of the work that is done (0 to 1).
    pub fn progress(&self) -> f32 {
        match *self {
            Self::Ready => 1.0,
            Self::Refining { progress } | Self::Pending { progress, .. } => progress,
        }
    }

    /// Whether what is gathered shows the scene as it is.
    pub fn is_usable(&self) -> bool {
        !matches!(self, Self::Pending { .. })
    }
}

/// Techniques that light one scene, and the resources that they share.
#[derive(Debug)]
pub struct Lighting {
    gpu: Gpu,
    capture: CaptureKernels,
    emission: Emission,
    shared: Shared,
    /// Where the techniques come from.
    registry: Registry,
    techniques: Vec<Box<dyn Technique>>,
    plans: Vec<Plan>,
    schedule: Schedule,
    /// Whether the last frame lacked light.
    is_pending: bool,
    /// Grows with every setting.
    settings_version: u64,
    lights_elsewhere: bool,
}

impl Lighting {
    /// Uploads a scene with what the named techniques need of it.
    ///
    /// # Errors
    /// [`LightingError::UnknownTechnique`], [`LightingError::Gpu`].
    pub fn upload(
        gpu: &Gpu,
        scene: &Scene,
        names: &[String],
        registry: &Registry,
    ) -> Result<GpuScene, LightingError> {
        let mut has_rays = false;
        for name in names {
            let found = registry
                .find(name)
                .ok_or_else(|| LightingError::UnknownTechnique {
                    name: name.clone(),
                    known: registry.names(),
                })?;
            has_rays |= found.info.needs != Needs::NOTHING;
        }
        Ok(if has_rays {
            GpuScene::with_texels(gpu, scene)?
        } else {
            GpuScene::new(gpu, scene)?
        })
    }

    /// The named techniques of `registry`, in its order.
    ///
    /// # Errors
    /// [`LightingError`].
    pub fn new(
        gpu: &Gpu,
        scene: &mut GpuScene,
        names: &[String],
        registry: &Registry,
    ) -> Result<Self, LightingError> {
        let is_wanted = |name: &str| names.iter().any(|wanted| wanted == name);
        let wanted = registry
            .all()
            .iter()
            .filter(|registration| is_wanted(registration.info.name));
        let mut own_points = wanted
            .clone()
            .map(|registration| registration.info.lights_points);
        scene.has_irradiance |= own_points.any(|points| points == OwnPoints::Irradiance);
        let techniques: Vec<_> = wanted
            .map(|registration| (registration.make)(gpu, scene))
            .collect::<Result<_, _>>()?;
        let capture = CaptureKernels::new(gpu, scene)?;
        let mut lighting = Self {
            gpu: gpu.clone(),
            emission: Emission::new(gpu, scene)?,
            shared: Shared::new(gpu, scene, &capture)?,
            capture,
            registry: registry.clone(),
            plans: Vec::new(),
            schedule: Schedule::new(techniques.len()),
            is_pending: false,
            lights_elsewhere: techniques
                .iter()
                .any(|technique| technique.info().lights_points != OwnPoints::None),
            techniques,
            settings_version: 0,
        };
        lighting.validate(scene)?;
        Ok(lighting)
    }

    /// Declares that receivers will be lit that the camera need not see, such as texels and probes: maps then cover the
    /// whole scene.
    pub fn light_elsewhere(&mut self) {
        self.lights_elsewhere = true;
    }

    /// Plans what each technique does in the scene, and hands each object to the techniques that claim it. To be called
    /// after changes of the scene; after changes of settings it is called by itself.
    ///
    /// # Errors
    /// [`LightingError::Needs`], [`LightingError::Overlap`]: the plans and the scene stay as they were. What was changed
    /// is to be taken back, and this to be called again, because techniques have already planned for it.
    pub fn validate(&mut self, scene: &mut GpuScene) -> Result<(), LightingError> {
        let mut claims = vec![Claims::NONE; scene.objects.len()];
        let mut covered: Vec<LightPaths> = Vec::new();
        let mut plans = Vec::new();
        for technique in &mut self.techniques {
            let plan = technique.plan(scene, &covered, &claims);
            for (all, own) in claims.iter_mut().zip(&plan.claims) {
                *all = *all | *own;
            }
            covered.extend_from_slice(&plan.paths);
            plans.push(plan);
        }
        self.check(&plans)?;
        scene.assign(&self.gpu, &claims);
        self.plans = plans;
        Ok(())
    }

    /// Refuses plans that lack what they read or add light twice.
    fn check(&self, plans: &[Plan]) -> Result<(), LightingError> {
        for (index, plan) in plans.iter().enumerate() {
            let Some((needed, setting)) = plan.needs else {
                continue;
            };
            let mut before = self.techniques[..index].iter();
            if !before.any(|technique| technique.info().provides.contains(&needed)) {
                return Err(LightingError::Needs {
                    technique: self.techniques[index].info().name.into(),
                    setting: setting.into(),
                    needed: self.registry.providers(needed),
                });
            }
        }
        // Techniques that claim objects add their light there alone; what adds everything leaves others nothing.
        let claims_nothing = |plan: &Plan| plan.claims.iter().all(|claim| *claim == Claims::NONE);
        let all: Vec<_> = self.techniques.iter().zip(plans).collect();
        for (index, &(second, plan)) in all.iter().enumerate() {
            for &(first, earlier) in &all[..index] {
                let are_compared = [first, second]
                    .iter()
                    .any(|technique| technique.info().role == Role::Everything)
                    || (claims_nothing(earlier) && claims_nothing(plan));
                if are_compared && let Some((class, path)) = overlap(&earlier.paths, &plan.paths) {
                    return Err(LightingError::Overlap {
                        first: first.info().name.into(),
                        second: second.info().name.into(),
                        path,
                        class,
                    });
                }
            }
        }
        Ok(())
    }

    /// Sets one setting of one technique from text. What is refused is not kept.
    ///
    /// # Errors
    /// [`LightingError::UnknownTechnique`] when it is not among those in use, [`LightingError::Setting`],
    /// [`LightingError::Overlap`], [`LightingError::Needs`].
    pub fn set(
        &mut self,
        scene: &mut GpuScene,
        technique: &str,
        name: &str,
        value: &str,
    ) -> Result<(), LightingError> {
        let known = || {
            let names: Vec<&str> = self
                .techniques
                .iter()
                .map(|technique| technique.info().name)
                .collect();
            names.join(", ")
        };
        let found = self
            .techniques
            .iter()
            .position(|known| known.info().name == technique);
        let index = found.ok_or_else(|| LightingError::UnknownTechnique {
            name: technique.to_owned(),
            known: known(),
        })?;
        let fail = |source| LightingError::Setting {
            technique: technique.to_owned(),
            source,
        };
        let before = self.techniques[index].settings().to_json();
        let named_before = self.plans[index].object_names.clone();
        self.techniques[index]
            .settings_mut()
            .set(name, value)
            .map_err(fail)?;
        self.settings_version += 1;
        let planned = self.validate(scene);
        let named = &self.plans[index].object_names;
        let objects = scene.objects.iter().map(|object| object.name.as_str());
        // Names that were known once may have gone from the scene since: only new ones are checked.
        let names = if *named == named_before {
            Ok(())
        } else {
            check_names(named, objects).map_err(|unknown| {
                fail(SettingError::Value {
                    name: name.to_owned(),
                    value: value.to_owned(),
                    reason: unknown.to_string(),
                })
            })
        };
        let result = names.and(planned);
        if result.is_err() {
            // These values were valid a moment ago.
            let _ = self.techniques[index].settings_mut().replace(before);
            let _ = self.validate(scene);
        }
        result
    }

    /// The technique of this type, to set its settings as a struct. [`Lighting::validate`] has to follow.
    pub fn technique_mut<T: Technique>(&mut self) -> Option<&mut T> {
        self.settings_version += 1;
        let mut techniques = self.techniques.iter_mut();
        techniques.find_map(|technique| {
            let technique: &mut dyn std::any::Any = technique.as_mut();
            technique.downcast_mut()
        })
    }

    /// Records what brings the maps of all techniques up to date for what `view` sees, as far as `budget` allows. Never
    /// waits: work that takes several frames continues in the next call. To cancel it, stop calling.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn prepare(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &mut GpuScene,
        view: &View,
        budget: Budget,
    ) -> Result<Readiness, GpuError> {
        scene.merge(frame);
        self.shared.begin_frame();
        let waiting = self.techniques.iter().map(|technique| technique.waiting());
        self.schedule
            .begin(budget, scene.versions, self.is_pending, waiting);
        self.is_pending = true;
        let (mut revision, mut lookups, mut final_progress) = (0, [1, 1], 1.0_f32);
        for index in 0..self.techniques.len() {
            let (techniques, rest) = self.techniques.split_at_mut(index);
            let technique = &mut rest[0];
            let lights_points = technique.info().lights_points != OwnPoints::None;
            let mut earlier = Earlier {
                light: EarlierLight {
                    settings_version: self.settings_version,
                    revision,
                    is_final: final_progress >= 1.0,
                    lights_elsewhere: self.lights_elsewhere,
                    lookups,
                    ..EarlierLight::new(&mut self.emission, techniques)
                },
                budget: self.schedule.slice(index, lights_points),
                shared: &mut self.shared,
            };
            let generated = technique.generate(frame, scene, view, &mut earlier);
            self.schedule.end(index, &earlier.budget);
            let pending = match generated {
                Err(Unready::Failed(error)) => return Err(error),
                Err(Unready::Waits { progress, what }) => Err((progress, what)),
                Ok(generated) => match generated.pending {
                    Some(what) => Err((generated.progress, what)),
                    // Those that a gather is yet to use.
                    None if frame.awaits_shaders() => Err((0.0, "shaders")),
                    None => Ok(generated),
                },
            };
            let generated = match pending {
                Ok(generated) => generated,
                // Later techniques would take the light of maps that are stale.
                Err((progress, what)) => return Ok(Readiness::Pending { progress, what }),
            };
            final_progress = final_progress.min(generated.progress);
            revision += generated.revision;
            let (own, shared) = (self.plans[index].lookups, technique.shared_lookups());
            lookups[0] += u64::from(own);
            lookups[1] += u64::from(own.saturating_sub(shared) + shared / 4);
        }
        self.is_pending = false;
        Ok(match final_progress {
            1.0.. => Readiness::Ready,
            progress => Readiness::Refining { progress },
        })
    }

    /// Lookups at each of a camera's points, of all techniques together.
    pub(crate) fn lookups(&self) -> u32 {
        let all = self.techniques.iter().zip(&self.plans);
        let lookups = all.map(|(technique, plan)| {
            let shared = technique.shared_lookups();
            plan.lookups.saturating_sub(shared) + shared / 4
        });
        lookups.sum()
    }

    /// Work of the last [`Lighting::prepare`], in units of [`Budget`].
    pub fn work(&self) -> u64 {
        self.schedule.work()
    }

    /// Lights a receiver: what emitters and the environment send straight to it, and what all techniques add.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
    ) -> Result<(), GpuError> {
        self.gather_some(frame, scene, receiver, |_| true)
    }

    /// As [`Lighting::gather`], of the techniques whose names `adds` accepts. The others light only what these see.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn gather_some(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        adds: impl Fn(&str) -> bool,
    ) -> Result<(), GpuError> {
        let light = EarlierLight {
            settings_version: self.settings_version,
            lights_elsewhere: self.lights_elsewhere,
            ..EarlierLight::new(&mut self.emission, &mut self.techniques)
        };
        let mut all = Earlier::unlimited(light, &mut self.shared);
        all.gather_some(frame, scene, receiver, true, adds)
    }

    /// Saved progress of techniques, by name. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn save(&mut self) -> Result<BTreeMap<String, Vec<u8>>, GpuError> {
        let mut saved = BTreeMap::new();
        for technique in &mut self.techniques {
            let name = technique.info().name;
            if let Some(resumable) = technique.resumable()
                && let Some(bytes) = resumable.save(&self.gpu)?
            {
                saved.insert(name.to_owned(), bytes);
            }
        }
        Ok(saved)
    }

    /// Lets techniques continue from saved progress, after a [`Lighting::prepare`]; returns what has to wait for the
    /// next one.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn resume(
        &mut self,
        mut saved: BTreeMap<String, Vec<u8>>,
    ) -> Result<BTreeMap<String, Vec<u8>>, GpuError> {
        for technique in &mut self.techniques {
            let name = technique.info().name;
            if let Some(bytes) = saved.get(name)
                && let Some(resumable) = technique.resumable()
                && resumable.resume(&self.gpu, bytes)?
            {
                saved.remove(name);
            }
        }
        Ok(saved)
    }

    /// Whether any technique tells which part of its light is noisy.
    pub(crate) fn is_noisy(&self) -> bool {
        are_noisy(&self.techniques)
    }

    /// The pipelines of captures, compiled for the scene.
    pub fn capture_kernels(&self) -> &CaptureKernels {
        &self.capture
    }

    /// The techniques in use.
    pub fn techniques(&self) -> &[Box<dyn Technique>] {
        &self.techniques
    }

    /// Light that the techniques in use add.
    pub fn light_paths(&self) -> Vec<LightPaths> {
        self.plans
            .iter()
            .flat_map(|plan| &plan.paths)
            .cloned()
            .collect()
    }

    /// Light that one technique adds; none when it is not in use.
    pub fn light_paths_of(&self, technique: &str) -> &[LightPaths] {
        let mut all = self.techniques.iter().zip(&self.plans);
        let found = all.find(|(known, _)| known.info().name == technique);
        found.map_or(&[], |(_, plan)| &plan.paths)
    }

    /// Light that exists in the scene, as far as the factors of its materials tell, and that no technique in use adds:
    /// a few words each.
    pub fn left_out(&self, scene: &GpuScene) -> Vec<String> {
        left_out(&self.light_paths(), &scene.light_classes(), &scene.lobes())
    }

    /// Every map that exists now.
    pub fn maps(&self) -> Vec<Map> {
        self.inspect()
            .flat_map(|(_, inspection)| inspection.maps)
            .collect()
    }

    /// What exists of each technique on the GPU, with its name.
    pub fn inspect(&self) -> impl Iterator<Item = (&'static str, Inspection)> {
        self.techniques
            .iter()
            .map(|technique| (technique.info().name, technique.inspect()))
    }

    /// Numbers about the techniques' work since the last call. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn figures(&mut self) -> Result<Vec<Figure>, GpuError> {
        let mut all = Vec::new();
        for technique in &mut self.techniques {
            all.extend(technique.figures(&self.gpu)?);
        }
        Ok(all)
    }
}
