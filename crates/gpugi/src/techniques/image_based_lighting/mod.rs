//! Image-based lighting: the environment as directional lights with shadows (tutorial section 3.2.3).
//!
//! Generate: splits the environment into N directional domains (domains.rs), each with a depth map that covers the
//! scene; the maps lie in batches with one atlas per batch (batches.rs). Or draws directions anew for each sample of a
//! picture (draws.rs), where the camera sees the environment (survey.rs). Gather: sums visibility times light times
//! average reflectivity over the domains. docs/techniques/image-based-lighting.md.

mod batches;
mod default_set;
mod delaunay;
mod domains;
mod draws;
pub(crate) mod gpu;
mod ratio;
mod rays;
mod survey;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use batches::{Batches, DepthMaps, GUTTER};
pub use domains::{Decomposition, Domain, DomainsOnTheWay};
use draws::{CellsOfSky, CellsOnTheWay};
use glam::Vec3;
use ratio::RatioPass;
use rays::{RayGather, Variant};
use survey::Survey;

use super::{
    Earlier, Generated, Info, Inspection, Map, Plan, Registration, Role, Technique, Unready,
};
use crate::capture::depth::{ATLAS_SIDE, DepthDrawing, DepthViewSpec, Rasterizer};
use crate::capture::{Receiver, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::light_paths::{LightClass, LightPaths};
use crate::prefiltered::{Prefiltered, PrefilteredRequest};
use crate::scene::{Claims, GpuScene, Inputs, Versions};
use crate::settings::SettingSet;
use crate::stage::Stage;

/// Name, summary, source and light paths of the technique.
pub const INFO: Info = Info {
    name: "image-based-lighting",
    summary: "direct light of the environment with shadows",
    source: "tutorial section 3.2.3; Lloyd 1982; Agarwal et al. 2003",
    paths: &[LightPaths::new(LightClass::Environment, "LS*[DG]E")],
    role: Role::Direct,
    ..Info::BASE
};

/// Its entry in the registry.
pub const REGISTRATION: Registration = Registration {
    info: &INFO,
    fields: Settings::fields,
    make: |gpu, scene| Ok(Box::new(ImageBasedLighting::new(gpu, scene)?)),
    suits: |occasion| Some(occasion.has_lights(INFO.paths)),
    settings: default_set::settings,
};

/// The light in scenes without glass.
const DIRECT: &[LightPaths] = &[LightPaths::new(LightClass::Environment, "L[DG]E")];

crate::choices! {
    /// How relaxation spreads directions.
    pub enum Spread {
        /// Tends to a density proportional to the power: centroids weighted by the square of the radiance.
        Power = "power",
        /// Tends to a density proportional to the root of the power: centroids weighted by the radiance.
        Root = "root",
    }
}

crate::choices! {
    /// How the average reflectivity of a domain is found.
    pub enum Reflectivity {
        /// Reflectivity in the domain's direction.
        Sample = "sample",
        /// Glossy lobes blurred by the solid angle that the domain's light comes from.
        Lobe = "lobe",
        /// Environment-map's prefiltered light of each lobe, times the fraction of it that the domains see.
        Ratio = "ratio",
    }
}

crate::choices! {
    /// How it is found whether a point sees the environment in a direction.
    pub enum Visibility {
        /// By a depth map of the direction.
        Maps = "maps",
        /// By a ray: exact.
        Rays = "rays",
    }
}

crate::settings! {
    /// Settings of image-based lighting.
    pub struct Settings {
        /// Number of directions drawn from the environment.
        pub samples: u32 = 128 => in_range(1.0, 2048.0),
        /// Most steps of Lloyd's relaxation.
        pub iterations: u32 = 4 => in_range(0.0, 256.0),
        /// Density that relaxed directions tend to: power, proportional to the power, or root, to its root.
        pub spread: Spread = Spread::Root => any(),
        /// How the average reflectivity of a domain is found: sample, in its direction; lobe, the mean of each lobe;
        /// ratio, prefiltered light times the fraction that the domains see.
        pub reflectivity: Reflectivity = Reflectivity::Lobe => any(),
        /// How it is found whether a point sees the environment in a direction: maps, by a depth map of the direction;
        /// rays, exactly, by a ray from each point.
        pub visibility: Visibility = Visibility::Maps => any(),
        /// Side of each direction's depth map.
        pub resolution: u32 = 512 => in_range(16.0, 4096.0).unit("texels"),
        /// Memory for depth maps. Maps that do not fit together are drawn and gathered batch by batch, again in every
        /// frame.
        pub memory: u32 = 1024 => in_range(16.0, 65536.0).unit("MiB"),
        /// Rasterizer of the depth maps: hardware, compute (for small triangles), or auto.
        pub rasterizer: Rasterizer = Rasterizer::Auto => any(),
        /// Fraction of the casters' triangles in depth maps: below 1, meshes are simplified.
        pub caster_detail: f32 = 1.0 => in_range(0.0, 1.0),
        /// Whether each sample of a picture is lit from other directions. Its shadows become exact with the number of
        /// samples; each draws its own maps. Maps of other techniques are lit from the domains only if they are made
        /// before the first sample (Renderer::converge).
        pub per_sample: bool = false => any(),
    }
}

/// Directions, and the views of their depth maps.
type DirectionsAndViews = (Vec<gpu::Direction>, Vec<DepthViewSpec>);

/// Image-based lighting.
#[derive(Debug)]
pub struct ImageBasedLighting {
    settings: Settings,
    decomposition: Decomposition,
    /// Where the light comes from.
    sources: Stage<SourcesKey, Sources>,
    /// The same, on their way from the GPU, in the order in which frames asked for them.
    on_the_way: VecDeque<SourcesOnTheWay>,
    batches: Stage<BatchesKey, Batches>,
    /// For [`Visibility::Rays`], once generated.
    rays: Stage<Variant, RayGather>,
    /// With [`Settings::per_sample`], what the camera sees of the environment; by whether casters let light through.
    survey: Stage<bool, Survey>,
    /// Largest side of an atlas (texels).
    atlas_side: u32,
    /// For [`Reflectivity::Ratio`], once generated.
    ratio: Stage<Prefiltered, RatioPass>,
    /// The maps, with the sample of the picture if each has its own.
    maps: Stage<(Versions, Settings, Option<u32>)>,
}

/// What the passes over maps are compiled for: reflectivity, whether casters let light through, and whether there are
/// media.
type BatchesKey = (Reflectivity, bool, bool);

fn batches_key(scene: &GpuScene, reflectivity: Reflectivity) -> BatchesKey {
    let is_see_through = scene.has_see_through(Claims::NONE);
    (reflectivity, is_see_through, !scene.media.is_empty())
}

/// The version of the environment's texels and the settings for which sources are computed.
type SourcesKey = (u64, Settings);

/// Where the light of an environment comes from.
#[derive(Debug)]
struct Sources {
    /// For all samples of a picture alike.
    domains: Vec<Domain>,
    /// With [`Settings::per_sample`], what is drawn from for each sample.
    cells: Option<CellsOfSky>,
}

/// [`Sources`] on their way from the GPU.
#[derive(Debug)]
struct SourcesOnTheWay {
    of: SourcesKey,
    domains: DomainsOnTheWay,
    cells: Option<CellsOnTheWay>,
}

impl SourcesOnTheWay {
    /// The sources, once everything has arrived.
    fn get(&self) -> Option<Result<Sources, GpuError>> {
        let domains = self.domains.get()?;
        let cells = match &self.cells {
            Some(cells) => Some(cells.get()?),
            None => None,
        };
        Some(domains.and_then(|domains| {
            Ok(Sources {
                domains,
                cells: cells.transpose()?,
            })
        }))
    }
}

impl Settings {
    /// Each direction that has light, in world space, and the view of its depth map.
    fn directions(&self, scene: &GpuScene, domains: &[Domain]) -> DirectionsAndViews {
        let side = self.resolution;
        let Some(environment) = &scene.environment else {
            return Default::default();
        };
        let world_from_map = environment.rotation;
        let lit = domains.iter().filter_map(|domain| {
            let flux_density = domain.flux_density * scene.environment_factor();
            let toward = world_from_map * domain.toward;
            (flux_density != Vec3::ZERO).then(|| {
                let view = DepthViewSpec::around_core(-toward, scene, side, GUTTER);
                let direction = gpu::Direction {
                    toward: toward.to_array(),
                    solid_angle: domain.lit_solid_angle,
                    flux_density: flux_density.to_array(),
                    texel: view.texel,
                };
                (direction, view)
            })
        });
        lit.unzip()
    }
}

impl ImageBasedLighting {
    /// Compiles the technique's passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let settings = Settings::default();
        let mut made = Self {
            decomposition: Decomposition::new(gpu, scene)?,
            sources: Stage::default(),
            on_the_way: VecDeque::new(),
            batches: Stage::default(),
            rays: Stage::default(),
            survey: Stage::default(),
            atlas_side: ATLAS_SIDE,
            ratio: Stage::default(),
            settings,
            maps: Stage::default(),
        };
        let key @ (reflectivity, is_see_through, _) =
            batches_key(scene, made.settings.reflectivity);
        made.batches
            .keep(key, |_| Batches::new(gpu, scene, reflectivity))?;
        made.survey
            .keep(is_see_through, |_| Survey::new(gpu, is_see_through))?;
        Ok(made)
    }

    /// Finds where the light comes from; again only when texels or settings have changed: a new rotation or intensity
    /// keeps it. False while that is on its way from the GPU: the sources are those of a frame before then, if any. A sky
    /// that changes in every frame is followed, as late as its sources arrive.
    fn find_sources(&mut self, frame: &mut Frame<'_>, scene: &GpuScene) -> Result<bool, GpuError> {
        if scene.environment.is_none() {
            self.sources.clear();
            self.on_the_way.clear();
            return Ok(true);
        }
        while let Some(found) = self.on_the_way.front().and_then(SourcesOnTheWay::get)
            && let Some(SourcesOnTheWay { of, .. }) = self.on_the_way.pop_front()
        {
            self.maps.restart();
            self.sources.keep(of, |_| found)?;
        }
        let key = (scene.versions.environment, self.settings.clone());
        self.sources.ask(key.clone());
        if self.sources.is_current() {
            return Ok(true);
        }
        if self.on_the_way.back().is_some_and(|last| last.of == key) {
            return Ok(false);
        }
        let domains = self.decomposition.decompose(frame, scene, &self.settings)?;
        let cells = match self.settings.per_sample {
            true => self.decomposition.cells(frame)?,
            false => None,
        };
        self.on_the_way
            .extend(domains.map(|domains| SourcesOnTheWay {
                of: key,
                domains,
                cells,
            }));
        Ok(false)
    }
}

impl Technique for ImageBasedLighting {
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
        // Straight through glass; what mirrors throw is missing.
        let paths = if scene.has_clear_objects() {
            INFO.paths
        } else {
            DIRECT
        };
        Plan {
            lookups: self.settings.samples * u32::from(scene.environment.is_some()),
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
        let gpu = frame.gpu;
        let versions = scene.versions.of(Inputs::LIGHTS.without());
        // What is lit for all samples, such as texels, takes the domains after `Renderer::converge`. Without it, it is
        // lit in a picture's samples, from the directions of the sample in which it is lit.
        let sample = view.uniform.sample_index;
        let turn = (self.settings.per_sample && sample != View::NO_SAMPLE).then_some(sample);
        self.maps.ask((versions, self.settings.clone(), turn));
        let reflectivity = self.settings.reflectivity;
        let mut of_maps = Generated::FINAL;
        if reflectivity != Reflectivity::Ratio || scene.environment.is_none() {
            self.ratio.clear();
        } else {
            let (found, generated) =
                earlier.prefiltered(frame, scene, PrefilteredRequest::default(), true)?;
            self.ratio
                .keep(found.clone(), |_| RatioPass::new(gpu, scene, found))?;
            of_maps = generated;
        }
        let of_environment = of_maps.revision;
        of_maps.revision += self.maps.revision();
        let are_current = self.maps.is_current();
        let are_late = are_current && !self.on_the_way.is_empty();
        if of_maps.pending.is_some() || (are_current && !are_late) {
            return Ok(of_maps);
        }
        let key @ (_, is_see_through, _) = batches_key(scene, reflectivity);
        let batches = self
            .batches
            .compiled(frame, key, |_| Batches::new(gpu, scene, reflectivity))?;
        self.survey
            .compiled(frame, is_see_through, |_| Survey::new(gpu, is_see_through))?;
        if self.settings.visibility == Visibility::Rays {
            let variant = Variant::new(scene, reflectivity);
            self.rays
                .compiled(frame, variant, |_| RayGather::new(gpu, scene, variant))?;
        } else {
            self.rays.clear();
        }
        let maps = DepthMaps {
            atlas_side: self.atlas_side,
            memory: u64::from(self.settings.memory) << 20,
            drawing: DepthDrawing {
                rasterizer: self.settings.rasterizer,
                caster_detail: self.settings.caster_detail,
            },
        };
        let are_cast = batches.prepare(frame, scene, &maps.drawing)?;
        // Live views keep the earlier maps; but ratios are of prefiltered light, which has changed already.
        let has_maps = earlier.budget.is_limited()
            && reflectivity != Reflectivity::Ratio
            && self.maps.begun().is_some();
        let waiting = |what| Generated {
            progress: 0.0,
            pending: (!has_maps).then_some(what),
            ..of_maps
        };
        if !are_cast {
            return Ok(waiting("simplified casters"));
        }
        let are_found = self.find_sources(frame, scene)?;
        // No live frame waits for what is read back: the directions are those of an earlier sky until then, and their maps
        // show the scene as it is. All samples of a still picture depend on the survey of its own sky.
        let may_be_late =
            earlier.budget.is_limited() || (frame.never_waits() && !self.settings.per_sample);
        if !are_found && (self.sources.get().is_none() || !may_be_late) {
            return Ok(waiting("the domains of the environment"));
        }
        if !are_found {
            of_maps.progress = of_maps.progress.min(self.sources.progress(1, 1));
        }
        if self.maps.is_current() {
            return Ok(of_maps);
        }
        let (Some(batches), Some(survey)) = (self.batches.get_mut(), self.survey.get_mut()) else {
            return Ok(of_maps);
        };
        let sources = self.sources.get();
        let mut domains = sources.map_or(&[][..], |sources| &sources.domains);
        let of_sample;
        if let Some(cells) = sources.and_then(|sources| sources.cells.as_ref()) {
            let environment = self
                .sources
                .begun()
                .map_or(0, |(environment, _)| *environment);
            let of_cells = Versions {
                environment,
                ..versions
            };
            let key = survey::Key::new(of_cells, &self.settings, view);
            // Survey maps replace those that a live view shows.
            let draws = if earlier.budget.is_limited() {
                survey.latest(key, cells)
            } else {
                let kernels = earlier.shared.impostors.capture_kernels();
                if !survey.is_current(&key) {
                    self.maps.restart();
                }
                let maps = (&mut *batches, &maps);
                let draws = survey.draws(frame, scene, (key, view), cells, maps, kernels)?;
                let Some(draws) = draws else {
                    return Ok(waiting("a survey of the environment"));
                };
                draws
            };
            if let Some(turn) = turn {
                of_sample = draws.of_sample(turn);
                domains = &of_sample;
            }
        }
        let (directions, views) = self.settings.directions(scene, domains);
        // What moves is followed map by map; another sky, at once.
        if has_maps && self.rays.get().is_none() && batches.has_maps_toward(scene, &directions) {
            let (lights, budget) = ((&directions[..], &views[..]), &mut earlier.budget);
            let progress = batches.draw_some(frame, scene, lights, budget)?;
            if progress >= 1.0 {
                self.maps.begin();
            }
            self.maps.improve();
            return Ok(Generated {
                revision: of_environment + self.maps.revision(),
                progress: of_maps.progress.min(progress),
                ..of_maps
            });
        }
        match self.rays.get_mut() {
            Some(rays) => rays.set(gpu, &directions)?,
            None => batches.generate(frame, scene, (&directions, &views), &maps)?,
        }
        self.maps.begin();
        // Earlier maps were lit by meanwhile.
        if has_maps || are_late {
            self.maps.improve();
        }
        Ok(Generated {
            revision: of_environment + self.maps.revision(),
            ..of_maps
        })
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        let sums = match self.ratio.get_mut() {
            Some(ratio) => &ratio.begin(frame, receiver)?,
            None => receiver,
        };
        match (self.rays.get(), self.batches.get_mut()) {
            (Some(rays), _) => rays.gather(frame, scene, sums)?,
            (None, Some(batches)) => batches.gather(frame, scene, sums)?,
            (None, None) => (),
        }
        match self.ratio.get_mut() {
            Some(ratio) => ratio.apply(frame, scene, receiver),
            None => Ok(()),
        }
    }

    fn inspect(&self) -> Inspection {
        let atlas = self.batches.get().and_then(Batches::atlas);
        let maps = [
            ("atlas", atlas.map(|atlas| &atlas.texture)),
            ("domains", self.decomposition.owners()),
        ];
        let map = |(name, texture): (&str, Option<&_>)| {
            Some(Map::of_texture(format!("{}.{name}", INFO.name), texture?))
        };
        Inspection::of(maps.into_iter().filter_map(map))
    }
}
