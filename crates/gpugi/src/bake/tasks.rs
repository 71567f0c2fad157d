//! Bakes as tasks: plain values that can be stored and sent to other processes or machines, and whose results merge.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::ops::Range;

use gpugi_scene::Scene;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::gpu::{Gpu, GpuError};
use crate::lighting::LightingError;

/// A bake that consists of tasks: the techniques make their maps; some samples of one tile. [`Bake::step`] takes all
/// tasks in order. [`Bake::run`] and [`Bake::merge`] do the same with tasks that run elsewhere: on the same kind of
/// adapter with the same build, the merged result has the same bits, in whatever order and wherever the tasks ran.
pub trait Bake {
    /// Samples of a tile, taken by one task.
    type Samples: Debug + Clone + PartialEq + Serialize + DeserializeOwned;

    /// All tasks, in the order in which [`Bake::step`] takes them. They depend on the options and on the adapter's
    /// limits.
    fn tasks(&self) -> Vec<Task>;

    /// Takes a step of bounded length; `None` when nothing is left to do.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    fn step(&mut self) -> Result<Option<Progress>, LightingError>;

    /// Runs one task to its end and returns its result, which is not merged here. Waits for the GPU.
    ///
    /// # Errors
    /// [`LightingError::Gpu`], also when the task is none of [`Bake::tasks`].
    fn run(&mut self, task: &Task) -> Result<Part<Self::Samples>, LightingError>;

    /// Takes over the result of a task that ran elsewhere; maps before the first step. Results that this bake already
    /// has are dropped.
    ///
    /// # Errors
    /// [`LightingError::Gpu`] when it is the result of another bake: one of another scene, with other techniques,
    /// settings or options, or on another adapter.
    fn merge(&mut self, part: Part<Self::Samples>) -> Result<(), LightingError>;

    /// Whether all samples are taken.
    fn is_complete(&self) -> bool;
}

/// A task of a bake ([`Bake::tasks`]).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Task {
    /// The techniques make their maps. Other bakes that merge the result need not solve them again.
    Maps,
    /// Some samples of one tile.
    Samples {
        /// Index of the tile.
        tile: u32,
        /// The samples.
        samples: Range<u32>,
    },
}

/// The result of a task, to be merged by [`Bake::merge`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Part<S> {
    pub(super) bake: BakeKey,
    pub(super) result: TaskResult<S>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) enum TaskResult<S> {
    Maps(SavedMaps),
    Samples(S),
}

/// Saved maps of techniques, by name.
pub type SavedMaps = BTreeMap<String, Vec<u8>>;

/// A hash of everything that decides the results of a bake's tasks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub(super) struct BakeKey([u8; 32]);

impl BakeKey {
    /// `how` describes what is baked and how.
    pub fn new(gpu: &Gpu, scene: &[u8; 32], how: &impl Debug) -> Self {
        let adapter = (&gpu.adapter.name, &gpu.adapter.driver);
        let text = format!("{} {adapter:?} {how:?}", env!("CARGO_PKG_VERSION"));
        let mut hasher = blake3::Hasher::new();
        hasher.update(scene);
        hasher.update(text.as_bytes());
        Self(*hasher.finalize().as_bytes())
    }
}

/// A hash of a scene and of the atlas that it is baked into.
pub(super) fn digest(scene: &Scene, atlas: &impl Serialize) -> [u8; 32] {
    let atlas = postcard::to_allocvec(atlas).expect("sequences of known length");
    let mut hasher = blake3::Hasher::new();
    hasher.update(&scene.digest());
    hasher.update(&atlas);
    *hasher.finalize().as_bytes()
}

/// The stages of a bake.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The techniques make their maps.
    Maps,
    /// Tiles get their samples.
    Samples,
}

/// Progress of a bake.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// The current stage.
    pub stage: Stage,
    /// Part of that stage that is done (0 to 1).
    pub done: f32,
}

/// The samples of a bake, and how tasks share them out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shares {
    pub tiles: u32,
    /// Samples of each tile.
    pub samples: u32,
    /// Most samples per task.
    pub samples_per_task: u32,
}

impl Shares {
    /// The samples of each task of a tile.
    pub fn of_tile(&self) -> impl Iterator<Item = Range<u32>> + use<> {
        let all = self.samples.max(1);
        let of_task = self.samples_per_task.max(1);
        let firsts = (0..all).step_by(of_task as usize);
        firsts.map(move |first| first..first.saturating_add(of_task).min(all))
    }

    /// Tile and samples of all tasks, tile after tile.
    pub fn all(&self) -> impl Iterator<Item = (u32, Range<u32>)> + use<> {
        let this = *self;
        (0..this.tiles).flat_map(move |tile| this.of_tile().map(move |samples| (tile, samples)))
    }

    /// The tasks of [`Shares::all`].
    pub fn tasks(&self) -> impl Iterator<Item = Task> + use<> {
        self.all()
            .map(|(tile, samples)| Task::Samples { tile, samples })
    }

    /// The place in [`Shares::all`] of a task.
    ///
    /// # Errors
    /// When it is none of them.
    pub fn find(&self, tile: u32, samples: &Range<u32>) -> Result<usize, LightingError> {
        let mut of_tile = self.of_tile();
        let found = of_tile.position(|range| range == *samples);
        let found = found.filter(|_| tile < self.tiles);
        let found = found.map(|index| tile as usize * self.of_tile().count() + index);
        found.ok_or_else(|| unfit("this is a task of another bake"))
    }
}

/// An error about results, states and tasks that do not fit a bake.
pub(super) fn unfit(reason: &str) -> LightingError {
    LightingError::Gpu(GpuError::Pass {
        pass: "bake".into(),
        reason: reason.into(),
    })
}

/// The result of a part of the bake `key`.
///
/// # Errors
/// When it is of another bake.
pub(super) fn result_of<S>(part: Part<S>, key: BakeKey) -> Result<TaskResult<S>, LightingError> {
    if part.bake == key {
        Ok(part.result)
    } else {
        Err(unfit("the result of a task of another bake"))
    }
}
