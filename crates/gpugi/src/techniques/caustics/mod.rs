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
    AUTO, Claimed, Earlier, Generated, Info, Inspection, LightState, Plan, Purpose, Registration,
    Role, Speed, Technique, Unready, chooses, named,
};
use crate::capture::{Gather, Receiver, View};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::light_paths::{LightClass, LightPaths};
use crate::lights::gpu::LightSample;
use crate::lights::samples::{on_emitters, punctual};
use crate::scene::{Claims, GpuScene, has_smooth_objects};
use crate::settings::SettingSet;
use crate::shader;
use crate::stage::Stage;
use object::{Caustic, FrameInputs};

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

/// What the pass that follows photons is compiled for: the tracer, and constants.
type TraceKey = (Tracer, Vec<(&'static str, f64)>);

/// The passes of caustics.
#[derive(Debug)]
struct Kernels {
    splat: Kernel,
    irradiance: Kernel,
    gather: Gather,
    sampler: wgpu::Sampler,
    /// Fewest and most invocations that share the texels of a photon: powers of two, at most 64, the size of a
    /// workgroup.
    splat_lanes: [u32; 2],
}

impl Kernels {
    fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let kernel = |shader| Kernel::new(gpu, &shader, "main", None);
        Ok(Self {
            splat: kernel(shader!("techniques.caustics.splat"))?,
            irradiance: kernel(shader!("techniques.caustics.irradiance"))?,
            gather: Gather::new(gpu, scene, &shader!("techniques.caustics.gather"), &[])?,
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

    /// Invocations that share the texels of one photon of each of `maps` maps of `side` x `side` pixels.
    fn lanes(&self, side: u32, maps: u32) -> u32 {
        let [fewest, most] = self.splat_lanes;
        let lanes = SPLAT_INVOCATIONS / (side * side * maps);
        (1 << lanes.max(1).ilog2()).clamp(fewest, most)
    }
}

/// Compiles the pass that follows photons.
fn trace(gpu: &Gpu, scene: &GpuScene, (tracer, constants): &TraceKey) -> Result<Kernel, GpuError> {
    let (shader, layout) = match tracer {
        Tracer::Maps => (shader!("techniques.caustics.maps"), &scene.layout),
        Tracer::Rays => {
            scene.check_rays(INFO.name, "tracer=rays")?;
            (shader!("techniques.caustics.rays"), &scene.ray_layout)
        }
    };
    Kernel::with_constants(gpu, &shader, "main", Some(layout), constants)
}

/// Caustics.
#[derive(Debug)]
pub struct Caustics {
    settings: Settings,
    kernels: Kernels,
    trace: Stage<TraceKey, Kernel>,
    /// Objects that cast caustics.
    claimed: Claimed,
    maps: Stage<(Settings, Claimed), CausticMaps>,
}

/// The caustics of all objects.
#[derive(Debug)]
struct CausticMaps {
    caustics: Vec<Caustic>,
    /// The light whose photons `frames` frames followed.
    photons: Stage<LightState>,
    frames: u32,
    /// The object whose photons of the next frame are followed next.
    next: usize,
    /// Whether photons of all objects were followed once, so that they can be gathered.
    is_complete: bool,
    /// The lights of each frame, which differ in the points on emitters.
    lights: Vec<Vec<LightSample>>,
    /// Index of the first sample point on an emitter among them.
    first_area: usize,
}

impl Settings {
    /// The lights of all frames.
    fn lights(&self, scene: &GpuScene) -> Vec<Vec<LightSample>> {
        let of_frame = |turn| {
            let samples = on_emitters(&scene.emitters, self.area_samples, turn);
            // The points of all frames share the emitters: each represents a part of the area.
            let samples = samples.into_iter().map(|sample| LightSample {
                area: sample.area / self.frames as f32,
                ..sample
            });
            scene.lights.iter().map(punctual).chain(samples).collect()
        };
        (0..self.frames).map(of_frame).collect()
    }
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
            trace: Stage::default(),
            claimed: Claimed::default(),
            maps: Stage::default(),
        })
    }
}

impl CausticMaps {
    fn new(gpu: &Gpu, settings: &Settings, claimed: &Claimed) -> Result<Self, GpuError> {
        let objects = claimed.objects().iter();
        let caustics = objects.map(|object| Caustic::new(gpu, settings, object, claimed));
        Ok(Self {
            caustics: caustics.collect::<Result<_, _>>()?,
            photons: Stage::default(),
            frames: 0,
            next: 0,
            is_complete: false,
            lights: Vec::new(),
            first_area: 0,
        })
    }

    /// Returns an error if too many objects or maps are needed.
    fn check_counts(&self, gpu: &Gpu) -> Result<(), GpuError> {
        let objects = self.caustics.len();
        let lights = self.lights.first().map_or(0, Vec::len);
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
}

impl Technique for Caustics {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn plan(&mut self, scene: &GpuScene, _: &[LightPaths], _: &[Claims]) -> Plan {
        let mut claims = vec![Claims::NONE; scene.objects.len()];
        let mut claimed: Vec<u32> = Vec::new();
        let mut most = 0;
        let lights = scene.lights.len() + self.settings.area_samples as usize;
        for (index, object) in scene.objects.iter().enumerate() {
            let has_room = claimed.len() < MOST && (claimed.len() + 1) * lights <= MOST_MAPS;
            // Only ideal reflection and refraction make caustics.
            if !(object.is_smooth && chooses(&self.settings.objects, object, has_room, true)) {
                continue;
            }
            claimed.push(index as u32);
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
        if !claimed.is_empty() {
            for class in [LightClass::Punctual, LightClass::Area] {
                let light = LightPaths::new(class, "LE");
                paths.push(light.continued(&format!("S{{1,{most}}}[DG]")));
            }
        }
        self.claimed = Claimed::new(&claimed, scene);
        Plan {
            paths,
            claims,
            object_names: named(&self.settings.objects),
            lookups: claimed.len() as u32,
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
    ) -> Result<Generated, Unready> {
        let has_lights = !(scene.lights.is_empty() && scene.emitters.is_empty());
        if self.claimed.objects().is_empty() || !has_lights {
            self.maps.clear();
            return Ok(Generated::FINAL);
        }
        let (gpu, settings, claimed) = (frame.gpu, &self.settings, &self.claimed);
        let mut constants = vec![scene.media_constant()];
        if settings.tracer == Tracer::Rays {
            constants.extend(scene.ray_constants());
        }
        let key = (settings.tracer, constants);
        let trace = self
            .trace
            .compiled(frame, key.clone(), |_| trace(gpu, scene, &key))?;
        let maps = self.maps.keep((settings.clone(), claimed.clone()), |_| {
            CausticMaps::new(gpu, settings, claimed)
        })?;
        maps.photons
            .ask(earlier.light.state(scene).however_refined());
        // Photons of all objects first: small budgets would never reach the last objects if changes came faster.
        if !maps.photons.is_current() && maps.next == 0 {
            maps.photons.begin();
            maps.frames = 0;
            for caustic in &mut maps.caustics {
                caustic.restart();
            }
            maps.lights = settings.lights(scene);
            maps.first_area = scene.lights.len();
            maps.check_counts(gpu)?;
        }
        if maps.frames < settings.frames {
            let making = FrameInputs {
                scene,
                kernels: &self.kernels,
                trace,
                settings,
                lights: &maps.lights,
                first_area: maps.first_area,
                objects: maps.caustics.len(),
                settings_version: earlier.light.settings_version,
            };
            let impostors = &mut earlier.shared.impostors;
            while let Some(caustic) = maps.caustics.get_mut(maps.next)
                && earlier.budget.may_step()
            {
                let pixels = caustic.surround(frame, making, impostors)?;
                if pixels > 0 {
                    earlier.budget.count(pixels);
                    continue;
                }
                let photons = caustic.generate(frame, making, impostors)?;
                earlier.budget.count(photons);
                maps.next += 1;
            }
            // Maps that nobody asks for are dropped: those of objects that wait must stay.
            for waiting in &maps.caustics[maps.next..] {
                waiting.keep_maps(gpu, making, impostors)?;
            }
            if maps.next == maps.caustics.len() {
                maps.next = 0;
                maps.frames += 1;
                maps.is_complete = true;
                // Dependents need not follow every step.
                if maps.frames.is_power_of_two() || maps.frames == settings.frames {
                    maps.photons.improve();
                }
            }
        }
        Ok(Generated {
            revision: maps.photons.revision(),
            progress: maps.photons.progress(maps.frames, settings.frames),
            pending: (!maps.is_complete).then_some("the photons of all objects"),
        })
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        let (gpu, gather, count) = (frame.gpu, &self.kernels.gather, receiver.points.lit);
        let Some(maps) = self.maps.get() else {
            return Ok(());
        };
        frame.compute("caustics.gather", |pass| {
            let mut caustics = maps.caustics.iter();
            caustics.try_for_each(|caustic| {
                let cube = caustic.resources();
                gather.run(gpu, pass, scene, receiver, &cube, count)
            })
        })
    }

    fn inspect(&self) -> Inspection {
        let caustics = || self.maps.get().into_iter().flat_map(|maps| &maps.caustics);
        Inspection {
            maps: caustics().map(Caustic::map).collect(),
            work_bytes: caustics().map(Caustic::work_bytes).sum(),
            warnings: Vec::new(),
        }
    }
}
