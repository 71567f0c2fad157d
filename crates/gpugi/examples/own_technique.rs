//! A technique outside gpugi: ambient light in the colour of the sky. docs/adding-a-technique.md walks through it.
//!
//! `cargo run --example own_technique -- ambient.png` renders a built-in scene with its default set, which this technique
//! joins.

use std::error::Error;
use std::ops::ControlFlow;

use gpugi::capture::{Gather, Receiver, View};
use gpugi::gpu::{AdapterChoice, Frame, Gpu, GpuError, Shader};
use gpugi::light_paths::{LightClass, LightPaths};
use gpugi::picture::Effects;
use gpugi::scene::{Claims, GpuScene};
use gpugi::settings::SettingSet;
use gpugi::stage::Stage;
use gpugi::techniques::{
    Earlier, Generated, Info, Plan, Registration, Registry, Role, Technique, Unready,
};
use gpugi::{Purpose, Renderer, default_set, settings};

const INFO: Info = Info {
    name: "sky-ambient",
    summary: "indirect light of the sky, alike at all points: each sees as much sky as its normal faces up",
    source: "hemisphere lighting",
    paths: &[LightPaths::new(LightClass::Environment, "LDD+E")],
    role: Role::Indirect,
    ..Info::BASE
};

settings! {
    /// Settings of the ambient term.
    pub struct Settings {
        /// Part of the sky's light that comes back from other surfaces.
        pub strength: f32 = 0.3 => in_range(0.0, 1.0),
    }
}

/// L = rho / pi E, with E = strength pi L_sky(n): the sky's radiance in the direction of the normal approximates the
/// radiance from all directions around it.
const GATHER: &str = "
override STRENGTH: f32 = 0.3;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) workgroups: vec3u) {
    let lit = lit_point(id, workgroups);
    if !lit.exists {
        return;
    }
    let irradiance = STRENGTH * 3.14159265 * environment_radiance(lit.normal);
    add(lit, diffuse_response(lit) * irradiance);
}
";

#[derive(Debug, Default)]
struct SkyAmbient {
    settings: Settings,
    /// The pass, by the strength that it is compiled for.
    gather: Stage<f32, Gather>,
}

impl Technique for SkyAmbient {
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
        Plan::adding(INFO.paths, scene)
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        _: &View,
        _: &mut Earlier<'_>,
    ) -> Result<Generated, Unready> {
        let strength = self.settings.strength;
        self.gather.compiled(frame, strength, |_| {
            let shader = Shader::gather("sky-ambient.gather", GATHER);
            let constants = [("STRENGTH", f64::from(strength))];
            Gather::new(frame.gpu, scene, &shader, &constants)
        })?;
        Ok(Generated::FINAL)
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        match self.gather.get() {
            Some(gather) => gather.record(frame, "sky-ambient.gather", scene, receiver, &[]),
            None => Ok(()),
        }
    }
}

/// What default sets and renderers know of the technique.
const REGISTRATION: Registration = Registration {
    info: &INFO,
    fields: Settings::fields,
    make: |_, _| {
        Ok(Box::new(SkyAmbient {
            settings: Settings::default(),
            gather: Stage::default(),
        }))
    },
    suits: |occasion| Some(occasion.has_lights(INFO.paths)),
    settings: |_| vec![("strength", 0.5.to_string())],
};

/// gpugi's techniques and this one. Radiosity and final-gather add indirect light, too; the first is the better one.
fn registry() -> Registry {
    let mut registry = Registry::default();
    registry.insert_before("radiosity", REGISTRATION);
    registry
}

fn main() -> Result<(), Box<dyn Error>> {
    let output = std::env::args()
        .nth(1)
        .unwrap_or_else(|| "ambient.png".into());
    let size = [256, 192];
    // The sky alone lights it.
    let scene = gpugi_scene::builtin::builtin("spheres", 1).ok_or("a built-in scene")?;
    let camera = &scene.cameras[0];
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    let registry = registry();
    let set = default_set(&scene, &gpu.adapter, Purpose::StillPicture, &registry);
    for choice in &set.choices {
        println!("{}: {}", choice.technique, choice.reason);
    }
    let mut renderer = Renderer::with_registry(&gpu, &scene, size, &set, &registry)?;
    renderer.converge(camera, false, |_, _| ControlFlow::Continue(()))?;
    renderer.render_sample(camera, 1, Some(&Effects::default()), false)?;
    gpugi_scene::image::save_png(output.as_ref(), size[0], size[1], &renderer.pixels()?)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use gpugi_scene::Scene;
    use gpugi_scene::builtin::builtin;

    use super::*;

    #[test]
    fn it_joins_default_sets_by_its_role_and_paths() {
        if std::env::var("GPUGI_SKIP_GPU").is_ok_and(|value| value == "1") {
            return;
        }
        let gpu = Gpu::open(&AdapterChoice::Best).expect("a GPU");
        let indirect = |scene: &Scene, purpose| {
            let set = default_set(scene, &gpu.adapter, purpose, &registry());
            set.names().pop().expect("a technique")
        };
        // Where only the sky gives light, it takes the place of other indirect light.
        let mut scene = builtin("spheres", 1).expect("a built-in scene");
        for purpose in [Purpose::StillPicture, Purpose::LiveView, Purpose::Bake] {
            assert_eq!(indirect(&scene, purpose), INFO.name);
        }
        let size = [16, 12];
        let purpose = Purpose::LiveView;
        let mut with = Renderer::with_registry(&gpu, &scene, size, purpose, &registry())
            .expect("no light is added twice");
        let in_use = with
            .techniques()
            .iter()
            .find(|technique| technique.info().name == INFO.name);
        let strength = in_use.map(|technique| technique.settings().to_json()["strength"].clone());
        assert_eq!(strength, Some(0.5.into()));
        let mut names = default_set(&scene, &gpu.adapter, purpose, &registry()).names();
        names.retain(|name| name != INFO.name);
        let mut without = Renderer::new(&gpu, &scene, size, &names).expect("a renderer");
        let [with, without] = [&mut with, &mut without].map(|renderer| {
            for (name, value) in [("samples", "16"), ("resolution", "32")] {
                let set = renderer.set("image-based-lighting", name, value);
                set.expect("a setting");
            }
            let sample = renderer.render_sample(&scene.cameras[0], 1, None, false);
            sample.expect("a sample");
            let radiance = renderer.radiance().expect("a picture");
            radiance.into_iter().map(f64::from).sum::<f64>()
        });
        assert!(with > 1.02 * without, "{with} {without}");
        // It lacks the light of lamps, which others add.
        scene.lights = builtin("glass-room", 1).expect("a built-in scene").lights;
        assert_eq!(indirect(&scene, Purpose::StillPicture), "radiosity");
        assert_eq!(indirect(&scene, Purpose::LiveView), "final-gather");
    }
}
