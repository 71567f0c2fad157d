//! Obscurances in a renderer: computed in the texels of an atlas of their own, a few steps per frame; and the ambient
//! term.

use std::sync::Arc;

use bytemuck::Zeroable;
use gpugi_scene::Atlas;

use super::gpu::{SettingsUniform, TEXEL_BYTES};
use super::{Ambient, Settings, Solution};
use crate::capture::atlas::{AtlasCapture, AtlasCaptureOptions, LeakTest, TexelGather};
use crate::capture::{Receiver, Target, View};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, ReadBack};
use crate::light_paths::{LightClass, LightPaths, overlap};
use crate::scene::{Claims, GpuScene, Versions};
use crate::settings::SettingSet;
use crate::shader;
use crate::techniques::{
    Cost, Earlier, Generated, Info, Inspection, Needs, Openness, OwnPoints, Plan, Provided,
    Registration, Role, Technique,
};

/// Name, summary, source and light paths. Obscurances add light only when their ambient term is enabled.
pub const INFO: Info = Info {
    name: "obscurances",
    summary: "how much ambient light arrives in corners and folds, and its colour there: maps, and light on request",
    source: "tutorial section 8.1; Zhukov et al. 1998; Mendez et al. 2003",
    paths: &[
        LightPaths::new(LightClass::Punctual, INDIRECT),
        LightPaths::new(LightClass::Area, INDIRECT),
        LightPaths::new(LightClass::Environment, INDIRECT),
    ],
    role: Role::Factor,
    needs: Needs::TEXELS,
    cost: Cost::Picture,
    lights_points: OwnPoints::TowardEye,
    provides: &[Provided::Openness],
    ..Info::BASE
};

/// Its entry in the registry.
pub const REGISTRATION: Registration = Registration {
    info: &INFO,
    fields: Settings::fields,
    make: |_, _| Ok(Box::new(Obscurances::default())),
    suits: |_| None,
    settings: |_| Vec::new(),
};

/// Light paths that the ambient term approximates.
const INDIRECT: &str = "LDD+E";

/// Rays per piece of the atlas that measure how open a scene is.
const OPENNESS_RAYS: u32 = 4096;
/// Largest share of these rays that may leave the scene without a warning (0 to 1).
const MOST_ESCAPES: f32 = 0.02;

/// Obscurances, and the ambient light that they attenuate.
#[derive(Debug, Default)]
pub struct Obscurances {
    settings: Settings,
    pub(super) made: Option<ObscuranceMaps>,
    /// Most texels per buffer; `None`: as many as fit.
    pub(super) most_texels: Option<u32>,
}

/// The obscurances of a scene, and what they were computed for.
#[derive(Debug)]
pub(super) struct ObscuranceMaps {
    settings: Settings,
    atlas: Arc<Atlas>,
    /// [`GpuScene::ray_features`] that the passes were compiled for.
    ray_features: [bool; 3],
    solution: Solution,
    pub(super) capture: AtlasCapture,
    leaks: LeakTest,
    light: Kernel,
    openness: Kernel,
    gather: TexelGather,
    /// Direct light at the texels of each piece.
    direct: Vec<Target>,
    /// Number of rays from all surfaces, and of those that hit nothing.
    escapes: wgpu::Buffer,
    /// The same, on their way to the host.
    escaped: Option<ReadBack<Vec<u32>>>,
    lit: Option<(Versions, u64, u64)>,
    revision: u64,
    /// Whether the maps contain all samples.
    is_shown: bool,
}

impl Obscurances {
    fn make(
        &self,
        gpu: &Gpu,
        scene: &GpuScene,
        atlas: Arc<Atlas>,
    ) -> Result<ObscuranceMaps, GpuError> {
        let host = scene
            .host()
            .ok_or_else(|| refused("there is an atlas, but no scene that it is one of"))?;
        let settings = Settings {
            colored: self.settings.colored || self.settings.ambient == Ambient::Colored,
            ..self.settings.clone()
        };
        let options = AtlasCaptureOptions {
            most_texels: self.most_texels.unwrap_or(u32::MAX),
            ..AtlasCaptureOptions::default()
        };
        let capture = AtlasCapture::new(gpu, host, scene, &atlas, &options)?;
        let mut solution = Solution::new(gpu, host, scene, &atlas, &capture, &settings)?;
        // The frame that shows them need not wait for their shaders.
        solution.pictures(gpu)?;
        let [texels, mean] = solution.buffers();
        let kept = [
            ("atlas", solution.lookup.words.as_entire_binding()),
            ("texels", texels.as_entire_binding()),
            ("mean", mean.as_entire_binding()),
        ];
        let is_colored = settings.ambient == Ambient::Colored;
        let constants = [
            ("COLORED", f64::from(u8::from(is_colored))),
            solution.least_samples(),
        ];
        let light = shader!("techniques.obscurances.light");
        let openness = shader!("techniques.obscurances.openness");
        let gather = shader!("techniques.obscurances.gather");
        let is_lit = settings.ambient != Ambient::Off;
        let direct = capture.points().filter(|_| is_lit);
        Ok(ObscuranceMaps {
            settings: self.settings.clone(),
            ray_features: scene.ray_features(),
            gather: TexelGather::new(gpu, scene, &gather, &constants, &kept)?,
            light: Kernel::new(gpu, &light, "main", Some(&scene.layout))?,
            openness: scene.ray_kernel(gpu, &openness, &[])?,
            leaks: LeakTest::new(gpu, scene, &capture)?,
            direct: direct
                .map(|points| Target::new(gpu, points.count))
                .collect::<Result<_, _>>()?,
            solution,
            capture,
            atlas,
            escapes: gpu.buffer("rays that get out", 16, wgpu::BufferUsages::STORAGE)?,
            escaped: None,
            lit: None,
            revision: 0,
            is_shown: false,
        })
    }

    /// Sums the direct light that surfaces reflect, and counts the rays that leave the scene: passes
    /// `obscurances.light` and `obscurances.openness`.
    fn sum_light(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        made: &ObscuranceMaps,
        earlier: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let [_, mean] = made.solution.buffers();
        frame.clear(&made.escapes);
        for (piece, direct) in made.capture.pieces().iter().zip(&made.direct) {
            let points = &piece.points;
            earlier.gather(frame, scene, &Receiver::new(points, direct), false)?;
            let uniform = SettingsUniform {
                first_texel: piece.rows.start * made.capture.size,
                end_point: points.count,
                end_sample: OPENNESS_RAYS,
                ..Zeroable::zeroed()
            };
            let uniform = gpu.uniform("obscurances", &uniform)?;
            let settings = ("settings", uniform.as_entire_binding());
            let of_points = ("points", points.points.as_entire_binding());
            let resources = [
                settings.clone(),
                of_points.clone(),
                ("radiance", direct.radiance.as_entire_binding()),
                ("mean", mean.as_entire_binding()),
            ];
            let group = made.light.bind(gpu, 1, &resources)?;
            frame.compute("obscurances.light", |pass| {
                let groups = [(0, &scene.bind_group), (1, &group)];
                made.light.dispatch(pass, &groups, [1, 1, 1]);
            });
            let counts = ("counts", made.escapes.as_entire_binding());
            let group = made.openness.bind(gpu, 1, &[settings, of_points, counts])?;
            frame.compute("obscurances.openness", |pass| {
                let groups = [(0, &scene.ray_bind_group), (1, &group)];
                made.openness.dispatch(pass, &groups, [OPENNESS_RAYS, 1, 1]);
            });
        }
        Ok(())
    }
}

impl Technique for Obscurances {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn plan(&mut self, scene: &GpuScene, covered: &[LightPaths], _: &[Claims]) -> Plan {
        // The ambient term derives from the direct light of other techniques: it covers only light classes that
        // they cover.
        let is_lit = |paths: &&LightPaths| {
            self.settings.ambient != Ambient::Off
                && overlap(covered, &[LightPaths::new(paths.class, "LDE")]).is_some()
        };
        let paths: Vec<LightPaths> = INFO.paths.iter().filter(is_lit).cloned().collect();
        Plan::adding(paths, scene)
    }

    fn settings(&self) -> &dyn SettingSet {
        &self.settings
    }

    fn settings_mut(&mut self) -> &mut dyn SettingSet {
        &mut self.settings
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        _: &View,
        earlier: &mut Earlier<'_>,
    ) -> Result<Generated, GpuError> {
        let Settings {
            resolution,
            density,
            ..
        } = self.settings;
        let atlas = scene.atlas(frame.gpu, INFO.name, resolution, density, TEXEL_BYTES)?;
        let Some(atlas) = atlas else {
            return Ok(Generated::without_atlas(scene));
        };
        let is_made = |made: &ObscuranceMaps| {
            made.settings == self.settings
                && made.ray_features == scene.ray_features()
                && Arc::ptr_eq(&made.atlas, &atlas)
        };
        let mut made = match self.made.take().filter(is_made) {
            Some(made) => made,
            None => {
                let made = self.make(frame.gpu, scene, atlas)?;
                if frame.awaits_shaders() {
                    self.made = Some(made);
                    return Ok(Generated::WITHOUT_SHADERS);
                }
                made
            }
        };
        made.capture.record(frame, scene)?;
        made.leaks.record(frame, scene, &made.capture);
        for step in 0..self.settings.steps {
            if step > 0 && made.solution.is_done() || !earlier.may_step() {
                break;
            }
            earlier.count(made.solution.record(frame, scene, &made.capture)?);
        }
        let is_done = made.solution.is_done();
        if is_done && !made.is_shown {
            made.solution.record_maps(frame)?;
            made.revision += 1;
        }
        made.is_shown = is_done;
        let now = Some((scene.versions, earlier.settings_version, earlier.revision));
        if self.settings.ambient != Ambient::Off && made.lit != now {
            made.lit = now;
            self.sum_light(frame, scene, &made, earlier)?;
            made.escaped = Some(frame.read_back(&made.escapes, 8)?);
        }
        let generated = Generated {
            revision: made.revision,
            progress: made.solution.progress(),
            pending: None,
        };
        self.made = Some(made);
        Ok(generated)
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        let Some(made) = &mut self.made else {
            return Ok(());
        };
        if self.settings.ambient == Ambient::Off {
            return Ok(());
        }
        let (name, texels) = ("obscurances.gather", Some(&made.capture));
        made.gather.record(frame, name, scene, texels, receiver)
    }

    fn openness(&self) -> Option<&dyn Openness> {
        let made = self.made.as_ref()?;
        Some(&made.solution)
    }

    fn inspect(&self) -> Inspection {
        let Some(made) = &self.made else {
            return Inspection::default();
        };
        let direct = made.direct.iter().map(|direct| direct.radiance.size());
        let states = made.leaks.states().map(wgpu::Buffer::size);
        let shared = made.capture.bytes + made.solution.work_bytes();
        Inspection {
            maps: made.solution.maps(),
            work_bytes: shared + direct.chain(states).sum::<u64>(),
            warnings: made.openness_warning().into_iter().collect(),
        }
    }
}

impl ObscuranceMaps {
    /// What to know of ambient light in a scene that is not closed, once the rays are counted.
    fn openness_warning(&self) -> Option<String> {
        let counts: Vec<u32> = self.escaped.as_ref()?.get()?.ok()?;
        let share = counts[1] as f32 / counts[0].max(1) as f32;
        (share > MOST_ESCAPES).then(|| {
            format!(
                "{:.0} % of the light that surfaces reflect leaves the scene: ambient light, which is made for closed scenes, is too bright",
                share * 100.0
            )
        })
    }
}

fn refused(reason: &str) -> GpuError {
    GpuError::Pass {
        pass: INFO.name.into(),
        reason: reason.into(),
    }
}
