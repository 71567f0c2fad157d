//! The caustics of one object: caustic maps of the lights that shine on it, and the cube around it that holds the
//! irradiance of their photons.

use std::ops::Range;

use glam::Vec2;

use super::gpu::{COUNTER_BYTES, CausticMap, LIT_TEXEL_BYTES, LitCube, PHOTON_BYTES};
use super::lights::LightView;
use super::{Kernels, LEAST_RESOLUTION, MOST_PIXELS, Settings};
use crate::capture::{Capture, CaptureKernels, SurfacePoints};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::impostor::{Impostors, Maps, Renewal, Wanted, gpu as impostor_gpu};
use crate::lights::gpu::LightSample;
use crate::scene::{Claims, GpuScene, Object};
use crate::sequences::low_discrepancy;
use crate::techniques::{Map, Texels};

/// Most bytes of photon buffers at a time: more photons are traced in several batches.
const PHOTONS_AT_ONCE: u64 = 64 << 20;
/// Invocations that splat the photons of one bounce of a map. Each photon's texels are shared among enough invocations
/// that maps with few photons, whose kernels are large, also fill the GPU.
const SPLAT_INVOCATIONS: u32 = 1 << 21;

/// The caustics of one object.
#[derive(Debug)]
pub struct Caustic {
    instance: u32,
    wanted: Wanted,
    bounces: u32,
    /// Photons per pixel: one mirrored, and one for each bounce inside.
    photons: u32,
    counters: wgpu::Buffer,
    lit_texels: wgpu::Buffer,
    of_object: wgpu::Buffer,
    lit_cube: wgpu::Buffer,
    count_flux: wgpu::Buffer,
    /// Bind group 2 of the gather.
    group: wgpu::BindGroup,
    bound: Option<PhotonGroups>,
    maps: Vec<CausticMapOf>,
    batches: Vec<Vec<Dispatch>>,
    /// Bytes of the photon buffers, which all batches share.
    photon_bytes: u64,
    /// Frames whose photons the counters hold.
    frames: u32,
    /// Flux per count of one frame's sums (W); 0: no light shines on the object.
    step: f64,
}

/// The maps around the object, and the bind groups that refer to them.
#[derive(Debug)]
struct PhotonGroups {
    maps: Maps,
    trace: wgpu::BindGroup,
    seen: wgpu::BindGroup,
    counted: wgpu::BindGroup,
}

/// The caustic map of one light.
#[derive(Debug)]
struct CausticMapOf {
    capture: Capture,
    seen: wgpu::BindGroup,
}

/// A light's view of the object, in a map of `side` x `side` pixels; `None` if it does not shine on the object.
#[derive(Debug, Clone, Copy)]
struct Seen {
    side: u32,
    view: Option<LightView>,
}

/// Tracing and splatting of some of the bounces of one caustic map's pixels.
#[derive(Debug)]
struct Dispatch {
    /// Index of the caustic map.
    of: usize,
    bounces: Range<u32>,
    map: wgpu::Buffer,
    trace: wgpu::BindGroup,
    splat: wgpu::BindGroup,
}

/// Inputs shared by the caustics of all objects.
#[derive(Debug, Clone, Copy)]
pub struct Making<'a> {
    pub scene: &'a GpuScene,
    pub kernels: &'a Kernels,
    pub settings: &'a Settings,
    /// Lights of each frame.
    pub lights: &'a [Vec<LightSample>],
    /// Index of the first light that shares one caustic map's pixels with the others after it: sample points on area
    /// lights.
    pub first_area: usize,
    /// Number of objects that cast caustics.
    pub objects: usize,
    pub settings_version: u64,
}

impl Caustic {
    /// An empty cube for the instance.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        kernels: &Kernels,
        settings: &Settings,
        instance: u32,
        object: &Object,
    ) -> Result<Self, GpuError> {
        let side = settings.cube_resolution;
        let texels = 6 * u64::from(side) * u64::from(side);
        let (storage, uniform) = (wgpu::BufferUsages::STORAGE, wgpu::BufferUsages::UNIFORM);
        let lit_texels = gpu.buffer("caustics [bytes]", texels * LIT_TEXEL_BYTES, storage)?;
        let lit_cube = gpu.buffer("lit cube", size_of::<LitCube>() as u64, uniform)?;
        let group = kernels.gather.to_bind().bind(
            gpu,
            2,
            &[
                ("lit_cube", lit_cube.as_entire_binding()),
                ("lit_texels", lit_texels.as_entire_binding()),
            ],
        )?;
        let is_refracting = object.is_transmissive && object.is_solid && settings.bounces > 0;
        let photons = match (object.is_transmissive, is_refracting) {
            (false, _) => 1,
            (true, false) => 2,
            (true, true) => 1 + settings.bounces,
        };
        Ok(Self {
            instance,
            wanted: Wanted {
                instances: [instance].into(),
                side,
                shape_side: is_refracting.then_some(settings.shape_resolution),
                reference: None,
                layers: 1,
                renewal: Renewal::default(),
            },
            bounces: settings.bounces,
            photons,
            counters: gpu.buffer("caustic counters [bytes]", texels * COUNTER_BYTES, storage)?,
            lit_texels,
            of_object: gpu.buffer(
                "impostor",
                size_of::<impostor_gpu::Impostor>() as u64,
                uniform,
            )?,
            lit_cube,
            count_flux: gpu.buffer("flux of a count [W]", size_of::<f32>() as u64, uniform)?,
            group,
            bound: None,
            maps: Vec::new(),
            batches: Vec::new(),
            photon_bytes: 0,
            frames: 0,
            step: 0.0,
        })
    }

    /// Makes the next frame's photons the first ones.
    pub fn restart(&mut self) {
        self.frames = 0;
    }

    /// Traces and counts the photons of one more frame; returns how many there are, and how many pixels were drawn.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        making: Making<'_>,
        impostors: &mut Impostors,
    ) -> Result<u64, GpuError> {
        let Making {
            scene,
            kernels,
            settings,
            ..
        } = making;
        let gpu = frame.gpu;
        let (maps, captured) =
            impostors.renew(frame, scene, &self.wanted, making.settings_version, 0)?;
        let maps = maps.clone();
        self.bind(gpu, kernels, &maps)?;
        if self.frames == 0 {
            frame.clear(&self.counters);
            // The finest step at which the sums of all frames still fit 31 bits and a sign.
            let flux: f64 = (0..settings.frames)
                .flat_map(|number| self.views(making, number))
                .filter_map(|seen| Some(seen.view?.flux()))
                .sum();
            self.step = flux / f64::from(1_u32 << 30);
        }
        let step = self.step;
        let views = self.views(making, self.frames);
        self.frames += 1;
        let of_object = impostor_gpu::Impostor {
            reference: maps.reference.to_array(),
            instance: self.instance,
            center: maps.center.to_array(),
            search: 0,
            iterations: 0,
            bounces: self.bounces,
            is_refracting: u32::from(self.wanted.shape_side.is_some()),
            is_classical: 0,
            world_from_shape: maps.world_from_shape.to_array(),
            ..bytemuck::Zeroable::zeroed()
        };
        gpu.write(&self.of_object, 0, std::slice::from_ref(&of_object));
        let lit_cube = LitCube {
            reference: maps.reference.to_array(),
            side: self.wanted.side,
            instance: self.instance,
            padding: [0; 3],
        };
        gpu.write(&self.lit_cube, 0, std::slice::from_ref(&lit_cube));
        let count_flux = (step / f64::from(self.frames)) as f32;
        gpu.write(&self.count_flux, 0, std::slice::from_ref(&count_flux));
        self.resize(gpu, kernels, impostors.capture_kernels(), &maps, &views)?;
        let Some(bound) = &self.bound else {
            return Ok(captured);
        };
        for (caustic_map, seen) in self.maps.iter_mut().zip(&views) {
            let Some(light) = &seen.view else { continue };
            let capture = &mut caustic_map.capture;
            capture.record(frame, scene, &light.view, |draw| {
                if draw.instance == self.instance {
                    scene.whole_class(draw)
                } else if scene
                    .claims(draw.instance as usize)
                    .contains(Claims::SHADOW)
                {
                    // Light that passes through another such object belongs to that object's caustic.
                    scene.whole_class(draw).from_both_sides()
                } else {
                    // Occluders block light with both of their sides.
                    draw.seen.from_both_sides()
                }
            })?;
        }
        for batch in &self.batches {
            let lit = batch.iter().filter_map(|dispatch| {
                let view = views[dispatch.of].view.as_ref()?;
                Some((dispatch, &view.map))
            });
            for (dispatch, &map) in lit.clone() {
                let map = CausticMap {
                    reference: maps.reference.to_array(),
                    cube_side: self.wanted.side,
                    counts: (f64::from(map.unit) / step) as f32,
                    first: dispatch.bounces.start,
                    end: dispatch.bounces.end,
                    lanes: lanes(map.side),
                    ..map
                };
                gpu.write(&dispatch.map, 0, std::slice::from_ref(&map));
            }
            frame.compute("caustics.trace", |pass| {
                for (dispatch, map) in lit.clone() {
                    let side = map.side;
                    let groups = [
                        (0, &scene.bind_group),
                        (1, &self.maps[dispatch.of].seen),
                        (2, &bound.trace),
                        (3, &dispatch.trace),
                    ];
                    kernels.trace.dispatch(pass, &groups, [side, side, 1]);
                }
            });
            frame.compute("caustics.splat", |pass| {
                for (dispatch, map) in lit {
                    let side = map.side;
                    let invocations = side * side * dispatch.bounces.len() as u32 * lanes(side);
                    let groups = [(3, &dispatch.splat)];
                    kernels.splat.dispatch(pass, &groups, [invocations, 1, 1]);
                }
            });
        }
        frame.compute("caustics.irradiance", |pass| {
            let groups = [(1, &bound.seen), (3, &bound.counted)];
            let side = self.wanted.side;
            kernels.irradiance.dispatch(pass, &groups, [side, side, 6]);
        });
        let pixels = views.iter().map(|seen| u64::from(seen.side).pow(2));
        Ok(captured + pixels.sum::<u64>() * (1 + u64::from(self.photons)))
    }

    /// The object's views from the lights of frame `number`: one per light that shines on it, and one per sample point
    /// on an emitter, even if it does not shine on the object, because their number must not change.
    fn views(&self, making: Making<'_>, number: u32) -> Vec<Seen> {
        let Making {
            scene,
            settings,
            first_area,
            objects,
            ..
        } = making;
        let mut draws = scene.draws.iter();
        let lights = making.lights.get(number as usize);
        let (Some(draw), Some(lights)) =
            (draws.find(|draw| draw.instance == self.instance), lights)
        else {
            return Vec::new();
        };
        let jitter = if settings.frames > 1 {
            low_discrepancy(number) - 0.5
        } else {
            Vec2::ZERO
        };
        // All sample points on emitters together get as many pixels as one other light.
        let emitters = lights.len() - first_area;
        let whole_maps = objects * (first_area + emitters.min(1));
        let affordable = (MOST_PIXELS / whole_maps.max(1) as f32).sqrt();
        let side = (settings.resolution as f32).min(affordable);
        let area_side = (side / (emitters.max(1) as f32).sqrt()).ceil();
        let lights = lights.iter().enumerate();
        lights
            .filter_map(|(index, light)| {
                let is_area = index >= first_area;
                let side = if is_area { area_side } else { side };
                let side = (side as u32).max(LEAST_RESOLUTION);
                let seed = number.wrapping_mul(0x9e37_79b9) ^ index as u32;
                let diagonal = scene.diagonal();
                let view = LightView::new(light, &draw.bounds, side, jitter, seed, diagonal);
                (is_area || view.is_some()).then_some(Seen { side, view })
            })
            .collect()
    }

    fn bind(&mut self, gpu: &Gpu, kernels: &Kernels, maps: &Maps) -> Result<(), GpuError> {
        if let Some(bound) = &mut self.bound
            && bound.maps.is_same(maps)
        {
            bound.maps = maps.clone();
            return Ok(());
        }
        self.maps.clear();
        self.batches.clear();
        let counted = [
            ("count_flux", self.count_flux.as_entire_binding()),
            ("counters", self.counters.as_entire_binding()),
            ("lit_texels", self.lit_texels.as_entire_binding()),
        ];
        self.bound = Some(PhotonGroups {
            trace: maps.bind(gpu, &kernels.trace, &self.of_object, &kernels.sampler, &[])?,
            seen: maps.points.bind(gpu, &kernels.irradiance)?,
            counted: kernels.irradiance.bind(gpu, 3, &counted)?,
            maps: maps.clone(),
        });
        Ok(())
    }

    /// Allocates the views' caustic maps and photon buffers, unless those that exist have the right sizes.
    fn resize(
        &mut self,
        gpu: &Gpu,
        kernels: &Kernels,
        capture_kernels: &CaptureKernels,
        maps: &Maps,
        views: &[Seen],
    ) -> Result<(), GpuError> {
        let sides = views.iter().map(|seen| seen.side);
        if self
            .maps
            .iter()
            .map(|map| map.capture.size()[0])
            .eq(sides.clone())
        {
            return Ok(());
        }
        self.maps.clear();
        self.batches.clear();
        let limits = gpu.limits();
        let limit = limits
            .max_buffer_size
            .min(limits.max_storage_buffer_binding_size)
            .min(PHOTONS_AT_ONCE);
        // Each dispatch of a batch has its own photon buffer, so that none waits for another; the next batch reuses the
        // buffers.
        let mut sizes: Vec<u64> = Vec::new();
        let mut batches: Vec<Vec<(usize, Range<u32>)>> = Vec::new();
        let mut left = 0;
        for (index, side) in sides.clone().enumerate() {
            let of_bounce = u64::from(side) * u64::from(side) * PHOTON_BYTES;
            let at_once = (limit / of_bounce).clamp(1, u64::from(self.photons)) as u32;
            for first in (0..self.photons).step_by(at_once as usize) {
                let bounces = first..(first + at_once).min(self.photons);
                let size = of_bounce * bounces.len() as u64;
                if left < size {
                    batches.push(Vec::new());
                    left = PHOTONS_AT_ONCE;
                }
                left = left.saturating_sub(size);
                if let Some(batch) = batches.last_mut() {
                    if batch.len() == sizes.len() {
                        sizes.push(0);
                    }
                    let room = &mut sizes[batch.len()];
                    *room = size.max(*room);
                    batch.push((index, bounces));
                }
            }
        }
        self.photon_bytes = sizes.iter().sum();
        let photons = sizes.iter().map(|&size| {
            let usage = wgpu::BufferUsages::STORAGE;
            gpu.buffer("photons [bytes]", size, usage)
        });
        let photons: Vec<_> = photons.collect::<Result<_, _>>()?;
        for side in sides {
            let capture = Capture::of_camera(gpu, capture_kernels, [side, side])?;
            self.maps.push(CausticMapOf {
                seen: capture.points.bind(gpu, &kernels.trace)?,
                capture,
            });
        }
        let dispatch = |((of, bounces), photons): ((usize, Range<u32>), &wgpu::Buffer)| {
            let size = size_of::<CausticMap>() as u64;
            let map = gpu.buffer("caustic map", size, wgpu::BufferUsages::STORAGE)?;
            let mut resources = vec![
                ("caustic_map", map.as_entire_binding()),
                ("photons", photons.as_entire_binding()),
                ("receivers", maps.points.points.as_entire_binding()),
            ];
            let trace = kernels.trace.bind(gpu, 3, &resources)?;
            resources.push(("counters", self.counters.as_entire_binding()));
            Ok(Dispatch {
                of,
                bounces,
                trace,
                splat: kernels.splat.bind(gpu, 3, &resources)?,
                map,
            })
        };
        self.batches = batches
            .into_iter()
            .map(|batch| batch.into_iter().zip(&photons).map(dispatch).collect())
            .collect::<Result<_, GpuError>>()?;
        Ok(())
    }

    /// Irradiance in the cube, the six faces stacked vertically.
    pub fn map(&self) -> Map {
        let side = self.wanted.side;
        Map {
            name: format!("caustics.{}.irradiance", self.instance),
            texels: Texels::Buffer {
                buffer: self.lit_texels.clone(),
                size: [side, 6 * side],
                stride: LIT_TEXEL_BYTES,
                is_number: false,
            },
        }
    }

    /// Bytes that are not in maps: counters, photons, and caustic maps with their visibility buffers and depth.
    pub fn work_bytes(&self) -> u64 {
        let maps = self.maps.iter().map(|map| {
            let points = &map.capture.points;
            points.points.size() + u64::from(points.count) * (4 + 4)
        });
        self.counters.size() + self.photon_bytes + maps.sum::<u64>()
    }

    /// Adds the caustics at `points`; `groups`: points and target.
    pub fn gather(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        scene: &GpuScene,
        gather: &Kernel,
        groups: &[wgpu::BindGroup; 2],
        points: &SurfacePoints,
    ) {
        let [seen, added] = groups;
        let groups = [
            (0, &scene.bind_group),
            (1, seen),
            (2, &self.group),
            (3, added),
        ];
        gather.dispatch(pass, &groups, [points.count, 1, 1]);
    }
}

/// Invocations that share the texels of one photon of a map: a power of two, at most 64, the size of a workgroup.
fn lanes(side: u32) -> u32 {
    let lanes = SPLAT_INVOCATIONS / (side * side);
    (1 << lanes.max(1).ilog2()).clamp(4, 64)
}

#[cfg(test)]
impl Caustic {
    /// Total flux in the cube (W).
    pub fn flux(&self, gpu: &Gpu) -> glam::DVec3 {
        use crate::gpu::read_buffer;

        let counters: Vec<[u32; 6]> =
            read_buffer(gpu, &self.counters, self.counters.size()).unwrap();
        let count_flux: Vec<f32> =
            read_buffer(gpu, &self.count_flux, self.count_flux.size()).unwrap();
        let mut sum = glam::DVec3::ZERO;
        for [r, g, b, ..] in counters {
            sum += glam::DVec3::new(r.into(), g.into(), b.into());
        }
        sum * f64::from(count_flux[0])
    }
}
