//! The depth maps of light samples, in one atlas.

use std::ops::Range;

use super::LightList;
use super::gpu::{LightSample, table};
use crate::capture::depth::{DepthAtlas, DepthKernels, clear_tiles};
use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Named, RasterKernel};
use crate::scene::{GpuScene, Versions};

/// How much sooner than others a light's maps are drawn if the light itself has changed: moving lights show more than
/// what moves in their light.
const CHANGED_FIRST: u64 = 8;

/// Light samples and their depth maps, for passes that import table.wesl.
#[derive(Debug)]
pub struct Shadows {
    kernels: DepthKernels,
    /// Compiled on first use.
    clear: RasterKernel,
    comparison: wgpu::Sampler,
    texels: wgpu::Sampler,
    maps: Option<DepthMaps>,
    /// Maps of other sizes, until each of them is drawn.
    next: Option<DepthMaps>,
    /// Counts calls of [`Shadows::update`].
    now: u64,
}

/// The samples and views of a list of lights.
#[derive(Debug)]
struct DepthMaps {
    atlas: DepthAtlas,
    table: HostBuffer,
    /// The samples as their maps show them.
    samples: Vec<LightSample>,
    /// When each sample's maps were drawn.
    drawn: Vec<Option<Drawn>>,
}

/// When a sample's maps were drawn.
#[derive(Debug, Clone, Copy)]
struct Drawn {
    /// The versions of the scene.
    of: Versions,
    /// [`Shadows::now`].
    at: u64,
}

/// What [`Shadows::update`] did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Updated {
    /// Whether there are maps to look up, or no lights.
    pub is_whole: bool,
    /// Share of the samples whose maps show the scene as it is (0 to 1).
    pub progress: f32,
}

impl Shadows {
    /// Compiles the passes that draw depth.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        Ok(Self {
            kernels: DepthKernels::of_lamps(gpu, scene)?,
            clear: clear_tiles(gpu)?,
            comparison: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("shadow comparison"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                // A point is lit if it is at least as near as the map's depth.
                compare: Some(wgpu::CompareFunction::GreaterEqual),
                ..Default::default()
            }),
            texels: (gpu.device).create_sampler(&wgpu::SamplerDescriptor {
                label: Some("shadow texels"),
                ..Default::default()
            }),
            maps: None,
            next: None,
            now: 0,
        })
    }

    /// Draws all maps of `list` in the pass `pass`, of the scene at the versions `of`.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the views do not fit one atlas.
    pub fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        pass: &str,
        list: LightList,
        of: Versions,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        self.next = None;
        if list.samples.is_empty() {
            self.maps = None;
            return Ok(());
        }
        // A light that moved needs no new tiles: only their content changes.
        let reused = self.maps.take().and_then(|mut made| {
            let is_same = made.has_tiles_of(&list) && made.atlas.update(gpu, &list.views);
            is_same.then_some(made)
        });
        let made = match reused {
            Some(mut made) => {
                made.samples = list.samples;
                made.write_table(gpu);
                made
            }
            None => DepthMaps::new(gpu, &self.kernels, list)?,
        };
        made.atlas
            .record(frame, pass, &self.kernels, scene.casters());
        let made = self.maps.insert(made);
        made.drawn.fill(Some(Drawn { of, at: self.now }));
        Ok(())
    }

    /// As [`Shadows::generate`], but draws only maps that would change, and of those only the maps of as many samples
    /// as `takes` allows. It is told the work of each sample's maps before they are drawn, in units of
    /// [`crate::lighting::Budget`]. Samples whose
    /// maps wait stay as their maps show them. If maps need other sizes, the earlier ones stay until all are drawn.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the views do not fit one atlas.
    pub fn update(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        pass: &str,
        (list, of): (&LightList, Versions),
        mut takes: impl FnMut(u64) -> bool,
    ) -> Result<Updated, GpuError> {
        let gpu = frame.gpu;
        self.now += 1;
        let now = self.now;
        if list.samples.is_empty() {
            (self.maps, self.next) = (None, None);
            return Ok(Updated {
                is_whole: true,
                progress: 1.0,
            });
        }
        let has_tiles = |maps: &Option<DepthMaps>| {
            let mut maps = maps.iter();
            maps.any(|made| made.has_tiles_of(list))
        };
        let is_kept = has_tiles(&self.maps);
        if is_kept {
            self.next = None;
        } else if self.next.is_none() {
            let next = match DepthMaps::new(gpu, &self.kernels, list.clone()) {
                // The earlier maps make room.
                Err(GpuError::OutOfMemory { .. }) if self.maps.take().is_some() => {
                    DepthMaps::new(gpu, &self.kernels, list.clone())?
                }
                made => made?,
            };
            self.next = Some(next);
        }
        // Begun maps are finished first, even if they have the wrong sizes by now: or else none would be finished while
        // the sizes change in every frame.
        let made = match &mut self.next {
            Some(next) => next,
            None => self.maps.as_mut().expect("maps that have the list's tiles"),
        };
        let list = made.has_tiles_of(list).then_some(list);
        let mut stale = made.stale(list, of, now);
        stale.sort_by_key(|(_, urgency)| std::cmp::Reverse(*urgency));
        let taken = stale.iter().map(|&(index, _)| index);
        let of_triangles = scene.casters().work();
        let taken = taken.take_while(|&index| takes(made.texels(index) + of_triangles));
        let taken: Vec<usize> = taken.collect();
        if !taken.is_empty() {
            if let Some(list) = list {
                made.show(gpu, list, &taken);
            }
            let views: Vec<Range<usize>> = taken.iter().map(|&index| made.views(index)).collect();
            let is_drawn = |view: usize| views.iter().any(|views| views.contains(&view));
            let kernels = (&self.clear, &self.kernels);
            made.atlas
                .record_some(frame, pass, kernels, scene.casters(), is_drawn);
            for &index in &taken {
                made.drawn[index] = Some(Drawn { of, at: now });
            }
        }
        let (left, all) = (stale.len() - taken.len(), made.samples.len());
        let is_current = left == 0 && list.is_some();
        if made.drawn.iter().all(Option::is_some) && self.next.is_some() {
            self.maps = self.next.take();
        }
        Ok(Updated {
            is_whole: self.maps.is_some(),
            progress: if is_current {
                1.0
            } else {
                (all - left) as f32 / (all + 1) as f32
            },
        })
    }

    /// What kernels that import table.wesl bind; `None` without lights.
    pub fn resources(&self) -> Option<[Named<'_>; 5]> {
        let made = self.maps.as_ref()?;
        Some([
            ("shadow_atlas", &made.atlas.view),
            ("shadow_comparison", &self.comparison),
            ("light_table", &made.table),
            ("shadow_transmittance", made.atlas.transmittance()),
            ("shadow_texels_unfilterable", &self.texels),
        ])
    }

    /// Whether the maps hold the transmittance of see-through casters; kernels that look them up set the constant
    /// `HAS_TRANSMITTANCE`.
    pub fn has_transmittance(&self) -> bool {
        self.kernels.has_transmittance()
    }

    /// Number of light samples.
    pub fn light_count(&self) -> u32 {
        self.maps
            .as_ref()
            .map_or(0, |made| made.samples.len() as u32)
    }

    /// The first sample of an area light, which all others follow.
    pub fn first_of_area(&self) -> u32 {
        let samples = self.maps.iter().flat_map(|made| &made.samples);
        samples
            .take_while(|sample| sample.kind < LightSample::AREA)
            .count() as u32
    }

    /// Texels of all maps.
    pub fn texels(&self) -> u64 {
        let maps = self.maps.iter();
        maps.flat_map(|made| (0..made.samples.len()).map(|index| made.texels(index)))
            .sum()
    }

    /// The depth atlas, once generated.
    pub fn atlas(&self) -> Option<&DepthAtlas> {
        self.maps.as_ref().map(|made| &made.atlas)
    }
}

impl DepthMaps {
    /// Maps for a list, not drawn yet.
    fn new(gpu: &Gpu, kernels: &DepthKernels, list: LightList) -> Result<Self, GpuError> {
        let atlas = DepthAtlas::new(gpu, kernels, list.views)?;
        let rows = table(&list.samples, &atlas.uniforms());
        let size = std::mem::size_of_val(rows.as_slice()) as u64;
        let usage = wgpu::BufferUsages::STORAGE;
        let table = HostBuffer::new(gpu, "light table [bytes]", size, usage)?;
        table.write(gpu, &rows);
        Ok(Self {
            table,
            atlas,
            drawn: vec![None; list.samples.len()],
            samples: list.samples,
        })
    }

    fn has_tiles_of(&self, list: &LightList) -> bool {
        let views = |sample: &LightSample| [sample.first_view, sample.view_count];
        let of_maps = self.samples.iter().map(views);
        of_maps.eq(list.samples.iter().map(views)) && self.atlas.has_tiles_of(&list.views)
    }

    fn write_table(&self, gpu: &Gpu) {
        let rows = table(&self.samples, &self.atlas.uniforms());
        self.table.write(gpu, &rows);
    }

    /// The views of a sample.
    fn views(&self, index: usize) -> Range<usize> {
        let sample = &self.samples[index];
        let first = sample.first_view as usize;
        first..first + sample.view_count as usize
    }

    /// Texels of a sample's maps.
    fn texels(&self, index: usize) -> u64 {
        let specs = self.atlas.specs()[self.views(index)].iter();
        specs
            .map(|spec| u64::from(spec.size[0]) * u64::from(spec.size[1]))
            .sum()
    }

    /// The samples whose maps would change, and how urgent each is: the older the maps, the more.
    fn stale(&self, list: Option<&LightList>, of: Versions, now: u64) -> Vec<(usize, u64)> {
        let urgency = |(index, drawn): (usize, &Option<Drawn>)| {
            let Some(drawn) = drawn else {
                return Some((index, u64::MAX));
            };
            let views = self.views(index);
            let is_same = |list: &LightList| {
                list.samples[index] == self.samples[index]
                    && list.views[views.clone()] == self.atlas.specs()[views.clone()]
            };
            let has_changed = !is_same(list?);
            let age = now - drawn.at;
            (has_changed || drawn.of != of).then(|| {
                (
                    index,
                    if has_changed {
                        CHANGED_FIRST * age
                    } else {
                        age
                    },
                )
            })
        };
        self.drawn.iter().enumerate().filter_map(urgency).collect()
    }

    /// Lets samples follow the list.
    fn show(&mut self, gpu: &Gpu, list: &LightList, samples: &[usize]) {
        let mut specs = self.atlas.specs().to_vec();
        for &index in samples {
            self.samples[index] = list.samples[index];
            let views = self.views(index);
            specs[views.clone()].copy_from_slice(&list.views[views]);
        }
        self.atlas.update(gpu, &specs);
        self.write_table(gpu);
    }
}
