//! A technique outside gpugi: ambient light in the colour of the sky. docs/adding-a-technique.md walks through it.
//!
//! `cargo run --example own_technique -- ambient.png` renders a built-in scene with it.

use std::error::Error;

use gpugi::capture::{Gather, Receiver, View};
use gpugi::display::DisplaySettings;
use gpugi::gpu::{AdapterChoice, Frame, Gpu, GpuError, Shader};
use gpugi::light_paths::{LightClass, LightPaths};
use gpugi::scene::{Claims, GpuScene};
use gpugi::settings::SettingSet;
use gpugi::stage::Stage;
use gpugi::techniques::{
    Earlier, Generated, Info, OwnPoints, Plan, Registration, Registry, Technique, Unready,
};
use gpugi::{Renderer, settings};

const INFO: Info = Info {
    name: "sky-ambient",
    summary: "indirect light of the sky, alike at all points: each sees as much sky as its normal faces up",
    source: "hemisphere lighting",
    paths: &[LightPaths::new(LightClass::Environment, "LDD+E")],
    suits: |_| true,
    keeps_texels: false,
    lights_points: OwnPoints::None,
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

fn main() -> Result<(), Box<dyn Error>> {
    let output = std::env::args()
        .nth(1)
        .unwrap_or_else(|| "ambient.png".into());
    let size = [256, 192];
    let mut scene = gpugi_scene::builtin::builtin("spheres", 1).ok_or("a built-in scene")?;
    scene
        .environment
        .get_or_insert_with(gpugi_scene::Environment::default_sky);
    let mut registry = Registry::default();
    registry.insert_before(
        "ray-tracing",
        Registration {
            info: &INFO,
            fields: Settings::fields,
            make: |_, _| Ok(Box::new(SkyAmbient::default())),
        },
    );
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    let names = ["image-based-lighting", "sky-ambient"].map(str::to_owned);
    let mut renderer = Renderer::with_registry(&gpu, &scene, size, &names, &registry)?;
    renderer.set("sky-ambient", "strength", "0.5")?;
    renderer.render_sample(
        &scene.cameras[0],
        1,
        Some(&DisplaySettings::default()),
        false,
    )?;
    gpugi_scene::image::save_png(output.as_ref(), size[0], size[1], &renderer.pixels()?)?;
    Ok(())
}
