//! The obscurances of an atlas's texels, computed in steps.

use std::ops::Range;

use bytemuck::Zeroable;
use glam::{Mat4, Vec3};
use gpugi_scene::{Atlas, Bounds, Scene};

use super::gpu::{BoxRow, PageUniform, Renewal, SettingsUniform, TEXEL_BYTES};
use super::peeling::Peeling;
use super::rays::Rays;
use super::{INFO, Mode, Settings};
use crate::capture::Target;
use crate::capture::atlas::{AtlasCapture, AtlasLookup, Dilation};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, read_buffer};
use crate::scene::{GpuScene, Inputs, Versions};
use crate::settings::SettingSet;
use crate::shader;
use crate::stage::Stage;
use crate::techniques::Map;

/// Rounding error of positions, relative to the scene's size.
const ROUNDING: f32 = 1e-6;

/// Most boxes around what moved, since every texel is tested against every box; with more, everything is recomputed.
const MOST_BOXES: usize = 512;

/// The obscurances of one page, one value per texel, row by row from the top. Texels without a surface continue their
/// neighbours' values.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ObscurancePage {
    /// W, 0 to 1: the fraction of the ambient light that arrives.
    pub obscurance: Vec<f32>,
    /// W with the albedo of the obscuring surfaces, or the scene's mean albedo where nothing obscures; `None` if
    /// colours are not wanted.
    pub colored: Option<Vec<Vec3>>,
}

/// Computes the obscurances of an atlas's texels.
#[derive(Debug)]
pub struct Solution {
    settings: Settings,
    size: u32,
    pages: u32,
    /// Lookup of triangles in the atlas.
    pub lookup: AtlasLookup,
    /// `Texel` of obscurance.wesl, page after page.
    texels: wgpu::Buffer,
    /// Sums over all surfaces: area times albedo, and area; area times the direct light that they reflect.
    mean: wgpu::Buffer,
    prepare: Kernel,
    average: Kernel,
    sampler: Sampler,
    pictures: Pictures,
    /// Bounding box and area (m^2) of each instance's mesh in its own space.
    meshes: Vec<(Bounds, f64)>,
    /// The surfaces that it is computed for.
    surfaces: Stage<Versions>,
    state: State,
}

/// The method of sampling.
#[derive(Debug)]
enum Sampler {
    Rays(Box<Rays>),
    Peeling(Box<Peeling>),
}

impl Sampler {
    /// Number of tiles, whose texels are sampled together.
    fn tiles(&self) -> u32 {
        match self {
            Self::Rays(rays) => rays.tiles(),
            Self::Peeling(peeling) => u32::from(peeling.has_texels()),
        }
    }

    /// Constant of the pipelines that look up the sums.
    fn least_samples(&self) -> (&'static str, f64) {
        let least = match self {
            // All texels have equally many samples.
            Self::Rays(_) => 0,
            Self::Peeling(peeling) => peeling.least_samples(),
        };
        ("LEAST_SAMPLES", f64::from(least))
    }

    /// Most samples per step.
    fn at_once(&self) -> u32 {
        match self {
            Self::Rays(rays) => rays.at_once(),
            Self::Peeling(_) => 1,
        }
    }
}

/// What was computed, and how far it has progressed.
#[derive(Debug, Default)]
struct State {
    /// World-space box of each instance at that time.
    bounds: Vec<Bounds>,
    /// Box around the texels that are computed; `None` if all are.
    region: Option<Bounds>,
    /// Steps taken.
    steps: u64,
}

/// The images of one page, and the maps made from them.
#[derive(Debug)]
struct Pictures {
    plain: Target,
    colored: Target,
    dilation: Dilation,
    resolve: Kernel,
    store: Kernel,
    maps: Vec<wgpu::Texture>,
}

impl Solution {
    /// Allocates the obscurances of `capture`'s texels, whose lobes must be diffuse. `atlas` belongs to `scene`, and
    /// `on_gpu` is its upload, for rays or for captures as [`Settings::mode`] requires.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when settings are out of range or the upload does not fit the mode; [`GpuError::TooLarge`],
    /// [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        on_gpu: &GpuScene,
        atlas: &Atlas,
        capture: &AtlasCapture,
        settings: &Settings,
    ) -> Result<Self, GpuError> {
        settings.check().map_err(|error| INFO.refused(error))?;
        atlas.check(scene).map_err(|reason| INFO.refused(reason))?;
        if [capture.size, capture.pages] != [atlas.size, atlas.pages] {
            return Err(INFO.refused("the points are of another atlas"));
        }
        match settings.mode {
            Mode::Rays if !on_gpu.has_rays() => {
                return Err(INFO.refused("mode=rays needs a scene with rays"));
            }
            Mode::Peeling if !on_gpu.has_captures() => {
                return Err(INFO.refused("mode=peeling needs a scene that captures see"));
            }
            _ => (),
        }
        let lookup = AtlasLookup::new(gpu, scene, atlas)?;
        let count = u64::from(atlas.pages) * u64::from(atlas.size) * u64::from(atlas.size);
        let bytes = count.max(1) * TEXEL_BYTES;
        let texels = gpu.room("obscurances [bytes]", bytes)?;
        let kernel = |shader| Kernel::new(gpu, &shader, "main", Some(&on_gpu.layout));
        let sampler = match settings.mode {
            Mode::Rays => {
                let rays = Rays::new(gpu, on_gpu, capture, settings, &lookup)?;
                Sampler::Rays(Box::new(rays))
            }
            Mode::Peeling => {
                let peeling = Peeling::new(gpu, on_gpu, capture, settings, &lookup)?;
                Sampler::Peeling(Box::new(peeling))
            }
        };
        let least = sampler.least_samples();
        let pixels = atlas.size * atlas.size;
        let plain =
            |shader, constants: &[_]| Kernel::with_constants(gpu, &shader, "main", None, constants);
        let of_mesh = scene.meshes.iter();
        let of_mesh: Vec<_> = of_mesh.map(|mesh| (mesh.bounds(), mesh.area())).collect();
        Ok(Self {
            settings: settings.clone(),
            size: atlas.size,
            pages: atlas.pages,
            lookup,
            texels,
            mean: gpu.buffer(
                "mean albedo and light",
                32,
                wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::UNIFORM,
            )?,
            prepare: kernel(shader!("techniques.obscurances.prepare"))?,
            average: kernel(shader!("techniques.obscurances.mean"))?,
            sampler,
            pictures: Pictures {
                plain: Target::new(gpu, pixels)?,
                colored: Target::new(gpu, pixels)?,
                dilation: Dilation::new(gpu, [atlas.size; 2])?,
                resolve: plain(shader!("techniques.obscurances.resolve"), &[least])?,
                store: plain(shader!("techniques.obscurances.store"), &[])?,
                maps: Vec::new(),
            },
            meshes: scene
                .instances
                .iter()
                .map(|instance| of_mesh[instance.mesh])
                .collect(),
            surfaces: Stage::default(),
            state: State::default(),
        })
    }

    /// Sums that shaders look up: `Texel` of obscurance.wesl, and the sums over all surfaces.
    pub(crate) fn buffers(&self) -> [&wgpu::Buffer; 2] {
        [&self.texels, &self.mean]
    }

    /// Constant of the pipelines that look up the sums.
    pub(super) fn least_samples(&self) -> (&'static str, f64) {
        self.sampler.least_samples()
    }

    /// Number of tiles, whose texels are sampled together.
    pub(crate) fn tiles(&self) -> u32 {
        self.sampler.tiles()
    }

    /// The texels of a tile.
    pub(crate) fn texels_of(&self, capture: &AtlasCapture, tile: u32) -> Range<usize> {
        match &self.sampler {
            Sampler::Rays(rays) => rays.texels_of(capture, tile),
            Sampler::Peeling(_) => 0..(self.texels.size() / TEXEL_BYTES) as usize,
        }
    }

    /// Number of steps until every texel has all its samples.
    fn steps(&self) -> u64 {
        let of_tile = self.settings.directions.div_ceil(self.sampler.at_once());
        u64::from(self.sampler.tiles()) * u64::from(of_tile)
    }

    /// Share of the work done (0 to 1).
    pub fn progress(&self) -> f32 {
        let all = self.steps();
        match self.surfaces.begun() {
            None => 0.0,
            Some(_) if all == 0 => 1.0,
            Some(_) => self.state.steps as f32 / all as f32,
        }
    }

    /// Whether every texel has all its samples, for the scene as it was last recorded.
    pub fn is_done(&self) -> bool {
        self.surfaces.begun().is_some() && self.state.steps >= self.steps()
    }

    /// The same, for the scene as it is.
    pub(super) fn is_done_for(&self, scene: &GpuScene) -> bool {
        let now = scene.versions.of(Inputs::SURFACES);
        self.surfaces.begun() == Some(&now) && self.is_done()
    }

    /// Takes one step, and returns the number of its rays or lines: passes `obscurances.prepare`, if the scene has
    /// changed, and `obscurances.rays` or `obscurances.peel` and `obscurances.transfer`. Beforehand, `capture` must
    /// have recorded the same scene, and its vertices must be merged.
    ///
    /// If instances have moved since the last call and nothing else has changed, only texels within reach of the
    /// instances' previous and present positions are recomputed.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        capture: &AtlasCapture,
    ) -> Result<u64, GpuError> {
        self.prepare(frame, scene, capture)?;
        if self.is_done() {
            return Ok(0);
        }
        // All tiles in turn, so that they improve together.
        let tiles = u64::from(self.sampler.tiles());
        let (tile, turn) = (self.state.steps % tiles, self.state.steps / tiles);
        let first = turn as u32 * self.sampler.at_once();
        let samples = first..self.settings.directions;
        let (_, work) = self.take(frame, scene, capture, tile as u32, samples)?;
        self.state.steps += 1;
        Ok(work)
    }

    /// Finds the texels to sample, and clears their sums, if the scene has changed: pass `obscurances.prepare`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub(crate) fn prepare(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        capture: &AtlasCapture,
    ) -> Result<(), GpuError> {
        self.surfaces.ask(scene.versions.of(Inputs::SURFACES));
        if !self.surfaces.is_current() {
            self.begin(frame, scene, capture)?;
        }
        Ok(())
    }

    /// Takes the first of `samples` of a tile, as many as a step may; returns the first that is left and the number of
    /// rays or lines. The sums do not depend on the order in which samples are taken.
    ///
    /// # Errors
    /// [`GpuError`].
    pub(crate) fn take(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        capture: &AtlasCapture,
        tile: u32,
        samples: Range<u32>,
    ) -> Result<(u32, u64), GpuError> {
        let end = samples.end.min(samples.start + self.sampler.at_once());
        let (base, texels, samples) = (self.uniform(), &self.texels, samples.start..end);
        let work = match &self.sampler {
            Sampler::Rays(rays) => {
                rays.take(frame, scene, capture, texels, (tile, &samples), base)?
            }
            Sampler::Peeling(peeling) => {
                let region = self.state.region;
                for number in samples {
                    peeling.take(frame, scene, texels, number, region, base)?;
                }
                peeling.lines()
            }
        };
        Ok((end, work))
    }

    /// Box around the texels that are computed; `None` if all may be.
    #[cfg(test)]
    pub(super) fn region(&self) -> Option<Bounds> {
        self.state.region
    }

    /// Settings as shaders read them, with an empty range of points.
    fn uniform(&self) -> SettingsUniform {
        SettingsUniform {
            distance: self.settings.distance,
            falloff: self.settings.falloff as u32,
            seed: self.settings.seed,
            ..Zeroable::zeroed()
        }
    }

    /// Finds the texels to recompute, and clears their sums.
    fn begin(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        capture: &AtlasCapture,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let placed = self.meshes.iter().zip(&scene.placements);
        let bounds: Vec<Bounds> = placed
            .clone()
            .map(|((bounds, _), place)| bounds.transformed(&place.world_from_mesh))
            .collect();
        if let Sampler::Peeling(peeling) = &mut self.sampler {
            let areas =
                placed.map(|((_, area), place)| area * most_stretch(&place.world_from_mesh));
            peeling.make_room(gpu, scene, areas.sum())?;
        }
        let before = self.surfaces.begun();
        let before = before.filter(|before| before.materials == scene.versions.materials);
        let changed = before.map(|before| self.changed(scene, before.geometry, &bounds));
        let changed = changed.filter(|boxes| boxes.len() <= MOST_BOXES);
        let was_done = self.is_done();
        let renewal = Renewal {
            all: u32::from(changed.is_none()),
            box_count: changed.as_ref().map_or(0, |boxes| boxes.len() as u32),
            finished: u32::from(was_done),
            padding: 0,
        };
        let mut boxes: Vec<BoxRow> = changed.iter().flatten().map(BoxRow::new).collect();
        // A buffer needs at least one element.
        boxes.resize(boxes.len().max(1), BoxRow::new(&Bounds::EMPTY));
        let renewal = gpu.constant("what is computed anew", &renewal)?;
        let boxes = gpu.storage("boxes around what changed [bytes]", &boxes)?;
        frame.clear(&self.mean);
        for piece in capture.pieces() {
            let settings = SettingsUniform {
                first_texel: piece.rows.start * self.size,
                end_point: piece.points.count,
                ..self.uniform()
            };
            let settings = gpu.constant("obscurances", &settings)?;
            let resources: [Named<'_>; 6] = [
                ("settings", &settings),
                ("points", &piece.points.points),
                ("texels", &self.texels),
                ("boxes", &boxes),
                ("renewal", &renewal),
                ("mean", &self.mean),
            ];
            let scene = Some(&scene.bind_group);
            frame.compute("obscurances.prepare", |pass| {
                let count = [piece.points.count, 1, 1];
                self.prepare.run(pass, scene, &resources, count)?;
                self.average.run(pass, scene, &resources, [1, 1, 1])
            })?;
        }
        // Texels that were not finished yet may lie anywhere.
        let changed = changed.filter(|_| was_done);
        let is_same = changed.as_ref().is_some_and(Vec::is_empty);
        self.surfaces.begin();
        self.state = State {
            bounds,
            region: changed.map(|boxes| boxes.into_iter().fold(Bounds::EMPTY, Bounds::union)),
            steps: if is_same { self.steps() } else { 0 },
        };
        Ok(())
    }

    /// Boxes around everything within reach of the previous and present positions of instances that have moved since
    /// `version` of the geometry.
    fn changed(&self, scene: &GpuScene, version: u64, bounds: &[Bounds]) -> Vec<Bounds> {
        let reach = self.settings.distance + scene.diagonal() * ROUNDING;
        let placed = scene
            .placements
            .iter()
            .zip(self.state.bounds.iter().zip(bounds));
        let moved = placed.filter(|(place, _)| place.moved > version);
        let boxes = moved.flat_map(|(_, (before, now))| [*before, *now]);
        let boxes = boxes
            .filter(|bounds| !bounds.is_empty())
            .map(|bounds| Bounds {
                min: bounds.min - reach,
                max: bounds.max + reach,
            });
        boxes.collect()
    }

    /// The present obscurances of all pages. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn pages(&self, gpu: &Gpu) -> Result<Vec<ObscurancePage>, GpuError> {
        (0..self.pages).map(|page| self.page(gpu, page)).collect()
    }

    /// As [`Solution::pages`], for one page.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn page(&self, gpu: &Gpu, page: u32) -> Result<ObscurancePage, GpuError> {
        let mut frame = Frame::new(gpu, false);
        self.resolve(&mut frame, page)?;
        frame.submit()?;
        let is_colored = self.settings.colored;
        let count = u64::from(self.size) * u64::from(self.size);
        let pictures = &self.pictures;
        let read = |image: &Target| -> Result<Vec<[f32; 4]>, GpuError> {
            read_buffer(gpu, &image.radiance, count * 16)
        };
        let plain = read(&pictures.plain)?;
        let colored = is_colored.then(|| read(&pictures.colored)).transpose()?;
        Ok(ObscurancePage {
            obscurance: plain.into_iter().map(|[w, ..]| w).collect(),
            colored: colored.map(|texels| {
                let texels = texels.into_iter();
                texels.map(|[r, g, b, _]| Vec3::new(r, g, b)).collect()
            }),
        })
    }

    /// Divides a page's sums by their sample counts, and fills empty texels: passes `obscurances.resolve` and
    /// `capture.atlas.dilate`.
    fn resolve(&self, frame: &mut Frame<'_>, page: u32) -> Result<(), GpuError> {
        let (size, pictures) = (self.size, &self.pictures);
        let count = size * size;
        let of_page = PageUniform {
            first: page * count,
            count,
            side: size,
            padding: 0,
        };
        let of_page = frame.gpu.constant("page", &of_page)?;
        let resources: [Named<'_>; 5] = [
            ("page", &of_page),
            ("texels", &self.texels),
            ("mean", &self.mean),
            ("plain", &pictures.plain),
            ("colored", &pictures.colored),
        ];
        let (name, resolve) = ("obscurances.resolve", &pictures.resolve);
        frame.run(name, resolve, None, &resources, [count, 1, 1])?;
        pictures.dilation.record(frame, &pictures.plain)?;
        pictures.dilation.record(frame, &pictures.colored)
    }

    /// Updates the maps that other techniques look up with the samples taken so far: passes `obscurances.resolve`,
    /// `capture.atlas.dilate` and `obscurances.store`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record_maps(&mut self, frame: &mut Frame<'_>) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let size = self.size;
        for page in 0..self.pages {
            self.resolve(frame, page)?;
            let pictures = &mut self.pictures;
            if pictures.maps.len() == page as usize {
                pictures.maps.push(gpu.texture_2d(
                    "obscurances",
                    [size, size, 1],
                    wgpu::TextureFormat::Rgba16Float,
                    wgpu::TextureUsages::STORAGE_BINDING
                        | wgpu::TextureUsages::TEXTURE_BINDING
                        | wgpu::TextureUsages::COPY_SRC,
                )?);
            }
            let map = pictures.maps[page as usize].create_view(&Default::default());
            let resources: [Named<'_>; 3] = [
                ("plain", &pictures.plain),
                ("colored", &pictures.colored),
                ("map", &map),
            ];
            let (name, store) = ("obscurances.store", &pictures.store);
            frame.run(name, store, None, &resources, [size, size, 1])?;
        }
        Ok(())
    }

    /// Bytes that are not in maps.
    pub(super) fn work_bytes(&self) -> u64 {
        let sampler = match &self.sampler {
            Sampler::Rays(_) => 0,
            Sampler::Peeling(peeling) => peeling.bytes(),
        };
        let pictures = &self.pictures;
        let images = pictures.plain.radiance.size() + pictures.colored.radiance.size();
        let pictures = images + pictures.dilation.bytes();
        sampler + pictures + self.texels.size() + self.lookup.words.size()
    }

    /// The maps that [`Solution::record_maps`] made, one per page: rgb colored, a plain.
    pub fn maps(&self) -> Vec<Map> {
        let named = self.pictures.maps.iter().enumerate();
        let named = named.map(|(page, map)| Map::of_texture(format!("{}.{page}", INFO.name), map));
        named.collect()
    }
}

/// Upper bound of the factor by which the matrix scales areas: the product of the two largest factors by which it
/// scales lengths is at most half the sum of the squares of all three.
fn most_stretch(matrix: &Mat4) -> f64 {
    let axes = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let squares = axes.map(|axis| f64::from(axis.truncate().length_squared()));
    squares.iter().sum::<f64>() / 2.0
}

/// Constant of the pipelines that take samples.
pub(super) fn colored(settings: &Settings) -> (&'static str, f64) {
    ("COLORED", f64::from(u8::from(settings.colored)))
}
