//! Caustics: light that objects mirror and refract onto their surroundings (tutorial section 5.4).
//!
//! Generate: each light sees each object in a caustic map. From the map's pixels, photons are followed through the
//! object to its surroundings, in the same maps that distance impostors use, and a cube around the object counts those
//! that arrive. Gather: looks up the irradiance in the cube. docs/techniques/caustics.md.

pub(crate) mod gpu;
mod lights;
mod object;
#[cfg(test)]
mod tests;

use super::{
    Earlier, Generated, Info, Inspection, ObjectMapsKey, Plan, Purpose, Registration, Role, Speed,
    Technique,
};
use crate::capture::{PerReceiver, Receiver, ReceiverKernel, View};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions};
use crate::light_paths::{LightClass, LightPaths};
use crate::lights::gpu::LightSample;
use crate::lights::samples::{on_emitters, punctual};
use crate::scene::{Claims, GpuScene, Versions, has_smooth_objects};
use crate::settings::SettingSet;
use crate::shader;
use object::{Caustic, Making};

/// Name, summary, source and light paths of the technique.
pub const INFO: Info = Info {
    name: "caustics",
    summary: "light of point, spot, directional and area lights that mirrors and glass throw on their surroundings",
    source: "tutorial section 5.4; Szirmay-Kalos et al. 2005; Wyman and Davis 2006",
    paths: &[
        LightPaths::new(LightClass::Punctual, "LS+[DG]E"),
        LightPaths::new(LightClass::Area, "LS+[DG]E"),
    ],
    role: Role::Caustics,
    ..Info::BASE
};

/// Its entry in the registry.
pub const REGISTRATION: Registration = Registration {
    info: &INFO,
    fields: Settings::fields,
    make: |gpu, scene| Ok(Box::new(Caustics::new(gpu, scene)?)),
    suits: |occasion| {
        let lights = occasion.has_lights(INFO.paths);
        has_smooth_objects(occasion.scene).then(|| format!("{lights}, and mirrors or glass"))
    },
    settings: |occasion| match (occasion.purpose, occasion.speed) {
        // Software takes long to splat photons: cubes have half as many texels per side; their error is the same
        // (docs/techniques/caustics.md).
        (Purpose::StillPicture, Speed::Software) => {
            vec![("cube-resolution", 128.to_string())]
        }
        _ => Vec::new(),
    },
};

crate::choices! {
    /// How photons are followed.
    pub enum Tracer {
        /// In the maps of distance-impostor around the object: one object, and what its centre sees.
        Maps = "maps",
        /// By rays in the scene's hierarchy: exactly, and on by way of further mirrors and glass.
        Rays = "rays",
    }
}

crate::settings! {
    /// Settings of caustics.
    pub struct Settings {
        /// How photons are followed: maps, in those around the object; rays, in the scene's hierarchy, also by way of
        /// several objects. Rays need a technique beside it that traces rays or keeps light in texels.
        pub tracer: Tracer = Tracer::Maps => any(),
        /// Side of the caustic map of one light and one object; all samples of area lights together have as many pixels
        /// as one map.
        pub resolution: u32 = 256 => in_range(LEAST_RESOLUTION as f64, 2048.0).unit("pixels"),
        /// Side of the faces of the cubes that hold the photons' light, a power of two.
        pub cube_resolution: u32 = 256 => in_range(16.0, 1024.0).power_of_two().unit("texels"),
        /// Side of the faces of refractors' shapes, a power of two.
        pub shape_resolution: u32 = 256 => in_range(16.0, 1024.0).power_of_two().unit("texels"),
        /// Most surfaces that light meets inside a refractor; 0: it refracts once, on its way in.
        pub bounces: u32 = 4 => in_range(0.0, 16.0),
        /// Sample points per frame on all area lights together; each frame has different points.
        pub area_samples: u32 = 4 => in_range(1.0, 256.0),
        /// Frames of a still scene over which photons accumulate.
        pub frames: u32 = 16 => in_range(1.0, 256.0),
        /// Objects that cast caustics: names separated by commas, * for any characters; auto: those with ideal
        /// surfaces.
        pub objects: String = AUTO.to_owned() => any(),
    }
}

/// The value of [`Settings::objects`] that leaves the choice to gpugi.
const AUTO: &str = "auto";
/// Most objects with caustics that `auto` chooses, and most that may be named.
const MOST: usize = 16;
const MOST_NAMED: usize = 32;
/// Most caustic maps: lights times objects.
const MOST_MAPS: usize = 4096;
/// Most pixels of all caustic maps: with more lights and objects, maps are smaller.
const MOST_PIXELS: f32 = 16.0 * 1024.0 * 1024.0;
/// Least side of a caustic map (pixels).
const LEAST_RESOLUTION: u32 = 8;
/// Most surfaces that photons of tracer `rays` meet after they have left the object: that of rays.wesl.
const MOST_FURTHER: u32 = 8;
/// Invocations that splat one photon per pixel of all maps of a batch. Each photon's texels are shared among enough
/// invocations that maps with few photons, whose kernels are large, also fill the GPU.
const SPLAT_INVOCATIONS: u32 = 1 << 21;

/// The pass that follows photons.
#[derive(Debug)]
struct Trace {
    kernel: Kernel,
    tracer: Tracer,
    /// With which it is compiled.
    constants: Vec<(&'static str, f64)>,
}

/// The passes of caustics.
#[derive(Debug)]
struct Kernels {
    trace: Option<Trace>,
    splat: Kernel,
    irradiance: Kernel,
    gather: ReceiverKernel,
    sampler: wgpu::Sampler,
    /// Fewest and most invocations that share the texels of a photon: powers of two, at most 64, the size of a
    /// workgroup.
    splat_lanes: [u32; 2],
}

impl Kernels {
    fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let kernel = |shader| Kernel::new(gpu, &shader, "main", None);
        Ok(Self {
            trace: None,
            splat: kernel(shader!("techniques.caustics.splat"))?,
            irradiance: kernel(shader!("techniques.caustics.irradiance"))?,
            gather: ReceiverKernel::new(gpu, scene, &shader!("techniques.caustics.gather"), &[])?,
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("refractor normals"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
            // Each invocation begins by computing the photon's kernel. On a processor, which few invocations fill, one
            // does all.
            splat_lanes: match gpu.adapter.device_type {
                wgpu::DeviceType::Cpu => [1, 1],
                _ => [4, 64],
            },
        })
    }

    /// Compiles the pass of a tracer, unless it is there. Returns whether bind groups of another one are stale.
    fn choose(&mut self, gpu: &Gpu, scene: &GpuScene, tracer: Tracer) -> Result<bool, GpuError> {
        let mut constants = vec![scene.media_constant()];
        if tracer == Tracer::Rays {
            constants.extend(scene.ray_constants());
        }
        let is_it = |made: &Trace| made.tracer == tracer && made.constants == constants;
        if self.trace.as_ref().is_some_and(is_it) {
            return Ok(false);
        }
        let kernel = match tracer {
            Tracer::Maps => {
                let options = KernelOptions {
                    constants: &constants,
                    ..Default::default()
                };
                let shader = shader!("techniques.caustics.maps");
                Kernel::with_options(gpu, &shader, "main", Some(&scene.layout), &options)?
            }
            Tracer::Rays => {
                scene.check_rays(INFO.name, "tracer=rays")?;
                let shader = shader!("techniques.caustics.rays");
                scene.ray_kernel(gpu, &shader, &[scene.media_constant()])?
            }
        };
        self.trace = Some(Trace {
            kernel,
            tracer,
            constants,
        });
        Ok(true)
    }

    /// The pass of the tracer that was chosen.
    fn trace(&self) -> (&Kernel, Tracer) {
        let chosen = self.trace.as_ref().expect("chosen before maps are made");
        (&chosen.kernel, chosen.tracer)
    }

    /// Invocations that share the texels of one photon of each of `maps` maps of `side` x `side` pixels.
    fn lanes(&self, side: u32, maps: u32) -> u32 {
        let [fewest, most] = self.splat_lanes;
        let lanes = SPLAT_INVOCATIONS / (side * side * maps);
        (1 << lanes.max(1).ilog2()).clamp(fewest, most)
    }
}

/// Caustics.
#[derive(Debug)]
pub struct Caustics {
    settings: Settings,
    kernels: Kernels,
    /// Instances that cast caustics.
    claimed: Vec<u32>,
    made: Option<CausticMaps>,
    bound: PerReceiver<[wgpu::BindGroup; 2]>,
}

/// The caustics of all objects, and what they were made for.
#[derive(Debug)]
struct CausticMaps {
    of: ObjectMapsKey<Settings>,
    caustics: Vec<Caustic>,
    /// Versions of the scene, and of the settings of techniques, that the photons of `frames` frames were followed in.
    followed: Option<(Versions, u64)>,
    /// Those of the latest frame, whose photons may have yet to be followed.
    seen: Option<(Versions, u64)>,
    frames: u32,
    /// The object whose photons of the next frame are followed next.
    next: usize,
    /// Whether photons of all objects were followed once, so that they can be gathered.
    is_complete: bool,
    /// The lights of each frame, which differ in the points on emitters.
    lights: Vec<Vec<LightSample>>,
    /// Index of the first sample point on an emitter among them.
    first_area: usize,
    revision: u64,
}

impl Caustics {
    /// Compiles the technique's passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        Ok(Self {
            settings: Settings::default(),
            kernels: Kernels::new(gpu, scene)?,
            claimed: Vec::new(),
            made: None,
            bound: PerReceiver::default(),
        })
    }

    /// Returns an error if too many objects or maps are needed.
    fn check_counts(&self, gpu: &Gpu, lights: usize) -> Result<(), GpuError> {
        let objects = self.claimed.len();
        for (what, needed, limit) in [
            ("objects with caustics (name fewer)", objects, MOST_NAMED),
            (
                "caustic maps, lights times objects",
                lights * objects,
                MOST_MAPS,
            ),
        ] {
            if needed > limit {
                return Err(GpuError::TooLarge {
                    what: what.into(),
                    needed: needed as u64,
                    limit: limit as u64,
                    adapter: gpu.adapter.name.clone(),
                });
            }
        }
        Ok(())
    }

    /// The lights of all frames.
    fn lights(&self, scene: &GpuScene) -> Vec<Vec<LightSample>> {
        let Settings {
            area_samples,
            frames,
            ..
        } = self.settings;
        let of_frame = |turn| {
            let samples = on_emitters(&scene.emitters, area_samples, turn);
            // The points of all frames share the emitters: each represents a part of the area.
            let samples = samples.into_iter().map(|sample| LightSample {
                area: sample.area / frames as f32,
                ..sample
            });
            scene.lights.iter().map(punctual).chain(samples).collect()
        };
        (0..frames).map(of_frame).collect()
    }

    fn make(&self, gpu: &Gpu, scene: &GpuScene) -> Result<CausticMaps, GpuError> {
        let of = ObjectMapsKey::new(&self.settings, &self.claimed, scene);
        let caustics = of
            .objects()
            .map(|(one, object)| {
                Caustic::new(
                    gpu,
                    &self.kernels,
                    &self.settings,
                    one,
                    object,
                    &self.claimed,
                )
            })
            .collect::<Result<_, _>>()?;
        Ok(CausticMaps {
            of,
            caustics,
            followed: None,
            seen: None,
            frames: 0,
            next: 0,
            is_complete: false,
            lights: Vec::new(),
            first_area: 0,
            revision: 0,
        })
    }
}

impl Technique for Caustics {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn plan(&mut self, scene: &GpuScene, _: &[LightPaths], _: &[Claims]) -> Plan {
        let mut claims = vec![Claims::NONE; scene.objects.len()];
        self.claimed.clear();
        let mut most = 0;
        let lights = scene.lights.len() + self.settings.area_samples as usize;
        for (index, object) in scene.objects.iter().enumerate() {
            let is_mine = match self.settings.objects.as_str() {
                AUTO => self.claimed.len() < MOST && (self.claimed.len() + 1) * lights <= MOST_MAPS,
                list => object.is_named_by(list),
            };
            // Only ideal reflection and refraction make caustics.
            if !(is_mine && object.is_smooth) {
                continue;
            }
            self.claimed.push(index as u32);
            claims[index] = Claims::SHADOW;
            most = most.max(match (object.is_transmissive, object.is_solid) {
                (true, true) => self.settings.bounces.max(1) + 1,
                _ => 1,
            });
        }
        if self.settings.tracer == Tracer::Rays {
            most += MOST_FURTHER;
        }
        let mut paths = Vec::new();
        if !self.claimed.is_empty() {
            for class in [LightClass::Punctual, LightClass::Area] {
                let light = LightPaths::new(class, "LE");
                paths.push(light.continued(&format!("S{{1,{most}}}[DG]")));
            }
        }
        Plan {
            paths,
            claims,
            object_names: match self.settings.objects.as_str() {
                AUTO => String::new(),
                list => list.to_owned(),
            },
            lookups: self.claimed.len() as u32,
            needs: None,
        }
    }

    fn settings(&self) -> &dyn SettingSet {
        &self.settings
    }

    fn settings_mut(&mut self) -> &mut dyn SettingSet {
        &mut self.settings
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        _: &View,
        earlier: &mut Earlier<'_>,
    ) -> Result<Generated, GpuError> {
        let has_lights = !(scene.lights.is_empty() && scene.emitters.is_empty());
        if self.claimed.is_empty() || !has_lights {
            self.made = None;
            return Ok(Generated::FINAL);
        }
        if self
            .kernels
            .choose(frame.gpu, scene, self.settings.tracer)?
        {
            self.made = None;
            if frame.awaits_shaders() {
                return Ok(Generated::WITHOUT_SHADERS);
            }
        }
        let is_made = |made: &CausticMaps| made.of.serves(&self.settings, &self.claimed, scene);
        let mut made = match self.made.take().filter(is_made) {
            Some(made) => made,
            None => self.make(frame.gpu, scene)?,
        };
        let now = Some((scene.versions, earlier.settings_version));
        let is_fresh = made.seen != now;
        made.seen = now;
        // Photons of all objects first: small budgets would never reach the last objects if changes came faster.
        if made.followed != now && made.next == 0 {
            made.followed = now;
            made.frames = 0;
            made.next = 0;
            for caustic in &mut made.caustics {
                caustic.restart();
            }
            made.lights = self.lights(scene);
            made.first_area = scene.lights.len();
            self.check_counts(frame.gpu, made.lights.first().map_or(0, Vec::len))?;
        }
        if made.frames < self.settings.frames {
            let making = Making {
                scene,
                kernels: &self.kernels,
                settings: &self.settings,
                lights: &made.lights,
                first_area: made.first_area,
                objects: made.caustics.len(),
                settings_version: earlier.settings_version,
            };
            while let Some(caustic) = made.caustics.get_mut(made.next)
                && earlier.may_step()
            {
                let pixels = caustic.surround(frame, making, earlier.impostors)?;
                if pixels > 0 {
                    earlier.count(pixels);
                    continue;
                }
                let photons = caustic.generate(frame, making, earlier.impostors)?;
                earlier.count(photons);
                made.next += 1;
            }
            // Maps that nobody asks for are dropped: those of objects that wait must stay.
            for waiting in &made.caustics[made.next..] {
                waiting.keep_maps(frame.gpu, making, earlier.impostors)?;
            }
            if made.next == made.caustics.len() {
                made.next = 0;
                made.frames += 1;
                made.is_complete = true;
                // Dependents need not follow every step.
                let is_step = made.frames.is_power_of_two() || made.frames == self.settings.frames;
                made.revision += u64::from(is_step && !is_fresh);
            }
        }
        let is_stale = made.followed != now;
        let generated = Generated {
            revision: made.revision,
            // Below 1 while the photons are those of an earlier scene.
            progress: made.frames as f32 / (self.settings.frames + u32::from(is_stale)) as f32,
            pending: (!made.is_complete).then_some("the photons of all objects"),
        };
        self.made = Some(made);
        Ok(generated)
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        let Some(made) = self.made.as_ref().filter(|made| !made.caustics.is_empty()) else {
            return Ok(());
        };
        let gpu = frame.gpu;
        let kernel = self.kernels.gather.of(gpu, &receiver.points)?;
        let groups = self.bound.of(receiver, || receiver.bind(gpu, kernel))?;
        frame.compute("caustics.gather", |pass| {
            for caustic in &made.caustics {
                caustic.gather(pass, scene, kernel, groups, &receiver.points);
            }
        });
        Ok(())
    }

    fn inspect(&self) -> Inspection {
        let caustics = || self.made.iter().flat_map(|made| &made.caustics);
        Inspection {
            maps: caustics().map(Caustic::map).collect(),
            work_bytes: caustics().map(Caustic::work_bytes).sum(),
            warnings: Vec::new(),
        }
    }
}
