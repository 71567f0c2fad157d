//! The techniques: each generates illumination into maps and gathers it at surface points.
//!
//! [`Technique`] is the trait that [`crate::lighting::Lighting`] loops over; [`Registry`] lists the techniques in the
//! order of the frame. docs/adding-a-technique.md walks through a new one.

mod budget;
pub mod caustics;
pub mod distance_impostor;
mod earlier;
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
pub mod path_tracing;
mod precomputed;
pub mod radiance_transfer;
pub mod radiosity;
pub mod ray_tracing;
mod registry;
pub mod shadow_map;

pub use budget::{Budget, Slice};
pub(crate) use earlier::LightState;
pub use earlier::{Earlier, EarlierLight, Shared};
pub use info::{Cost, Info, Layer, Needs, OwnPoints, Provided, Role};
pub use map::{Map, MapRead, Texels};
pub(crate) use occasion::MOST_TRACED;
pub use occasion::{Occasion, Purpose, Speed, Values};
pub use openness::{Openness, OpennessLookup};
pub use participating_media::sources::MediaSources;
pub use precomputed::Precomputed;
pub use registry::{Registration, Registry};

use std::any::Any;
use std::sync::Arc;

use gpugi_scene::Atlas;

use crate::capture::{Receiver, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::light_paths::LightPaths;
use crate::prefiltered::Filled;
use crate::scene::{Claims, GpuScene, Object};
use crate::settings::SettingSet;
pub use crate::stage::Unready;

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

impl Inspection {
    /// Maps, and nothing beside.
    pub fn of(maps: impl IntoIterator<Item = Map>) -> Self {
        Self {
            maps: maps.into_iter().collect(),
            ..Self::default()
        }
    }
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

    /// Updates the technique's maps for what `view` sees: a list of stages ([`crate::stage::Stage`]), which do nothing
    /// if they are current. Never waits for the GPU.
    ///
    /// # Errors
    /// [`Unready`]: it failed, or waits for something without which no light can be gathered.
    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        view: &View,
        earlier: &mut Earlier<'_>,
    ) -> Result<Generated, Unready>;

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

/// The value of settings that leaves the choice of objects, or of a point, to gpugi.
pub(crate) const AUTO: &str = "auto";

/// Whether any of these draws its light by chance for each point.
pub(crate) fn are_noisy(techniques: &[Box<dyn Technique>]) -> bool {
    let mut techniques = techniques.iter();
    techniques.any(|technique| technique.info().is_noisy)
}

/// [`Plan::object_names`] of such a setting.
pub(crate) fn named(objects: &str) -> String {
    match objects {
        AUTO => String::new(),
        list => list.to_owned(),
    }
}

/// Whether such a setting chooses the object: if `auto` holds where it leaves the choice to gpugi, otherwise if it names
/// the object and `named` holds.
pub(crate) fn chooses(objects: &str, object: &Object, auto: bool, named: bool) -> bool {
    match objects {
        AUTO => auto,
        list => named && object.is_named_by(list),
    }
}

/// Objects that have maps of their own, by number: other objects, or other kinds of them, need other maps.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Claimed(Arc<[(u32, Object)]>);

impl Claimed {
    /// The objects with these numbers.
    pub fn new(numbers: &[u32], scene: &GpuScene) -> Self {
        let objects = numbers.iter();
        let objects = objects.map(|&number| (number, scene.objects[number as usize].clone()));
        Self(objects.collect())
    }

    /// The objects, and their numbers.
    pub fn objects(&self) -> &[(u32, Object)] {
        &self.0
    }

    /// Their numbers.
    pub fn numbers(&self) -> impl Iterator<Item = u32> {
        self.0.iter().map(|(number, _)| *number)
    }
}

/// The atlas in which the technique `name` keeps light: [`GpuScene::atlas`].
///
/// # Errors
/// [`Unready`], also while it is being laid out.
pub(crate) fn atlas(
    gpu: &Gpu,
    scene: &GpuScene,
    name: &'static str,
    (size, density): (u32, f32),
    bytes_per_texel: u64,
) -> Result<Arc<Atlas>, Unready> {
    let atlas = scene.atlas(gpu, name, size, density, bytes_per_texel)?;
    atlas.ok_or_else(|| Unready::Waits {
        progress: scene.atlas_progress(),
        what: "texture atlas",
    })
}
