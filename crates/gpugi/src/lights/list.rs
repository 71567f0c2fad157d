//! Light samples and the depth views that they need.

use std::borrow::Cow;

use glam::Vec3;
use gpugi_scene::{Light, LightKind};

use super::cascades::cascades;
use super::gpu::LightSample;
use super::samples::{on_emitters, punctual, within_radius};
use super::sharing::{Demand, share};
use super::warp::warped;
use crate::capture::View;
use crate::capture::depth::{ATLAS_SIDE, DepthAtlas, DepthViewSpec};
use crate::scene::GpuScene;

/// Sizes and kinds of the lights' depth maps.
#[derive(Debug, Clone, PartialEq)]
pub struct MapSettings {
    /// Side of a punctual light's maps if the atlas has room (texels).
    pub resolution: u32,
    /// Texels that a view reaches beyond its field of view, for filters: for lights without a radius, and with one.
    pub gutters: [u32; 2],
    /// Whether maps of punctual lights draw closed meshes by their back faces.
    pub second_depth: bool,
    /// Whether spot lights warp one view toward what the camera sees.
    pub warp: bool,
    /// Cascades of a directional light.
    pub cascades: u32,
    /// Sample points on all area lights together.
    pub area_samples: u32,
    /// Side of an area sample's hemicube if the atlas has room (texels).
    pub area_resolution: u32,
    /// Which points of area lights and of lights with a radius are sampled. Without a number, every frame lights with
    /// the same points of area lights, and with the centres of other lights, whose radius is left to filters.
    pub turn: Option<u32>,
    /// Whether points outside the camera's view are lit. Then each light also has a view of everything that it may
    /// light.
    pub beyond_camera: bool,
    /// Whether lights have no views at all, because none casts shadows.
    pub unshadowed: bool,
}

/// Light samples and their depth views.
#[derive(Debug, Clone, Default)]
pub struct LightList {
    /// The samples that gathers sum over.
    pub samples: Vec<LightSample>,
    /// The views that the depth atlas holds.
    pub views: Vec<DepthViewSpec>,
    /// Notes on lights whose maps are smaller than requested.
    pub notes: Vec<String>,
}

/// A light source: a punctual light, or a sample point of an area light.
enum Source<'a> {
    Punctual(Cow<'a, Light>),
    Area(LightSample),
}

impl LightList {
    /// The lights of `scene`, and depth views that cover what `view` sees or, with [`MapSettings::beyond_camera`], the
    /// whole scene. The views are smaller than requested if one atlas cannot hold them all.
    pub fn new(scene: &GpuScene, view: &View, settings: &MapSettings) -> Self {
        let area = on_emitters(
            &scene.emitters,
            settings.area_samples,
            settings.turn.unwrap_or(0),
        );
        let lights = (0..).zip(&scene.lights);
        let sources: Vec<Source<'_>> = lights
            .map(|(index, light)| match settings.turn {
                Some(turn) if light.radius > 0.0 => Cow::Owned(within_radius(light, index, turn)),
                _ => Cow::Borrowed(light),
            })
            .map(Source::Punctual)
            .chain(area.into_iter().map(Source::Area))
            .collect();
        let views_at = |sides: &[u32]| -> Vec<Vec<DepthViewSpec>> {
            let of_sources = sources.iter().zip(sides);
            of_sources
                .map(|(source, &side)| source.views(scene, view, settings, side))
                .collect()
        };
        let asked: Vec<u32> = sources.iter().map(|source| source.side(settings)).collect();
        let mut sides = asked.clone();
        let mut views = views_at(&sides);
        if !DepthAtlas::has_room(&views.concat()) {
            let radius = scene.diagonal() / 2.0;
            let demands: Vec<Demand> = sources
                .iter()
                .zip(&asked)
                .zip(&views)
                .map(|((source, &side), views)| Demand {
                    side,
                    squares: squares(views, side),
                    power: source.sample().power(radius),
                })
                .collect();
            let area = (ATLAS_SIDE as f32).powi(2);
            sides = share(&demands, area, |sides| {
                DepthAtlas::has_room(&views_at(sides).concat())
            });
            views = views_at(&sides);
        }
        let (punctual, area) = sides.split_at(scene.lights.len());
        let notes = [
            note("lights", punctual, settings.resolution),
            note("samples of area lights", area, settings.area_resolution),
        ];
        let mut list = Self {
            notes: notes.into_iter().flatten().collect(),
            ..Self::default()
        };
        for (source, views) in sources.iter().zip(views) {
            list.samples.push(LightSample {
                first_view: list.views.len() as u32,
                view_count: views.len() as u32,
                ..source.sample()
            });
            list.views.extend(views);
        }
        list
    }
}

/// The total area of the views in units of squares of `side` texels.
fn squares(views: &[DepthViewSpec], side: u32) -> f32 {
    let texels = |view: &DepthViewSpec| view.size[0] as f32 * view.size[1] as f32;
    views.iter().map(texels).sum::<f32>() / (side as f32).powi(2)
}

/// Describes the range of map sides if some are smaller than `asked`.
fn note(lights: &str, sides: &[u32], asked: u32) -> Option<String> {
    let (least, most) = (sides.iter().min()?, sides.iter().max()?);
    let texels = if least == most {
        least.to_string()
    } else {
        format!("{least} to {most}")
    };
    (*least < asked).then(|| {
        let count = sides.len();
        format!(
            "{count} {lights} share the shadow atlas: {texels} texels per face instead of {asked}"
        )
    })
}

impl Source<'_> {
    fn sample(&self) -> LightSample {
        match self {
            Self::Punctual(light) => punctual(light),
            Self::Area(sample) => *sample,
        }
    }

    /// Side of its views if there is room (texels).
    fn side(&self, settings: &MapSettings) -> u32 {
        match self {
            Self::Punctual(_) => settings.resolution,
            Self::Area(_) => settings.area_resolution,
        }
    }

    /// Views of `side` texels, unless there are to be none: six faces for a point light, five or ten for an area sample. A spot or directional light
    /// has the views that follow the camera first (cascades, a warped view). With [`MapSettings::beyond_camera`], and
    /// for a spot light without a warped view, a view of everything that it may light comes last; that of a directional
    /// light shows the scene's core, beyond which nothing is in shadow.
    fn views(
        &self,
        scene: &GpuScene,
        view: &View,
        settings: &MapSettings,
        side: u32,
    ) -> Vec<DepthViewSpec> {
        if settings.unshadowed {
            return Vec::new();
        }
        let near = scene.near();
        let gutter = |gutter: u32| gutter.min(side / 8);
        let light = match self {
            Self::Punctual(light) => light,
            Self::Area(sample) => {
                let [position, normal, tangent] =
                    [sample.position, sample.direction, sample.tangent].map(Vec3::from_array);
                let gutter = gutter(settings.gutters[0]);
                return if sample.kind == LightSample::AREA_TWO_SIDED {
                    DepthViewSpec::hemicubes(position, normal, tangent, near, side, gutter).to_vec()
                } else {
                    DepthViewSpec::hemicube(position, normal, tangent, near, side, gutter).to_vec()
                };
            }
        };
        let (position, direction) = (light.position(), light.direction());
        let bounds = &scene.bounds;
        let gutter = gutter(settings.gutters[usize::from(light.radius > 0.0)]);
        let mut views = match light.kind {
            LightKind::Point => DepthViewSpec::cube(position, near, side, gutter).to_vec(),
            LightKind::Spot {
                outer_cone_angle, ..
            } => {
                let tangent = outer_cone_angle.clamp(0.01, 1.55).tan();
                let up = direction.any_orthonormal_vector();
                let all = DepthViewSpec::perspective(
                    position, direction, up, tangent, near, side, gutter,
                );
                match (settings.warp, settings.beyond_camera) {
                    (false, _) => vec![all],
                    (true, false) => vec![warped(all, direction, bounds, view, gutter)],
                    (true, true) => vec![warped(all, direction, bounds, view, gutter), all],
                }
            }
            LightKind::Directional => {
                let mut views = cascades(direction, settings.cascades, side, scene, view);
                if settings.beyond_camera {
                    views.push(DepthViewSpec::around_core(direction, scene, side, gutter));
                }
                views
            }
        };
        for view in &mut views {
            view.second_depth = settings.second_depth;
        }
        views
    }
}
