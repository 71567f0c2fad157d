//! Obscurances in a renderer: computed in the texels of an atlas of their own, a few steps a frame, and the ambient term.

use std::sync::Arc;

use bytemuck::Zeroable;
use gpugi_scene::Atlas;

use super::gpu::{SettingsUniform, TEXEL_BYTES};
use super::{Ambient, FIELDS, Settings, Solution};
use crate::capture::atlas::{AtlasCapture, AtlasCaptureOptions, LeakTest, TexelGather};
use crate::capture::{SurfacePoints, Target, View};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, read_buffer};
use crate::light_paths::{LightClass, LightPaths, overlap};
use crate::scene::{Claims, GpuScene, Versions};
use crate::shader;
use crate::techniques::{Field, Info, Lit, Map, SettingError, Technique, settings};

/// What obscurances say of themselves. They add light only where their ambient term is asked for.
pub const INFO: Info = Info {
    name: "obscurances",
    summary: "how much ambient light arrives in corners and folds, and its colour there: maps, and light on request",
    source: "tutorial section 8.1; Zhukov et al. 1998; Mendez et al. 2003",
    paths: &[
        LightPaths::new(LightClass::Punctual, INDIRECT),
        LightPaths::new(LightClass::Area, INDIRECT),
        LightPaths::new(LightClass::Environment, INDIRECT),
    ],
    suits: |_| false,
    keeps_texels: true,
};

/// What the ambient term stands for.
const INDIRECT: &str = "LDD+E";

/// Rays that tell how open a scene is, of each piece of the atlas.
const OPENNESS_RAYS: u32 = 4096;
/// Share of them that may get out (0 to 1).
const MOST_ESCAPES: f32 = 0.02;

/// Obscurances, and the ambient light that they let through.
#[derive(Debug, Default)]
pub struct Obscurances {
    settings: Settings,
    paths: Vec<LightPaths>,
    /// Whether others add indirect light, too.
    is_covered: bool,
    pub(super) made: Option<Made>,
    /// Most texels in one buffer, if not as many as fit.
    pub(super) most_texels: Option<u32>,
}

/// The obscurances of a scene, and what they were made for.
#[derive(Debug)]
pub(super) struct Made {
    settings: Settings,
    atlas: Arc<Atlas>,
    /// [`GpuScene::passages`].
    passages: [bool; 2],
    solution: Solution,
    pub(super) capture: AtlasCapture,
    leaks: LeakTest,
    light: Kernel,
    openness: Kernel,
    gather: TexelGather,
    /// The direct light of each piece's texels.
    direct: Vec<Target>,
    /// Rays from all surfaces, and those that met nothing.
    escapes: wgpu::Buffer,
    lit: Option<(Versions, u64, u64)>,
    refinements: u64,
    /// Whether the maps show all samples.
    is_shown: bool,
}

impl Obscurances {
    /// The obscurances, once generated.
    pub fn solution(&self) -> Option<&Solution> {
        self.made.as_ref().map(|made| &made.solution)
    }

    fn make(&self, gpu: &Gpu, scene: &GpuScene, atlas: Arc<Atlas>) -> Result<Made, GpuError> {
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
        let solution = Solution::new(gpu, host, scene, &atlas, &capture, &settings)?;
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
        Ok(Made {
            settings: self.settings.clone(),
            passages: scene.passages(),
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
            lit: None,
            refinements: 0,
            is_shown: false,
        })
    }

    /// Sums up the direct light that surfaces send on, and counts how many rays get out: passes `obscurances.light` and `obscurances.openness`.
    fn sum_light(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        made: &Made,
        lit: &mut Lit<'_>,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let [_, mean] = made.solution.buffers();
        frame.clear(&made.escapes);
        for (piece, direct) in made.capture.pieces().iter().zip(&made.direct) {
            let points = &piece.points;
            lit.gather(frame, scene, points, direct, false)?;
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
                let groups = [(0, &scene.bind_group), (1, &group)];
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

    fn paths(&self) -> &[LightPaths] {
        &self.paths
    }

    fn claim(&mut self, scene: &GpuScene, covered: &[LightPaths]) -> Vec<Claims> {
        self.paths.clear();
        self.is_covered = false;
        if self.settings.ambient != Ambient::Off {
            self.is_covered = overlap(covered, INFO.paths).is_some();
            // Ambient light is what others' direct light becomes.
            let is_lit = |paths: &&LightPaths| {
                overlap(covered, &[LightPaths::new(paths.class, "LDE")]).is_some()
            };
            self.paths.extend(INFO.paths.iter().filter(is_lit).cloned());
        }
        vec![Claims::NONE; scene.objects.len()]
    }

    fn refinements(&self) -> u64 {
        self.made.as_ref().map_or(0, |made| made.refinements)
    }

    fn progress(&self) -> f32 {
        self.solution().map_or(0.0, Solution::progress)
    }

    fn lights_own_points(&self) -> bool {
        self.settings.ambient != Ambient::Off
    }

    fn settings(&self) -> serde_json::Value {
        settings::to_json(&self.settings)
    }

    fn fields(&self) -> &'static [Field] {
        FIELDS
    }

    fn set(&mut self, name: &str, value: &str) -> Result<(), SettingError> {
        self.settings.set(name, value)
    }

    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        _: &View,
        lit: &mut Lit<'_>,
    ) -> Result<(), GpuError> {
        if self.is_covered {
            return Err(refused(
                "another technique adds indirect light, too: choose one of them, or ambient=off",
            ));
        }
        let Settings {
            resolution,
            density,
            ..
        } = self.settings;
        let atlas = scene.atlas(frame.gpu, INFO.name, resolution, density, TEXEL_BYTES)?;
        let is_made = |made: &Made| {
            made.settings == self.settings
                && made.passages == scene.passages()
                && Arc::ptr_eq(&made.atlas, &atlas)
        };
        let mut made = match self.made.take().filter(is_made) {
            Some(made) => made,
            None => self.make(frame.gpu, scene, atlas)?,
        };
        made.capture.record(frame, scene)?;
        made.leaks.record(frame, scene, &made.capture);
        for step in 0..self.settings.steps {
            if step > 0 && made.solution.is_done() {
                break;
            }
            made.solution.record(frame, scene, &made.capture)?;
        }
        let is_done = made.solution.is_done();
        if is_done && !made.is_shown {
            made.solution.record_maps(frame)?;
            made.refinements += 1;
        }
        made.is_shown = is_done;
        let now = Some((scene.versions, lit.version, lit.refinements()));
        if self.settings.ambient != Ambient::Off && made.lit != now {
            made.lit = now;
            self.sum_light(frame, scene, &made, lit)?;
        }
        self.made = Some(made);
        Ok(())
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        points: &SurfacePoints,
        target: &Target,
    ) -> Result<(), GpuError> {
        let Some(made) = &mut self.made else {
            return Ok(());
        };
        if self.settings.ambient == Ambient::Off {
            return Ok(());
        }
        let (name, texels) = ("obscurances.gather", &made.capture);
        made.gather
            .record(frame, name, scene, texels, points, target)
    }

    fn maps(&self) -> Vec<Map> {
        self.solution().map_or(Vec::new(), Solution::maps)
    }

    fn work_bytes(&self) -> u64 {
        let made = self.made.iter();
        made.map(|made| {
            let direct = made.direct.iter().map(|direct| direct.radiance.size());
            let states = made.leaks.states().map(wgpu::Buffer::size);
            let shared = made.capture.bytes + made.solution.work_bytes();
            shared + direct.chain(states).sum::<u64>()
        })
        .sum()
    }

    fn warnings(&self, gpu: &Gpu) -> Result<Vec<String>, GpuError> {
        let lit = self.made.iter().filter(|made| made.lit.is_some());
        let mut warnings = Vec::new();
        for made in lit {
            let [all, out] = read_buffer::<[u32; 2]>(gpu, &made.escapes, 8)?[0];
            let share = out as f32 / all.max(1) as f32;
            if share > MOST_ESCAPES {
                warnings.push(format!(
                    "{:.0} % of the light that surfaces send on leaves the scene: ambient light, which is that of closed scenes, is too bright",
                    share * 100.0
                ));
            }
        }
        Ok(warnings)
    }
}

fn refused(reason: &str) -> GpuError {
    GpuError::Pass {
        pass: INFO.name.into(),
        reason: reason.into(),
    }
}
