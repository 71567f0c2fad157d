//! Obscurances in a renderer: computed in the texels of an atlas of their own, a few steps a frame, and the ambient term.

use bytemuck::Zeroable;

use super::gpu::{AmbientUniform, SettingsUniform, TEXEL_BYTES};
use super::{Ambient, FIELDS, Settings, Solution};
use crate::capture::atlas::{AtlasCapture, LeakTest, lay_out};
use crate::capture::{PerTarget, SurfacePoints, Target, View};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions, read_buffer};
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
#[derive(Debug)]
pub struct Obscurances {
    settings: Settings,
    light: Kernel,
    openness: Kernel,
    gather: Kernel,
    paths: Vec<LightPaths>,
    /// Whether others add indirect light, too.
    is_covered: bool,
    made: Option<Made>,
    bound: PerTarget<[wgpu::BindGroup; 2]>,
}

/// The obscurances of a scene, and what they were made for.
#[derive(Debug)]
struct Made {
    settings: Settings,
    topology: u64,
    solution: Solution,
    capture: AtlasCapture,
    leaks: LeakTest,
    of_gather: wgpu::BindGroup,
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
    /// Compiles the technique's passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let kernel = |shader| Kernel::new(gpu, &shader, "main", Some(&scene.layout));
        Ok(Self {
            settings: Settings::default(),
            light: kernel(shader!("techniques.obscurances.light"))?,
            openness: Kernel::with_options(
                gpu,
                &shader!("techniques.obscurances.openness"),
                "main",
                Some(&scene.layout),
                &KernelOptions {
                    constants: &scene.ray_constants(),
                    ..Default::default()
                },
            )?,
            gather: kernel(shader!("techniques.obscurances.gather"))?,
            paths: Vec::new(),
            is_covered: false,
            made: None,
            bound: PerTarget::default(),
        })
    }

    /// The obscurances, once generated.
    pub fn solution(&self) -> Option<&Solution> {
        self.made.as_ref().map(|made| &made.solution)
    }

    fn make(&self, gpu: &Gpu, scene: &GpuScene) -> Result<Made, GpuError> {
        let host = scene.host().ok_or_else(|| {
            refused("the scene was uploaded without what an atlas is laid out of")
        })?;
        let settings = Settings {
            colored: self.settings.colored || self.settings.ambient == Ambient::Colored,
            ..self.settings.clone()
        };
        let atlas = lay_out(
            gpu,
            host,
            INFO.name,
            settings.resolution,
            settings.density,
            TEXEL_BYTES,
        )?;
        let capture = AtlasCapture::new(gpu, host, scene, &atlas, &Default::default())?;
        let solution = Solution::new(gpu, host, scene, &atlas, &capture, &settings)?;
        let [texels, mean] = solution.buffers();
        let resources = [
            ("atlas", solution.lookup.words.as_entire_binding()),
            ("texels", texels.as_entire_binding()),
            ("mean", mean.as_entire_binding()),
        ];
        let is_lit = settings.ambient != Ambient::Off;
        let direct = capture.points().filter(|_| is_lit);
        Ok(Made {
            settings: self.settings.clone(),
            topology: scene.versions.topology,
            of_gather: self.gather.bind(gpu, 2, &resources)?,
            leaks: LeakTest::new(gpu, scene, &capture)?,
            direct: direct
                .map(|points| Target::new(gpu, points.count))
                .collect::<Result<_, _>>()?,
            solution,
            capture,
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
            let group = self.light.bind(gpu, 1, &resources)?;
            frame.compute("obscurances.light", |pass| {
                let groups = [(0, &scene.bind_group), (1, &group)];
                self.light.dispatch(pass, &groups, [1, 1, 1]);
            });
            let counts = ("counts", made.escapes.as_entire_binding());
            let group = self.openness.bind(gpu, 1, &[settings, of_points, counts])?;
            frame.compute("obscurances.openness", |pass| {
                let groups = [(0, &scene.bind_group), (1, &group)];
                self.openness.dispatch(pass, &groups, [OPENNESS_RAYS, 1, 1]);
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
        let topology = scene.versions.topology;
        let is_made = |made: &Made| made.settings == self.settings && made.topology == topology;
        let mut made = match self.made.take().filter(is_made) {
            Some(made) => made,
            None => {
                self.bound.clear();
                self.make(frame.gpu, scene)?
            }
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
        let Some(made) = &self.made else {
            return Ok(());
        };
        if self.settings.ambient == Ambient::Off {
            return Ok(());
        }
        let mut own = made.capture.pieces().iter();
        let own = own.find(|piece| piece.points.points == points.points);
        let uniform = AmbientUniform {
            colored: u32::from(self.settings.ambient == Ambient::Colored),
            first_texel: own.map_or(0, |piece| piece.rows.start * made.capture.size),
            is_own: u32::from(own.is_some()),
            padding: 0,
        };
        let (gpu, kernel) = (frame.gpu, &self.gather);
        let [seen, added] = self.bound.of(points, target, || {
            let uniform = gpu.uniform("ambient light", &uniform)?;
            let resources = [
                ("radiance", target.radiance.as_entire_binding()),
                ("hits", wgpu::BindingResource::TextureView(&points.hits)),
                ("ambient", uniform.as_entire_binding()),
            ];
            Ok([points.bind(gpu, kernel)?, kernel.bind(gpu, 3, &resources)?])
        })?;
        frame.compute("obscurances.gather", |pass| {
            let groups = [
                (0, &scene.bind_group),
                (1, seen),
                (2, &made.of_gather),
                (3, added),
            ];
            kernel.dispatch(pass, &groups, [points.count, 1, 1]);
        });
        Ok(())
    }

    fn maps(&self) -> Vec<Map> {
        self.solution().map_or(Vec::new(), Solution::maps)
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
