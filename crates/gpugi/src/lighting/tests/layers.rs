//! Layers between the eye and surfaces.

use super::*;
use crate::capture::{Gather, PerReceiver, Target};
use crate::gpu::{Named, Shader};
use crate::settings::SettingSet;
use crate::techniques::{Generated, Info, Layer, Registration, Unready};

crate::settings! {
    /// Settings, of which there must be one.
    pub struct Settings {
        /// Without effect.
        pub weight: f32 = 1.0 => in_range(0.0, 1.0),
    }
}

/// Dims what is behind it and glows.
#[derive(Debug)]
struct Veil {
    info: &'static Info,
    /// Share of the light that it lets through, and its own (W/sr/m^2).
    dim: f64,
    glow: f64,
    settings: Settings,
    gather: Option<Gather>,
    behind: PerReceiver<Receiver>,
}

const GATHER: &str = "
override DIM: f32;
override GLOW: f32;
@group(2) @binding(0) var<storage, read> behind: array<vec4f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) workgroups: vec3u) {
    let lit = lit_point(id, workgroups);
    if !lit.exists {
        return;
    }
    let value = DIM * behind[lit.index] + vec4f(vec3f(GLOW), 0.0);
    radiance[lit.index] = select(radiance[lit.index] + value, value, seen.sample_index == 0u);
}
";

impl Veil {
    fn of(&mut self, gpu: &Gpu, receiver: &Receiver) -> Result<Receiver, GpuError> {
        let behind = self.behind.of(receiver, || {
            let target = Target::new(gpu, receiver.points.count)?;
            Ok::<_, GpuError>(Receiver::new(&receiver.points, &target))
        });
        behind.cloned()
    }
}

impl Technique for Veil {
    fn info(&self) -> &'static Info {
        self.info
    }

    fn settings(&self) -> &dyn SettingSet {
        &self.settings
    }

    fn settings_mut(&mut self) -> &mut dyn SettingSet {
        &mut self.settings
    }

    fn plan(&mut self, scene: &GpuScene, _: &[LightPaths], _: &[Claims]) -> Plan {
        Plan::adding([], scene)
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        _: &View,
        _: &mut Earlier<'_>,
    ) -> Result<Generated, Unready> {
        if self.gather.is_none() {
            let shader = Shader::gather("veil.gather", GATHER);
            let constants = [("DIM", self.dim), ("GLOW", self.glow)];
            self.gather = Some(Gather::new(frame.gpu, scene, &shader, &constants)?);
        }
        Ok(Generated::FINAL)
    }

    fn behind(
        &mut self,
        frame: &mut Frame<'_>,
        receiver: &Receiver,
    ) -> Result<Option<Receiver>, GpuError> {
        let behind = self.of(frame.gpu, receiver)?;
        frame.clear(&behind.target.radiance);
        Ok(Some(behind))
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        let behind = self.of(frame.gpu, receiver)?.target;
        let gather = self.gather.as_mut().unwrap();
        let behind: Named<'_> = ("behind", &behind.radiance);
        gather.record(frame, "veil.gather", scene, receiver, &[behind])
    }
}

/// Registers a veil.
macro_rules! veil {
    ($name:literal, $layer:expr, $dim:literal, $glow:literal) => {{
        const INFO: Info = Info {
            name: $name,
            layer: $layer,
            ..Info::BASE
        };
        Registration {
            info: &INFO,
            fields: Settings::fields,
            make: |_, _| {
                Ok(Box::new(Veil {
                    info: &INFO,
                    dim: $dim,
                    glow: $glow,
                    settings: Settings::default(),
                    gather: None,
                    behind: PerReceiver::default(),
                }))
            },
            suits: |_| None,
            settings: |_| Vec::new(),
        }
    }};
}

#[test]
fn what_lies_nearer_to_the_eye_dims_what_lies_farther() {
    let Some(gpu) = test_gpu() else { return };
    let mut registry = Registry::default();
    // Layers come before the order of the frame, which decides within them.
    for veil in [
        veil!("pane", Layer::Eye, 0.25, 2.0),
        veil!("fog", Layer::Media, 0.5, 1.0),
        veil!("smoke", Layer::Media, 0.75, 3.0),
    ] {
        registry.insert_before("", veil);
    }
    let above = Camera::look_at("", Vec3::new(0.0, 1.5, 0.01), Vec3::ZERO, 0.5);
    let picture = |names: &[&str]| {
        let mut renderer =
            Renderer::with_registry(&gpu, &balls(), [8, 8], names, &registry).unwrap();
        renderer.render_sample(&above, 1, None, false).unwrap();
        // Another picture into the same targets: the first sample overwrites what they hold.
        renderer.restart();
        for _ in 0..2 {
            renderer.render_sample(&above, 1, None, false).unwrap();
        }
        renderer.radiance().unwrap()
    };
    let surfaces = picture(&["shadow-map"]);
    assert!(surfaces.iter().any(|&value| value > 0.1), "{surfaces:?}");
    let seen = picture(&["shadow-map", "pane", "fog", "smoke"]);
    for (surface, seen) in surfaces.iter().zip(seen) {
        let expected = ((surface * 0.5 + 1.0) * 0.75 + 3.0) * 0.25 + 2.0;
        assert!(
            (seen - expected).abs() < 1e-4 * expected,
            "{seen} {expected}"
        );
    }
}
