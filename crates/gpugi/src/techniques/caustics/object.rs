//! The caustics of one object: caustic maps of the lights that shine on it, and the cube around it that holds what their photons light.

use glam::Vec2;

use super::gpu::{COUNTER_BYTES, CausticMap, Counting, LIT_TEXEL_BYTES, LitCube, PHOTON_BYTES};
use super::lights::LightView;
use super::{Kernels, Settings};
use crate::capture::{Capture, CaptureKernels, SurfacePoints, View};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::impostor::{Impostors, Maps, Renewal, Wanted, gpu as impostor_gpu};
use crate::scene::{GpuScene, Object};
use crate::techniques::shadow_map::gpu::LightSample;
use crate::techniques::shadow_map::lights::low_discrepancy;

/// Most bytes of photons at a time: more are followed in several dispatches.
const PHOTONS_AT_ONCE: u64 = 64 << 20;

/// `LANES` of splat.wesl.
const SPLAT_LANES: u32 = 16;

/// The caustics of one object.
#[derive(Debug)]
pub struct Caustic {
    wanted: Wanted,
    bounces: u32,
    /// Photons of a pixel: one that is mirrored, and one for each bounce inside.
    photons: u32,
    counters: wgpu::Buffer,
    lit_texels: wgpu::Buffer,
    of_object: wgpu::Buffer,
    lit_cube: wgpu::Buffer,
    counting: wgpu::Buffer,
    /// Bind group 2 of the gather.
    group: wgpu::BindGroup,
    bound: Option<Bound>,
    maps: Vec<CausticMapOf>,
    /// Frames whose photons are counted.
    frames: u32,
    /// Flux of one count of one frame's sums (W).
    step: f64,
}

/// What reads the maps around the object.
#[derive(Debug)]
struct Bound {
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
    dispatches: Vec<Dispatch>,
}

/// Some of the photons of a caustic map's pixels.
#[derive(Debug)]
struct Dispatch {
    range: std::ops::Range<u32>,
    map: wgpu::Buffer,
    trace: wgpu::BindGroup,
    splat: wgpu::BindGroup,
}

/// What the caustics of every object are made with.
#[derive(Debug, Clone, Copy)]
pub struct Making<'a> {
    pub scene: &'a GpuScene,
    pub kernels: &'a Kernels,
    pub settings: &'a Settings,
    pub lights: &'a [LightSample],
    /// First of the lights that share the pixels of one caustic map: sample points on area lights.
    pub first_area: usize,
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
        let group = kernels.gather.bind(
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
            wanted: Wanted {
                instance,
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
            counting: gpu.buffer("counting", size_of::<Counting>() as u64, uniform)?,
            group,
            bound: None,
            maps: Vec::new(),
            frames: 0,
            step: 1.0,
        })
    }

    /// Traces and counts another frame's photons; `is_fresh`: the first since something changed.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        making: Making<'_>,
        impostors: &mut Impostors,
        is_fresh: bool,
    ) -> Result<(), GpuError> {
        let Making {
            scene,
            kernels,
            settings,
            ..
        } = making;
        let gpu = frame.gpu;
        let maps = impostors
            .of(frame, scene, self.wanted, making.settings_version, 0)?
            .clone();
        self.bind(gpu, kernels, &maps)?;
        if is_fresh {
            self.frames = 0;
            frame.clear(&self.counters);
        }
        let views = self.views(making);
        if is_fresh {
            // Counts are as fine as sums of all frames fit 31 bits, of which half is for frames with more light than the first: their samples
            // of area lights lie elsewhere.
            let flux: f64 = views.iter().map(LightView::flux).sum();
            self.step =
                flux.max(f64::MIN_POSITIVE) * f64::from(settings.frames) / f64::from(1_u32 << 30);
        }
        let step = self.step;
        self.frames += 1;
        let queue = &gpu.queue;
        let of_object = impostor_gpu::Impostor {
            reference: maps.reference.to_array(),
            instance: self.wanted.instance,
            center: maps.center.to_array(),
            search: 0,
            iterations: 0,
            bounces: self.bounces,
            is_refracting: u32::from(self.wanted.shape_side.is_some()),
            is_classical: 0,
            world_from_shape: maps.world_from_shape.to_array(),
        };
        queue.write_buffer(&self.of_object, 0, bytemuck::bytes_of(&of_object));
        let lit_cube = LitCube {
            reference: maps.reference.to_array(),
            side: self.wanted.side,
            instance: self.wanted.instance,
            padding: [0; 3],
        };
        queue.write_buffer(&self.lit_cube, 0, bytemuck::bytes_of(&lit_cube));
        let counting = Counting {
            unit: (step / f64::from(self.frames)) as f32,
            padding: [0; 3],
        };
        queue.write_buffer(&self.counting, 0, bytemuck::bytes_of(&counting));
        self.resize(gpu, kernels, impostors.capture_kernels(), &maps, &views)?;
        let Some(bound) = &self.bound else {
            return Ok(());
        };
        for (caustic_map, light) in self.maps.iter_mut().zip(&views) {
            let map = CausticMap {
                reference: maps.reference.to_array(),
                cube_side: self.wanted.side,
                counts: (f64::from(light.map.unit) / step) as f32,
                ..light.map
            };
            caustic_map.record(frame, making, bound, self.wanted.instance, light.view, map)?;
        }
        frame.compute("caustics.irradiance", |pass| {
            let groups = [(1, &bound.seen), (3, &bound.counted)];
            let side = self.wanted.side;
            kernels.irradiance.dispatch(pass, &groups, [side, side, 6]);
        });
        Ok(())
    }

    /// The views of all lights that shine on the object.
    fn views(&self, making: Making<'_>) -> Vec<LightView> {
        let draws = &making.scene.draws;
        let Some(draw) = draws
            .iter()
            .find(|draw| draw.instance == self.wanted.instance)
        else {
            return Vec::new();
        };
        let jitter = if making.settings.frames > 1 {
            low_discrepancy(self.frames) - 0.5
        } else {
            Vec2::ZERO
        };
        let area_lights = (making.lights.len() - making.first_area).max(1);
        // Area lights have as many pixels together as one point light.
        let area_side = (making.settings.resolution as f32 / (area_lights as f32).sqrt()).ceil();
        let lights = making.lights.iter().enumerate();
        lights
            .filter_map(|(index, light)| {
                let side = if index < making.first_area {
                    making.settings.resolution
                } else {
                    (area_side as u32).max(super::LEAST_RESOLUTION)
                };
                let diagonal = making.scene.diagonal();
                let seed = self.frames.wrapping_mul(0x9e37_79b9) ^ index as u32;
                LightView::new(light, &draw.bounds, side, jitter, seed, diagonal)
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
        let counted = [
            ("counting", self.counting.as_entire_binding()),
            ("counters", self.counters.as_entire_binding()),
            ("lit_texels", self.lit_texels.as_entire_binding()),
        ];
        self.bound = Some(Bound {
            trace: maps.bind(gpu, &kernels.trace, &self.of_object, &kernels.sampler, &[])?,
            seen: maps.points.bind(gpu, &kernels.irradiance)?,
            counted: kernels.irradiance.bind(gpu, 3, &counted)?,
            maps: maps.clone(),
        });
        Ok(())
    }

    /// Makes room for the views' caustic maps.
    fn resize(
        &mut self,
        gpu: &Gpu,
        kernels: &Kernels,
        capture_kernels: &CaptureKernels,
        maps: &Maps,
        views: &[LightView],
    ) -> Result<(), GpuError> {
        let sides = views.iter().map(|view| view.map.side);
        if self
            .maps
            .iter()
            .map(|map| map.capture.size()[0])
            .eq(sides.clone())
        {
            return Ok(());
        }
        self.maps.clear();
        let limits = gpu.device.limits();
        let limit = limits
            .max_buffer_size
            .min(limits.max_storage_buffer_binding_size)
            .min(PHOTONS_AT_ONCE);
        let Some(largest) = sides.clone().max() else {
            return Ok(());
        };
        // One after the other is traced and spread: they share their photons.
        let of_photon = u64::from(largest) * u64::from(largest) * PHOTON_BYTES;
        let at_once = (limit / of_photon).clamp(1, u64::from(self.photons)) as u32;
        let photons = gpu.buffer(
            "photons [bytes]",
            of_photon * u64::from(at_once),
            wgpu::BufferUsages::STORAGE,
        )?;
        for side in sides {
            let capture = Capture::of_camera(gpu, capture_kernels, [side, side])?;
            let dispatches = (0..self.photons)
                .step_by(at_once as usize)
                .map(|first| {
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
                        range: first..(first + at_once).min(self.photons),
                        trace,
                        splat: kernels.splat.bind(gpu, 3, &resources)?,
                        map,
                    })
                })
                .collect::<Result<_, GpuError>>()?;
            self.maps.push(CausticMapOf {
                seen: capture.points.bind(gpu, &kernels.trace)?,
                capture,
                dispatches,
            });
        }
        Ok(())
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

impl CausticMapOf {
    fn record(
        &mut self,
        frame: &mut Frame<'_>,
        making: Making<'_>,
        bound: &Bound,
        own: u32,
        view: View,
        map: CausticMap,
    ) -> Result<(), GpuError> {
        let Making { scene, kernels, .. } = making;
        self.capture.record(frame, scene, &view, |draw| {
            if draw.instance == own {
                scene.whole_class(draw)
            } else {
                // Light is kept out by both sides of what is in its way.
                draw.seen.from_both_sides()
            }
        })?;
        let side = map.side;
        for dispatch in &self.dispatches {
            let map = CausticMap {
                first: dispatch.range.start,
                end: dispatch.range.end,
                ..map
            };
            let queue = &frame.gpu.queue;
            queue.write_buffer(&dispatch.map, 0, bytemuck::bytes_of(&map));
            frame.compute("caustics.trace", |pass| {
                let groups = [
                    (0, &scene.bind_group),
                    (1, &self.seen),
                    (2, &bound.trace),
                    (3, &dispatch.trace),
                ];
                kernels.trace.dispatch(pass, &groups, [side, side, 1]);
            });
            frame.compute("caustics.splat", |pass| {
                let photons = dispatch.range.len() as u32;
                let groups = [(3, &dispatch.splat)];
                let invocations = side * side * photons * SPLAT_LANES;
                kernels.splat.dispatch(pass, &groups, [invocations, 1, 1]);
            });
        }
        Ok(())
    }
}

#[cfg(test)]
impl Caustic {
    /// All flux that the cube holds (W).
    pub fn flux(&self, gpu: &Gpu) -> glam::DVec3 {
        use crate::gpu::read_buffer;

        let counters: Vec<[u32; 6]> =
            read_buffer(gpu, &self.counters, self.counters.size()).unwrap();
        let counting: Vec<Counting> =
            read_buffer(gpu, &self.counting, self.counting.size()).unwrap();
        let mut sum = glam::DVec3::ZERO;
        for [r, g, b, ..] in counters {
            sum += glam::DVec3::new(r.into(), g.into(), b.into());
        }
        sum * f64::from(counting[0].unit)
    }
}
