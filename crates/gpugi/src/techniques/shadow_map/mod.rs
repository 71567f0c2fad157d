//! Shadow mapping: direct light of punctual and area lights, with shadows from depth maps (tutorial section 3.1).
//!
//! Generate: every light becomes one or more light samples with depth views in one atlas: six cube faces for a point light, one
//! view for a spot light, cascades for a directional one, five hemicube faces for each sample of an area light. Gather: sums
//! the samples' reflected light times visibility. Differences to the tutorial: point lights and area lights are complete, depth is
//! reversed floating point, bias is a normal offset, filters follow the receiver's plane, and the second depth value is a choice. docs/techniques/shadow-map.md.

mod gather;
pub(crate) mod gpu;

use serde::{Deserialize, Serialize};

use super::{Field, Info, Lit, Map, SettingError, Technique, Texels, settings};
use crate::capture::{SurfacePoints, Target, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::light_paths::{LightClass, LightPaths};
use crate::lights::{LightList, MapSettings, Shadows};
use crate::scene::{GpuScene, Versions};
use gather::Gather;
use gpu::GatherSettings;
use gpugi_scene::LightKind;

/// What shadow mapping says of itself.
pub const INFO: Info = Info {
    name: "shadow-map",
    summary: "direct light of point, spot, directional and area lights with shadows",
    source: "tutorial section 3.1; Williams 1978; Reeves et al. 1987; Fernando 2005",
    paths: &[
        LightPaths::new(LightClass::Punctual, "L[DG]E"),
        LightPaths::new(LightClass::Area, "L[DG]E"),
    ],
    suits: |_| true,
    keeps_texels: false,
};

/// How shadows are smoothed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Filter {
    /// One comparison, interpolated by the hardware.
    None,
    /// Percentage-closer filtering over a disc.
    Pcf,
    /// Percentage-closer soft shadows: the disc grows with the penumbra.
    Pcss,
}

/// Settings of shadow mapping.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// Side of a depth map (texels).
    pub resolution: u32,
    /// Smoothing.
    pub filter: Filter,
    /// Radius of the filter disc (texels).
    pub filter_radius: f32,
    /// Comparisons a lookup.
    pub taps: u32,
    /// Normal offset (texels).
    pub normal_offset: f32,
    /// Whether punctual lights draw closed meshes by their back faces: needs no bias, but light leaks where such a mesh stands on something.
    pub second_depth: bool,
    /// Whether spot lights warp their depth view toward what the camera sees.
    pub warp: bool,
    /// Cascades of a directional light.
    pub cascades: u32,
    /// Sample points on all area lights together.
    pub area_samples: u32,
    /// Side of an area sample's hemicube (texels).
    pub area_resolution: u32,
    /// Comparisons a lookup in an area sample's map.
    pub area_taps: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            resolution: 1024,
            filter: Filter::Pcf,
            filter_radius: 1.5,
            taps: 16,
            normal_offset: 1.5,
            second_depth: false,
            warp: false,
            cascades: 4,
            area_samples: 64,
            area_resolution: 256,
            area_taps: 4,
        }
    }
}

const FIELDS: &[Field] = &[
    Field {
        name: "resolution",
        summary: "side of a depth map [texels]",
        range: Some((16.0, 8192.0)),
    },
    Field {
        name: "filter",
        summary: "none, pcf or pcss",
        range: None,
    },
    Field {
        name: "filter-radius",
        summary: "radius of the filter disc [texels]",
        range: Some((0.0, 16.0)),
    },
    Field {
        name: "taps",
        summary: "comparisons a lookup",
        range: Some((1.0, 256.0)),
    },
    Field {
        name: "normal-offset",
        summary: "bias along the normal [texels]",
        range: Some((0.0, 16.0)),
    },
    Field {
        name: "second-depth",
        summary: "true: closed meshes cast by their back faces, without bias but with light leaks at their feet",
        range: None,
    },
    Field {
        name: "warp",
        summary: "true: spot lights spend their texels where the camera looks",
        range: None,
    },
    Field {
        name: "cascades",
        summary: "depth maps of a directional light",
        range: Some((1.0, 4.0)),
    },
    Field {
        name: "area-samples",
        summary: "sample points on all area lights",
        range: Some((1.0, 4096.0)),
    },
    Field {
        name: "area-resolution",
        summary: "side of an area sample's hemicube [texels]",
        range: Some((16.0, 2048.0)),
    },
    Field {
        name: "area-taps",
        summary: "comparisons a lookup for area lights",
        range: Some((1.0, 256.0)),
    },
];

impl Settings {
    /// Texels by which the views of a light reach beyond their field of view, for the filter.
    fn gutter(&self, has_radius: bool) -> u32 {
        // The largest disc of lookup.wesl, where discs grow.
        let disc = if self.filter == Filter::Pcss && has_radius {
            64.0
        } else {
            self.filter_radius
        };
        (disc.ceil() as u32 + 2).min(self.resolution / 8)
    }

    /// The maps that lights get; with `beyond_camera` for points, too, that the camera does not see.
    fn maps(&self, beyond_camera: bool) -> MapSettings {
        MapSettings {
            resolution: self.resolution,
            gutters: [false, true].map(|has_radius| self.gutter(has_radius)),
            second_depth: self.second_depth,
            warp: self.warp,
            cascades: self.cascades,
            area_samples: self.area_samples,
            area_resolution: self.area_resolution,
            beyond_camera,
        }
    }

    /// What the gather reads, all but the range.
    fn gather(&self) -> GatherSettings {
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
            ..bytemuck::Zeroable::zeroed()
        }
    }
}

/// What the maps depend on: they are made again when it changes.
#[derive(Debug, Clone, PartialEq)]
struct Made {
    versions: Versions,
    maps: MapSettings,
    /// The camera, where maps follow it. Jitter does not count.
    camera: Option<(glam::Mat4, glam::Vec2)>,
}

/// Shadow mapping.
#[derive(Debug)]
pub struct ShadowMap {
    settings: Settings,
    shadows: Shadows,
    gather: Gather,
    made: Option<Made>,
    looked_up: Option<GatherSettings>,
    notes: Vec<String>,
}

impl ShadowMap {
    /// Compiles the technique's passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        Ok(Self {
            settings: Settings::default(),
            shadows: Shadows::new(gpu, scene)?,
            gather: Gather::new(gpu, scene)?,
            made: None,
            looked_up: None,
            notes: Vec::new(),
        })
    }

    /// The settings, typed.
    pub fn settings_mut(&mut self) -> &mut Settings {
        &mut self.settings
    }
}

impl Technique for ShadowMap {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn settings(&self) -> serde_json::Value {
        settings::to_json(&self.settings)
    }

    fn fields(&self) -> &'static [Field] {
        FIELDS
    }

    fn set(&mut self, name: &str, value: &str) -> Result<(), SettingError> {
        settings::set(&mut self.settings, FIELDS, name, value)
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        view: &View,
        lit: &mut Lit<'_>,
    ) -> Result<(), GpuError> {
        let follows_camera = scene.lights.iter().any(|light| match light.kind {
            LightKind::Directional => true,
            LightKind::Spot { .. } => self.settings.warp,
            LightKind::Point => false,
        });
        let made = Made {
            versions: scene.versions,
            maps: self.settings.maps(lit.beyond_camera),
            camera: follows_camera.then_some((view.world_from_view, view.half_extent)),
        };
        if self.made.as_ref() != Some(&made) {
            let mut list = LightList::new(scene, view, &made.maps);
            self.notes = std::mem::take(&mut list.notes);
            let pass = "shadow-map.generate";
            if self.shadows.generate(frame, scene, pass, list)? {
                self.looked_up = None;
            }
            self.made = Some(made);
        }
        let settings = self.settings.gather();
        if self.looked_up != Some(settings) {
            self.gather.look_up(frame.gpu, &self.shadows, settings)?;
            self.looked_up = Some(settings);
        }
        Ok(())
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        points: &SurfacePoints,
        target: &Target,
    ) -> Result<(), GpuError> {
        self.gather
            .record(frame, scene, "shadow-map.gather", points, target)
    }

    fn maps(&self) -> Vec<Map> {
        let atlas = self.shadows.atlas();
        atlas
            .map(|atlas| Map {
                name: "shadow-map.atlas".into(),
                texels: Texels::Texture(atlas.texture.clone()),
            })
            .into_iter()
            .collect()
    }

    fn warnings(&self, _: &Gpu) -> Result<Vec<String>, GpuError> {
        Ok(self.notes.clone())
    }
}
