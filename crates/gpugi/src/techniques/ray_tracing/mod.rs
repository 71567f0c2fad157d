//! Ray tracing: exact recursive reflections and refractions on chosen objects (tutorial section 4).
//!
//! Gather: rays start at a receiver's points on these objects. What a generation of rays hits becomes surface points,
//! which the techniques before this one light, and from which the next generation starts.
//! docs/techniques/ray-tracing.md.

mod gpu;
mod passes;

use super::{Earlier, Generated, Info, Inspection, Plan, Technique, distance_impostor};
use crate::capture::{Output, Receiver, View};
use crate::gpu::{Frame, GpuError};
use crate::light_paths::{LightClass, LightPaths, SEEN_DIRECTLY};
use crate::scene::{Claims, GpuScene, Object};
use crate::settings::SettingSet;
use passes::Passes;

/// Name, summary, source and light paths of the technique.
pub const INFO: Info = Info {
    name: "ray-tracing",
    summary: "exact recursive reflections and refractions of lit surroundings, on chosen objects",
    source: "tutorial section 4; Carr, Hall and Hart 2002",
    paths: distance_impostor::INFO.paths,
    suits: |_| false,
    keeps_texels: true,
    lights_points: true,
};

crate::settings! {
    /// Settings of ray-tracing.
    pub struct Settings {
        /// Most reflections and refractions on a path.
        pub bounces: u32 = 8 => in_range(1.0, 16.0),
        /// Objects whose rays are traced: names separated by commas, * for any characters; auto: those with ideal
        /// surfaces. They take the place of objects of distance-impostor.
        pub objects: String = AUTO.to_owned() => any(),
    }
}

/// The value of [`Settings::objects`] that leaves the choice to gpugi.
const AUTO: &str = "auto";

/// Ray tracing.
#[derive(Debug, Default)]
pub struct RayTracing {
    settings: Settings,
    /// Whether any object is traced.
    has_objects: bool,
    passes: Option<Passes>,
    /// With which constants the passes are compiled.
    compiled_for: Option<[(&'static str, f64); 1]>,
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
        let is_traced = |object: &&Object| match list {
            AUTO => object.is_smooth,
            list => object.is_named_by(list) && !object.is_diffuse,
        };
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
        let lobes = match (is_smooth, is_rough) {
            (true, true) => "[GS]",
            (false, _) => "G",
            (true, false) => "S",
        };
        let most = self.settings.bounces;
        let mut paths = Vec::new();
        if self.has_objects {
            let bounces = format!("{lobes}{{1,{most}}}");
            paths.extend(covered.iter().map(|one| one.continued(&bounces)));
        }
        if is_smooth {
            // Other techniques add lights on rough lobes.
            let bounces = format!("S{{1,{most}}}");
            for class in [LightClass::Area, LightClass::Environment] {
                paths.push(LightPaths::new(class, SEEN_DIRECTLY).continued(&bounces));
            }
        }
        Plan {
            paths,
            claims: scene.objects.iter().map(claim).collect(),
            object_names: match list {
                AUTO => String::new(),
                list => list.to_owned(),
            },
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
    ) -> Result<Generated, GpuError> {
        if !scene.has_rays() {
            return Err(GpuError::Pass {
                pass: INFO.name.into(),
                reason: "the scene was uploaded without rays: use GpuScene::with_texels".into(),
            });
        }
        let constants = Some(scene.ray_constants());
        if self.has_objects && self.compiled_for != constants {
            self.passes = Some(Passes::new(frame.gpu, scene, &self.settings)?);
            self.compiled_for = constants;
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
        match &mut self.passes {
            Some(passes) => passes.record(frame, scene, receiver, &self.settings, earlier),
            None => Ok(()),
        }
    }

    fn inspect(&self) -> Inspection {
        Inspection {
            work_bytes: self.passes.as_ref().map_or(0, Passes::bytes),
            ..Inspection::default()
        }
    }
}
