//! Shadow mapping: direct light of punctual and area lights, with shadows from depth maps (tutorial section 3.1).
//!
//! Generate: every light becomes one or more light samples with depth views in one atlas (../../lights). A point light
//! has six cube faces, a spot light one view, a directional light cascades, and each sample of an area light five
//! hemicube faces (ten if it is two-sided). Where points beyond the camera's view are lit, a directional light and a
//! warped spot light have one more view, which does not follow the camera. Gather: sums the samples' reflected light
//! times visibility.
//!
//! Differences from the tutorial: point lights and area lights are complete, depth is reversed floating point, the bias
//! is a normal offset, filters follow the receiver's plane, and the second depth value is an option.
//! docs/techniques/shadow-map.md.

mod default_set;
mod gather;
pub(crate) mod gpu;

use super::{
    Earlier, Generated, Info, Inspection, Map, Plan, Registration, Role, Technique, Unready,
};
use crate::capture::{Receiver, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::light_paths::{LightClass, LightPaths};
use crate::lights::{LightList, MapSettings, Shadows};
use crate::scene::{Claims, Emitter, GpuScene, Inputs, Versions};
use crate::settings::SettingSet;
use crate::stage::Stage;
use gather::ShadowGather;
use gpu::GatherSettings;
use gpugi_scene::LightKind;

/// Name, summary, source and light paths of the technique.
pub const INFO: Info = Info {
    name: "shadow-map",
    summary: "direct light of point, spot, directional and area lights with shadows",
    source: "tutorial section 3.1; Williams 1978; Reeves et al. 1987; Fernando 2005",
    paths: &[
        LightPaths::new(LightClass::Punctual, "LS*[DG]E"),
        LightPaths::new(LightClass::Area, "LS*[DG]E"),
    ],
    role: Role::Direct,
    ..Info::BASE
};

/// Its entry in the registry.
pub const REGISTRATION: Registration = Registration {
    info: &INFO,
    fields: Settings::fields,
    make: |gpu, scene| Ok(Box::new(ShadowMap::new(gpu, scene)?)),
    suits: |occasion| Some(occasion.has_lights(INFO.paths)),
    settings: default_set::settings,
};

/// The light in scenes without glass.
const DIRECT: &[LightPaths] = &[
    LightPaths::new(LightClass::Punctual, "L[DG]E"),
    LightPaths::new(LightClass::Area, "L[DG]E"),
];

crate::choices! {
    /// How shadows are smoothed.
    pub enum Filter {
        /// No shadows, and no depth maps: the light of what stands in the way of nothing (tutorial figure 2, left).
        Unshadowed = "unshadowed",
        /// One comparison, interpolated by the hardware.
        None = "none",
        /// Percentage-closer filtering over a disc.
        Pcf = "pcf",
        /// Percentage-closer soft shadows: the disc grows with the penumbra.
        Pcss = "pcss",
    }
}

crate::settings! {
    /// Settings of shadow mapping.
    pub struct Settings {
        /// Side of a depth map.
        pub resolution: u32 = 1024 => in_range(16.0, 8192.0).unit("texels"),
        /// How shadows are smoothed: none, percentage-closer filtering, or percentage-closer soft shadows. unshadowed:
        /// there are no shadows, and no depth maps.
        pub filter: Filter = Filter::Pcf => any(),
        /// Radius of the filter disc.
        pub filter_radius: f32 = 1.5 => in_range(0.0, 16.0).unit("texels"),
        /// Comparisons per lookup.
        pub taps: u32 = 16 => in_range(1.0, 256.0),
        /// Offset along the normal that prevents self-shadowing.
        pub normal_offset: f32 = 1.5 => in_range(0.0, 16.0).unit("texels"),
        /// Whether closed meshes cast shadows by their back faces: no bias, but light leaks where they stand on
        /// something.
        pub second_depth: bool = false => any(),
        /// Whether spot lights spend their texels where the camera looks.
        pub warp: bool = false => any(),
        /// Cascades: depth maps of a directional light that follow the camera.
        pub cascades: u32 = 4 => in_range(1.0, 4.0),
        /// Sample points on all area lights together.
        pub area_samples: u32 = 64 => in_range(1.0, 4096.0),
        /// Side of an area sample's hemicube.
        pub area_resolution: u32 = 256 => in_range(16.0, 2048.0).unit("texels"),
        /// Comparisons per lookup in an area sample's map.
        pub area_taps: u32 = 4 => in_range(1.0, 256.0),
        /// Whether 2 x 2 pixels share the samples of area lights, and four samples of a picture make up for it. Lights
        /// need 16 sample points each for this, on average.
        pub interleaved: bool = false => any(),
        /// Whether each sample of a picture is lit from other points of area lights and of lights with a radius. Soft
        /// shadows become exact with the number of samples; each draws its own maps.
        pub per_sample: bool = false => any(),
    }
}

/// Fewest samples per area light that pixels share: a quarter of them still shows its shape.
const SHARED_PER_LIGHT: usize = 16;

impl Settings {
    /// Texels that the views of a light reach beyond their field of view, for the filter.
    fn gutter(&self, has_radius: bool) -> u32 {
        // Where discs grow, the largest disc of lookup.wesl.
        let disc = if self.filter == Filter::Pcss && has_radius {
            64.0
        } else {
            self.filter_radius
        };
        (disc.ceil() as u32 + 2).min(self.resolution / 8)
    }

    /// The lights' maps; with `beyond_camera`, also for points that the camera does not see.
    fn maps(&self, beyond_camera: bool, sample: u32) -> MapSettings {
        MapSettings {
            resolution: self.resolution,
            gutters: [false, true].map(|has_radius| self.gutter(has_radius)),
            second_depth: self.second_depth,
            warp: self.warp,
            cascades: self.cascades,
            area_samples: self.area_samples,
            area_resolution: self.area_resolution,
            // What is lit for all samples, such as texels, takes the lights' centres.
            turn: (self.per_sample && sample != View::NO_SAMPLE).then_some(sample),
            beyond_camera,
            unshadowed: self.filter == Filter::Unshadowed,
        }
    }

    /// The gather's settings, except for the range.
    fn gather(&self, shadows: &Shadows, emitters: &[Emitter]) -> GatherSettings {
        let (first, count) = (shadows.first_of_area(), shadows.light_count());
        let shared = (count - first) as usize;
        let lights = || emitters.chunk_by(|emitter, next| emitter.instance == next.instance);
        let is_shared = self.interleaved
            && shared.is_multiple_of(4)
            && shared >= SHARED_PER_LIGHT * lights().count();
        GatherSettings {
            kind: match self.filter {
                Filter::Unshadowed | Filter::None => 0,
                Filter::Pcf => 1,
                Filter::Pcss => 2,
            },
            radius: self.filter_radius,
            taps: self.taps,
            normal_offset: self.normal_offset,
            cascade_blend: 0.1,
            second_depth: u32::from(self.second_depth),
            area_taps: self.area_taps,
            first_shared: if is_shared { first } else { count },
            ..bytemuck::Zeroable::zeroed()
        }
    }
}

/// The inputs of the maps: when they change, the maps are regenerated.
#[derive(Debug, Clone, PartialEq)]
struct MapsKey {
    versions: Versions,
    maps: MapSettings,
    /// The camera, if maps follow it. Jitter is ignored.
    camera: Option<(glam::Mat4, glam::Vec2)>,
}

/// Shadow mapping.
#[derive(Debug, Default)]
pub struct ShadowMap {
    /// The settings.
    pub settings: Settings,
    /// By whether casters let light through, whether there are media, and whether there are no shadows.
    passes: Stage<[bool; 3], Passes>,
    /// Lights whose maps are drawn. While maps wait, the list stays: a jittered view would change the maps of warped
    /// spots in every sample.
    lights: Stage<MapsKey, LightList>,
    progress: f32,
    /// The gather's settings, once there are maps.
    gather: Option<GatherSettings>,
}

/// The passes, and the maps that they draw and read.
#[derive(Debug)]
struct Passes {
    shadows: Shadows,
    gather: ShadowGather,
}

impl Passes {
    fn new(gpu: &Gpu, scene: &GpuScene, settings: &Settings) -> Result<Self, GpuError> {
        let shadows = Shadows::new(gpu, scene)?;
        let unshadowed = settings.filter == Filter::Unshadowed;
        Ok(Self {
            gather: ShadowGather::new(gpu, scene, &shadows, unshadowed)?,
            shadows,
        })
    }

    fn key(scene: &GpuScene, settings: &Settings) -> [bool; 3] {
        let is_see_through = scene.has_see_through(Claims::SHADOW);
        let unshadowed = settings.filter == Filter::Unshadowed;
        [is_see_through, !scene.media.is_empty(), unshadowed]
    }
}

impl ShadowMap {
    /// Compiles the technique's passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let mut made = Self::default();
        made.passes.keep(Passes::key(scene, &made.settings), |_| {
            Passes::new(gpu, scene, &made.settings)
        })?;
        Ok(made)
    }
}

impl Technique for ShadowMap {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn settings(&self) -> &dyn SettingSet {
        &self.settings
    }

    fn settings_mut(&mut self) -> &mut dyn SettingSet {
        &mut self.settings
    }

    fn plan(&mut self, scene: &GpuScene, _: &[LightPaths], _: &[Claims]) -> Plan {
        let on_emitters = if scene.emitters.is_empty() {
            0
        } else {
            self.settings.area_samples
        };
        // Straight through glass; what mirrors throw is missing.
        let paths = if scene.has_clear_objects() {
            INFO.paths
        } else {
            DIRECT
        };
        Plan {
            lookups: scene.lights.len() as u32 + on_emitters,
            ..Plan::adding(paths, scene)
        }
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        view: &View,
        earlier: &mut Earlier<'_>,
    ) -> Result<Generated, Unready> {
        let (gpu, lights, budget) = (frame.gpu, &mut self.lights, &mut earlier.budget);
        let (key, settings) = (Passes::key(scene, &self.settings), &self.settings);
        let passes = self.passes.compiled(frame, key, |_| {
            lights.clear();
            Passes::new(gpu, scene, settings)
        })?;
        let follows_camera = scene.lights.iter().any(|light| match light.kind {
            LightKind::Directional => true,
            LightKind::Spot { .. } => self.settings.warp,
            LightKind::Point => false,
        });
        let sample = view.uniform.sample_index;
        let maps = self.settings.maps(earlier.light.lights_elsewhere, sample);
        let key = MapsKey {
            // The environment casts no shadows here.
            versions: scene
                .versions
                .of((Inputs::SKY | Inputs::ENVIRONMENT).without()),
            maps: maps.clone(),
            camera: follows_camera.then_some((view.world_from_view, view.half_extent)),
        };
        // Lights do not decide what a map shows of the others.
        let of = key.versions.of(Inputs::LIGHTS.without());
        let list = lights.keep(key, |_| {
            self.progress = 0.0;
            Ok::<_, GpuError>(LightList::new(scene, view, &maps))
        })?;
        let mut pending = None;
        if self.progress < 1.0 {
            let (pass, shadows) = ("shadow-map.generate", &mut passes.shadows);
            // Maps of a picture's sample serve that sample alone.
            if budget.is_limited() && maps.turn.is_none() {
                let takes = |work| budget.takes(work);
                let updated = shadows.update(frame, scene, pass, (list, of), takes)?;
                self.progress = updated.progress;
                pending = (!updated.is_whole).then_some("the depth maps of lights");
            } else {
                shadows.generate(frame, scene, pass, list.clone(), of)?;
                let of_triangles = scene.casters().work() * u64::from(shadows.light_count());
                budget.count(shadows.texels() + of_triangles);
                self.progress = 1.0;
            }
            if self.progress >= 1.0 {
                lights.improve();
            }
        }
        self.gather = Some(self.settings.gather(&passes.shadows, &scene.emitters));
        Ok(Generated {
            revision: lights.revision(),
            progress: self.progress,
            pending,
        })
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        let (Some(passes), Some(settings)) = (self.passes.get(), &self.gather) else {
            return Ok(());
        };
        let of_lights = (&passes.shadows, settings);
        passes
            .gather
            .record(frame, "shadow-map.gather", scene, receiver, of_lights)
    }

    fn shared_lookups(&self) -> u32 {
        let (Some(passes), Some(settings)) = (self.passes.get(), &self.gather) else {
            return 0;
        };
        let count = passes.shadows.light_count();
        count.saturating_sub(settings.first_shared)
    }

    fn inspect(&self) -> Inspection {
        let atlas = self.passes.get().and_then(|passes| passes.shadows.atlas());
        let atlas = atlas.filter(|_| self.settings.filter != Filter::Unshadowed);
        let map = atlas.map(|atlas| Map::of_texture("shadow-map.atlas", &atlas.texture));
        let list = self.lights.get();
        Inspection {
            maps: map.into_iter().collect(),
            work_bytes: 0,
            warnings: list.map_or_else(Vec::new, |list| list.notes.clone()),
        }
    }
}
