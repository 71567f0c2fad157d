//! Path tracing: at each point, a few paths look for all light that the techniques before this one leave out.
//! docs/techniques/path-tracing.md.

mod cache;
mod default_set;
mod passes;
#[cfg(test)]
mod tests;

use super::{
    Cost, Earlier, Generated, Info, Inspection, Needs, Plan, Registration, Role, Technique, Unready,
};
use crate::capture::{Output, Receiver, View};
use crate::gpu::{Frame, GpuError};
use crate::light_paths::{LightClass, LightPaths, PathFilter, overlap};
use crate::scene::{Claims, GpuScene, Object};
use crate::settings::SettingSet;
use crate::stage::Stage;
use passes::{Constants, Lights, Passes};

/// All paths whose last vertex before the eye lies on a surface.
const ALL: &str = "L.*[DGS]E";
/// The same without caustics: no mirror or glass lies between a light and the first surface that scatters its light.
const WITHOUT_CAUSTICS: &str = "L([DGV].*[DGS]|[DG]|S+)E";
/// The same without light straight from lights.
const INDIRECT: &str = "L.+[DGS]E";
const INDIRECT_WITHOUT_CAUSTICS: &str = "L[DGV].*[DGS]E";

/// Name, summary, source and light paths of the technique.
pub const INFO: Info = Info {
    name: "path-tracing",
    summary: "all light that the techniques before it leave out, by a few paths per point",
    source: "Kajiya 1986; Veach 1997",
    paths: &[
        // Paths that leave a light without extent are not found behind mirrors and glass.
        LightPaths::new(LightClass::Punctual, "L([DGV].*[DGS]|[DG])E"),
        LightPaths::new(LightClass::Area, ALL),
        LightPaths::new(LightClass::Environment, ALL),
    ],
    role: Role::Everything,
    needs: Needs::RAYS,
    cost: Cost::Frame,
    is_noisy: true,
    ..Info::BASE
};

/// Its entry in the registry.
pub const REGISTRATION: Registration = Registration {
    info: &INFO,
    fields: Settings::fields,
    make: |_, _| Ok(Box::new(PathTracing::default())),
    suits: default_set::suits,
    settings: |_| Vec::new(),
};

crate::settings! {
    /// Settings of path-tracing.
    #[derive(Copy)]
    pub struct Settings {
        /// Paths per point in each sample of a picture.
        pub samples: u32 = 1 => in_range(1.0, 64.0).unit("paths"),
        /// Most surfaces on a path between the light and the eye. With the cache, light may have met more of them in earlier
        /// frames.
        pub bounces: u32 = 16 => in_range(1.0, 64.0),
        /// Whether it adds light of lamps and the sky that mirrors and glass throw on other surfaces, unless a technique
        /// before it does. Paths find such light by chance: it is noisy.
        pub caustics: bool = true => any(),
        /// Whether paths of live pictures end on light that earlier frames have found.
        pub cache: bool = true => any(),
    }
}

/// Path tracing.
#[derive(Debug, Default)]
pub struct PathTracing {
    settings: Settings,
    /// What it adds.
    pattern: &'static str,
    passes: Stage<Constants, Passes>,
    lights: Lights,
    /// Whether passes know of a tree of lights.
    had_tree: bool,
    /// Most paths in flight, if not as many as the adapter's kind suggests.
    most_paths: Option<u32>,
    /// Places that are remembered of each block of 8 x 8 points, if not [`cache::PLACES_OF_BLOCK`].
    places_of_block: Option<u32>,
}

impl Technique for PathTracing {
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
        let patterns = [ALL, WITHOUT_CAUSTICS, INDIRECT, INDIRECT_WITHOUT_CAUSTICS];
        let patterns = patterns.iter().enumerate();
        let mut patterns = patterns.filter(|(index, _)| self.settings.caustics || index % 2 == 1);
        let paths = |pattern| paths(pattern, &scene.light_classes());
        let fitting = patterns.find(|(_, pattern)| overlap(covered, &paths(pattern)).is_none());
        // If none fits, lighting tells the user what overlaps.
        self.pattern = fitting.map_or(INDIRECT_WITHOUT_CAUSTICS, |(_, pattern)| pattern);
        // Cameras see glass whole: paths pass through it.
        let claim = |object: &Object| match object.is_transmissive {
            true => Claims::TRANSMISSION,
            false => Claims::NONE,
        };
        Plan {
            claims: scene.objects.iter().map(claim).collect(),
            lookups: 4 * self.settings.samples,
            ..Plan::adding(paths(self.pattern), scene)
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
        let gpu = frame.gpu;
        self.lights.follow(gpu, scene)?;
        let shows_lights = [ALL, WITHOUT_CAUSTICS].contains(&self.pattern);
        let bounces = self.settings.bounces;
        let of_light = (shows_lights, self.had_tree);
        let constants = Constants::of(scene, self.pattern, bounces, of_light);
        self.had_tree = constants.has_tree();
        let pattern = self.pattern;
        let made_for = constants.clone();
        self.passes.compiled(frame, made_for, |_| {
            let filter = PathFilter::new(pattern).expect("a pattern");
            Passes::new(gpu, scene, &constants, &filter)
        })?;
        if let Some(passes) = self.passes.get_mut() {
            passes.settle(frame, scene.versions)?;
        }
        Ok(Generated::FINAL)
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        // Paths begin at surfaces.
        if ![Output::RadianceToEye, Output::Irradiance].contains(&receiver.points.output) {
            return Ok(());
        }
        let Some(passes) = self.passes.get_mut() else {
            return Ok(());
        };
        let places_of_block = self.places_of_block.unwrap_or(cache::PLACES_OF_BLOCK);
        let settings = (&self.settings, self.most_paths, places_of_block);
        passes.record(frame, scene, receiver, &self.lights, settings)
    }

    fn inspect(&self) -> Inspection {
        Inspection {
            work_bytes: self.passes.get().map_or(0, Passes::bytes),
            ..Inspection::default()
        }
    }
}

/// The paths of a pattern that are found, of some classes of light.
fn paths(pattern: &'static str, classes: &[LightClass]) -> Vec<LightPaths> {
    let of_class = |class: &LightClass| {
        let pattern = match (class, pattern) {
            (LightClass::Punctual, ALL | WITHOUT_CAUSTICS) => INFO.paths[0].pattern.clone(),
            (LightClass::Punctual, _) => INDIRECT_WITHOUT_CAUSTICS.into(),
            _ => pattern.into(),
        };
        LightPaths {
            class: *class,
            pattern,
        }
    };
    classes.iter().map(of_class).collect()
}
