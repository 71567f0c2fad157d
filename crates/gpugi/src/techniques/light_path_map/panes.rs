//! The panes: the indirect irradiance of all texels for irradiance 1 of each cluster, computed in steps.

mod steps;

use std::ops::Range;
use std::sync::Arc;

use bytemuck::Zeroable;
use gpugi_scene::LightPathPanes;

use super::entries::COLUMN;
use super::entry_points::EntryPoints;
use super::gpu::{Choice, LANES, NEAR_BYTES, Sum, TILE, VIRTUAL_LIGHT_BYTES, Work};
use super::{INFO, Settings, Store, Visibility};
use crate::capture::atlas::{AtlasCapture, KeptTexels, tiles_of};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, ReadBack, Shader, join, read_buffer};
use crate::scene::{GpuScene, Inputs, Versions};
use crate::shader;
use crate::stage::Stage;

/// Rays per step, roughly: about 40 ms on a small GPU.
const RAYS_OF_STEP: u64 = 1 << 22;

/// Virtual lights of a walk, roughly, for the size of steps: those of a mean albedo of 3/4.
const LIGHTS_PER_WALK: u64 = 3;

/// Entry points whose distance to a texel takes about as long as a ray.
const COMPARED_PER_RAY: u64 = 64;

/// Texels that a virtual light's depth map is looked up for in about the time of a ray.
const LOOKED_UP_PER_RAY: u64 = 8;

/// Bytes of depth maps that are kept at once, roughly.
const MAP_BYTES: u64 = 1 << 26;

/// The geometric term is bounded so that no virtual light within this many times the distance between entry points
/// brightens a texel more than one at that distance.
const BOUNDED_DISTANCES: f32 = 4.0;

/// How often near surfaces light each other, where light may be reflected any number of times.
const NEAR_BOUNCES: u32 = 8;

/// Panes in one buffer.
#[derive(Debug)]
pub(super) struct Sheet {
    pub panes: Range<u32>,
    /// Pane by pane, as [`Store`] has it.
    pub words: wgpu::Buffer,
}

/// Transfer of entry points, on its way to the host.
type Columns = Box<ReadBack<Vec<[f32; COLUMN]>>>;

#[derive(Debug)]
struct Kernels {
    columns: Kernel,
    owners: Kernel,
    near: Kernel,
    walks: Kernel,
    depth_maps: Kernel,
    light: Kernel,
    add_near: Kernel,
    store: Kernel,
    energy: Kernel,
}

/// The panes of a scene, and what they are made with.
#[derive(Debug)]
pub(super) struct Panes {
    settings: Settings,
    /// Texels of all pages.
    pub texels: u32,
    size: u32,
    kernels: Kernels,
    /// Where triangles find their texels.
    atlas: wgpu::Buffer,
    pub points: EntryPoints,
    lights: wgpu::Buffer,
    /// Depth maps of the virtual lights of `mapped_at_once` entry points.
    depths: wgpu::Buffer,
    mapped_at_once: u32,
    /// The cluster of each texel, `NOTHING` where it has no point.
    pub owners: wgpu::Buffer,
    /// Area of each texel (m^2), 0 where it has no point.
    pub areas: wgpu::Buffer,
    near: wgpu::Buffer,
    /// Light of one cluster: by virtual lights, then with near surfaces, in turn.
    lit: [wgpu::Buffer; 3],
    pub sheets: Vec<Sheet>,
    /// What each pane brings to each tile of texels, as energy.wesl has it.
    pub energies: wgpu::Buffer,
    /// Number of a piece and range of its points, per tile.
    tiles: Vec<(usize, Range<u32>)>,
    /// Panes of a file, instead of new ones.
    stored: Option<Arc<LightPathPanes>>,
    /// The surfaces that they are made for.
    surfaces: Stage<Versions>,
    /// Steps that are done.
    steps: usize,
    /// Transfer of the entry points, by which they will be clustered, on its way to the host.
    columns: Option<Columns>,
}

impl Panes {
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        settings: &Settings,
        KeptTexels {
            capture, lookup, ..
        }: &KeptTexels,
        stored: Option<Arc<LightPathPanes>>,
    ) -> Result<Self, GpuError> {
        let texels = capture.size * capture.size * capture.pages;
        let buffer = |label: &str, count: u64, bytes: u64| gpu.room(label, count * bytes);
        let per_entry = 1 + u64::from(settings.walks) * u64::from(settings.depth);
        let light = || buffer("light of a cluster [bytes]", texels.into(), 16);
        let entries = u64::from(settings.entries);
        let of_cluster = entries.div_ceil(settings.clusters.into());
        let rays = of_cluster * (1 + LIGHTS_PER_WALK * u64::from(settings.walks));
        let map = u64::from(settings.map_resolution).pow(2) * 4;
        let (rays, depths, mapped_at_once) = match settings.visibility {
            Visibility::Rays => (rays, 4, u32::MAX),
            Visibility::Maps => {
                let at_once = (MAP_BYTES / (per_entry * map)).clamp(1, entries);
                (
                    rays / LOOKED_UP_PER_RAY,
                    at_once * per_entry * map,
                    at_once as u32,
                )
            }
        };
        let at_once = (RAYS_OF_STEP / rays.max(settings.near_rays.into())).clamp(64, 1 << 20);
        Ok(Self {
            settings: settings.clone(),
            texels,
            size: capture.size,
            atlas: lookup.words.clone(),
            kernels: Kernels::new(gpu, scene, settings)?,
            points: EntryPoints::new(gpu, scene, settings)?,
            lights: buffer(
                "virtual lights [bytes]",
                entries * per_entry,
                VIRTUAL_LIGHT_BYTES,
            )?,
            depths: buffer("depth maps [bytes]", 1, depths)?,
            mapped_at_once,
            owners: buffer("clusters of texels [bytes]", texels.into(), 4)?,
            areas: buffer("areas of texels [bytes]", texels.into(), 4)?,
            near: buffer(
                "near surfaces [bytes]",
                u64::from(texels) * u64::from(settings.near_rays),
                NEAR_BYTES,
            )?,
            lit: [light()?, light()?, light()?],
            sheets: sheets(
                gpu,
                settings
                    .store
                    .stored([capture.size, capture.size * capture.pages]),
                settings.clusters + 1,
            )?,
            energies: buffer(
                "energy of panes [bytes]",
                count_tiles(capture) * u64::from(settings.clusters + 1),
                16,
            )?,
            tiles: tiles_of(capture.points().map(|points| points.count), at_once as u32),
            stored,
            surfaces: Stage::default(),
            steps: 0,
            columns: None,
        })
    }

    /// What passes bind, unless they name others: all buffers, the entry points and their light.
    pub fn resources(&self) -> [Named<'_>; 11] {
        let points = &self.points;
        [
            ("atlas", &self.atlas),
            ("points", &points.receiver.points.points),
            ("irradiance", &points.receiver.target),
            ("firsts", &points.firsts),
            ("lights", &self.lights),
            ("depths", &self.depths),
            ("owners", &self.owners),
            ("areas", &self.areas),
            ("near", &self.near),
            ("energies", &self.energies),
            ("lit", &self.lit[0]),
        ]
    }

    /// Runs `kernel` with the parameters `work`, in which case it also binds `more`: pass `light-path-map.NAME`.
    fn run(
        &self,
        frame: &mut Frame<'_>,
        name: &str,
        (kernel, scene): (&Kernel, Option<&wgpu::BindGroup>),
        (work, more): (Work, &[Named<'_>]),
        invocations: u32,
    ) -> Result<(), GpuError> {
        let work = frame.gpu.constant("light path map", &work)?;
        let own: [Named<'_>; 1] = [("work", &work)];
        let resources = [&self.resources()[..], &own, more].concat();
        frame.run(name, kernel, scene, &resources, [invocations, 1, 1])
    }

    /// Most surfaces that walks visit after their entry points.
    pub fn depth(&self) -> u32 {
        self.settings.depth
    }

    /// How panes are stored.
    pub fn stored_as(&self) -> Store {
        self.settings.store
    }

    /// Rows of texels of all pages.
    fn rows(&self) -> u32 {
        self.texels / self.size
    }

    /// Words of a pane.
    fn words(&self) -> u32 {
        self.settings.store.stored([self.size, self.rows()])
    }

    /// Bytes of all buffers but the sheets.
    pub fn work_bytes(&self) -> u64 {
        let lit = self.lit.iter().map(wgpu::Buffer::size).sum::<u64>();
        let of_texels = self.owners.size() + self.areas.size() + self.near.size();
        lit + self.lights.size()
            + self.depths.size()
            + of_texels
            + self.energies.size()
            + self.points.bytes()
    }

    /// Steps until all panes are done: entry points and walks; per tile owners and near surfaces; per cluster and tile
    /// its light; the sum of all panes.
    fn all_steps(&self) -> usize {
        let clusters = self.points.entries.clusters() as usize;
        2 + self.tiles.len() * (1 + clusters)
    }

    /// Whether all panes are done.
    pub fn is_done(&self) -> bool {
        self.surfaces.begun().is_some() && self.steps >= self.all_steps()
    }

    /// Part of the work that is done (0 to 1).
    pub fn progress(&self) -> f32 {
        self.steps as f32 / self.all_steps() as f32
    }

    /// Panes that are done.
    pub fn panes_done(&self) -> u32 {
        let tiles = self.tiles.len().max(1);
        let done = self.steps.saturating_sub(1) / tiles;
        (done.saturating_sub(1) as u32).min(self.points.entries.clusters())
    }

    /// Starts again if geometry or materials have changed.
    pub fn follow(&mut self, gpu: &Gpu, scene: &GpuScene) {
        if self.surfaces.renew(scene.versions.of(Inputs::SURFACES)) {
            self.points
                .choose(gpu, scene, &self.settings, self.stored.as_deref());
            self.steps = 0;
            self.columns = None;
        }
    }

    /// Parameters of all passes.
    fn work(&self) -> Work {
        let entries = &self.points.entries;
        let reach = BOUNDED_DISTANCES * entries.area.max(1e-12).sqrt();
        Work {
            size: self.size,
            texels: self.texels,
            entries: entries.entries.len() as u32,
            points: entries.points().count() as u32,
            walks: self.settings.walks,
            depth: self.settings.depth,
            near_rays: self.settings.near_rays,
            seed: self.settings.seed,
            bound: 1.0 / (reach * reach),
            reach,
            entry_area: entries.area,
            map_resolution: self.settings.map_resolution,
            ..Work::zeroed()
        }
    }

    /// Takes the next step and returns its rays, roughly.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn step(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        capture: &AtlasCapture,
    ) -> Result<u64, GpuError> {
        let tiles = self.tiles.len();
        let clusters = self.points.entries.clusters() as usize;
        let rays = match self.steps {
            0 => match self.cluster(frame, scene)? {
                Some(rays) => return Ok(rays),
                None => self.walk(frame, scene)?,
            },
            step if step <= tiles => self.find_near(frame, scene, capture, step - 1)?,
            step if step <= tiles * (1 + clusters) => {
                let step = step - 1 - tiles;
                let (cluster, tile) = ((step / tiles) as u32, step % tiles);
                let rays = self.light(frame, scene, capture, cluster, tile)?;
                if tile + 1 == tiles {
                    self.finish_pane(frame, cluster)?;
                }
                rays
            }
            _ => 0,
        };
        self.steps += 1;
        if let Some(stored) = self.stored.clone()
            && self.steps == 1 + tiles
        {
            self.resume(frame.gpu, &stored.panes)
                .map_err(|error| INFO.unfit(error))?;
        }
        Ok(rays)
    }

    /// Stores irradiance of all texels as a pane: pass `light-path-map.store`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn store(
        &self,
        frame: &mut Frame<'_>,
        pane: u32,
        lit: &wgpu::Buffer,
    ) -> Result<(), GpuError> {
        let Some(sheet) = self.sheets.iter().find(|sheet| sheet.panes.contains(&pane)) else {
            return Ok(());
        };
        let work = Work {
            first_word: (pane - sheet.panes.start) * self.words(),
            ..self.work()
        };
        let own: [Named<'_>; 2] = [("lit", lit), ("panes", &sheet.words)];
        let lanes = match self.settings.store {
            Store::Bc6h => self.words() / self.settings.store.words(),
            Store::Rgb9e5 | Store::Half => self.texels,
        };
        let (name, store) = ("light-path-map.store", &self.kernels.store);
        self.run(frame, name, (store, None), (work, &own), lanes)
    }

    /// Stores the sum of all panes, which `sum` holds, behind them, and finds what each brings to each tile: passes
    /// `light-path-map.store` and `light-path-map.energy`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn complete(&self, frame: &mut Frame<'_>, sum: &wgpu::Buffer) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let clusters = self.points.entries.clusters();
        self.store(frame, clusters, sum)?;
        let chosen = Choice {
            clusters,
            ..Choice::zeroed()
        };
        let chosen = gpu.constant("clusters", &chosen)?;
        for sheet in &self.sheets {
            let of_sheet = gpu.constant("sheet", &self.sum_of(sheet, 0, 0))?;
            let own: [Named<'_>; 4] = [
                ("sheet", &of_sheet),
                ("chosen", &chosen),
                ("panes", &sheet.words),
                ("all", sum),
            ];
            let [x, y, _] = self.lanes(LANES);
            // The scene may have fewer clusters than there is room for.
            let panes = sheet.panes.end.min(clusters + 1) - sheet.panes.start.min(clusters + 1);
            if panes > 0 {
                let (name, energy) = ("light-path-map.energy", &self.kernels.energy);
                let resources = join(&self.resources(), &own);
                frame.run(name, energy, None, &resources, [x, y, panes])?;
            }
        }
        Ok(())
    }

    /// Invocations of passes with one workgroup of so many lanes per tile of texels.
    pub fn lanes(&self, of_tile: u32) -> [u32; 3] {
        let [columns, rows] = tiles(self.size, self.rows());
        [columns * of_tile, rows, 1]
    }

    /// Parameters of passes over a sheet, of which up to `slots` panes are added per tile, whose slots are `stride`
    /// apart.
    pub fn sum_of(&self, sheet: &Sheet, slots: u32, stride: u32) -> Sum {
        let is_last = sheet.panes.contains(&self.points.entries.clusters());
        Sum {
            size: self.size,
            texels: self.texels,
            first_pane: sheet.panes.start,
            end_pane: sheet.panes.end,
            slots,
            stride,
            is_last: u32::from(is_last),
        }
    }

    /// The words of all panes that are done. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn save(&self, gpu: &Gpu) -> Result<Vec<u32>, GpuError> {
        let mut words = Vec::new();
        let mut rest = u64::from(self.panes_done());
        for sheet in &self.sheets {
            let panes = rest.min(sheet.panes.len() as u64);
            if panes > 0 {
                let bytes = panes * u64::from(self.words()) * 4;
                words.extend(read_buffer::<u32>(gpu, &sheet.words, bytes)?);
            }
            rest -= panes;
        }
        Ok(words)
    }

    /// Continues from panes that were saved. Returns false while there are no entry points yet.
    ///
    /// # Errors
    /// Why they do not fit.
    pub fn resume(&mut self, gpu: &Gpu, words: &[u32]) -> Result<bool, String> {
        let tiles = self.tiles.len();
        if self.steps <= tiles {
            return Ok(false);
        }
        let of_pane = self.words() as usize;
        let panes = words.len() / of_pane.max(1);
        if words.len() != panes * of_pane || panes > self.points.entries.clusters() as usize {
            return Err("other texels or other clusters".into());
        }
        for sheet in &self.sheets {
            let end = (sheet.panes.end as usize).min(panes);
            let first = (sheet.panes.start as usize).min(end);
            gpu.write(&sheet.words, 0, &words[first * of_pane..end * of_pane]);
        }
        self.steps = self.steps.max(1 + tiles * (1 + panes));
        Ok(true)
    }
}

impl Kernels {
    fn new(gpu: &Gpu, scene: &GpuScene, settings: &Settings) -> Result<Self, GpuError> {
        let plain = |shader| Kernel::new(gpu, &shader, "main", None);
        let of_panes = |shader, entry| of_panes(gpu, shader, entry, settings);
        let with_maps = settings.visibility == Visibility::Maps;
        let tracing = |shader| scene.ray_kernel(gpu, &shader, &[]);
        Ok(Self {
            columns: tracing(shader!("techniques.light_path_map.columns"))?,
            owners: plain(shader!("techniques.light_path_map.owners"))?,
            near: tracing(shader!("techniques.light_path_map.near"))?,
            walks: tracing(shader!("techniques.light_path_map.walks"))?,
            depth_maps: tracing(shader!("techniques.light_path_map.depth_maps"))?,
            light: scene.ray_kernel(
                gpu,
                &shader!("techniques.light_path_map.light"),
                &[("MAPS", f64::from(u8::from(with_maps)))],
            )?,
            add_near: plain(shader!("techniques.light_path_map.add_near"))?,
            store: of_panes(
                &shader!("techniques.light_path_map.store"),
                match settings.store {
                    Store::Bc6h => "blocks",
                    Store::Rgb9e5 | Store::Half => "texels",
                },
            )?,
            energy: of_panes(&shader!("techniques.light_path_map.energy"), "main")?,
        })
    }
}

/// A pass over panes.
pub(super) fn of_panes(
    gpu: &Gpu,
    shader: &Shader,
    entry: &str,
    settings: &Settings,
) -> Result<Kernel, GpuError> {
    let words = [("WORDS", settings.store.words().into())];
    Kernel::with_constants(gpu, shader, entry, None, &words)
}

/// Columns and rows of tiles.
fn tiles(width: u32, height: u32) -> [u32; 2] {
    [width, height].map(|side| side.div_ceil(TILE))
}

/// Tiles of all pages.
pub(super) fn count_tiles(capture: &AtlasCapture) -> u64 {
    let [columns, rows] = tiles(capture.size, capture.size * capture.pages);
    u64::from(columns) * u64::from(rows)
}

/// As many sheets as the adapter's limits ask for. `words`: of a pane.
fn sheets(gpu: &Gpu, words: u32, panes: u32) -> Result<Vec<Sheet>, GpuError> {
    let limits = gpu.limits();
    let most = limits
        .max_buffer_size
        .min(limits.max_storage_buffer_binding_size);
    let bytes = u64::from(words) * 4;
    let at_once = (most / bytes.max(1)).clamp(1, panes.into()) as u32;
    (0..panes)
        .step_by(at_once as usize)
        .map(|first| {
            let panes = first..panes.min(first + at_once);
            Ok(Sheet {
                words: gpu.room("light path map [bytes]", panes.len() as u64 * bytes)?,
                panes,
            })
        })
        .collect()
}
