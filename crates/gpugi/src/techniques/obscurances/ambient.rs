//! Obscurances in a renderer: computed in the texels of an atlas of their own, a few steps per frame; and the ambient
//! term.

use bytemuck::Zeroable;
use gpugi_scene::Atlas;

use super::gpu::{SettingsUniform, TEXEL_BYTES};
use super::{Ambient, Settings, Solution};
use crate::capture::atlas::{AtlasCapture, AtlasCaptureOptions, LeakTest, TexelGather};
use crate::capture::{Receiver, Target, View};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, ReadBack, join};
use crate::light_paths::{LightClass, LightPaths, overlap};
use crate::scene::{Claims, GpuScene};
use crate::settings::SettingSet;
use crate::shader;
use crate::stage::{Same, Stage};
use crate::techniques::{
    Cost, Earlier, Generated, Info, Inspection, LightState, Needs, Openness, OwnPoints, Plan,
    Provided, Registration, Role, Technique, Unready, atlas,
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
    /// In an atlas, by [`GpuScene::ray_features`].
    pub(super) maps: Stage<(Settings, Same<Atlas>, [bool; 3]), ObscuranceMaps>,
    /// Most texels per buffer; `None`: as many as fit.
    pub(super) most_texels: Option<u32>,
}

/// The obscurances of a scene.
#[derive(Debug)]
pub(super) struct ObscuranceMaps {
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
    /// The direct light that was summed.
    lit: Stage<LightState>,
    revision: u64,
    /// Whether the maps contain all samples.
    is_shown: bool,
}

impl Obscurances {
    /// The obscurances, once generated.
    pub fn solution(&self) -> Option<&Solution> {
        self.maps.get().map(|maps| &maps.solution)
    }
}

impl ObscuranceMaps {
    fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        atlas: &Atlas,
        settings: &Settings,
        most_texels: Option<u32>,
    ) -> Result<Self, GpuError> {
        let host = scene
            .host()
            .ok_or_else(|| INFO.refused("there is an atlas, but no scene that it is one of"))?;
        let settings = Settings {
            colored: settings.colored || settings.ambient == Ambient::Colored,
            ..settings.clone()
        };
        let options = AtlasCaptureOptions {
            most_texels: most_texels.unwrap_or(u32::MAX),
            ..AtlasCaptureOptions::default()
        };
        let capture = AtlasCapture::new(gpu, host, scene, atlas, &options)?;
        let solution = Solution::new(gpu, host, scene, atlas, &capture, &settings)?;
        let is_colored = settings.ambient == Ambient::Colored;
        let is_constant = settings.ambient == Ambient::Constant;
        let constants = [
            ("COLORED", f64::from(u8::from(is_colored))),
            ("CONSTANT", f64::from(u8::from(is_constant))),
            ("RADIANCE", f64::from(settings.ambient_radiance)),
            solution.least_samples(),
        ];
        let light = shader!("techniques.obscurances.light");
        let openness = shader!("techniques.obscurances.openness");
        let gather = shader!("techniques.obscurances.gather");
        let is_lit = settings.sums_light();
        let direct = capture.points().filter(|_| is_lit);
        Ok(Self {
            gather: TexelGather::new(gpu, scene, &gather, &constants)?,
            light: Kernel::new(gpu, &light, "main", Some(&scene.layout))?,
            openness: scene.ray_kernel(gpu, &openness, &[])?,
            leaks: LeakTest::new(gpu, scene, &capture)?,
            direct: direct
                .map(|points| Target::new(gpu, points.count))
                .collect::<Result<_, _>>()?,
            solution,
            capture,
            escapes: gpu.room("rays that get out", 16)?,
            escaped: None,
            lit: Stage::default(),
            revision: 0,
            is_shown: false,
        })
    }

    /// Sums the direct light that surfaces reflect, and counts the rays that leave the scene: passes
    /// `obscurances.light` and `obscurances.openness`.
    fn sum_light(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        earlier: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        let [_, mean] = self.solution.buffers();
        frame.clear(&self.escapes);
        for (piece, direct) in self.capture.pieces().iter().zip(&self.direct) {
            let receiver = Receiver::new(&piece.points, direct);
            earlier.gather(frame, scene, &receiver, false)?;
            let settings = SettingsUniform {
                first_texel: piece.rows.start * self.capture.size,
                end_point: piece.points.count,
                end_sample: OPENNESS_RAYS,
                ..Zeroable::zeroed()
            };
            let settings = frame.gpu.constant("obscurances", &settings)?;
            let own: [Named<'_>; 3] = [
                ("settings", &settings),
                ("mean", mean),
                ("counts", &self.escapes),
            ];
            let resources = join(&receiver.resources(), &own);
            let (name, own) = ("obscurances.light", Some(&scene.bind_group));
            frame.run(name, &self.light, own, &resources, [1, 1, 1])?;
            let (name, rays) = ("obscurances.openness", Some(&scene.ray_bind_group));
            let count = [OPENNESS_RAYS, 1, 1];
            frame.run(name, &self.openness, rays, &resources, count)?;
        }
        self.escaped = Some(frame.read_back(&self.escapes, 8)?);
        Ok(())
    }

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

impl Technique for Obscurances {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn plan(&mut self, scene: &GpuScene, covered: &[LightPaths], _: &[Claims]) -> Plan {
        // Unless its radiance is given, the ambient term derives from the direct light of other techniques: it covers
        // only light classes that they cover.
        let is_lit = |paths: &&LightPaths| {
            self.settings.ambient != Ambient::Off
                && (!self.settings.sums_light()
                    || overlap(covered, &[LightPaths::new(paths.class, "LDE")]).is_some())
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
    ) -> Result<Generated, Unready> {
        let (gpu, settings) = (frame.gpu, &self.settings);
        let size = (settings.resolution, settings.density);
        let atlas = atlas(gpu, scene, INFO.name, size, TEXEL_BYTES)?;
        let key = (settings.clone(), Same(atlas.clone()), scene.ray_features());
        let maps = self.maps.compiled(frame, key, |_| {
            ObscuranceMaps::new(gpu, scene, &atlas, settings, self.most_texels)
        })?;
        let ObscuranceMaps {
            solution, capture, ..
        } = maps;
        capture.record(frame, scene)?;
        maps.leaks.record(frame, scene, capture);
        earlier.budget.steps(
            settings.steps,
            solution,
            |solution| solution.is_done_for(scene),
            |solution| solution.record(frame, scene, capture),
        )?;
        let is_done = solution.is_done();
        if is_done && !maps.is_shown {
            solution.record_maps(frame)?;
            maps.revision += 1;
        }
        maps.is_shown = is_done;
        if settings.sums_light() && maps.lit.renew(earlier.light.state(scene)) {
            maps.sum_light(frame, scene, earlier)?;
        }
        Ok(Generated {
            revision: maps.revision,
            progress: maps.solution.progress(),
            pending: None,
        })
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
        _: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        let maps = self.maps.get();
        let Some(maps) = maps.filter(|_| self.settings.ambient != Ambient::Off) else {
            return Ok(());
        };
        let [texels, mean] = maps.solution.buffers();
        let kept: [Named<'_>; 3] = [
            ("atlas", &maps.solution.lookup.words),
            ("texels", texels),
            ("mean", mean),
        ];
        let (name, captured) = ("obscurances.gather", Some(&maps.capture));
        maps.gather
            .record(frame, name, scene, captured, receiver, &kept)
    }

    fn openness(&self) -> Option<&dyn Openness> {
        let maps = self.maps.get()?;
        Some(&maps.solution)
    }

    fn inspect(&self) -> Inspection {
        let Some(maps) = self.maps.get() else {
            return Inspection::default();
        };
        let direct = maps.direct.iter().map(|direct| direct.radiance.size());
        let states = maps.leaks.states().map(wgpu::Buffer::size);
        let shared = maps.capture.bytes + maps.solution.work_bytes();
        Inspection {
            maps: maps.solution.maps(),
            work_bytes: shared + direct.chain(states).sum::<u64>(),
            warnings: maps.openness_warning().into_iter().collect(),
        }
    }
}
