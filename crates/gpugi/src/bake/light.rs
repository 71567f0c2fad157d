//! Bakes the light that techniques add at the texels of an atlas.

mod merge;
mod state;

use std::ops::Range;

use glam::{Vec2, Vec3};
use gpugi_scene::atlas::Seams;
use gpugi_scene::{Atlas, Camera, Projection, Scene};
use serde::{Deserialize, Serialize};

pub use state::{LightState, TexelPart};

use super::Leaks;
use super::solver::Solver;
use super::tasks::{
    Bake, BakeKey, Part, Progress, Shares, Stage, Task, TaskResult, digest, result_of, unfit,
};
use crate::capture::atlas::{self, AtlasCapture, AtlasCaptureOptions, LeakTest, TexelLobes};
use crate::capture::{Output, Receiver, Target, View};
use crate::denoise::{self, FILTER_BYTES, SPREAD_BYTES, Spreads};
use crate::gpu::{Frame, Gpu, GpuError, read_buffer};
use crate::lighting::{Budget, Lighting, LightingError};
use crate::scene::GpuScene;
use crate::techniques::Registry;
use state::LitRows;

/// GPU memory per texel while it is lit (bytes): point (48), coverage (16), hit (4), state (4), sum of light (16),
/// dilation levels (22), and the sums again while they are read back (16).
pub(super) const TEXEL_BYTES: u64 = 126;
/// The same for texels that are denoised, while they are filtered: point, coverage, hit, state, sum of light, squares (16),
/// and what the filter needs. Less while they are lit, with the spread of their samples (32).
const DENOISED_TEXEL_BYTES: u64 = 104 + FILTER_BYTES;
const _: () = assert!(DENOISED_TEXEL_BYTES >= TEXEL_BYTES + SPREAD_BYTES);

/// The quantity that texels store.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Quantity {
    /// Radiance that leaves the diffuse lobes, the same in all directions, plus emitted radiance.
    #[default]
    Diffuse,
    /// Irradiance over pi, independent of materials: the radiance of a white Lambert surface.
    Irradiance,
    /// Radiance that leaves all lobes, seen from straight above.
    All,
}

/// Options of a light bake.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct LightOptions {
    /// What texels store: radiance, or irradiance over pi.
    pub quantity: Quantity,
    /// Samples per texel, at least 1.
    pub samples: u32,
    /// Most samples of a task, at least 1. Samples are summed task by task, so it decides the rounding of the result.
    pub samples_per_task: u32,
    /// Seed of everything stochastic.
    pub seed: u32,
    /// Whether noise is filtered out of the texels, guided by how far their samples spread ([`crate::denoise`]). It takes two
    /// samples or more, and techniques whose noise differs from texel to texel, such as path-tracing.
    pub denoises: bool,
    /// GPU memory for texels (bytes). The bake splits the atlas into as many tiles as that requires and lights them one
    /// after another. The scene and the maps of techniques need memory on top.
    pub memory: u64,
}

impl Default for LightOptions {
    fn default() -> Self {
        Self {
            quantity: Quantity::Diffuse,
            samples: 16,
            samples_per_task: 64,
            seed: 0,
            denoises: false,
            memory: 512 << 20,
        }
    }
}

/// A baked atlas.
#[derive(Debug, Clone, PartialEq)]
pub struct LitAtlas {
    /// Means of the samples, page by page, row by row from the top. Empty texels are filled from their neighbours, and
    /// seams are closed.
    pub pages: Vec<Vec<Vec3>>,
    /// Texels that lie inside other objects.
    pub leaks: Leaks,
}

/// Lights the texels of an atlas, tile by tile and some samples at a time. A step refines the maps by one frame until
/// they are final; then each adds one sample of light to a tile.
#[derive(Debug)]
pub struct LightBake {
    scene: Scene,
    atlas: Atlas,
    options: LightOptions,
    /// [`digest`] of the scene and the atlas.
    digest: [u8; 32],
    solver: Solver,
    /// Techniques whose light is left out.
    left_out: Vec<String>,
    tiles: Vec<atlas::Tile>,
    /// The finished tiles.
    done: Vec<Option<LitRows>>,
    /// Results of tasks in unfinished tiles.
    parts: Vec<TexelPart>,
    /// The task that [`LightBake::step`] is at.
    running: Option<Running>,
    /// The first samples of that task, before it has begun again.
    unfinished: Option<TexelPart>,
}

/// A task that lights texels.
#[derive(Debug)]
struct Running {
    tile: u32,
    samples: Range<u32>,
    /// The next sample.
    next: u32,
    lit: Tile,
}

/// The texels that are being lit: one tile.
#[derive(Debug)]
struct Tile {
    pub capture: AtlasCapture,
    pub leaks: LeakTest,
    /// Sums of light, one target per piece of the capture.
    pub targets: Vec<Target>,
    /// Of each target, if the bake is denoised.
    pub spreads: Vec<Spreads>,
}

impl Drop for Tile {
    /// Frees memory at once: techniques keep what they bound for a while.
    fn drop(&mut self) {
        for points in self.capture.points() {
            points.points.destroy();
            points.hits.texture().destroy();
        }
        for target in &self.targets {
            target.radiance.destroy();
        }
        self.spreads.iter().for_each(Spreads::destroy);
    }
}

impl LightBake {
    /// A bake of `scene` into `atlas`, an atlas of that scene, by the named techniques.
    ///
    /// # Errors
    /// [`LightingError`].
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        atlas: &Atlas,
        names: &[String],
        options: &LightOptions,
    ) -> Result<Self, LightingError> {
        let mut on_gpu = GpuScene::with_texels(gpu, scene)?;
        let lighting = Lighting::new(gpu, &mut on_gpu, names, &Registry::default())?;
        gpu.check()?;
        let (texel_bytes, halo) = match options.denoises {
            true => (DENOISED_TEXEL_BYTES, atlas::HALO + denoise::MARGIN),
            false => (TEXEL_BYTES, atlas::HALO),
        };
        let most_texels = u32::try_from(options.memory / texel_bytes).unwrap_or(u32::MAX);
        let tiles = atlas::tiles(gpu, atlas, most_texels, halo)?;
        // Maps that follow a camera follow one that sees the whole scene.
        let diagonal = on_gpu.diagonal();
        let center = scene.bounds().center();
        let all = Camera {
            projection: Projection::Orthographic { height: diagonal },
            ..Camera::look_at("all", center + Vec3::Y * diagonal, center, 1.0)
        };
        let index = View::NO_SAMPLE;
        let view = View::new(&all, [1, 1], Vec2::ZERO, index, options.seed, diagonal);
        Ok(Self {
            scene: scene.clone(),
            atlas: atlas.clone(),
            options: *options,
            digest: digest(scene, atlas),
            solver: Solver::new(gpu, on_gpu, lighting, view),
            left_out: Vec::new(),
            done: vec![None; tiles.len()],
            tiles,
            parts: Vec::new(),
            running: None,
            unfinished: None,
        })
    }

    /// The lighting of the texels, which knows what it leaves out.
    pub fn lighting(&self) -> &Lighting {
        &self.solver.lighting
    }

    /// The scene on the GPU.
    pub fn scene(&self) -> &GpuScene {
        &self.solver.on_gpu
    }

    /// Sets one setting of one technique from text, before the first step.
    ///
    /// # Errors
    /// Those of [`Lighting::set`].
    pub fn set(&mut self, technique: &str, name: &str, value: &str) -> Result<(), LightingError> {
        self.solver.set(technique, name, value)
    }

    /// Leaves the light of these techniques out, before the first step. They still light what the others capture.
    pub fn leave_out(&mut self, techniques: &[&str]) {
        self.left_out = techniques.iter().map(|&name| name.to_owned()).collect();
    }

    /// Number of tiles, which are lit one after another.
    pub fn tiles(&self) -> usize {
        self.tiles.len()
    }

    /// The stage of the next step.
    pub fn stage(&self) -> Stage {
        if self.solver.is_refining {
            Stage::Maps
        } else {
            Stage::Samples
        }
    }

    /// Adds the next sample of light at the texels of a tile: emission, and the light of the techniques.
    fn light(&mut self, running: &mut Running) -> Result<(), LightingError> {
        let Solver {
            gpu,
            on_gpu: scene,
            lighting,
            view,
            ..
        } = &mut self.solver;
        let mut frame = Frame::new(gpu, false);
        let lit = &mut running.lit;
        lit.capture.look(gpu, running.next, self.options.seed);
        lit.capture.record(&mut frame, scene)?;
        lit.leaks.record(&mut frame, scene, &lit.capture);
        lighting.prepare(&mut frame, scene, view, Budget::UNLIMITED)?;
        let adds = |name: &str| !self.left_out.iter().any(|technique| technique == name);
        for (points, target) in lit.capture.points().zip(&lit.targets) {
            let receiver = Receiver::new(points, target);
            lighting.gather_some(&mut frame, scene, &receiver, adds)?;
        }
        for (spread, target) in lit.spreads.iter().zip(&lit.targets) {
            spread.record(&mut frame, &target.radiance)?;
        }
        frame.submit()?;
        running.next += 1;
        Ok(())
    }

    /// Begins a task; `first`: its first samples, if they are known.
    fn begin(
        &self,
        number: u32,
        samples: Range<u32>,
        first: Option<&TexelPart>,
    ) -> Result<Running, LightingError> {
        let gpu = &self.solver.gpu;
        let (capture, leaks) = self.capture(number)?;
        let targets = capture
            .points()
            .map(|points| Target::new(gpu, points.count));
        let targets: Vec<Target> = targets.collect::<Result<_, GpuError>>()?;
        let spreads = (capture.points().filter(|_| self.denoises()))
            .map(|points| Spreads::new(gpu, points.count));
        let spreads: Vec<Spreads> = spreads.collect::<Result<_, GpuError>>()?;
        let mut next = samples.start;
        if let Some(first) =
            first.filter(|part| (part.tile, part.samples.start) == (number, samples.start))
        {
            next = first.samples.end;
            let (mut rest, mut squares) = (&first.sums[..], &first.squares[..]);
            for (index, target) in targets.iter().enumerate() {
                let (these, others) = rest.split_at((target.radiance.size() / 16) as usize);
                gpu.write(&target.radiance, 0, these);
                rest = others;
                if let Some(spread) = spreads.get(index) {
                    let (of_these, others) = squares.split_at(these.len());
                    spread.resume(gpu, these, of_these);
                    squares = others;
                }
            }
        }
        Ok(Running {
            tile: number,
            samples,
            next,
            lit: Tile {
                capture,
                leaks,
                targets,
                spreads,
            },
        })
    }

    /// Allocates the surface points of a tile, and their test.
    fn capture(&self, number: u32) -> Result<(AtlasCapture, LeakTest), LightingError> {
        let tile = &self.tiles[number as usize];
        let gpu = &self.solver.gpu;
        let options = AtlasCaptureOptions {
            lobes: match self.options.quantity {
                Quantity::Diffuse | Quantity::Irradiance => TexelLobes::Diffuse,
                Quantity::All => TexelLobes::All,
            },
            output: match self.options.quantity {
                Quantity::Irradiance => Output::Irradiance,
                Quantity::Diffuse | Quantity::All => Output::RadianceToEye,
            },
            rows: Some(tile.captured.clone()),
            ..AtlasCaptureOptions::default()
        };
        let on_gpu = &self.solver.on_gpu;
        let capture = AtlasCapture::new(gpu, &self.scene, on_gpu, &self.atlas, &options)?;
        let leaks = LeakTest::new(gpu, on_gpu, &capture)?;
        Ok((capture, leaks))
    }

    /// Whether the texels are filtered: one sample does not tell its noise.
    fn denoises(&self) -> bool {
        self.options.denoises && self.options.samples > 1
    }

    /// The light of a task so far. Waits for the GPU.
    fn part(&self, running: &Running) -> Result<TexelPart, LightingError> {
        let mut sums = Vec::new();
        for Target { radiance, .. } in &running.lit.targets {
            sums.extend(read_buffer::<[f32; 4]>(
                &self.solver.gpu,
                radiance,
                radiance.size(),
            )?);
        }
        let mut squares = Vec::new();
        for spread in &running.lit.spreads {
            squares.extend(spread.squares(&self.solver.gpu)?);
        }
        Ok(TexelPart {
            tile: running.tile,
            samples: running.samples.start..running.next,
            sums,
            squares,
            leak_map: running.lit.leaks.map(&self.solver.gpu)?,
        })
    }

    /// Saves the state of the bake. Waits for the GPU.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn save(&mut self) -> Result<LightState, LightingError> {
        let maps = self.solver.save()?;
        let unfinished = match &self.running {
            None => self.unfinished.clone(),
            Some(running) => Some(self.part(running)?),
        };
        Ok(LightState {
            maps,
            done: self.done.clone(),
            parts: self.parts.clone(),
            unfinished,
        })
    }

    /// Resumes from the saved state of a bake of the same scene, atlas, techniques, settings and options. Call it
    /// before the first step.
    ///
    /// # Errors
    /// [`LightingError::Gpu`] when the state does not fit such a bake.
    pub fn resume(&mut self, state: LightState) -> Result<(), LightingError> {
        let is_whole = |(tile, rows): (&atlas::Tile, &Option<LitRows>)| {
            let texels = tile.rows.len() * self.side();
            rows.as_ref().is_none_or(|rows| rows.is_sound(texels))
        };
        if state.done.len() != self.tiles.len() || !self.tiles.iter().zip(&state.done).all(is_whole)
        {
            return Err(unfit("what was saved is of another bake"));
        }
        for part in &state.parts {
            self.check(part, true)?;
        }
        if let Some(part) = &state.unfinished {
            self.check(part, false)?;
        }
        self.solver.saved = state.maps;
        self.done = state.done;
        for part in state.parts {
            self.keep(part)?;
        }
        self.unfinished = state.unfinished;
        Ok(())
    }

    /// The result; texels that were never lit are black.
    pub fn finish(self) -> LitAtlas {
        let (mut texels, mut leak_map) = (Vec::new(), Vec::new());
        for (tile, rows) in self.tiles.iter().zip(self.done) {
            let count = tile.rows.len() * self.atlas.size as usize;
            let rows = rows.unwrap_or_else(|| LitRows {
                texels: vec![Vec3::ZERO; count],
                leak_map: vec![[0; 4]; count],
            });
            texels.extend(rows.texels);
            leak_map.extend(rows.leak_map);
        }
        Seams::new(&self.scene, &self.atlas).smooth(&mut texels);
        let page = (self.atlas.size as usize).pow(2);
        LitAtlas {
            pages: texels.chunks(page).map(<[_]>::to_vec).collect(),
            leaks: Leaks::new(&leak_map, self.atlas.size),
        }
    }
}

impl Bake for LightBake {
    type Samples = TexelPart;

    fn tasks(&self) -> Vec<Task> {
        let texels = self.shares().tasks();
        [Task::Maps].into_iter().chain(texels).collect()
    }

    fn step(&mut self) -> Result<Option<Progress>, LightingError> {
        // Maps serve nobody then, in particular where the atlas is empty.
        if self.is_complete() {
            return Ok(None);
        }
        if self.solver.is_refining {
            return Ok(Some(self.solver.refine()?));
        }
        let mut running = match (self.running.take(), self.next_task()) {
            (Some(running), _) => running,
            (None, Some((tile, samples))) => {
                let first = self.unfinished.take();
                self.begin(tile, samples, first.as_ref())?
            }
            (None, None) => return Ok(None),
        };
        self.light(&mut running)?;
        let lit = running.next - running.samples.start;
        if running.next < running.samples.end {
            self.running = Some(running);
        } else {
            let part = self.part(&running)?;
            // Frees the tile's memory.
            drop(running);
            self.keep(part)?;
        }
        let of_tile = u64::from(self.options.samples.max(1));
        let tiles = self.done.iter().flatten().count() as u64 * of_tile;
        let parts = self.parts.iter().map(|part| part.samples.len() as u64);
        let running = self.running.iter().map(|_| u64::from(lit));
        let samples = tiles + parts.chain(running).sum::<u64>();
        let done = samples as f64 / (of_tile * self.tiles.len() as u64) as f64;
        Ok(Some(Progress {
            stage: Stage::Samples,
            done: done as f32,
        }))
    }

    fn run(&mut self, task: &Task) -> Result<Part<TexelPart>, LightingError> {
        if let Task::Samples { tile, samples } = task {
            self.shares().find(*tile, samples)?;
        }
        self.solver.solve()?;
        let result = match task {
            Task::Maps => TaskResult::Maps(self.solver.save()?),
            Task::Samples { tile, samples } => {
                let mut running = self.begin(*tile, samples.clone(), None)?;
                while running.next < running.samples.end {
                    self.light(&mut running)?;
                    self.solver.gpu.wait()?;
                }
                TaskResult::Samples(self.part(&running)?)
            }
        };
        let bake = self.key();
        Ok(Part { bake, result })
    }

    fn merge(&mut self, part: Part<TexelPart>) -> Result<(), LightingError> {
        match result_of(part, self.key())? {
            TaskResult::Maps(maps) => {
                if self.solver.is_refining {
                    self.solver.saved = maps;
                }
                Ok(())
            }
            TaskResult::Samples(part) => {
                self.check(&part, true)?;
                self.keep(part)
            }
        }
    }

    fn is_complete(&self) -> bool {
        self.done.iter().all(Option::is_some)
    }
}

impl LightBake {
    /// Whether maps are not final yet: the next step refines them.
    pub fn is_refining(&self) -> bool {
        self.solver.is_refining
    }

    pub(super) fn key(&self) -> BakeKey {
        let how = (
            "light",
            self.solver.techniques(),
            &self.left_out,
            self.options,
        );
        BakeKey::new(&self.solver.gpu, &self.digest, &how)
    }

    /// The samples of all tiles, and how tasks share them out.
    fn shares(&self) -> Shares {
        Shares {
            tiles: self.tiles.len() as u32,
            samples: self.options.samples,
            samples_per_task: self.options.samples_per_task,
        }
    }
}
