//! Batches of directions, each with an atlas of depth maps, and the gather over them.

use std::ops::Range;

use super::Reflectivity;
use super::gpu::{self, Direction, DirectionMap};
use crate::capture::depth::{
    DepthAtlas, DepthDrawing, DepthRasterizer, DepthViewSpec, TRANSMITTANCE_BYTES,
};
use crate::capture::{Gather, Receiver};
use crate::gpu::{Frame, Gpu, GpuError, Named, join};
use crate::scene::{GpuScene, Inputs, Versions};
use crate::shader;
use crate::techniques::Slice;

/// Most direction x point products per dispatch: about 100 ms on a slow GPU.
const DISPATCH_WORK: u64 = 1 << 27;
/// Lookups for a direction that passes media, roughly, where one counts as a lookup of a depth map.
const MEDIA_LOOKUPS: u64 = 16;

/// Bytes of a texel's depth.
const DEPTH_BYTES: u32 = 4;

/// Border of a depth map, outside the scene, as room for interpolation (texels).
pub const GUTTER: u32 = 2;

/// How depth maps are stored and drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthMaps {
    /// Largest side of an atlas (texels).
    pub atlas_side: u32,
    /// Memory for all atlases together (bytes).
    pub memory: u64,
    /// Rasterizer of the depth maps, and detail of the casters.
    pub drawing: DepthDrawing,
}

/// How directions are split into batches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Plan {
    /// Directions per batch; the last one may have fewer.
    pub per_batch: u32,
    /// Whether each batch keeps its own atlas. Otherwise all are drawn into one atlas, again in every frame.
    pub is_kept: bool,
}

impl Plan {
    /// Plan for `count` maps of `side` x `side` texels of `texel` bytes, in atlases of at most `atlas_side` x
    /// `atlas_side` texels and `memory` bytes together; a batch has at least one map.
    pub fn new(count: u32, [side, texel]: [u32; 2], atlas_side: u32, memory: u64) -> Self {
        let map = u64::from(side) * u64::from(side) * u64::from(texel);
        let columns = u64::from((atlas_side / side).max(1));
        // Batches of equal size, in square atlases.
        let batches = u64::from(count).div_ceil(columns * columns).max(1);
        let per_batch = u64::from(count).div_ceil(batches).max(1);
        let used = (per_batch - 1).isqrt() + 1;
        if batches * used * used * map <= memory {
            return Self {
                per_batch: per_batch as u32,
                is_kept: true,
            };
        }
        let columns = (memory / map).isqrt().clamp(1, columns);
        Self {
            per_batch: (columns * columns).min(u64::from(count)) as u32,
            is_kept: false,
        }
    }
}

/// Directions with their depth maps, and the passes over them.
#[derive(Debug)]
pub struct Batches {
    /// Most direction x point products per dispatch.
    work: u64,
    rasterizer: DepthRasterizer,
    gather: Gather,
    /// Gathers four texels of an atlas.
    texels: wgpu::Sampler,
    made: Option<DirectionMaps>,
}

/// Resources for a number of directions.
#[derive(Debug)]
struct DirectionMaps {
    plan: Plan,
    drawing: DepthDrawing,
    count: u32,
    /// The directions as shaders have them.
    known: Vec<Direction>,
    directions: wgpu::Buffer,
    maps: wgpu::Buffer,
    batches: Vec<Batch>,
    /// Of the scene for which maps are drawn in turn; the next one, and how many of them are left.
    turn: Option<Versions>,
    next: u32,
    left: u32,
}

/// Directions whose depth maps share an atlas.
#[derive(Debug)]
struct Batch {
    directions: Range<u32>,
    atlas: DepthAtlas,
}

/// Directions, in ranges short enough for any driver's watchdog.
pub struct Ranges {
    all: Range<u32>,
    at_once: usize,
}

impl Ranges {
    /// With at most `work` direction x point products each.
    pub fn new(all: Range<u32>, receiver: &Receiver, work: u64) -> Self {
        let at_once = work / u64::from(receiver.points.lit.max(1));
        Self {
            all,
            at_once: at_once.max(1) as usize,
        }
    }

    /// Adds the light of the directions to the receiver's target: pass `image-based-lighting.gather`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        self,
        frame: &mut Frame<'_>,
        gather: &Gather,
        scene: &GpuScene,
        receiver: &Receiver,
        maps: &[Named<'_>],
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        frame.compute("image-based-lighting.gather", |pass| {
            for first in self.all.clone().step_by(self.at_once) {
                let end = (first + self.at_once as u32).min(self.all.end);
                let range = range(gpu, first..end)?;
                let own = [("range", &range as _), ("sums", &receiver.target as _)];
                let more = join(maps, &own);
                gather.run(gpu, pass, scene, receiver, &more, receiver.points.lit)?;
            }
            Ok(())
        })
    }
}

/// A range of directions, for shaders.
pub fn range(gpu: &Gpu, directions: Range<u32>) -> Result<wgpu::Buffer, GpuError> {
    let range = gpu::Range {
        first: directions.start,
        end: directions.end,
        padding_0: 0,
        padding_1: 0,
    };
    gpu.constant("range of directions", &range)
}

impl Batches {
    /// Compiles the passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, reflectivity: Reflectivity) -> Result<Self, GpuError> {
        let gather = shader!("techniques.image_based_lighting.gather");
        let rasterizer = DepthRasterizer::new(gpu, scene)?;
        let has_transmittance = rasterizer.kernels.has_transmittance();
        let constants = [
            ("REFLECTIVITY", f64::from(reflectivity as u32)),
            ("HAS_TRANSMITTANCE", has_transmittance.into()),
            scene.media_constant(),
        ];
        Ok(Self {
            work: match scene.media.is_empty() {
                true => DISPATCH_WORK,
                false => DISPATCH_WORK / MEDIA_LOOKUPS,
            },
            rasterizer,
            gather: Gather::new(gpu, scene, &gather, &constants)?,
            texels: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("texels of depth maps"),
                ..Default::default()
            }),
            made: None,
        })
    }

    /// Whether the maps hold the transmittance of see-through casters.
    pub fn has_transmittance(&self) -> bool {
        self.rasterizer.kernels.has_transmittance()
    }

    /// Prepares what depth maps draw. False while that takes more frames.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn prepare(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        drawing: &DepthDrawing,
    ) -> Result<bool, GpuError> {
        self.rasterizer.prepare(frame, scene, drawing.caster_detail)
    }

    /// Sets the directions and the views of their depth maps, which all have one size, and draws the maps if there is
    /// memory for all of them.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        (directions, views): (&[Direction], &[DepthViewSpec]),
        maps: &DepthMaps,
    ) -> Result<(), GpuError> {
        let of = seen_by_maps(scene);
        let gpu = frame.gpu;
        let drawing = maps.drawing;
        let count = directions.len() as u32;
        let Some(side) = views.first().map(|view| view.size[0]) else {
            self.made = None;
            return Ok(());
        };
        let texel = if self.has_transmittance() {
            DEPTH_BYTES + TRANSMITTANCE_BYTES
        } else {
            DEPTH_BYTES
        };
        let plan = Plan::new(count, [side, texel], maps.atlas_side, maps.memory);
        // Directions that moved need no new tiles: only the contents of their maps change.
        let reused = self.made.as_mut().is_some_and(|made| {
            made.plan == plan
                && made.count == count
                && made.batches.iter_mut().all(|batch| {
                    let [first, end] = [batch.directions.start, batch.directions.end];
                    batch
                        .atlas
                        .update(gpu, &views[first as usize..end as usize])
                })
        });
        if !reused {
            // Frees the old resources first.
            self.made = None;
            self.made = Some(self.make(gpu, plan, drawing, views)?);
        }
        let Some(made) = &mut self.made else {
            return Ok(());
        };
        made.drawing = drawing;
        made.known = directions.to_vec();
        (made.turn, made.left) = (Some(of), 0);
        made.write(gpu, scene);
        if plan.is_kept {
            for batch in &mut made.batches {
                batch.draw(frame, &mut self.rasterizer, drawing, scene)?;
            }
        }
        Ok(())
    }

    /// Whether there are maps of just these directions, whatever comes from there, that the hardware rasterizer draws.
    pub fn has_maps_toward(&self, scene: &GpuScene, directions: &[Direction]) -> bool {
        let toward = |directions: &[Direction]| {
            let toward = directions.iter().map(|direction| direction.toward);
            toward.collect::<Vec<_>>()
        };
        let by_compute = |made: &DirectionMaps| {
            let mut batches = made.batches.iter();
            let is_drawn = |batch: &Batch| {
                self.rasterizer
                    .draws_by_compute(scene, &batch.atlas, made.drawing)
            };
            batches.any(is_drawn)
        };
        let mut made = self.made.iter().filter(|made| made.plan.is_kept);
        made.any(|made| toward(&made.known) == toward(directions) && !by_compute(made))
    }

    /// As [`Batches::generate`], where [`Batches::has_maps_toward`] holds: draws no more maps than `budget` allows, those
    /// first that were drawn longest ago; the others show the scene as it was then. Returns the share of maps that show it
    /// as it is (0 to 1).
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn draw_some(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        (directions, views): (&[Direction], &[DepthViewSpec]),
        budget: &mut Slice,
    ) -> Result<f32, GpuError> {
        let (gpu, Some(made)) = (frame.gpu, &mut self.made) else {
            return Ok(1.0);
        };
        let of = seen_by_maps(scene);
        if made.turn.replace(of) != Some(of) {
            made.left = made.count;
        }
        let mut drawn = vec![false; made.count as usize];
        while made.left > 0 && budget.takes(map_work(scene, &views[made.next as usize])) {
            drawn[made.next as usize] = true;
            made.next = (made.next + 1) % made.count;
            made.left -= 1;
        }
        for (index, direction) in directions.iter().enumerate() {
            // A map that waits keeps its texels.
            let texel = match drawn[index] {
                true => direction.texel,
                false => made.known[index].texel,
            };
            made.known[index] = Direction {
                texel,
                ..*direction
            };
        }
        let name = "image-based-lighting.generate";
        for batch in &mut made.batches {
            let first = batch.directions.start as usize;
            let own = &drawn[first..batch.directions.end as usize];
            if own.contains(&true) {
                let mut specs = batch.atlas.specs().to_vec();
                for (index, spec) in specs
                    .iter_mut()
                    .enumerate()
                    .filter(|(index, _)| own[*index])
                {
                    *spec = views[first + index];
                }
                batch.atlas.update(gpu, &specs);
                self.rasterizer
                    .record_some(frame, name, scene, &batch.atlas, |index| own[index]);
            }
        }
        made.write(gpu, scene);
        Ok((made.count - made.left) as f32 / made.count as f32)
    }

    fn make(
        &self,
        gpu: &Gpu,
        plan: Plan,
        drawing: DepthDrawing,
        views: &[DepthViewSpec],
    ) -> Result<DirectionMaps, GpuError> {
        let storage = |label: &str, size: usize| {
            let size = (views.len() * size) as u64;
            gpu.room(label, size)
        };
        let directions = storage("directions [bytes]", size_of::<Direction>())?;
        let maps = storage("direction maps [bytes]", size_of::<DirectionMap>())?;
        let mut batches: Vec<Batch> = Vec::new();
        let mut first = 0;
        for views in views.chunks(plan.per_batch as usize) {
            let views = views.to_vec();
            let end = first + views.len() as u32;
            let atlas = match batches.first() {
                Some(other) if !plan.is_kept => {
                    let kernels = &self.rasterizer.kernels;
                    other.atlas.sharing_textures(gpu, kernels, views)?
                }
                _ => DepthAtlas::new(gpu, &self.rasterizer.kernels, views)?,
            };
            batches.push(Batch {
                directions: first..end,
                atlas,
            });
            first = end;
        }
        Ok(DirectionMaps {
            plan,
            drawing,
            count: first,
            known: Vec::new(),
            directions,
            maps,
            batches,
            turn: None,
            next: 0,
            left: 0,
        })
    }

    /// One atlas of depth maps, once generated.
    pub fn atlas(&self) -> Option<&DepthAtlas> {
        let made = self.made.as_ref()?;
        made.batches.first().map(|batch| &batch.atlas)
    }

    /// The directions whose depth maps share an atlas, and what passes bind that look these maps up, with the resources
    /// of gather.wesl; if all are kept.
    pub fn maps(&self) -> impl Iterator<Item = (Range<u32>, [Named<'_>; 5])> {
        let made = self.made.iter();
        made.flat_map(|made| {
            let batches = made.batches.iter();
            batches.map(|batch| {
                (
                    batch.directions.clone(),
                    made.resources(batch, &self.texels),
                )
            })
        })
    }

    /// Adds the light of every direction to the receiver's target: see gather.wesl.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
    ) -> Result<(), GpuError> {
        let Some(made) = &mut self.made else {
            return Ok(());
        };
        for index in 0..made.batches.len() {
            let batch = &mut made.batches[index];
            if !made.plan.is_kept {
                batch.draw(frame, &mut self.rasterizer, made.drawing, scene)?;
            }
            let ranges = Ranges::new(batch.directions.clone(), receiver, self.work);
            let maps = made.resources(&made.batches[index], &self.texels);
            ranges.record(frame, &self.gather, scene, receiver, &maps)?;
        }
        Ok(())
    }
}

/// The versions of what depth maps of the sky show.
fn seen_by_maps(scene: &GpuScene) -> Versions {
    scene
        .versions
        .of((Inputs::LIGHTS | Inputs::SKY | Inputs::ENVIRONMENT).without())
}

/// Work of drawing a map, in units of [`crate::lighting::Budget`].
fn map_work(scene: &GpuScene, view: &DepthViewSpec) -> u64 {
    let [width, height] = view.size.map(u64::from);
    width * height + scene.casters().work()
}

impl DirectionMaps {
    /// Writes directions and views for shaders.
    fn write(&self, gpu: &Gpu, scene: &GpuScene) {
        let is_all_covered = scene.core == scene.bounds;
        let batches = self.batches.iter();
        let maps = batches.flat_map(|batch| batch.maps(is_all_covered));
        let maps: Vec<DirectionMap> = maps.collect();
        gpu.write(&self.directions, 0, &self.known);
        gpu.write(&self.maps, 0, &maps);
    }

    fn resources<'a>(&'a self, batch: &'a Batch, texels: &'a wgpu::Sampler) -> [Named<'a>; 5] {
        [
            ("direction_maps", &self.maps),
            ("depth_atlas", &batch.atlas.view),
            ("directions", &self.directions),
            ("transmittance_unfilterable", batch.atlas.transmittance()),
            ("texels_unfilterable", texels),
        ]
    }
}

impl Batch {
    fn draw(
        &mut self,
        frame: &mut Frame<'_>,
        rasterizer: &mut DepthRasterizer,
        drawing: DepthDrawing,
        scene: &GpuScene,
    ) -> Result<(), GpuError> {
        let name = "image-based-lighting.generate";
        rasterizer.record(frame, name, scene, &mut self.atlas, drawing)
    }

    /// The batch's depth maps as the shader reads them; `is_all_covered`: no point lies beside them.
    fn maps(&self, is_all_covered: bool) -> impl Iterator<Item = DirectionMap> {
        let sign = if is_all_covered { 1.0 } else { -1.0 };
        (0..self.directions.len()).map(move |index| {
            let texels_from_world = self.atlas.texels_from_world(index);
            let rows = [0, 1, 2].map(|row| texels_from_world.row(row));
            let [u, v, depth] = rows.map(|row| row.truncate().length_squared());
            let side = self.atlas.texture.width() as f32;
            DirectionMap {
                u: rows[0].to_array(),
                v: rows[1].to_array(),
                depth: rows[2].to_array(),
                scale: [depth / u, depth / v, depth.sqrt(), sign / side],
                tile: self.atlas.texels_within(index, GUTTER / 2),
            }
        })
    }
}
