//! Bakes the light that techniques add at the texels of an atlas.

use std::collections::BTreeMap;

use glam::{Vec2, Vec3};
use gpugi_scene::atlas::Seams;
use gpugi_scene::{Atlas, Camera, Projection, Scene};
use serde::{Deserialize, Serialize};

use super::Leaks;
use crate::capture::atlas::{
    self, AtlasCapture, AtlasCaptureOptions, Dilation, LeakTest, TexelLobes,
};
use crate::capture::{Output, Receiver, Target, View};
use crate::gpu::{Frame, Gpu, GpuError, read_buffer};
use crate::lighting::{Lighting, LightingError, Readiness};
use crate::scene::GpuScene;
use crate::techniques::Registry;

/// GPU memory per texel while it is lit (bytes): point (48), coverage (16), hit (4), state (4), sum of light (16),
/// dilation levels (22), and the sums again while they are read back (16).
pub(super) const TEXEL_BYTES: u64 = 126;

/// The quantity that texels store.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LightOptions {
    /// What texels store: radiance, or irradiance over pi.
    pub quantity: Quantity,
    /// Samples per texel, at least 1.
    pub samples: u32,
    /// Seed of everything stochastic.
    pub seed: u32,
    /// GPU memory for texels (bytes). The bake splits the atlas into as many tiles as that requires and lights them one
    /// after another. The scene and the maps of techniques need memory on top.
    pub memory: u64,
}

impl Default for LightOptions {
    fn default() -> Self {
        Self {
            quantity: Quantity::Diffuse,
            samples: 16,
            seed: 0,
            memory: 512 << 20,
        }
    }
}

/// The stages of a bake.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The techniques make their maps.
    Maps,
    /// Texels are lit.
    Texels,
}

/// Progress of a bake.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// The current stage.
    pub stage: Stage,
    /// Part of that stage that is done (0 to 1).
    pub done: f32,
}

/// The saved state of a light bake, from which another resumes.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LightState {
    /// Saved maps of techniques, by name.
    maps: BTreeMap<String, Vec<u8>>,
    /// The finished tiles.
    done: LitRows,
    /// Samples so far of the unfinished tile, and their sums.
    samples: u32,
    sums: Vec<[f32; 4]>,
}

/// Rows of texels from the first row on.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
struct LitRows {
    texels: Vec<Vec3>,
    leak_map: Vec<[u8; 4]>,
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

/// Lights the texels of an atlas tile by tile, one sample at a time.
#[derive(Debug)]
pub struct LightBake<'a> {
    gpu: Gpu,
    scene: &'a Scene,
    atlas: &'a Atlas,
    options: LightOptions,
    on_gpu: GpuScene,
    lighting: Lighting,
    view: View,
    /// Progress of the maps; `None` once they are final.
    refining: Option<f32>,
    tiles: Vec<atlas::Tile>,
    tile: Option<Tile>,
    done: LitRows,
    resumed: LightState,
}

/// The texels that are being lit: one tile.
#[derive(Debug)]
struct Tile {
    pub capture: AtlasCapture,
    pub leaks: LeakTest,
    /// Sums of light, one target per piece of the capture.
    pub targets: Vec<Target>,
    /// Samples so far.
    pub samples: u32,
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
    }
}

impl<'a> LightBake<'a> {
    /// A bake of `scene` into `atlas`, an atlas of that scene, by the named techniques.
    ///
    /// # Errors
    /// [`LightingError`].
    pub fn new(
        gpu: &Gpu,
        scene: &'a Scene,
        atlas: &'a Atlas,
        names: &[String],
        options: &LightOptions,
    ) -> Result<Self, LightingError> {
        let mut on_gpu = GpuScene::with_texels(gpu, scene)?;
        let mut lighting = Lighting::new(gpu, &mut on_gpu, names, &Registry::default())?;
        lighting.light_elsewhere();
        gpu.check()?;
        let most_texels = u32::try_from(options.memory / TEXEL_BYTES).unwrap_or(u32::MAX);
        let tiles = atlas::tiles(gpu, atlas, most_texels)?;
        // Maps that follow a camera follow one that sees the whole scene.
        let diagonal = on_gpu.diagonal();
        let center = scene.bounds().center();
        let all = Camera {
            projection: Projection::Orthographic { height: diagonal },
            ..Camera::look_at("all", center + Vec3::Y * diagonal, center, 1.0)
        };
        Ok(Self {
            view: View::new(
                &all,
                [1, 1],
                Vec2::ZERO,
                View::NO_SAMPLE,
                options.seed,
                diagonal,
            ),
            gpu: gpu.clone(),
            scene,
            atlas,
            options: *options,
            on_gpu,
            lighting,
            refining: Some(-1.0),
            tiles,
            tile: None,
            done: LitRows::default(),
            resumed: LightState::default(),
        })
    }

    /// The lighting of the texels, which knows what it leaves out.
    pub fn lighting(&self) -> &Lighting {
        &self.lighting
    }

    /// The scene on the GPU.
    pub fn scene(&self) -> &GpuScene {
        &self.on_gpu
    }

    /// Sets one setting of one technique from text, before the first step.
    ///
    /// # Errors
    /// Those of [`Lighting::set`].
    pub fn set(&mut self, technique: &str, name: &str, value: &str) -> Result<(), LightingError> {
        self.lighting.set(&mut self.on_gpu, technique, name, value)
    }

    /// Number of tiles, which are lit one after another.
    pub fn tiles(&self) -> usize {
        self.tiles.len()
    }

    /// The stage of the next step.
    pub fn stage(&self) -> Stage {
        match self.refining {
            Some(_) => Stage::Maps,
            None => Stage::Texels,
        }
    }

    /// Takes a step. First, steps refine the maps one frame at a time until they are final. Then each step adds one
    /// sample of light to the current tile: the light of those techniques whose names `adds` accepts. The other
    /// techniques still light what these capture. `None` when nothing is left to do.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn step(&mut self, adds: impl Fn(&str) -> bool) -> Result<Option<Progress>, LightingError> {
        let stage = self.stage();
        if let Some(before) = self.refining {
            let (done, is_usable) = self.refine()?;
            self.resumed.maps = self
                .lighting
                .resume(std::mem::take(&mut self.resumed.maps))?;
            let is_final = is_usable && (done >= 1.0 || done <= before);
            self.refining = (!is_final).then_some(done);
            return Ok(Some(Progress { stage, done }));
        }
        let mut tile = match self.tile.take() {
            Some(tile) => tile,
            None => match self.tile_at(self.tiles_done())? {
                Some(tile) => tile,
                None => return Ok(None),
            },
        };
        if tile.samples < self.options.samples {
            let gpu = self.gpu.clone();
            let mut frame = Frame::new(&gpu, false);
            self.light(&mut frame, &mut tile, adds)?;
            frame.submit()?;
        }
        let share = f64::from(tile.samples) / f64::from(self.options.samples.max(1));
        let done = (self.tiles_done() as f64 + share) / self.tiles.len() as f64;
        if tile.samples >= self.options.samples {
            self.keep(&tile)?;
        } else {
            self.tile = Some(tile);
        }
        let done = done as f32;
        Ok(Some(Progress { stage, done }))
    }

    /// Refines the maps by one frame; returns their progress (0 to 1) and whether they can be gathered.
    fn refine(&mut self) -> Result<(f32, bool), LightingError> {
        let gpu = self.gpu.clone();
        let mut frame = Frame::new(&gpu, false);
        let readiness = self
            .lighting
            .prepare(&mut frame, &mut self.on_gpu, &self.view)?;
        frame.submit()?;
        Ok(match readiness {
            Readiness::Ready => (1.0, true),
            Readiness::Refining { progress } => (progress, true),
            Readiness::Pending { progress, .. } => {
                gpu.wait()?;
                self.on_gpu.wait_for_atlas();
                (progress, false)
            }
        })
    }

    /// Adds one sample of light at the texels of `tile`: emission, and the light of those techniques whose names `adds`
    /// accepts.
    fn light(
        &mut self,
        frame: &mut Frame<'_>,
        tile: &mut Tile,
        adds: impl Fn(&str) -> bool,
    ) -> Result<(), GpuError> {
        let (lighting, scene) = (&mut self.lighting, &mut self.on_gpu);
        tile.capture
            .look(frame.gpu, tile.samples, self.options.seed);
        tile.capture.record(frame, scene)?;
        tile.leaks.record(frame, scene, &tile.capture);
        lighting.prepare(frame, scene, &self.view)?;
        for (points, target) in tile.capture.points().zip(&tile.targets) {
            lighting.gather_some(frame, scene, &Receiver::new(points, target), &adds)?;
        }
        tile.samples += 1;
        Ok(())
    }

    fn tiles_done(&self) -> usize {
        let mut ends = self.tiles.iter().scan(0, |end, tile| {
            *end += tile.rows.len() * self.atlas.size as usize;
            Some(*end)
        });
        let done = self.done.texels.len();
        ends.position(|end| end > done).unwrap_or(self.tiles.len())
    }

    /// Allocates a tile; `None` when there is no tile of this index.
    fn tile_at(&mut self, index: usize) -> Result<Option<Tile>, LightingError> {
        let Some(tile) = self.tiles.get(index) else {
            return Ok(None);
        };
        let gpu = &self.gpu;
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
        let on_gpu = &self.on_gpu;
        let capture = AtlasCapture::new(gpu, self.scene, on_gpu, self.atlas, &options)?;
        let leaks = LeakTest::new(gpu, on_gpu, &capture)?;
        let targets = capture
            .points()
            .map(|points| Target::new(gpu, points.count));
        let targets: Vec<Target> = targets.collect::<Result<_, GpuError>>()?;
        let sums = std::mem::take(&mut self.resumed.sums);
        let mut rest = &sums[..];
        for target in &targets {
            let count = (target.radiance.size() / 16) as usize;
            let Some((these, others)) = rest.split_at_checked(count) else {
                break;
            };
            gpu.write(&target.radiance, 0, these);
            rest = others;
        }
        Ok(Some(Tile {
            capture,
            leaks,
            targets,
            samples: std::mem::take(&mut self.resumed.samples),
        }))
    }

    /// Stores the light of a finished tile.
    fn keep(&mut self, tile: &Tile) -> Result<(), LightingError> {
        let gpu = &self.gpu;
        let mut captured: Vec<Vec3> = Vec::new();
        for (piece, target) in tile.capture.pieces().iter().zip(&tile.targets) {
            let rows = piece.rows.len() as u32;
            let mut frame = Frame::new(gpu, false);
            Dilation::new(gpu, [tile.capture.size, rows])?.record(&mut frame, target)?;
            frame.submit()?;
            let radiance = &target.radiance;
            let texels: Vec<[f32; 4]> = read_buffer(gpu, radiance, radiance.size())?;
            let unit = match self.options.quantity {
                Quantity::Irradiance => std::f32::consts::FRAC_1_PI,
                Quantity::Diffuse | Quantity::All => 1.0,
            };
            // `a` is the number of samples in the sum; a filled texel holds one mean.
            let means = texels
                .into_iter()
                .map(|[r, g, b, a]| Vec3::new(r, g, b) * unit / a.max(1.0));
            captured.extend(means);
        }
        let size = self.atlas.size;
        let leak_map = tile.leaks.map(gpu)?;
        let place = &self.tiles[self.tiles_done()];
        self.done
            .leak_map
            .extend_from_slice(place.of(&leak_map, size));
        self.done
            .texels
            .extend_from_slice(place.of(&captured, size));
        Ok(())
    }

    /// Saves the state of the bake. Waits for the GPU.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn save(&mut self) -> Result<LightState, LightingError> {
        // Saved maps that this bake has not resumed yet are still the best that it has.
        let mut maps = self.lighting.save()?;
        maps.extend(self.resumed.maps.clone());
        let (samples, sums) = match &self.tile {
            None => (self.resumed.samples, self.resumed.sums.clone()),
            Some(tile) => {
                let mut sums: Vec<[f32; 4]> = Vec::new();
                for target in &tile.targets {
                    let radiance = &target.radiance;
                    sums.extend(read_buffer::<[f32; 4]>(
                        &self.gpu,
                        radiance,
                        radiance.size(),
                    )?);
                }
                (tile.samples, sums)
            }
        };
        Ok(LightState {
            maps,
            done: self.done.clone(),
            samples,
            sums,
        })
    }

    /// Resumes from the saved state of a bake of the same scene, atlas, techniques, settings and options. Call it
    /// before the first step.
    ///
    /// # Errors
    /// [`LightingError::Gpu`] when the state does not fit such a bake.
    pub fn resume(&mut self, state: LightState) -> Result<(), LightingError> {
        let texels = |rows: usize| rows * self.atlas.size as usize;
        self.done = state.done.clone();
        let index = self.tiles_done();
        let before = self.tiles[..index].iter();
        let whole = texels(before.map(|tile| tile.rows.len()).sum());
        let next = self.tiles.get(index);
        let next = texels(next.map_or(0, |tile| tile.captured.len()));
        let is_whole = self.done.texels.len() == whole && self.done.leak_map.len() == whole;
        let has_sums = if state.samples == 0 {
            state.sums.is_empty()
        } else {
            state.samples < self.options.samples && state.sums.len() == next
        };
        if !(is_whole && has_sums) {
            return Err(LightingError::Gpu(GpuError::Pass {
                pass: "bake".into(),
                reason: "what was saved does not fit this bake".into(),
            }));
        }
        self.resumed = LightState {
            done: LitRows::default(),
            ..state
        };
        Ok(())
    }

    /// The result; texels that were never lit are missing.
    pub fn finish(mut self) -> LitAtlas {
        Seams::new(self.scene, self.atlas).smooth(&mut self.done.texels);
        let page = (self.atlas.size as usize).pow(2);
        LitAtlas {
            pages: self.done.texels.chunks(page).map(<[_]>::to_vec).collect(),
            leaks: Leaks::new(&self.done.leak_map, self.atlas.size),
        }
    }
}
