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
    Earlier, Generated, Info, Inspection, Map, Plan, Registration, Role, Technique, Texels,
};
use crate::capture::{Receiver, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::light_paths::{LightClass, LightPaths};
use crate::lights::{LightList, MapSettings, Shadows};
use crate::scene::{Claims, Emitter, GpuScene, Versions};
use crate::settings::SettingSet;
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
        /// How shadows are smoothed: none, percentage-closer filtering, or percentage-closer soft shadows.
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
        }
    }

    /// The gather's settings, except for the range.
    fn gather(&self, shadows: &Shadows, emitters: &[Emitter]) -> GatherSettings {
        let (first, count) = (shadows.first_of_area(), shadows.light_count());
        let shared = (count - first) as usize;
        let lights = || emitters.chunk_by(|one, next| one.instance == next.instance);
        let is_shared = self.interleaved
            && shared.is_multiple_of(4)
            && shared >= SHARED_PER_LIGHT * lights().count();
        GatherSettings {
            kind: match self.filter {
                Filter::None => 0,
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
#[derive(Debug)]
pub struct ShadowMap {
    /// The settings.
    pub settings: Settings,
    shadows: Shadows,
    gather: ShadowGather,
    /// The inputs that the maps were generated from, or are being generated from.
    generated_for: Option<MapsKey>,
    /// Lights whose maps are not all drawn yet.
    list: Option<LightList>,
    /// State of the maps.
    generated: Generated,
    /// The settings that the gather was bound with.
    bound_with: Option<GatherSettings>,
    /// Warnings about the maps.
    warnings: Vec<String>,
}

impl ShadowMap {
    /// Compiles the technique's passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let shadows = Shadows::new(gpu, scene)?;
        Ok(Self {
            settings: Settings::default(),
            gather: ShadowGather::new(gpu, scene, &shadows)?,
            shadows,
            generated_for: None,
            list: None,
            generated: Generated::FINAL,
            bound_with: None,
            warnings: Vec::new(),
        })
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
    ) -> Result<Generated, GpuError> {
        if self.shadows.has_transmittance() != scene.has_see_through(Claims::SHADOW)
            || self.gather.knows_media == scene.media.is_empty()
        {
            // Materials, claims or media have changed.
            *self = Self {
                settings: self.settings.clone(),
                generated: Generated {
                    revision: self.generated.revision + 1,
                    ..Generated::FINAL
                },
                ..Self::new(frame.gpu, scene)?
            };
            if frame.awaits_shaders() {
                return Ok(Generated::WITHOUT_SHADERS);
            }
        }
        let follows_camera = scene.lights.iter().any(|light| match light.kind {
            LightKind::Directional => true,
            LightKind::Spot { .. } => self.settings.warp,
            LightKind::Point => false,
        });
        let key = MapsKey {
            // The environment casts no shadows here.
            versions: Versions {
                sky: 0,
                environment: 0,
                ..scene.versions
            },
            maps: self
                .settings
                .maps(earlier.lights_elsewhere, view.uniform.sample_index),
            camera: follows_camera.then_some((view.world_from_view, view.half_extent)),
        };
        let is_fresh = self.generated_for.as_ref() != Some(&key);
        if is_fresh || self.generated.progress < 1.0 {
            // While maps wait, the list stays: a jittered view would change the maps of warped spots in every sample.
            let list = match self.list.take().filter(|_| !is_fresh) {
                Some(list) => list,
                None => {
                    let mut list = LightList::new(scene, view, &key.maps);
                    self.warnings = std::mem::take(&mut list.notes);
                    list
                }
            };
            let pass = "shadow-map.generate";
            // Lights do not decide what a map shows of the others.
            let of = Versions {
                lights: 0,
                ..key.versions
            };
            // Maps of a picture's sample serve that sample alone.
            if earlier.is_limited() && key.maps.turn.is_none() {
                let takes = |texels| {
                    let may_step = earlier.may_step();
                    if may_step {
                        earlier.count(texels);
                    }
                    may_step
                };
                let updated = self
                    .shadows
                    .update(frame, scene, pass, (&list, of), takes)?;
                self.list = Some(list);
                if updated.is_rebound {
                    self.bound_with = None;
                }
                let is_late = updated.progress >= 1.0 && !is_fresh;
                self.generated = Generated {
                    revision: self.generated.revision + u64::from(is_late),
                    progress: updated.progress,
                    pending: (!updated.is_whole).then_some("the depth maps of lights"),
                };
            } else {
                if self.shadows.generate(frame, scene, pass, list, of)? {
                    self.bound_with = None;
                }
                earlier.count(self.shadows.texels());
                self.generated = Generated {
                    revision: self.generated.revision + u64::from(!is_fresh),
                    ..Generated::FINAL
                };
            }
            self.generated_for = Some(key);
        }
        let settings = self.settings.gather(&self.shadows, &scene.emitters);
        if self.bound_with != Some(settings) {
            self.gather.look_up(frame.gpu, &self.shadows, settings)?;
            self.bound_with = Some(settings);
        }
        Ok(self.generated)
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        self.gather
            .record(frame, scene, "shadow-map.gather", receiver)
    }

    fn shared_lookups(&self) -> u32 {
        let first = self.bound_with.map(|settings| settings.first_shared);
        first.map_or(0, |first| self.shadows.light_count().saturating_sub(first))
    }

    fn inspect(&self) -> Inspection {
        let atlas = self.shadows.atlas();
        let maps = atlas.map(|atlas| Map {
            name: "shadow-map.atlas".into(),
            texels: Texels::Texture(atlas.texture.clone()),
        });
        Inspection {
            maps: maps.into_iter().collect(),
            work_bytes: 0,
            warnings: self.warnings.clone(),
        }
    }
}
