//! The caustics of one object: caustic maps of the lights that shine on it, and the cube around it that holds the
//! irradiance of their photons.

use std::ops::Range;

use glam::Vec2;

use super::gpu::{Batch, COUNTER_BYTES, CausticMap, LIT_TEXEL_BYTES, LitCube, PHOTON_BYTES};
use super::lights::{Framing, LightView};
use super::{Kernels, LEAST_RESOLUTION, MOST_PIXELS, Settings, Tracer};
use crate::capture::{CaptureKernels, HitImages, SurfacePoints};
use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Kernel};
use crate::impostor::{Impostors, Maps, Renewal, Wanted, gpu as impostor_gpu};
use crate::lights::gpu::LightSample;
use crate::scene::{Claims, GpuScene, Object};
use crate::sequences::low_discrepancy;
use crate::techniques::{Map, Texels};

/// Most bytes of photons at a time, unless one per pixel of a single map takes more: others follow in further batches.
const PHOTONS_AT_ONCE: u64 = 64 << 20;
/// The caustics of one object.
#[derive(Debug)]
pub struct Caustic {
    instance: u32,
    wanted: Wanted,
    /// Most surfaces that light meets inside; 0: it is refracted once, or not at all.
    bounces: u32,
    /// Photons per pixel: one mirrored, and one for each bounce inside.
    photons: u32,
    counters: wgpu::Buffer,
    lit_texels: wgpu::Buffer,
    of_object: HostBuffer,
    lit_cube: HostBuffer,
    count_flux: HostBuffer,
    /// Bind group 2 of the gather.
    group: wgpu::BindGroup,
    bound: Option<PhotonGroups>,
    caustic_maps: Option<CausticMaps>,
    /// Whether the maps around the object are renewed for the next frame's photons.
    is_surrounded: bool,
    /// Frames whose photons the counters hold.
    frames: u32,
    /// Flux per count of one frame's sums (W); 0: no light shines on the object.
    step: f64,
}

/// The maps around the object, and the bind groups that refer to them.
#[derive(Debug)]
struct PhotonGroups {
    maps: Maps,
    /// Bind group 2 of tracer `maps`.
    trace: Option<wgpu::BindGroup>,
    seen: wgpu::BindGroup,
    counted: wgpu::BindGroup,
}

/// The caustic maps of all lights.
#[derive(Debug)]
struct CausticMaps {
    images: HitImages,
    /// The scene's merged vertices and the bind group with them. The scene replaces the vertices when it changes.
    seen: Option<(wgpu::Buffer, wgpu::BindGroup)>,
    uniforms: HostBuffer,
    batches: Vec<BatchOf>,
    /// Bytes of the photon buffer, which all batches share.
    photon_bytes: u64,
}

/// A light's view of the object, in a map of `side` x `side` pixels; `None` if it does not shine on the object.
#[derive(Debug, Clone, Copy)]
struct Seen {
    side: u32,
    view: Option<LightView>,
}

/// Tracing and splatting of some photons of consecutive maps of the same size.
#[derive(Debug)]
struct BatchOf {
    maps: Range<usize>,
    /// Numbers of the photons.
    numbers: Range<u32>,
    uniform: HostBuffer,
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
    /// An empty cube for the instance, one of those that are `claimed`.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        kernels: &Kernels,
        settings: &Settings,
        instance: u32,
        object: &Object,
        claimed: &[u32],
    ) -> Result<Self, GpuError> {
        let side = settings.cube_resolution;
        let texels = 6 * u64::from(side) * u64::from(side);
        let (storage, uniform) = (wgpu::BufferUsages::STORAGE, wgpu::BufferUsages::UNIFORM);
        let lit_texels = gpu.buffer("caustics [bytes]", texels * LIT_TEXEL_BYTES, storage)?;
        let lit_cube = HostBuffer::new(gpu, "lit cube", size_of::<LitCube>() as u64, uniform)?;
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
                // Rays pass by what casts caustics: what lies behind it must be seen.
                instances: match settings.tracer {
                    Tracer::Maps => [instance].into(),
                    Tracer::Rays => claimed.into(),
                },
                side,
                shape_side: (is_refracting && settings.tracer == Tracer::Maps)
                    .then_some(settings.shape_resolution),
                reference: None,
                layers: 1,
                renewal: Renewal::default(),
            },
            bounces: if is_refracting { settings.bounces } else { 0 },
            photons,
            counters: gpu.buffer("caustic counters [bytes]", texels * COUNTER_BYTES, storage)?,
            lit_texels,
            of_object: HostBuffer::new(
                gpu,
                "impostor",
                size_of::<impostor_gpu::Impostor>() as u64,
                uniform,
            )?,
            lit_cube,
            count_flux: HostBuffer::new(gpu, "flux of a count [W]", 4, uniform)?,
            group,
            bound: None,
            caustic_maps: None,
            is_surrounded: false,
            frames: 0,
            step: 0.0,
        })
    }

    /// Makes the next frame's photons the first ones, in surroundings that are yet to be renewed.
    pub fn restart(&mut self) {
        self.frames = 0;
        self.is_surrounded = false;
    }

    /// Renews the maps around the object for the next frame's photons, unless that is done; returns how many pixels were
    /// drawn.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn surround(
        &mut self,
        frame: &mut Frame<'_>,
        making: Making<'_>,
        impostors: &mut Impostors,
    ) -> Result<u64, GpuError> {
        if self.is_surrounded {
            return Ok(0);
        }
        let Making {
            scene,
            settings,
            settings_version,
            ..
        } = making;
        if settings.tracer == Tracer::Rays {
            let mut draws = scene.draws.iter();
            let draw = draws.find(|draw| draw.instance == self.instance);
            self.wanted.reference = draw.map(|draw| draw.bounds.center());
        }
        let (_, pixels) = impostors.renew(frame, scene, &self.wanted, settings_version, 0)?;
        self.is_surrounded = true;
        Ok(pixels)
    }

    /// Keeps the maps around the object, which this frame neither captures nor reads.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn keep_maps(
        &self,
        gpu: &Gpu,
        making: Making<'_>,
        impostors: &mut Impostors,
    ) -> Result<(), GpuError> {
        let version = making.settings_version;
        impostors.follow(gpu, making.scene, &self.wanted, version, 0)?;
        Ok(())
    }

    /// Traces and counts the photons of one more frame, which follows [`Caustic::surround`]; returns how many there are,
    /// and how many pixels were drawn.
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
        self.is_surrounded = false;
        let version = making.settings_version;
        let maps = impostors.follow(gpu, scene, &self.wanted, version, 0)?;
        let maps = maps.clone();
        self.bind(gpu, kernels, &maps)?;
        if self.frames == 0 {
            frame.clear(&self.counters);
            // The finest step at which the sums of all frames still fit 31 bits and a sign.
            let flux: f64 = (0..settings.frames)
                .flat_map(|number| self.framings(making, number))
                .filter_map(|(_, _, framing)| Some(framing?.flux()))
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
            is_refracting: u32::from(self.bounces > 0),
            is_classical: 0,
            world_from_shape: maps.world_from_shape.to_array(),
            ..bytemuck::Zeroable::zeroed()
        };
        self.of_object.write(gpu, std::slice::from_ref(&of_object));
        let lit_cube = LitCube {
            reference: maps.reference.to_array(),
            side: self.wanted.side,
            instance: self.instance,
            padding: [0; 3],
        };
        self.lit_cube.write(gpu, std::slice::from_ref(&lit_cube));
        let count_flux = (step / f64::from(self.frames)) as f32;
        self.count_flux
            .write(gpu, std::slice::from_ref(&count_flux));
        self.resize(gpu, kernels, impostors.capture_kernels(), &maps, &views)?;
        let Some(bound) = &self.bound else {
            return Ok(0);
        };
        // Without a light that shines on the object there are no maps, and the irradiance becomes that of no photons.
        if let Some(caustic_maps) = &mut self.caustic_maps {
            caustic_maps.follow_photons(frame, making, self.instance, &views, bound)?;
            caustic_maps.write(gpu, kernels, &views, step, &lit_cube, self.bounces);
        }
        frame.compute("caustics.irradiance", |pass| {
            let groups = [(1, &bound.seen), (3, &bound.counted)];
            let side = self.wanted.side;
            kernels.irradiance.dispatch(pass, &groups, [side, side, 6]);
        });
        let pixels = views.iter().map(|seen| u64::from(seen.side).pow(2));
        Ok(pixels.sum::<u64>() * (1 + u64::from(self.photons)))
    }

    /// The lights of frame `number`, each with the side of its map (pixels) and its view's framing, `None` if it does not
    /// shine on the object; empty if the object is not drawn.
    fn framings<'a>(
        &self,
        making: Making<'a>,
        number: u32,
    ) -> impl Iterator<Item = (&'a LightSample, u32, Option<Framing>)> {
        let Making {
            scene,
            settings,
            first_area,
            objects,
            ..
        } = making;
        let mut draws = scene.draws.iter();
        let draw = draws.find(|draw| draw.instance == self.instance);
        let lights = making
            .lights
            .get(number as usize)
            .filter(|_| draw.is_some());
        let lights = lights.map_or(&[][..], Vec::as_slice);
        // All sample points on emitters together get as many pixels as one other light.
        let emitters = lights.len().saturating_sub(first_area);
        let whole_maps = objects * (first_area + emitters.min(1));
        let affordable = (MOST_PIXELS / whole_maps.max(1) as f32).sqrt();
        let side = (settings.resolution as f32).min(affordable);
        let area_side = (side / (emitters.max(1) as f32).sqrt()).ceil();
        lights.iter().enumerate().map(move |(index, light)| {
            let is_area = index >= first_area;
            let side = if is_area { area_side } else { side };
            let side = (side as u32).max(LEAST_RESOLUTION);
            let framing =
                draw.and_then(|draw| Framing::new(light, &draw.bounds, side, scene.diagonal()));
            (light, side, framing)
        })
    }

    /// The object's views from the lights of frame `number`: one per light that shines on it, and one per sample point
    /// on an emitter, even if it does not shine on the object, because their number must not change.
    fn views(&self, making: Making<'_>, number: u32) -> Vec<Seen> {
        let jitter = if making.settings.frames > 1 {
            low_discrepancy(number) - 0.5
        } else {
            Vec2::ZERO
        };
        let diagonal = making.scene.diagonal();
        let framings = self.framings(making, number).enumerate();
        let views = framings.filter_map(|(index, (light, side, framing))| {
            let seed = number.wrapping_mul(0x9e37_79b9) ^ index as u32;
            let view = framing.map(|framing| {
                let mut view = LightView::new(light, &framing, side, jitter, seed, diagonal);
                view.map.frame = number;
                view
            });
            let is_area = index >= making.first_area;
            (is_area || view.is_some()).then_some(Seen { side, view })
        });
        views.collect()
    }

    fn bind(&mut self, gpu: &Gpu, kernels: &Kernels, maps: &Maps) -> Result<(), GpuError> {
        if let Some(bound) = &mut self.bound
            && bound.maps.is_same(maps)
        {
            bound.maps = maps.clone();
            return Ok(());
        }
        self.caustic_maps = None;
        let counted = [
            ("count_flux", self.count_flux.as_entire_binding()),
            ("counters", self.counters.as_entire_binding()),
            ("lit_texels", self.lit_texels.as_entire_binding()),
        ];
        self.bound = Some(PhotonGroups {
            trace: match kernels.trace() {
                (_, Tracer::Rays) => None,
                (trace, Tracer::Maps) => {
                    Some(maps.bind(gpu, trace, &self.of_object, &kernels.sampler, &[])?)
                }
            },
            seen: maps.points.bind(gpu, &kernels.irradiance)?,
            counted: kernels.irradiance.bind(gpu, 3, &counted)?,
            maps: maps.clone(),
        });
        Ok(())
    }

    /// Allocates the views' caustic maps and photon buffer, unless those that exist have the right sizes.
    fn resize(
        &mut self,
        gpu: &Gpu,
        kernels: &Kernels,
        capture_kernels: &CaptureKernels,
        maps: &Maps,
        views: &[Seen],
    ) -> Result<(), GpuError> {
        let sides: Vec<u32> = views.iter().map(|seen| seen.side).collect();
        let is_right = |made: &CausticMaps| made.images.sides == sides;
        if self.caustic_maps.as_ref().is_some_and(is_right) {
            return Ok(());
        }
        self.caustic_maps = None;
        if sides.is_empty() {
            return Ok(());
        }
        let limits = gpu.limits();
        let limit = limits
            .max_buffer_size
            .min(limits.max_storage_buffer_binding_size)
            .min(PHOTONS_AT_ONCE);
        let parts = parts(&sides, self.photons, limit);
        let bytes = parts.iter().map(|(maps, numbers)| {
            let side = u64::from(sides[maps.start]);
            side * side * PHOTON_BYTES * (maps.len() * numbers.len()) as u64
        });
        let photon_bytes = bytes.max().unwrap_or(0);
        let usage = wgpu::BufferUsages::STORAGE;
        let photons = gpu.buffer("photons [bytes]", photon_bytes, usage)?;
        let size = (sides.len() * size_of::<CausticMap>()) as u64;
        let uniforms = HostBuffer::new(gpu, "caustic maps", size, usage)?;
        let batches = parts.into_iter().map(|(of, numbers)| {
            let size = size_of::<Batch>() as u64;
            let uniform = HostBuffer::new(gpu, "photon batch", size, wgpu::BufferUsages::UNIFORM)?;
            let resources = [
                ("batch", uniform.as_entire_binding()),
                ("caustic_maps", uniforms.as_entire_binding()),
                ("photons", photons.as_entire_binding()),
                ("receivers", maps.points.points.as_entire_binding()),
                ("counters", self.counters.as_entire_binding()),
            ];
            let (trace, tracer) = kernels.trace();
            let of_trace = match tracer {
                Tracer::Maps => &resources[..4],
                Tracer::Rays => &resources[..3],
            };
            let trace = trace.bind(gpu, 3, of_trace)?;
            Ok(BatchOf {
                maps: of,
                numbers,
                trace,
                splat: kernels.splat.bind(gpu, 3, &resources)?,
                uniform,
            })
        });
        self.caustic_maps = Some(CausticMaps {
            batches: batches.collect::<Result<_, GpuError>>()?,
            images: HitImages::new(gpu, capture_kernels, sides)?,
            seen: None,
            uniforms,
            photon_bytes,
        });
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

    /// Bytes that are not in maps: counters, photons, and caustic maps with their depth.
    pub fn work_bytes(&self) -> u64 {
        let maps = self.caustic_maps.iter().map(|made| {
            let pixels = made.images.pixels * (4 + 4);
            pixels + made.uniforms.size() + made.photon_bytes
        });
        self.counters.size() + maps.sum::<u64>()
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

impl CausticMaps {
    /// Records the passes that follow the photons of all maps around `instance`.
    fn follow_photons(
        &mut self,
        frame: &mut Frame<'_>,
        making: Making<'_>,
        instance: u32,
        views: &[Seen],
        bound: &PhotonGroups,
    ) -> Result<(), GpuError> {
        let Making { scene, kernels, .. } = making;
        let lit = views.iter().map(|seen| Some(&seen.view.as_ref()?.view));
        let lit: Vec<_> = lit.collect();
        self.images.record(frame, scene, &lit, |draw| {
            if draw.instance == instance {
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
        });
        let seen = self.seen(frame.gpu, kernels, scene)?;
        for batch in &self.batches {
            let side = self.images.sides[batch.maps.start];
            let maps = batch.maps.len() as u32;
            frame.compute("caustics.trace", |pass| {
                let (trace, tracer) = kernels.trace();
                let of_scene = match tracer {
                    Tracer::Maps => &scene.bind_group,
                    Tracer::Rays => &scene.ray_bind_group,
                };
                let mut groups = vec![(0, of_scene), (1, &seen), (3, &batch.trace)];
                groups.extend(bound.trace.iter().map(|group| (2, group)));
                trace.dispatch(pass, &groups, [side, side, maps]);
            });
            frame.compute("caustics.splat", |pass| {
                let lanes = kernels.lanes(side, maps);
                let invocations = side * side * batch.numbers.len() as u32 * lanes;
                let groups = [(3, &batch.splat)];
                kernels
                    .splat
                    .dispatch(pass, &groups, [invocations, 1, maps]);
            });
        }
        Ok(())
    }

    /// Bind group 1 of the trace: hit records, and the merged vertices that they refer to.
    fn seen(
        &mut self,
        gpu: &Gpu,
        kernels: &Kernels,
        scene: &GpuScene,
    ) -> Result<wgpu::BindGroup, GpuError> {
        if let Some((vertices, group)) = &self.seen
            && *vertices == scene.vertices
        {
            return Ok(group.clone());
        }
        let hits = wgpu::BindingResource::TextureView(&self.images.hits);
        let merged = scene.vertices.as_entire_binding();
        let (trace, _) = kernels.trace();
        let group = trace.bind(gpu, 1, &[("hits", hits), ("merged", merged)])?;
        self.seen = Some((scene.vertices.clone(), group.clone()));
        Ok(group)
    }

    /// Writes what the photon passes read. `step`: flux per count (W).
    fn write(
        &self,
        gpu: &Gpu,
        kernels: &Kernels,
        views: &[Seen],
        step: f64,
        cube: &LitCube,
        bounces: u32,
    ) {
        let uniforms = views.iter().zip(&self.images.corners);
        let uniforms = uniforms.map(|(seen, &corner)| match seen.view {
            Some(LightView { map, .. }) => CausticMap {
                corner,
                counts: (f64::from(map.unit) / step) as f32,
                ..map
            },
            None => bytemuck::Zeroable::zeroed(),
        });
        self.uniforms.write(gpu, &uniforms.collect::<Vec<_>>());
        for batch in &self.batches {
            let side = self.images.sides[batch.maps.start];
            let uniform = Batch {
                reference: cube.reference,
                cube_side: cube.side,
                first_map: batch.maps.start as u32,
                side,
                first: batch.numbers.start,
                end: batch.numbers.end,
                lanes: kernels.lanes(side, batch.maps.len() as u32),
                instance: cube.instance,
                bounces,
                padding: 0,
            };
            batch.uniform.write(gpu, std::slice::from_ref(&uniform));
        }
    }
}

/// The maps, by their `sides`, and the numbers of their `photons` per pixel that are traced together, so that at most
/// `limit` bytes hold them; one number of one map may take more.
fn parts(sides: &[u32], photons: u32, limit: u64) -> Vec<(Range<usize>, Range<u32>)> {
    let mut parts = Vec::new();
    let mut first = 0;
    for run in sides.chunk_by(|a, b| a == b) {
        let maps = first..first + run.len();
        first = maps.end;
        let of_number = u64::from(run[0]).pow(2) * PHOTON_BYTES;
        let at_once = (limit / of_number).max(1);
        let whole = (at_once / u64::from(photons)) as usize;
        if whole > 0 {
            let starts = maps.clone().step_by(whole);
            parts.extend(starts.map(|start| (start..(start + whole).min(maps.end), 0..photons)));
            continue;
        }
        for map in maps {
            let numbers = (0..photons).step_by(at_once as usize);
            let end = |number: u32| (number + at_once as u32).min(photons);
            parts.extend(numbers.map(|number| (map..map + 1, number..end(number))));
        }
    }
    parts
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
