//! The texels of a scene's atlas, their panes, and the irradiance that these give under the present light.

use std::sync::Arc;

use gpugi_scene::{Atlas, LightPathPanes};

use super::gpu::{CHOOSING_LANES, Choice, LANES, SLOT_BYTES};
use super::panes::{Panes, count_tiles, of_panes};
use super::{INFO, Settings, Store, entry_points};
use crate::capture::atlas::{KeptIrradiance, KeptTexels};
use crate::capture::{Receiver, SURFACE_POINT_BYTES};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, join};
use crate::scene::GpuScene;
use crate::shader;
use crate::stage::Stage;
use crate::techniques::{Earlier, Generated, LightState, Map, Texels};

/// Panes, and the light that they give.
#[derive(Debug)]
pub(super) struct LightPathMaps {
    pub texels: KeptTexels,
    pub panes: Panes,
    /// Mean irradiance of each cluster (W/m^2).
    pub weights: wgpu::Buffer,
    /// `Slot` of sum.wesl: the panes that are added, tile by tile.
    pub slots: wgpu::Buffer,
    pub irradiance: KeptIrradiance,
    weigh: Kernel,
    choose: Kernel,
    relight: Kernel,
    /// The light of the irradiance.
    lit: Stage<LightState>,
    revision: u64,
}

impl LightPathMaps {
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        settings: &Settings,
        atlas: &Atlas,
        stored: Option<Arc<LightPathPanes>>,
        most_texels: u32,
    ) -> Result<Self, GpuError> {
        let texels = KeptTexels::new(gpu, scene, atlas, most_texels)?;
        let kernel = |shader| Kernel::new(gpu, &shader, "main", None);
        let clusters = u64::from(settings.clusters);
        let buffer = |label: &str, bytes: u64| gpu.room(label, bytes);
        Ok(Self {
            panes: Panes::new(gpu, scene, settings, &texels, stored)?,
            weights: buffer("weights of clusters [bytes]", clusters * 16)?,
            slots: buffer(
                "panes to add [bytes]",
                count_tiles(&texels.capture) * (clusters + 1) * SLOT_BYTES,
            )?,
            weigh: kernel(shader!("techniques.light_path_map.weigh"))?,
            choose: kernel(shader!("techniques.light_path_map.choose"))?,
            relight: of_panes(
                gpu,
                &shader!("techniques.light_path_map.relight"),
                "main",
                settings,
            )?,
            irradiance: KeptIrradiance::new(gpu, scene, texels.size(), Some(atlas), &[])?,
            texels,
            lit: Stage::default(),
            revision: 0,
        })
    }

    /// Takes steps toward the panes; lights the texels by them if these or the light have changed.
    pub fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        settings: &Settings,
        earlier: &mut Earlier<'_>,
    ) -> Result<Generated, GpuError> {
        self.texels.record(frame, scene)?;
        self.panes.follow(frame.gpu, scene);
        let was_done = self.panes.is_done();
        let (panes, capture) = (&mut self.panes, &self.texels.capture);
        let step = |panes: &mut Panes| panes.step(frame, scene, capture);
        let budget = &mut earlier.budget;
        budget.steps(settings.steps, panes, Panes::is_done, step)?;
        let is_done = self.panes.is_done();
        if is_done && !was_done {
            self.complete(frame)?;
            // What texels hold now is no light: it is replaced below.
            self.lit.restart();
            self.revision += 1;
        }
        self.lit.ask(earlier.light.state(scene));
        let may_light = || self.lit.begun().is_none() || earlier.budget.may_step();
        if is_done && !self.lit.is_current() && may_light() {
            let entries = &self.panes.points.receiver;
            earlier.gather(frame, scene, entries, false)?;
            self.weigh(frame)?;
            self.relight(frame, settings)?;
            self.irradiance.finish(frame)?;
            earlier.budget.count(u64::from(self.panes.texels));
            self.lit.begin();
        }
        let is_current = is_done && self.lit.is_current();
        let done = self.panes.progress();
        Ok(Generated {
            revision: self.revision,
            progress: if is_current { 1.0 } else { done * 0.999 },
            // The picture needs no indirect light to show the direct.
            pending: None,
        })
    }

    /// Adds up all panes, and finds the power of each.
    fn complete(&self, frame: &mut Frame<'_>) -> Result<(), GpuError> {
        let clusters = self.panes.points.entries.clusters();
        let ones = (0..clusters).map(|pane| [1.0, 1.0, 1.0, f32::from_bits(pane)]);
        let ones: Vec<[f32; 4]> = ones.collect();
        let ones = frame.gpu.storage("all panes [bytes]", &ones)?;
        self.sum(frame, &ones, clusters, 0)?;
        self.panes.complete(frame, &self.irradiance.target.radiance)
    }

    /// Fills the texels of all panes that have no point from those around them, so that any bilinear filter may read
    /// them. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn fill(&self, gpu: &Gpu) -> Result<(), GpuError> {
        for pane in 0..self.panes.points.entries.clusters() {
            let mut frame = Frame::new(gpu, false);
            let alone = [1.0, 1.0, 1.0, f32::from_bits(pane)];
            let alone = gpu.storage("one pane [bytes]", &[alone])?;
            self.sum(&mut frame, &alone, 1, 0)?;
            self.irradiance.fill(&mut frame)?;
            self.panes
                .store(&mut frame, pane, &self.irradiance.target.radiance)?;
            frame.submit()?;
            gpu.wait()?;
        }
        Ok(())
    }

    /// Weighs the clusters by the light at their entry points: pass `light-path-map.weigh`.
    fn weigh(&self, frame: &mut Frame<'_>) -> Result<(), GpuError> {
        let resources = join(&self.panes.resources(), &[("weights", &self.weights)]);
        let lanes = [self.panes.points.entries.clusters() * LANES, 1, 1];
        frame.run("light-path-map.weigh", &self.weigh, None, &resources, lanes)
    }

    /// Chooses the panes to add in each tile: pass `light-path-map.choose`.
    fn choose(&self, frame: &mut Frame<'_>, settings: &Settings) -> Result<(), GpuError> {
        let chosen = Choice {
            clusters: self.panes.points.entries.clusters(),
            panes: self.added(settings),
            left_out: settings.left_out,
        };
        let chosen = frame.gpu.constant("choice of panes", &chosen)?;
        let own: [Named<'_>; 3] = [
            ("chosen", &chosen),
            ("weights", &self.weights),
            ("slots", &self.slots),
        ];
        let resources = join(&self.panes.resources(), &own);
        let (name, lanes) = ("light-path-map.choose", self.panes.lanes(CHOOSING_LANES));
        frame.run(name, &self.choose, None, &resources, lanes)
    }

    /// Panes of clusters that are added in a tile, at most.
    fn added(&self, settings: &Settings) -> u32 {
        let clusters = self.panes.points.entries.clusters();
        match settings.panes {
            0 => clusters,
            panes => panes.min(clusters),
        }
    }

    /// Chooses panes by their weights and sums them: passes `light-path-map.choose` and `light-path-map.relight`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn relight(&self, frame: &mut Frame<'_>, settings: &Settings) -> Result<(), GpuError> {
        self.choose(frame, settings)?;
        let count = self.added(settings) + 1;
        self.sum(frame, &self.slots, count, count)
    }

    /// Sums up to `count` panes per tile, whose slots are `stride` apart: pass `light-path-map.relight`.
    fn sum(
        &self,
        frame: &mut Frame<'_>,
        slots: &wgpu::Buffer,
        count: u32,
        stride: u32,
    ) -> Result<(), GpuError> {
        for sheet in &self.panes.sheets {
            let of_sheet = self.panes.sum_of(sheet, count, stride);
            let of_sheet = frame.gpu.constant("sheet", &of_sheet)?;
            let own: [Named<'_>; 4] = [
                ("sheet", &of_sheet),
                ("slots", slots),
                ("panes", &sheet.words),
                ("irradiance", &self.irradiance.target),
            ];
            let resources = join(&self.panes.resources(), &own);
            let (name, lanes) = ("light-path-map.relight", self.panes.lanes(LANES));
            frame.run(name, &self.relight, None, &resources, lanes)?;
        }
        Ok(())
    }

    /// Adds the light at the receiver's points: pass `light-path-map.gather`.
    pub fn gather(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
    ) -> Result<(), GpuError> {
        let found = (Some(&self.texels.capture), &self.texels.lookup.words);
        let name = "light-path-map.gather";
        self.irradiance.gather(frame, name, scene, receiver, found)
    }

    /// Positions of entry points, irradiance of all rows, weights of clusters, clusters of texels, and panes below each
    /// other, sheet by sheet.
    pub fn maps(&self) -> Vec<Map> {
        let name = |name: &str| format!("{}.{name}", INFO.name);
        let map = |map: &str, buffer: &wgpu::Buffer, size: [u32; 2], stride: u64| {
            Map::of_colors(name(map), buffer, size, stride)
        };
        let size = self.texels.size();
        let clusters = (self.weights.size() / 16) as u32;
        let entries = &self.panes.points.receiver.points.points;
        let count = self.panes.points.entries.entries.len() as u32;
        let of_entries = [
            entry_points::WIDTH,
            count.div_ceil(entry_points::WIDTH).max(1),
        ];
        let mut maps = vec![
            // A surface point begins with its position.
            map("entries", entries, of_entries, SURFACE_POINT_BYTES),
            map("irradiance", &self.irradiance.target.radiance, size, 16),
            map("weights", &self.weights, [clusters, 1], 16),
            Map::of_numbers(name("clusters"), &self.panes.owners, size, 4),
        ];
        for sheet in &self.panes.sheets {
            let panes = format!("panes-{}", sheet.panes.start);
            let count = sheet.panes.len() as u32;
            let store = self.panes.stored_as();
            let texels = [size[0], size[1] * count];
            maps.push(match store {
                Store::Rgb9e5 | Store::Half => {
                    map(&panes, &sheet.words, texels, 4 * u64::from(store.words()))
                }
                Store::Bc6h => Map {
                    name: name(&panes),
                    texels: Texels::Blocks {
                        buffer: sheet.words.clone(),
                        size: [size[0], size[1].next_multiple_of(4) * count],
                    },
                },
            });
        }
        maps
    }

    /// Bytes that are not in maps.
    pub fn work_bytes(&self) -> u64 {
        let around = self.irradiance.work_bytes();
        self.texels.bytes() + self.panes.work_bytes() + self.slots.size() + around
    }
}
