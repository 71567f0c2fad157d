//! The techniques: each generates illumination into maps and gathers it at surface points.
//!
//! [`Technique`] is the trait that [`crate::lighting::Lighting`] loops over; [`Registry`] lists the techniques in the
//! order of the frame. docs/adding-a-technique.md walks through a new one.

mod budget;
pub mod caustics;
pub mod distance_impostor;
pub mod environment_map;
pub mod final_gather;
pub mod image_based_lighting;
mod info;
pub mod light_path_map;
mod map;
pub mod obscurances;
pub(crate) mod occasion;
mod openness;
pub mod participating_media;
mod precomputed;
pub mod radiance_transfer;
pub mod radiosity;
pub mod ray_tracing;
mod registry;
pub mod shadow_map;

pub use budget::Budget;
pub(crate) use budget::Slice;
pub use info::{Cost, Info, Layer, Needs, OwnPoints, Provided, Role};
pub use map::{Map, MapRead, Texels};
pub use occasion::{Occasion, Purpose, Speed, Values};
pub use openness::{Openness, OpennessLookup};
pub use participating_media::sources::MediaSources;
pub use precomputed::Precomputed;
pub use registry::{Registration, Registry};

use std::any::Any;

use crate::capture::{Emission, Receiver, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::impostor::{Impostors, Maps, Wanted as WantedImpostor};
use crate::light_paths::LightPaths;
use crate::prefiltered::{Environments, Filled, Prefiltered, Wanted};
use crate::scene::{Claims, GpuScene, Object};
use crate::settings::SettingSet;

/// The part of a technique in a scene, given its settings and the techniques before it in the frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The light that it adds.
    pub paths: Vec<LightPaths>,
    /// What it claims of each object, one entry per object of the scene.
    pub claims: Vec<Claims>,
    /// The list of object names in its settings, separated by commas; empty if there is none.
    /// [`crate::lighting::Lighting::set`] refuses names that no object has.
    pub object_names: String,
    /// What its gather looks up per point, roughly: lights, depth maps or other maps. The unit of [`Budget`].
    pub lookups: u32,
    /// What it reads of a technique before it, and the name of the setting that asks for it.
    /// [`crate::lighting::Lighting::validate`] refuses sets in which no technique before this one provides it.
    pub needs: Option<(Provided, &'static str)>,
}

impl Plan {
    /// Adds light of `paths` at every object and claims none.
    pub fn adding(paths: impl Into<Vec<LightPaths>>, scene: &GpuScene) -> Self {
        Self {
            paths: paths.into(),
            claims: vec![Claims::NONE; scene.objects.len()],
            object_names: String::new(),
            lookups: 1,
            needs: None,
        }
    }
}

/// The state of a technique's maps after [`Technique::generate`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Generated {
    /// Counts how often the maps improved although nothing had changed. Dependents recapture when it grows.
    pub revision: u64,
    /// Part of the work on a still scene that is done (0 to 1); at 1 the maps are final.
    pub progress: f32,
    /// What the maps wait for before they can be gathered. `None` also while they still hold light of the scene before
    /// its last change, with a progress below 1.
    pub pending: Option<&'static str>,
}

impl Generated {
    /// Nothing yet: the technique's atlas is being laid out.
    pub(crate) fn without_atlas(scene: &GpuScene) -> Self {
        Self {
            revision: 0,
            progress: scene.atlas_progress(),
            pending: Some("texture atlas"),
        }
    }

    /// Nothing yet: the technique's shaders are being compiled.
    pub const WITHOUT_SHADERS: Self = Self {
        revision: 0,
        progress: 0.0,
        pending: Some("shaders"),
    };

    /// Those of the environment's maps.
    pub(crate) fn of_environment(filled: Filled) -> Self {
        Self {
            revision: filled.revision,
            progress: f32::from(u8::from(filled.is_current)),
            pending: (!filled.is_whole).then_some("the maps of the environment"),
        }
    }

    /// Maps that are final at once.
    pub const FINAL: Self = Self {
        revision: 0,
        progress: 1.0,
        pending: None,
    };
}

/// A technique's resources on the GPU, for dumps, measurements and messages.
#[derive(Debug, Clone, Default)]
pub struct Inspection {
    /// The current maps.
    pub maps: Vec<Map>,
    /// GPU memory besides the maps that it uses to make them (bytes).
    pub work_bytes: u64,
    /// Warnings about the picture beyond its light paths, one sentence each.
    pub warnings: Vec<String>,
}

/// A number about a technique's work, for measurements.
#[derive(Debug, Clone)]
pub struct Figure {
    /// What it is of: the technique, a dot, and a few words.
    pub name: String,
    /// The number.
    pub value: f64,
    /// Its unit.
    pub unit: &'static str,
    /// The pass that does this work, whose time makes the number a rate.
    pub pass: Option<&'static str>,
}

impl Figure {
    /// A number that no time divides.
    pub fn new(name: &str, value: f64, unit: &'static str) -> Self {
        Self {
            name: name.to_owned(),
            value,
            unit,
            pass: None,
        }
    }

    /// The same, with the pass that does this work.
    pub fn by(self, pass: &'static str) -> Self {
        Self {
            pass: Some(pass),
            ..self
        }
    }
}

/// A technique. In each frame [`crate::lighting::Lighting`] calls `generate` of all techniques in the registry's order,
/// then `gather` of all techniques for each receiver.
pub trait Technique: std::fmt::Debug + Any + Send + Sync {
    /// Name, source and light paths.
    fn info(&self) -> &'static Info;

    /// Its settings.
    fn settings(&self) -> &dyn SettingSet;

    /// Its settings, to be changed; a new plan follows.
    fn settings_mut(&mut self) -> &mut dyn SettingSet;

    /// Decides what the technique does in `scene`. Called whenever settings or the scene change. `covered`: the light
    /// that the techniques before it add; `claimed`: what they claim of each object.
    fn plan(&mut self, scene: &GpuScene, covered: &[LightPaths], claimed: &[Claims]) -> Plan;

    /// Updates the technique's maps for what `view` sees; does nothing if they are current. Never waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        view: &View,
        earlier: &mut Earlier<'_>,
    ) -> Result<Generated, GpuError>;

    /// Adds the technique's light at the receiver's points to its target. A technique whose rays go on from these points
    /// has `earlier` light what they hit.
    ///
    /// # Errors
    /// [`GpuError`].
    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        earlier: &mut Earlier<'_>,
    ) -> Result<(), GpuError>;

    /// For a technique of a [`Layer`] before surfaces: a receiver of the same points with a cleared target, to which
    /// emission and all that lies farther from the eye add. `gather` follows with `receiver` itself: what it dims of that
    /// it writes to the target with the first sample of a picture, and adds with others. `None`: it adds light at surfaces.
    ///
    /// # Errors
    /// [`GpuError`].
    fn behind(
        &mut self,
        _frame: &mut Frame<'_>,
        _receiver: &Receiver,
    ) -> Result<Option<Receiver>, GpuError> {
        Ok(None)
    }

    /// How many of its plan's lookups four neighbouring points share where their light is soon gathered again, such as in
    /// cubes while a light moves.
    fn shared_lookups(&self) -> u32 {
        0
    }

    /// Work that waited in the last frame and that shows as soon as it is done, such as cubes that mirrors show.
    /// Techniques before this one that light points of their own leave room for it in the frame's budget.
    fn waiting(&self) -> u64 {
        0
    }

    /// How open the scene is at its surfaces, for techniques after it ([`Provided::Openness`]); `None` until it is known.
    fn openness(&self) -> Option<&dyn Openness> {
        None
    }

    /// What rays of techniques after it meet in media ([`Provided::MediaSources`]); `None` without media.
    fn media_sources(&self) -> Option<MediaSources> {
        None
    }

    /// Its resources on the GPU.
    fn inspect(&self) -> Inspection {
        Inspection::default()
    }

    /// Numbers about its work since the last call, counted on the GPU. Waits for the GPU; for measurements.
    ///
    /// # Errors
    /// [`GpuError`].
    fn figures(&mut self, _gpu: &Gpu) -> Result<Vec<Figure>, GpuError> {
        Ok(Vec::new())
    }

    /// Saving and resuming, for techniques whose maps take long.
    fn resumable(&mut self) -> Option<&mut dyn Resume> {
        None
    }
}

/// A technique whose maps take so long that checkpoints save them.
pub trait Resume {
    /// Saved progress, for resuming; `None` when there is none yet. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    fn save(&self, gpu: &Gpu) -> Result<Option<Vec<u8>>, GpuError>;

    /// Continues from progress that was saved for the same scene and settings. Called after each `generate` until it
    /// returns true. It returns false until the light from which its maps are made is what it was when they were saved.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when the progress was saved for another scene or other settings.
    fn resume(&mut self, gpu: &Gpu, saved: &[u8]) -> Result<bool, GpuError>;
}

/// The light of emitters and of the techniques earlier in the frame, whose maps are current. Techniques that light
/// points of their own gather it.
#[derive(Debug)]
pub struct Earlier<'a> {
    emission: &'a mut Emission,
    techniques: &'a mut [Box<dyn Technique>],
    /// The maps around objects.
    pub impostors: &'a mut Impostors,
    environments: &'a mut Environments,
    /// Grows when a setting of any technique changes: earlier captures are stale.
    pub settings_version: u64,
    /// Grows when the light of these techniques improves although nothing has changed.
    pub revision: u64,
    /// Whether the light of these techniques is final, as long as nothing changes.
    pub is_final: bool,
    /// Whether points outside the camera's view are lit: maps that follow the camera do not cover them.
    pub lights_elsewhere: bool,
    /// The technique's part of the frame's budget.
    slice: Slice,
    /// What a gather of these techniques looks up per point: where its light stays, and where it is brief.
    lookups: [u64; 2],
}

impl<'a> Earlier<'a> {
    /// Light of emitters and of `techniques`.
    pub(crate) fn new(
        emission: &'a mut Emission,
        techniques: &'a mut [Box<dyn Technique>],
        impostors: &'a mut Impostors,
        environments: &'a mut Environments,
        settings_version: u64,
        revision: u64,
        lights_elsewhere: bool,
    ) -> Self {
        Self {
            emission,
            techniques,
            impostors,
            environments,
            settings_version,
            revision,
            is_final: true,
            lights_elsewhere,
            slice: Slice::unlimited(),
            lookups: [1; 2],
        }
    }

    /// How open the scene is at its surfaces, as the last technique knows that provides it.
    pub fn openness(&self) -> Option<&dyn Openness> {
        let mut techniques = self.techniques.iter().rev();
        techniques.find_map(|technique| technique.openness())
    }

    /// What rays meet in media, as the last technique knows that provides it.
    pub fn media_sources(&self) -> Option<MediaSources> {
        let mut techniques = self.techniques.iter().rev();
        techniques.find_map(|technique| technique.media_sources())
    }

    /// The same with a limit on the technique's work. `lookups`: what a gather of the techniques looks up per point, where
    /// its light stays, and where it is brief.
    pub(crate) fn within(self, slice: Slice, lookups: [u64; 2]) -> Self {
        Self {
            slice,
            lookups,
            ..self
        }
    }

    /// The same, with light that may not be final.
    pub(crate) fn refining(self, is_final: bool) -> Self {
        Self { is_final, ..self }
    }

    /// Whether the technique may begin another step in this frame. To be asked only if it would; one that is refused its
    /// first gets its turn in a later frame.
    pub fn may_step(&self) -> bool {
        self.slice.may_step_after(0)
    }

    /// What is left of the technique's budget in this frame.
    pub(crate) fn left(&self) -> u64 {
        self.slice.left()
    }

    /// Whether the frame has a budget: work that would otherwise be done at once is cut into steps.
    pub fn is_limited(&self) -> bool {
        self.slice.is_limited()
    }

    /// As [`Earlier::may_step`], after further work that the technique is going to do in this frame.
    pub(crate) fn may_step_after(&self, work: u64) -> bool {
        self.slice.may_step_after(work)
    }

    /// Work of a gather at the points.
    pub(crate) fn gather_work(&self, points: u64) -> u64 {
        points * self.lookups[0]
    }

    /// Work of a gather at the points, if it is brief ([`Receiver::briefly`]).
    pub(crate) fn brief_gather_work(&self, points: u64) -> u64 {
        points * self.lookups[1]
    }

    /// Counts work of the technique's own: rays traced, lookups at points, or pixels drawn. [`Earlier::gather`] counts by
    /// itself.
    pub fn count(&mut self, work: u64) {
        self.slice.count(work);
    }

    /// Ends the technique's part of the frame.
    pub(crate) fn into_slice(self) -> Slice {
        self.slice
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
        wanted: &WantedImpostor,
        seed: u32,
    ) -> Result<Maps, GpuError> {
        let settings = self.settings_version;
        let (maps, pixels) = self.impostors.renew(frame, scene, wanted, settings, seed)?;
        let maps = maps.clone();
        if pixels > 0 {
            self.count(pixels);
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
        wanted: Wanted,
        is_read: bool,
    ) -> Result<(&Prefiltered, Generated), GpuError> {
        let (gpu, never_waits, slice) = (frame.gpu, frame.never_waits(), &mut self.slice);
        let takes = |step: u64| {
            let awaits_shaders = never_waits && gpu.is_compiling();
            let may_step = !awaits_shaders && slice.may_step_after(0);
            if may_step {
                slice.count(step);
            }
            may_step
        };
        let generated = if is_read {
            Generated::of_environment(self.environments.fill(frame, scene, wanted, takes)?)
        } else {
            Generated::FINAL
        };
        let maps = self.environments.of(frame.gpu, scene, wanted)?;
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
        self.count(match receiver.is_brief {
            true => self.brief_gather_work(points),
            false => self.gather_work(points),
        });
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
        let attenuated = self.emission.attenuation.begin(frame, receiver)?;
        // From the eye on, what lies before surfaces has all else gathered behind it.
        let techniques = self.techniques.iter().enumerate();
        let layers = techniques.map(|(index, one)| (one.info().layer, index));
        let mut before: Vec<_> = layers
            .filter(|&(layer, index)| layer > Layer::Surfaces && adds(self.name(index)))
            .collect();
        before.sort_unstable_by(|a, b| b.cmp(a));
        let mut farthest = attenuated.clone();
        let mut nearer = Vec::new();
        for (_, index) in before {
            if let Some(behind) = self.techniques[index].behind(frame, &farthest)? {
                nearer.push((index, std::mem::replace(&mut farthest, behind)));
            }
        }
        if with_emission {
            self.emission.record(frame, scene, &farthest)?;
        } else {
            attenuated.clear(frame);
        }
        for index in 0..self.techniques.len() {
            if adds(self.name(index)) && !nearer.iter().any(|(one, _)| *one == index) {
                self.gather_by(index, frame, scene, &farthest)?;
            }
        }
        for (index, receiver) in nearer.iter().rev() {
            self.gather_by(*index, frame, scene, receiver)?;
        }
        self.emission.attenuation.end(frame, receiver)
    }

    /// Adds the light of one of the techniques.
    fn gather_by(
        &mut self,
        index: usize,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
    ) -> Result<(), GpuError> {
        let (techniques, rest) = self.techniques.split_at_mut(index);
        let mut earlier = Earlier::new(
            self.emission,
            techniques,
            self.impostors,
            self.environments,
            self.settings_version,
            self.revision,
            self.lights_elsewhere,
        );
        rest[0].gather(frame, scene, receiver, &mut earlier)
    }

    fn name(&self, index: usize) -> &'static str {
        self.techniques[index].info().name
    }
}

/// The inputs of per-object maps: other settings or other kinds of objects need other maps.
#[derive(Debug)]
pub(crate) struct ObjectMapsKey<S> {
    settings: S,
    claimed: Vec<u32>,
    objects: Vec<Object>,
}

impl<S: PartialEq + Clone> ObjectMapsKey<S> {
    /// For the objects with the numbers `claimed`.
    pub fn new(settings: &S, claimed: &[u32], scene: &GpuScene) -> Self {
        let objects = claimed.iter().map(|&one| &scene.objects[one as usize]);
        Self {
            settings: settings.clone(),
            claimed: claimed.to_vec(),
            objects: objects.cloned().collect(),
        }
    }

    /// Whether the maps are also valid for these settings and objects.
    pub fn serves(&self, settings: &S, claimed: &[u32], scene: &GpuScene) -> bool {
        let objects = claimed.iter().map(|&one| &scene.objects[one as usize]);
        self.settings == *settings && self.claimed == claimed && self.objects.iter().eq(objects)
    }

    /// The objects, and their numbers.
    pub fn objects(&self) -> impl Iterator<Item = (u32, &Object)> {
        self.claimed.iter().copied().zip(&self.objects)
    }
}
