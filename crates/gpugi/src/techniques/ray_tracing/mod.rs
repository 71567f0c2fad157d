//! Ray tracing: exact recursive reflections and refractions on chosen objects (tutorial section 4).
//!
//! Gather: rays start at a receiver's points on these objects. What a generation of rays hits becomes surface points,
//! which the techniques before this one light, and from which the next generation starts.
//! docs/techniques/ray-tracing.md.

mod default_set;
mod gpu;
mod passes;
#[cfg(test)]
mod tests;

use super::{
    AUTO, Cost, Earlier, Figure, Generated, Info, Inspection, Needs, OwnPoints, Plan, Registration,
    Role, Technique, Unready, chooses, distance_impostor, named,
};
use crate::capture::{Output, Receiver, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::light_paths::{LightPaths, SEEN_LIGHTS, shown};
use crate::scene::{Claims, GpuScene, Object};
use crate::settings::SettingSet;
use crate::stage::Stage;
use passes::{MOST_RAYS, Passes};

/// Name, summary, source and light paths of the technique.
pub const INFO: Info = Info {
    name: "ray-tracing",
    summary: "exact recursive reflections and refractions of lit surroundings, on chosen objects",
    source: "tutorial section 4; Carr, Hall and Hart 2002",
    paths: distance_impostor::INFO.paths,
    role: Role::Gloss,
    needs: Needs::RAYS,
    cost: Cost::Picture,
    lights_points: OwnPoints::TowardEye,
    ..Info::BASE
};

/// Its entry in the registry.
pub const REGISTRATION: Registration = Registration {
    info: &INFO,
    fields: Settings::fields,
    make: |_, _| Ok(Box::new(RayTracing::default())),
    suits: |occasion| occasion.has_wide_lobes(),
    settings: default_set::settings,
};

crate::choices! {
    /// How rays find their closest hits. All tracers find the same.
    pub enum Tracer {
        /// In the scene's hierarchy of bounding volumes.
        Bvh = "bvh",
        /// By a test against every triangle: the tutorial's ray engine.
        Engine = "engine",
        /// By a test against every triangle that cones around tiles of rays do not exclude.
        Cones = "cones",
    }
}

crate::choices! {
    /// Whether the environment is all that rays see.
    pub enum SeenEnvironment {
        /// Behind lit surroundings and lamps.
        Behind = "behind",
        /// It alone: what else rays hit is black.
        Only = "only",
    }
}

crate::settings! {
    /// Settings of ray-tracing.
    pub struct Settings {
        /// How rays find their closest hits: bvh, in a hierarchy; engine, among all triangles; cones, among those that
        /// cones around tiles of rays do not exclude.
        pub tracer: Tracer = Tracer::Bvh => any(),
        /// Most reflections and refractions on a path.
        pub bounces: u32 = 8 => in_range(1.0, 16.0),
        /// Surfaces from the eye on at which both the reflected and the refracted ray are followed; at others, one is
        /// drawn for each sample. Each doubles the memory of the rays.
        pub split: u32 = 0 => in_range(0.0, 4.0),
        /// What rays see: behind, lit surroundings, lamps, and the environment behind them; only, the environment, with
        /// anything in front of it black.
        pub environment: SeenEnvironment = SeenEnvironment::Behind => any(),
        /// Objects whose rays are traced: names separated by commas, * for any characters; auto: those with ideal
        /// surfaces. They take the place of objects of distance-impostor.
        pub objects: String = AUTO.to_owned() => any(),
    }
}

/// Beyond this many triangles, testing every one deserves a warning.
const MOST_TRIANGLES: u32 = 100_000;

/// Constants of the passes' shaders.
type Constants = [(&'static str, f64); 3];

/// Ray tracing.
#[derive(Debug, Default)]
pub struct RayTracing {
    settings: Settings,
    /// Whether any object is traced.
    has_objects: bool,
    /// By the constants and the tracer that they are compiled for.
    passes: Stage<(Constants, Tracer), Passes>,
    /// Most rays in flight, if not [`MOST_RAYS`].
    most_rays: Option<u64>,
}

impl Technique for RayTracing {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn settings(&self) -> &dyn SettingSet {
        &self.settings
    }

    fn settings_mut(&mut self) -> &mut dyn SettingSet {
        &mut self.settings
    }

    fn plan(&mut self, scene: &GpuScene, covered: &[LightPaths], _: &[Claims]) -> Plan {
        let list = self.settings.objects.as_str();
        let is_traced =
            |object: &&Object| chooses(list, object, object.is_smooth, !object.is_diffuse);
        let claim = |object: &Object| {
            let surface = Claims::RAYS | Claims::SPECULAR | Claims::GLOSSY;
            match (is_traced(&object), object.is_transmissive) {
                (false, _) => Claims::NONE,
                (true, false) => surface,
                (true, true) => surface | Claims::TRANSMISSION | Claims::REFRACTION,
            }
        };
        let traced = || scene.objects.iter().filter(is_traced);
        self.has_objects = traced().next().is_some();
        let is_smooth = traced().any(|object| object.is_smooth || object.least_roughness == 0.0);
        let is_rough = traced().any(|object| !object.is_smooth);
        let most = self.settings.bounces;
        let mut paths = Vec::new();
        let sees_only_environment = self.settings.environment == SeenEnvironment::Only;
        if self.has_objects && !sees_only_environment {
            paths.extend(shown(covered, [is_smooth, is_rough], most));
        }
        if is_smooth {
            // Other techniques add lights on rough lobes.
            let lights = &SEEN_LIGHTS[..if sees_only_environment { 1 } else { 2 }];
            paths.extend(shown(lights, [true, false], most));
        }
        Plan {
            paths,
            claims: scene.objects.iter().map(claim).collect(),
            object_names: named(list),
            lookups: most,
            needs: None,
        }
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        _: &View,
        _: &mut Earlier<'_>,
    ) -> Result<Generated, Unready> {
        scene.expect_rays(INFO.name)?;
        if self.has_objects {
            let (gpu, settings) = (frame.gpu, &self.settings);
            let [alpha, spheres] = scene.ray_constants();
            let constants = [alpha, spheres, scene.media_constant()];
            let passes = self
                .passes
                .compiled(frame, (constants, settings.tracer), |_| {
                    Passes::new(gpu, scene, settings)
                })?;
            passes.follow(gpu, scene)?;
        }
        Ok(Generated::FINAL)
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        earlier: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        // Reflections and refractions exist toward an eye only.
        if !self.has_objects || receiver.points.output != Output::RadianceToEye {
            return Ok(());
        }
        let Some(passes) = self.passes.get_mut() else {
            return Ok(());
        };
        let media = earlier.media_sources();
        let settings = (&self.settings, self.most_rays.unwrap_or(MOST_RAYS));
        passes.record(frame, scene, receiver, settings, media, earlier)
    }

    fn inspect(&self) -> Inspection {
        let triangles = self.passes.get().map_or(0, Passes::triangles);
        let warning = format!(
            "ray-tracing tests its rays against all {triangles} triangles, which is slow: ray-tracing.tracer=bvh \
             needs a few tests per ray"
        );
        Inspection {
            work_bytes: self.passes.get().map_or(0, Passes::bytes),
            warnings: Vec::from_iter((triangles > MOST_TRIANGLES).then_some(warning)),
            ..Inspection::default()
        }
    }

    fn figures(&mut self, gpu: &Gpu) -> Result<Vec<Figure>, GpuError> {
        let figures = self.passes.get().map(|passes| passes.figures(gpu));
        figures.unwrap_or_else(|| Ok(Vec::new()))
    }
}
