//! The obscurances of an atlas.

use std::ops::Range;

use gpugi_scene::{Atlas, Scene};
use serde::{Deserialize, Serialize};

use super::Leaks;
use super::tasks::{
    Bake, BakeKey, Part, Progress, Shares, Stage, Task, TaskResult, digest, result_of, unfit,
};
use crate::capture::atlas::{AtlasCapture, AtlasCaptureOptions, LeakTest};
use crate::gpu::{Frame, Gpu, GpuError, read_buffer};
use crate::lighting::LightingError;
use crate::scene::GpuScene;
use crate::techniques::obscurances::{ObscurancePage, Settings, Solution};

/// Words of `Texel` of obscurance.wesl; the sums are those from `FIRST_SUM` on.
const WORDS: usize = 12;
const FIRST_SUM: usize = 3;
/// Sum of a sample of value 1, and the most samples of a texel.
const UNIT: u64 = 65_535;
const MOST_SAMPLES: u32 = 65_536;

/// Sums of a texel, as in `Texel` of obscurance.wesl: samples, those in which nothing was within reach, of the others
/// rho and rho times the albedo, and of the open ones the directions.
type Sums = [u32; WORDS - FIRST_SUM];

/// Computes the obscurances of an atlas. Its sums are integers, so that the order of its samples does not matter.
#[derive(Debug)]
pub struct ObscuranceBake {
    gpu: Gpu,
    on_gpu: GpuScene,
    capture: AtlasCapture,
    leaks: LeakTest,
    solution: Solution,
    key: BakeKey,
    shares: Shares,
    state: State,
}

/// How far a bake is.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
struct State {
    /// The finished tasks.
    done: Vec<bool>,
    /// Number of samples taken of the first task that is not finished.
    taken: u32,
}

/// The saved state of an obscurance bake, from which another resumes.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ObscuranceState {
    bake: BakeKey,
    state: State,
    /// `Texel` of obscurance.wesl, page after page; none if no sample is taken.
    texels: Vec<u32>,
}

/// Sums of some samples of the texels of one tile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObscurancePart {
    /// Index of the tile.
    pub(super) tile: u32,
    /// The samples in the sums.
    pub(super) samples: Range<u32>,
    /// The sums of the tile's texels.
    pub(super) sums: Vec<Sums>,
}

impl ObscuranceBake {
    /// Allocates the bake of `atlas`, an atlas of `scene`, in tasks of up to `samples_per_task` directions each.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        atlas: &Atlas,
        settings: &Settings,
        samples_per_task: u32,
    ) -> Result<Self, GpuError> {
        let on_gpu = GpuScene::with_texels(gpu, scene)?;
        let options = AtlasCaptureOptions::default();
        let capture = AtlasCapture::new(gpu, scene, &on_gpu, atlas, &options)?;
        let solution = Solution::new(gpu, scene, &on_gpu, atlas, &capture, settings)?;
        let shares = Shares {
            tiles: solution.tiles(),
            samples: settings.directions,
            samples_per_task,
        };
        let how = ("obscurances", settings, samples_per_task);
        Ok(Self {
            leaks: LeakTest::new(gpu, &on_gpu, &capture)?,
            solution,
            key: BakeKey::new(gpu, &digest(scene, atlas), &how),
            state: State {
                done: vec![false; shares.all().count()],
                taken: 0,
            },
            shares,
            gpu: gpu.clone(),
            on_gpu,
            capture,
        })
    }

    /// Takes the first of `samples` of a tile, as many as a step may; returns the first that is left. Without a sample,
    /// only finds the texels that have a surface.
    fn take(&mut self, tile: u32, samples: Range<u32>) -> Result<u32, GpuError> {
        let mut frame = Frame::new(&self.gpu, false);
        self.on_gpu.merge(&mut frame);
        self.capture.record(&mut frame, &self.on_gpu)?;
        self.leaks.record(&mut frame, &self.on_gpu, &self.capture);
        self.solution
            .prepare(&mut frame, &self.on_gpu, &self.capture)?;
        let mut next = samples.start;
        if !samples.is_empty() {
            let (scene, capture) = (&self.on_gpu, &self.capture);
            (next, _) = self
                .solution
                .take(&mut frame, scene, capture, tile, samples)?;
        }
        frame.submit()?;
        Ok(next)
    }

    /// The texels after the `samples` of a tile.
    fn after(&mut self, tile: u32, samples: &Range<u32>) -> Result<Vec<u32>, LightingError> {
        let mut next = samples.start;
        while next < samples.end {
            next = self.take(tile, next..samples.end)?;
            self.gpu.wait()?;
        }
        Ok(self.texels()?)
    }

    /// `Texel` of obscurance.wesl, page after page.
    fn texels(&self) -> Result<Vec<u32>, GpuError> {
        let [texels, _] = self.solution.buffers();
        read_buffer(&self.gpu, texels, texels.size())
    }

    fn set_texels(&self, words: &[u32]) {
        let [texels, _] = self.solution.buffers();
        self.gpu.write(texels, 0, words);
    }

    /// The texels of a tile among those of [`Self::texels`].
    fn words_of(&self, tile: u32) -> Range<usize> {
        let texels = self.solution.texels_of(&self.capture, tile);
        texels.start * WORDS..texels.end * WORDS
    }

    /// What has been computed so far. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn save(&self) -> Result<ObscuranceState, GpuError> {
        let is_begun = self.state.taken > 0 || self.state.done.contains(&true);
        Ok(ObscuranceState {
            bake: self.key,
            state: self.state.clone(),
            texels: if is_begun { self.texels()? } else { Vec::new() },
        })
    }

    /// Resumes from the saved state of a bake of the same scene, atlas and settings.
    ///
    /// # Errors
    /// [`LightingError::Gpu`], also when the state does not fit such a bake.
    pub fn resume(&mut self, saved: &ObscuranceState) -> Result<(), LightingError> {
        let ObscuranceState {
            bake,
            state,
            texels,
        } = saved;
        let next = state.done.iter().position(|done| !done);
        let next = next.and_then(|index| self.shares.all().nth(index));
        let [buffer, _] = self.solution.buffers();
        let is_sound = state.done.len() == self.state.done.len()
            && state.taken as usize <= next.map_or(0, |(_, samples)| samples.len())
            && (texels.is_empty() || texels.len() as u64 * 4 == buffer.size());
        if *bake != self.key || !is_sound {
            return Err(unfit("what was saved is of another bake"));
        }
        if !texels.is_empty() {
            self.take(0, 0..0)?;
            self.set_texels(texels);
            self.state = state.clone();
        }
        Ok(())
    }

    /// Texels that lie inside other objects. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn leaks(&self) -> Result<Leaks, GpuError> {
        Ok(Leaks::new(&self.leaks.map(&self.gpu)?, self.capture.size))
    }

    /// The pages as they stand now. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn pages(&mut self) -> Result<Vec<ObscurancePage>, GpuError> {
        self.solution.pages(&self.gpu)
    }
}

impl Bake for ObscuranceBake {
    type Samples = ObscurancePart;

    fn tasks(&self) -> Vec<Task> {
        self.shares.tasks().collect()
    }

    fn step(&mut self) -> Result<Option<Progress>, LightingError> {
        let next = self.state.done.iter().position(|done| !done);
        let Some((index, (tile, samples))) =
            next.and_then(|index| Some((index, self.shares.all().nth(index)?)))
        else {
            return Ok(None);
        };
        let left = samples.start + self.state.taken..samples.end;
        let next = self.take(tile, left)?;
        self.state.done[index] = next == samples.end;
        self.state.taken = if next == samples.end {
            0
        } else {
            next - samples.start
        };
        let tasks = self.shares.all().zip(&self.state.done);
        let whole = tasks.filter(|(_, done)| **done);
        let whole: u64 = whole.map(|((_, samples), _)| samples.len() as u64).sum();
        let all = u64::from(self.shares.tiles) * u64::from(self.shares.samples);
        let done = (whole + u64::from(self.state.taken)) as f64 / all as f64;
        Ok(Some(Progress {
            stage: Stage::Samples,
            done: done as f32,
        }))
    }

    fn run(&mut self, task: &Task) -> Result<Part<ObscurancePart>, LightingError> {
        let Task::Samples { tile, samples } = task else {
            return Err(unfit("obscurances have no maps"));
        };
        self.shares.find(*tile, samples)?;
        self.take(*tile, 0..0)?;
        let before = self.texels()?;
        let after = self.after(*tile, samples);
        // What the task adds is not this bake's yet.
        self.set_texels(&before);
        let after = after?;
        let words = self.words_of(*tile);
        let [before, after] = [&before, &after].map(|all| all[words.clone()].chunks_exact(WORDS));
        let added = |(before, after): (&[u32], &[u32])| {
            std::array::from_fn(|sum| after[FIRST_SUM + sum].wrapping_sub(before[FIRST_SUM + sum]))
        };
        let part = ObscurancePart {
            tile: *tile,
            samples: samples.clone(),
            sums: before.zip(after).map(added).collect(),
        };
        Ok(Part {
            bake: self.key,
            result: TaskResult::Samples(part),
        })
    }

    /// Also drops the result of a task that [`Bake::step`] has begun here.
    fn merge(&mut self, part: Part<ObscurancePart>) -> Result<(), LightingError> {
        let TaskResult::Samples(part) = result_of(part, self.key)? else {
            return Err(unfit("obscurances have no maps"));
        };
        let index = self.shares.find(part.tile, &part.samples)?;
        let words = self.words_of(part.tile);
        if words.len() != part.sums.len() * WORDS || !part.sums.iter().all(are_sums) {
            return Err(unfit("the result of a task of another bake"));
        }
        let begun = self.state.done.iter().position(|done| !done);
        if self.state.done[index] || begun == Some(index) && self.state.taken > 0 {
            return Ok(());
        }
        self.take(part.tile, 0..0)?;
        let mut texels = self.texels()?;
        let of_tile = texels[words].chunks_exact_mut(WORDS);
        for (texel, sums) in of_tile.zip(&part.sums) {
            // Sums have no room for more samples than the most, which only peeling with far more lines than its default
            // reaches; a bake in one piece drops single samples instead.
            if texel[FIRST_SUM].saturating_add(sums[0]) <= MOST_SAMPLES {
                for (sum, more) in texel[FIRST_SUM..].iter_mut().zip(sums) {
                    *sum = sum.saturating_add(*more);
                }
            }
        }
        self.set_texels(&texels);
        self.state.done[index] = true;
        Ok(())
    }

    fn is_complete(&self) -> bool {
        self.state.done.iter().all(|done| *done)
    }
}

/// Whether these can be the sums of a texel.
fn are_sums(sums: &Sums) -> bool {
    let [count, open, of_near @ .., x, y, z] = sums;
    let is_within = |sum: &u32, samples: u32| u64::from(*sum) <= u64::from(samples) * UNIT;
    let near = count.saturating_sub(*open);
    *count <= MOST_SAMPLES
        && open <= count
        && of_near.iter().all(|sum| is_within(sum, near))
        && [x, y, z].iter().all(|sum| is_within(sum, *open))
}
