//! Caustics: light that objects mirror and refract onto what is around them (tutorial section 5.4).
//!
//! Generate: each light sees each object in a caustic map, from whose pixels photons are followed through the object to its surroundings, in
//! the same maps as distance impostors use; a cube around the object counts what arrives. Gather: looks the irradiance up there.
//! docs/techniques/caustics.md.

pub(crate) mod gpu;
mod lights;
mod object;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

use super::{Field, Info, Lit, MadeFor, Map, SettingError, Technique, settings};
use crate::capture::{PerTarget, SurfacePoints, Target, View};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::light_paths::{LightClass, LightPaths};
use crate::lights::gpu::LightSample;
use crate::lights::samples::{on_emitters, punctual};
use crate::scene::{Claims, GpuScene, Versions};
use crate::shader;
use object::{Caustic, Making};

/// What caustics say of themselves.
pub const INFO: Info = Info {
    name: "caustics",
    summary: "light of point, spot, directional and area lights that mirrors and glass throw on their surroundings",
    source: "tutorial section 5.4; Szirmay-Kalos et al. 2005; Wyman and Davis 2006",
    paths: &[
        LightPaths::new(LightClass::Punctual, "LS+[DG]E"),
        LightPaths::new(LightClass::Area, "LS+[DG]E"),
    ],
    suits: |scene| scene.objects.iter().any(|object| object.is_smooth),
    keeps_texels: false,
};

/// Settings of caustics.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// Pixels a side of a light's caustic map of an object; all samples of area lights share as many.
    pub resolution: u32,
    /// Side of the faces of the cubes that hold what photons light (texels): a power of two.
    pub cube_resolution: u32,
    /// Side of the faces of refractors' shapes (texels): a power of two.
    pub shape_resolution: u32,
    /// Most surfaces that light meets inside a refractor; 0: it refracts once, on its way in.
    pub bounces: u32,
    /// Sample points on all area lights together, in every frame others.
    pub area_samples: u32,
    /// Frames of a still scene whose photons are added up.
    pub frames: u32,
    /// Objects that throw caustics: names separated by commas, `*` for any characters. `auto`: those with ideal surfaces.
    pub objects: String,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            resolution: 256,
            cube_resolution: 256,
            shape_resolution: 256,
            bounces: 4,
            area_samples: 4,
            frames: 16,
            objects: AUTO.to_owned(),
        }
    }
}

const FIELDS: &[Field] = &[
    Field {
        name: "resolution",
        summary: "side of a light's caustic map of an object; all samples of area lights share as many [pixels]",
        range: Some((LEAST_RESOLUTION as f64, 2048.0)),
    },
    Field {
        name: "cube-resolution",
        summary: "side of the faces of the cubes that hold what photons light, a power of two [texels]",
        range: Some((16.0, 1024.0)),
    },
    Field {
        name: "shape-resolution",
        summary: "side of the faces of refractors' shapes, a power of two [texels]",
        range: Some((16.0, 1024.0)),
    },
    Field {
        name: "bounces",
        summary: "most surfaces that light meets inside a refractor; 0: it refracts once",
        range: Some((0.0, 16.0)),
    },
    Field {
        name: "area-samples",
        summary: "sample points on all area lights, in every frame others",
        range: Some((1.0, 256.0)),
    },
    Field {
        name: "frames",
        summary: "frames of a still scene whose photons are added up",
        range: Some((1.0, 256.0)),
    },
    Field {
        name: "objects",
        summary: "objects that throw caustics, names with commas between and * for any letters; auto: those with ideal surfaces",
        range: None,
    },
];

/// The value of [`Settings::objects`] that leaves the choice to gpugi.
const AUTO: &str = "auto";
/// Most objects that throw caustics by themselves, and most that may be named.
const MOST: usize = 16;
const MOST_NAMED: usize = 32;
/// Most caustic maps: lights times objects.
const MOST_MAPS: usize = 4096;
/// Most pixels of all caustic maps, 56 bytes each: more lights and objects get smaller maps.
const MOST_PIXELS: f32 = 16.0 * 1024.0 * 1024.0;
/// Least side of a caustic map (pixels).
const LEAST_RESOLUTION: u32 = 8;

/// The passes of caustics.
#[derive(Debug)]
struct Kernels {
    trace: Kernel,
    splat: Kernel,
    irradiance: Kernel,
    gather: Kernel,
    sampler: wgpu::Sampler,
}

impl Kernels {
    fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let layout = Some(&scene.layout);
        let kernel = |shader, layout| Kernel::new(gpu, &shader, "main", layout);
        Ok(Self {
            trace: kernel(shader!("techniques.caustics.trace"), layout)?,
            splat: kernel(shader!("techniques.caustics.splat"), None)?,
            irradiance: kernel(shader!("techniques.caustics.irradiance"), None)?,
            gather: kernel(shader!("techniques.caustics.gather"), layout)?,
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("refractor normals"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
        })
    }
}

/// Caustics.
#[derive(Debug)]
pub struct Caustics {
    settings: Settings,
    kernels: Kernels,
    paths: Vec<LightPaths>,
    /// Instances that throw caustics.
    claimed: Vec<u32>,
    made: Option<Made>,
    bound: PerTarget<[wgpu::BindGroup; 2]>,
}

/// The caustics of all objects, and what they were made for.
#[derive(Debug)]
struct Made {
    of: MadeFor<Settings>,
    caustics: Vec<Caustic>,
    /// What the photons of so many frames were followed in: the scene, and the settings of techniques.
    followed: Option<(Versions, u64)>,
    frames: u32,
    /// The lights of each frame: points on emitters lie elsewhere in each.
    lights: Vec<Vec<LightSample>>,
    refinements: u64,
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
            paths: Vec::new(),
            claimed: Vec::new(),
            made: None,
            bound: PerTarget::default(),
        })
    }

    /// Refuses what would take too many maps.
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
            // All frames' points share the emitters: each stands for a part of the area.
            let samples = samples.into_iter().map(|sample| LightSample {
                area: sample.area / frames as f32,
                ..sample
            });
            scene.lights.iter().map(punctual).chain(samples).collect()
        };
        (0..frames).map(of_frame).collect()
    }

    fn make(&self, gpu: &Gpu, scene: &GpuScene) -> Result<Made, GpuError> {
        let of = MadeFor::new(&self.settings, &self.claimed, scene);
        let caustics = of
            .objects()
            .map(|(one, object)| Caustic::new(gpu, &self.kernels, &self.settings, one, object))
            .collect::<Result<_, _>>()?;
        Ok(Made {
            of,
            caustics,
            followed: None,
            frames: 0,
            lights: Vec::new(),
            refinements: 0,
        })
    }
}

impl Technique for Caustics {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn paths(&self) -> &[LightPaths] {
        &self.paths
    }

    fn claim(&mut self, scene: &GpuScene, _: &[LightPaths]) -> Vec<Claims> {
        let mut claims = vec![Claims::NONE; scene.objects.len()];
        self.claimed.clear();
        let mut most = 0;
        let lights = scene.lights.len() + self.settings.area_samples as usize;
        for (index, object) in scene.objects.iter().enumerate() {
            let is_mine = match self.settings.objects.as_str() {
                AUTO => self.claimed.len() < MOST && (self.claimed.len() + 1) * lights <= MOST_MAPS,
                list => object.is_named_by(list),
            };
            // What rough surfaces mirror is no caustic.
            if !(is_mine && object.is_smooth) {
                continue;
            }
            self.claimed.push(index as u32);
            if object.is_transmissive {
                claims[index] = Claims::SHADOW;
            }
            most = most.max(match (object.is_transmissive, object.is_solid) {
                (true, true) => self.settings.bounces.max(1) + 1,
                _ => 1,
            });
        }
        self.paths.clear();
        if most > 0 {
            for class in [LightClass::Punctual, LightClass::Area] {
                let light = LightPaths::new(class, "LE");
                self.paths
                    .push(light.continued(&format!("S{{1,{most}}}[DG]")));
            }
        }
        claims
    }

    fn names(&self) -> &str {
        match self.settings.objects.as_str() {
            AUTO => "",
            list => list,
        }
    }

    fn refinements(&self) -> u64 {
        self.made.as_ref().map_or(0, |made| made.refinements)
    }

    fn progress(&self) -> f32 {
        let frames = self.made.as_ref().map_or(0, |made| made.frames);
        frames as f32 / self.settings.frames as f32
    }

    fn settings(&self) -> serde_json::Value {
        settings::to_json(&self.settings)
    }

    fn fields(&self) -> &'static [Field] {
        FIELDS
    }

    fn set(&mut self, name: &str, value: &str) -> Result<(), SettingError> {
        let sides = |all: &Settings| [all.cube_resolution, all.shape_resolution];
        settings::set_with_sides(&mut self.settings, FIELDS, name, value, sides)
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        _: &View,
        lit: &mut Lit<'_>,
    ) -> Result<(), GpuError> {
        let is_made = |made: &Made| made.of.is(&self.settings, &self.claimed, scene);
        let mut made = match self.made.take().filter(is_made) {
            Some(made) => made,
            None => self.make(frame.gpu, scene)?,
        };
        let now = Some((scene.versions, lit.version));
        let is_fresh = made.followed != now;
        if is_fresh {
            made.followed = now;
            made.frames = 0;
            made.lights = self.lights(scene);
            self.check_counts(frame.gpu, made.lights.first().map_or(0, Vec::len))?;
        }
        if made.frames < self.settings.frames {
            let making = Making {
                scene,
                kernels: &self.kernels,
                settings: &self.settings,
                lights: &made.lights,
                first_area: scene.lights.len(),
                objects: made.caustics.len(),
                settings_version: lit.version,
            };
            for caustic in &mut made.caustics {
                caustic.generate(frame, making, lit.impostors, is_fresh)?;
            }
            made.frames += 1;
            // Whoever shows caustics need not follow every step.
            let is_step = made.frames.is_power_of_two() || made.frames == self.settings.frames;
            made.refinements += u64::from(is_step && !is_fresh);
        }
        self.made = Some(made);
        Ok(())
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        points: &SurfacePoints,
        target: &Target,
    ) -> Result<(), GpuError> {
        let Some(made) = self.made.as_ref().filter(|made| !made.caustics.is_empty()) else {
            return Ok(());
        };
        let (gpu, kernel) = (frame.gpu, &self.kernels.gather);
        let groups = self.bound.of(points, target, || {
            Ok([points.bind(gpu, kernel)?, target.bind(gpu, kernel)?])
        })?;
        frame.compute("caustics.gather", |pass| {
            for caustic in &made.caustics {
                caustic.gather(pass, scene, kernel, groups, points);
            }
        });
        Ok(())
    }

    fn maps(&self) -> Vec<Map> {
        let caustics = self.made.iter().flat_map(|made| &made.caustics);
        caustics.map(Caustic::map).collect()
    }

    fn work_bytes(&self) -> u64 {
        let caustics = self.made.iter().flat_map(|made| &made.caustics);
        caustics.map(Caustic::work_bytes).sum()
    }
}
