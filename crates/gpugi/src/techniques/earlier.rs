//! What lies before a technique in the frame: light, what is left of the budget, and maps that techniques share.

use super::{Generated, Layer, MediaSources, Openness, Slice, Technique};
use crate::capture::{CaptureKernels, Emission, Receiver};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::impostor::{ImpostorRequest, Impostors, Maps};
use crate::prefiltered::{Environments, Prefiltered, PrefilteredRequest};
use crate::scene::{GpuScene, Versions};

/// What lies before a technique in the frame. Techniques that light points of their own gather its light.
#[derive(Debug)]
pub struct Earlier<'a> {
    /// The light of emitters and of the techniques before this one, whose maps are current.
    pub light: EarlierLight<'a>,
    /// This technique's part of the frame's budget.
    pub budget: Slice,
    /// Maps that techniques share.
    pub shared: &'a mut Shared,
}

/// The light of emitters and of some techniques.
#[derive(Debug)]
pub struct EarlierLight<'a> {
    pub(crate) emission: &'a mut Emission,
    pub(crate) techniques: &'a mut [Box<dyn Technique>],
    /// Grows when a setting of any technique changes: earlier captures are stale.
    pub settings_version: u64,
    /// Grows when the light improves although nothing has changed.
    pub revision: u64,
    /// Whether the light is final, as long as nothing changes.
    pub is_final: bool,
    /// Whether points outside the camera's view are lit: maps that follow the camera do not cover them.
    pub lights_elsewhere: bool,
    /// What a gather looks up per point: where its light stays, and where it is brief.
    pub(crate) lookups: [u64; 2],
}

/// Maps that techniques share.
#[derive(Debug)]
pub struct Shared {
    /// Those around objects.
    pub impostors: Impostors,
    /// Those of the environment.
    pub environments: Environments,
}

impl Shared {
    /// None yet.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub(crate) fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        capture: &CaptureKernels,
    ) -> Result<Self, GpuError> {
        Ok(Self {
            impostors: Impostors::new(gpu, scene, capture)?,
            environments: Environments::default(),
        })
    }

    /// Begins a frame, and drops maps that are no longer requested.
    pub(crate) fn begin_frame(&mut self) {
        self.impostors.begin_frame();
        self.environments.begin_frame();
    }
}

/// Everything that light depends on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LightState {
    pub versions: Versions,
    /// [`EarlierLight::settings_version`].
    pub settings: u64,
    /// [`EarlierLight::revision`].
    pub revision: u64,
}

impl LightState {
    /// The same, however often the light became better: of what does not follow each improvement.
    pub fn however_refined(self) -> Self {
        Self {
            revision: 0,
            ..self
        }
    }
}

impl<'a> EarlierLight<'a> {
    /// The final light of emitters and of `techniques`, everywhere.
    pub(crate) fn new(
        emission: &'a mut Emission,
        techniques: &'a mut [Box<dyn Technique>],
    ) -> Self {
        Self {
            emission,
            techniques,
            settings_version: 0,
            revision: 0,
            is_final: true,
            lights_elsewhere: true,
            lookups: [1; 2],
        }
    }

    /// Whether any of it is drawn by chance for each point.
    pub(crate) fn is_noisy(&self) -> bool {
        super::are_noisy(self.techniques)
    }

    /// Everything that it depends on.
    pub(crate) fn state(&self, scene: &GpuScene) -> LightState {
        LightState {
            versions: scene.versions,
            settings: self.settings_version,
            revision: self.revision,
        }
    }

    /// Work of a gather at the points; `is_brief`: [`Receiver::briefly`].
    pub(crate) fn work(&self, points: u64, is_brief: bool) -> u64 {
        points * self.lookups[usize::from(is_brief)]
    }

    /// The technique with this index, and the light of those before it.
    fn split(&mut self, index: usize) -> (EarlierLight<'_>, &mut dyn Technique) {
        let (techniques, rest) = self.techniques.split_at_mut(index);
        let before = EarlierLight {
            emission: self.emission,
            techniques,
            ..*self
        };
        (before, rest[0].as_mut())
    }
}

impl<'a> Earlier<'a> {
    /// The light, and maps that techniques share, without a limit on the technique's work.
    pub(crate) fn unlimited(light: EarlierLight<'a>, shared: &'a mut Shared) -> Self {
        Self {
            light,
            budget: Slice::unlimited(),
            shared,
        }
    }

    /// How open the scene is at its surfaces, as the last technique knows that provides it.
    pub fn openness(&self) -> Option<&dyn Openness> {
        let mut techniques = self.light.techniques.iter().rev();
        techniques.find_map(|technique| technique.openness())
    }

    /// What rays meet in media, as the last technique knows that provides it.
    pub fn media_sources(&self) -> Option<MediaSources> {
        let mut techniques = self.light.techniques.iter().rev();
        techniques.find_map(|technique| technique.media_sources())
    }

    /// The maps `wanted` around objects, renewed as far as that is due; counts the pixels drawn. Afterwards
    /// [`Maps::renewed`] tells which points to relight. `seed` as in [`Impostors::follow`].
    ///
    /// # Errors
    /// [`GpuError`].
    pub(crate) fn renew(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        wanted: &ImpostorRequest,
        seed: u32,
    ) -> Result<Maps, GpuError> {
        let settings = self.light.settings_version;
        let impostors = &mut self.shared.impostors;
        let (maps, pixels) = impostors.renew(frame, scene, wanted, settings, seed)?;
        let maps = maps.clone();
        if pixels > 0 {
            self.budget.count(pixels);
        }
        Ok(maps)
    }

    /// The maps `wanted` of the scene's environment, and their state. `is_read`: they are filled, as far as this
    /// frame may; otherwise they are only bound.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn prefiltered(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        wanted: PrefilteredRequest,
        is_read: bool,
    ) -> Result<(&Prefiltered, Generated), GpuError> {
        let (gpu, never_waits, budget) = (frame.gpu, frame.never_waits(), &mut self.budget);
        let takes = |step: u64| {
            let awaits_shaders = never_waits && gpu.is_compiling();
            !awaits_shaders && budget.takes(step)
        };
        let environments = &mut self.shared.environments;
        let generated = if is_read {
            Generated::of_environment(environments.fill(frame, scene, wanted, takes)?)
        } else {
            Generated::FINAL
        };
        let maps = environments.of(frame.gpu, scene, wanted)?;
        Ok((maps, generated))
    }

    /// Writes the light at the receiver's points to its target; `with_emission`: also light straight from emitters and
    /// the environment.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        with_emission: bool,
    ) -> Result<(), GpuError> {
        let points = receiver.points.count.into();
        self.budget
            .count(self.light.work(points, receiver.is_brief));
        self.gather_some(frame, scene, receiver, with_emission, |_| true)
    }

    /// As [`Earlier::gather`], of the techniques whose names `adds` accepts.
    ///
    /// # Errors
    /// [`GpuError`].
    pub(crate) fn gather_some(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        with_emission: bool,
        adds: impl Fn(&str) -> bool,
    ) -> Result<(), GpuError> {
        let light = &mut self.light;
        let attenuated = light.emission.attenuation.begin(frame, receiver)?;
        // From the eye on, what lies before surfaces has all else gathered behind it.
        let techniques = light.techniques.iter().enumerate();
        let mut before: Vec<_> = techniques
            .map(|(index, technique)| (technique.info(), index))
            .filter(|(info, _)| info.layer > Layer::Surfaces && adds(info.name))
            .map(|(info, index)| (info.layer, index))
            .collect();
        before.sort_unstable_by(|a, b| b.cmp(a));
        let mut farthest = attenuated.clone();
        let mut nearer = Vec::new();
        for (_, index) in before {
            if let Some(behind) = light.techniques[index].behind(frame, &farthest)? {
                nearer.push((index, std::mem::replace(&mut farthest, behind)));
            }
        }
        if with_emission {
            light.emission.record(frame, scene, &farthest)?;
        } else {
            attenuated.clear(frame);
            farthest.clear(frame);
        }
        let is_nearer = |index| nearer.iter().any(|(other, _)| *other == index);
        let others = (0..light.techniques.len()).filter(|&index| !is_nearer(index));
        let others = others.map(|index| (index, &farthest));
        let nearer = nearer.iter().rev();
        for (index, receiver) in others.chain(nearer.map(|(index, receiver)| (*index, receiver))) {
            let (before, technique) = light.split(index);
            if !adds(technique.info().name) {
                continue;
            }
            let mut earlier = Earlier::unlimited(before, self.shared);
            technique.gather(frame, scene, receiver, &mut earlier)?;
        }
        light.emission.attenuation.end(frame, receiver)
    }
}
