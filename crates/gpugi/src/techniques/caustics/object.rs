//! The caustics of one object: caustic maps of the lights that shine on it, and the cube around it that holds the
//! irradiance of their photons.

use std::ops::Range;

use glam::Vec2;

use super::gpu::{Batch, COUNTER_BYTES, CausticMap, LIT_TEXEL_BYTES, LitCube, PHOTON_BYTES};
use super::lights::{Framing, LightView};
use super::{Kernels, LEAST_RESOLUTION, MOST_PIXELS, Settings, Tracer};
use crate::capture::{CaptureKernels, HitImages};
use crate::gpu::{Frame, Gpu, GpuError, HostBuffer, Kernel, Named, join};
use crate::impostor::{ImpostorRequest, Impostors, Renewal, gpu as impostor_gpu};
use crate::lights::gpu::LightSample;
use crate::scene::{Claims, GpuScene, Object};
use crate::sequences::low_discrepancy;
use crate::techniques::{Claimed, Map};

/// Most bytes of photons at a time, unless one per pixel of a single map takes more: others follow in further batches.
const PHOTONS_AT_ONCE: u64 = 64 << 20;
/// The caustics of one object.
#[derive(Debug)]
pub struct Caustic {
    instance: u32,
    wanted: ImpostorRequest,
    /// Most surfaces that light meets inside; 0: it is refracted once, or not at all.
    bounces: u32,
    /// Photons per pixel: one mirrored, and one for each bounce inside.
    photons: u32,
    counters: wgpu::Buffer,
    lit_texels: wgpu::Buffer,
    of_object: HostBuffer,
    lit_cube: HostBuffer,
    count_flux: HostBuffer,
    caustic_maps: Option<CausticMaps>,
    /// Whether the maps around the object are renewed for the next frame's photons.
    is_surrounded: bool,
    /// Frames whose photons the counters hold.
    frames: u32,
    /// Flux per count of one frame's sums (W); 0: no light shines on the object.
    step: f64,
}

/// The caustic maps of all lights.
#[derive(Debug)]
struct CausticMaps {
    images: HitImages,
    uniforms: HostBuffer,
    batches: Vec<BatchOf>,
    /// All batches share it.
    photons: wgpu::Buffer,
}

/// A light's view of the object, in a map of `side` x `side` pixels; `None` if it does not shine on the object.
#[derive(Debug, Clone, Copy)]
struct ViewOfObject {
    side: u32,
    view: Option<LightView>,
}

/// Tracing and splatting of some photons of consecutive maps of the same size.
#[derive(Debug)]
struct BatchOf {
    maps: Range<usize>,
    /// Numbers of the photons.
    numbers: Range<u32>,
}

/// Inputs shared by the caustics of all objects.
#[derive(Debug, Clone, Copy)]
pub struct FrameInputs<'a> {
    pub scene: &'a GpuScene,
    pub kernels: &'a Kernels,
    /// The pass that follows photons.
    pub trace: &'a Kernel,
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
        settings: &Settings,
        (instance, object): &(u32, Object),
        claimed: &Claimed,
    ) -> Result<Self, GpuError> {
        let side = settings.cube_resolution;
        let texels = 6 * u64::from(side) * u64::from(side);
        let uniform = wgpu::BufferUsages::UNIFORM;
        let lit_texels = gpu.room("caustics [bytes]", texels * LIT_TEXEL_BYTES)?;
        let lit_cube = HostBuffer::new(gpu, "lit cube", size_of::<LitCube>() as u64, uniform)?;
        let is_refracting = object.is_transmissive && object.is_solid && settings.bounces > 0;
        let photons = match (object.is_transmissive, is_refracting) {
            (false, _) => 1,
            (true, false) => 2,
            (true, true) => 1 + settings.bounces,
        };
        Ok(Self {
            instance: *instance,
            wanted: ImpostorRequest {
                // Rays pass by what casts caustics: what lies behind it must be seen.
                instances: match settings.tracer {
                    Tracer::Maps => [*instance].into(),
                    Tracer::Rays => claimed.numbers().collect(),
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
            counters: gpu.room("caustic counters [bytes]", texels * COUNTER_BYTES)?,
            lit_texels,
            of_object: HostBuffer::new(
                gpu,
                "impostor",
                size_of::<impostor_gpu::Impostor>() as u64,
                uniform,
            )?,
            lit_cube,
            count_flux: HostBuffer::new(gpu, "flux of a count [W]", 4, uniform)?,
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
        making: FrameInputs<'_>,
        impostors: &mut Impostors,
    ) -> Result<u64, GpuError> {
        if self.is_surrounded {
            return Ok(0);
        }
        let FrameInputs {
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
        making: FrameInputs<'_>,
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
        making: FrameInputs<'_>,
        impostors: &mut Impostors,
    ) -> Result<u64, GpuError> {
        let FrameInputs {
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
        self.resize(gpu, impostors.capture_kernels(), &views)?;
        let own: [Named<'_>; 5] = [
            ("receivers", &maps.points.points),
            ("counters", &self.counters),
            ("count_flux", &self.count_flux),
            ("lit_texels", &self.lit_texels),
            ("merged", &scene.vertices),
        ];
        let of_maps = maps.resources(&self.of_object, &kernels.sampler);
        let resources = [&own[..], &of_maps, &maps.points.resources()].concat();
        // Without a light that shines on the object there are no maps, and the irradiance becomes that of no photons.
        if let Some(caustic_maps) = &self.caustic_maps {
            caustic_maps.write(gpu, &views, step);
            let of_cube = (&lit_cube, self.bounces);
            caustic_maps.follow_photons(frame, making, of_cube, &views, &resources)?;
        }
        let (name, texels) = ("caustics.irradiance", [lit_cube.side, lit_cube.side, 6]);
        frame.run(name, &kernels.irradiance, None, &resources, texels)?;
        let pixels = views.iter().map(|seen| u64::from(seen.side).pow(2));
        Ok(pixels.sum::<u64>() * (1 + u64::from(self.photons)))
    }

    /// The lights of frame `number`, each with the side of its map (pixels) and its view's framing, `None` if it does not
    /// shine on the object; empty if the object is not drawn.
    fn framings<'a>(
        &self,
        making: FrameInputs<'a>,
        number: u32,
    ) -> impl Iterator<Item = (&'a LightSample, u32, Option<Framing>)> {
        let FrameInputs {
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
    fn views(&self, making: FrameInputs<'_>, number: u32) -> Vec<ViewOfObject> {
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
            (is_area || view.is_some()).then_some(ViewOfObject { side, view })
        });
        views.collect()
    }

    /// Allocates the views' caustic maps and photon buffer, unless those that exist have the right sizes.
    fn resize(
        &mut self,
        gpu: &Gpu,
        capture_kernels: &CaptureKernels,
        views: &[ViewOfObject],
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
        let batch = |(maps, numbers)| BatchOf { maps, numbers };
        self.caustic_maps = Some(CausticMaps {
            batches: parts.into_iter().map(batch).collect(),
            images: HitImages::new(gpu, capture_kernels, sides)?,
            uniforms,
            photons,
        });
        Ok(())
    }

    /// Irradiance in the cube, the six faces stacked vertically.
    pub fn map(&self) -> Map {
        let size = [self.wanted.side, 6 * self.wanted.side];
        let name = format!("caustics.{}.irradiance", self.instance);
        Map::of_colors(name, &self.lit_texels, size, LIT_TEXEL_BYTES)
    }

    /// Bytes that are not in maps: counters, photons, and caustic maps with their depth.
    pub fn work_bytes(&self) -> u64 {
        let maps = self.caustic_maps.iter().map(|made| {
            let pixels = made.images.pixels * (4 + 4);
            pixels + made.uniforms.size() + made.photons.size()
        });
        self.counters.size() + maps.sum::<u64>()
    }

    /// What the gather binds.
    pub fn resources(&self) -> [Named<'_>; 2] {
        [
            ("lit_cube", &self.lit_cube),
            ("lit_texels", &self.lit_texels),
        ]
    }
}

impl CausticMaps {
    /// Records the passes that follow the photons of all maps around an object, into a cube.
    fn follow_photons(
        &self,
        frame: &mut Frame<'_>,
        making: FrameInputs<'_>,
        (cube, bounces): (&LitCube, u32),
        views: &[ViewOfObject],
        resources: &[Named<'_>],
    ) -> Result<(), GpuError> {
        let FrameInputs {
            scene,
            kernels,
            settings,
            trace,
            ..
        } = making;
        let gpu = frame.gpu;
        let instance = cube.instance;
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
        let of_scene = Some(match settings.tracer {
            Tracer::Maps => &scene.bind_group,
            Tracer::Rays => &scene.ray_bind_group,
        });
        for batch in &self.batches {
            let side = self.images.sides[batch.maps.start];
            let maps = batch.maps.len() as u32;
            let lanes = kernels.lanes(side, maps);
            let values = Batch {
                reference: cube.reference,
                cube_side: cube.side,
                first_map: batch.maps.start as u32,
                side,
                first: batch.numbers.start,
                end: batch.numbers.end,
                lanes,
                instance,
                bounces,
                padding: 0,
            };
            let values = gpu.constant("photon batch", &values)?;
            let own: [Named<'_>; 4] = [
                ("batch", &values),
                ("caustic_maps", &self.uniforms),
                ("photons", &self.photons),
                ("hits", &self.images.hits),
            ];
            let resources = join(resources, &own);
            let pixels = [side, side, maps];
            frame.run("caustics.trace", trace, of_scene, &resources, pixels)?;
            let photons = side * side * batch.numbers.len() as u32;
            let (splat, invocations) = (&kernels.splat, [photons * lanes, 1, maps]);
            frame.run("caustics.splat", splat, None, &resources, invocations)?;
        }
        Ok(())
    }

    /// Writes what the photon passes read of the maps. `step`: flux per count (W).
    fn write(&self, gpu: &Gpu, views: &[ViewOfObject], step: f64) {
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
