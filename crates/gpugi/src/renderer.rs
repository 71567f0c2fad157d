//! The frame, readable as a table of contents: capture, resolve, each technique's generate, each technique's gather.

use std::collections::BTreeMap;

use glam::Vec2;
use gpugi_scene::names::check_names;
use gpugi_scene::{Camera, Scene};

use crate::bake::Tile;
use crate::capture::{Capture, CaptureKernels, Emission, Target, View};
use crate::display::{Display, DisplaySettings};
use crate::gpu::{Frame, Gpu, GpuError, Timing, read_buffer};
use crate::impostor::Impostors;
use crate::light_paths::{LightClass, LightPaths, left_out, overlap};
use crate::scene::{Claims, GpuScene, check_environment};
use crate::techniques::{Info, Lit, Map, REGISTRY, SettingError, Technique};

/// A renderer that cannot do what it was asked.
#[derive(Debug, Clone, thiserror::Error, PartialEq)]
pub enum RenderError {
    /// The GPU failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A setting does not fit.
    #[error("{technique}: {source}")]
    Setting {
        /// Technique.
        technique: String,
        /// Why.
        source: SettingError,
    },
    /// There is no such technique.
    #[error("there is no technique {name:?}; there are: {known}")]
    UnknownTechnique {
        /// The name asked for.
        name: String,
        /// The names there are.
        known: String,
    },
    /// The scene holds something that no light can be computed from.
    #[error("{what}")]
    Scene {
        /// What, and where.
        what: String,
    },
    /// Two techniques would add the same light twice.
    #[error("{first} and {second} both add light of path {path} ({class}): choose one of them")]
    Overlap {
        /// One technique.
        first: String,
        /// The other.
        second: String,
        /// A path that both add.
        path: String,
        /// Its class of lights.
        class: LightClass,
    },
}

/// Renders one scene with a set of techniques at one size.
#[derive(Debug)]
pub struct Renderer {
    gpu: Gpu,
    scene: GpuScene,
    size: [u32; 2],
    capture: Capture,
    emission: Emission,
    techniques: Vec<Box<dyn Technique>>,
    impostors: Impostors,
    target: Target,
    display: Display,
    samples: u32,
    seed: u32,
    /// Grows with every setting.
    settings_version: u64,
}

impl Renderer {
    /// A renderer of `scene` at `size` pixels with the named techniques; none named means every real-time technique that adds light
    /// in this scene.
    ///
    /// # Errors
    /// [`RenderError::UnknownTechnique`], [`RenderError::Overlap`], [`RenderError::Scene`], [`RenderError::Gpu`].
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        size: [u32; 2],
        names: &[String],
    ) -> Result<Self, RenderError> {
        check_environment(scene.environment.as_ref())?;
        let is_named = |info: &Info| names.iter().any(|name| name == info.name);
        let mut infos = REGISTRY.iter().map(|(info, _)| info);
        let scene = if infos.any(|info| info.keeps_texels && is_named(info)) {
            GpuScene::with_texels(gpu, scene)?
        } else {
            GpuScene::new(gpu, scene)?
        };
        Self::of(gpu, scene, size, names)
    }

    /// As [`Renderer::new`], of a scene in which rays are traced at texels whether techniques do so or not.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub(crate) fn with_texels(
        gpu: &Gpu,
        scene: &Scene,
        names: &[String],
    ) -> Result<Self, RenderError> {
        check_environment(scene.environment.as_ref())?;
        Self::of(gpu, GpuScene::with_texels(gpu, scene)?, [1, 1], names)
    }

    fn of(
        gpu: &Gpu,
        scene: GpuScene,
        size: [u32; 2],
        names: &[String],
    ) -> Result<Self, RenderError> {
        let is_named = |info: &Info| names.iter().any(|name| name == info.name);
        let present = light_classes(&scene);
        if let Some(name) = names
            .iter()
            .find(|name| REGISTRY.iter().all(|(info, _)| info.name != **name))
        {
            return Err(RenderError::UnknownTechnique {
                name: name.clone(),
                known: REGISTRY
                    .iter()
                    .map(|(info, _)| info.name)
                    .collect::<Vec<_>>()
                    .join(", "),
            });
        }
        let kernels = CaptureKernels::new(gpu, &scene)?;
        let mut techniques: Vec<Box<dyn Technique>> = Vec::new();
        for (info, make) in REGISTRY {
            let wanted = if names.is_empty() {
                info.paths
                    .iter()
                    .any(|paths| present.contains(&paths.class))
                    && (info.suits)(&scene)
            } else {
                is_named(info)
            };
            if !wanted {
                continue;
            }
            techniques.push(make(gpu, &scene)?);
        }
        let capture = Capture::of_camera(gpu, &kernels, size)?;
        let target = Target::new(gpu, capture.points.count)?;
        let mut renderer = Self {
            display: Display::new(gpu, size)?,
            gpu: gpu.clone(),
            size,
            capture,
            emission: Emission::new(gpu, &scene)?,
            impostors: Impostors::new(gpu, &scene, &kernels)?,
            techniques,
            target,
            samples: 0,
            seed: 0,
            settings_version: 0,
            scene,
        };
        let claiming = renderer.assign();
        // Techniques with objects of their own add their light there alone.
        let unclaimed = renderer.techniques.iter().zip(claiming);
        let unclaimed = unclaimed.filter_map(|(technique, claims)| (!claims).then_some(technique));
        for (index, second) in unclaimed.clone().enumerate() {
            for first in unclaimed.clone().take(index) {
                if let Some((class, path)) = overlap(first.paths(), second.paths()) {
                    return Err(RenderError::Overlap {
                        first: first.info().name.into(),
                        second: second.info().name.into(),
                        path,
                        class,
                    });
                }
            }
        }
        Ok(renderer)
    }

    /// Asks the techniques which objects are their own affair; returns which of them have any.
    fn assign(&mut self) -> Vec<bool> {
        let mut claims = vec![Claims::NONE; self.scene.objects.len()];
        let mut covered = Vec::new();
        let mut claiming = Vec::new();
        for technique in &mut self.techniques {
            let own = technique.claim(&self.scene, &covered);
            claiming.push(own.iter().any(|claim| *claim != Claims::NONE));
            for (all, own) in claims.iter_mut().zip(own) {
                *all = *all | own;
            }
            covered.extend_from_slice(technique.paths());
        }
        self.scene.assign(&self.gpu, &claims);
        claiming
    }

    /// Sets one setting of one technique from text.
    ///
    /// # Errors
    /// [`RenderError::UnknownTechnique`] when it is not among those in use, [`RenderError::Setting`].
    pub fn set(&mut self, technique: &str, name: &str, value: &str) -> Result<(), RenderError> {
        let known = self
            .techniques
            .iter()
            .map(|one| one.info().name)
            .collect::<Vec<_>>()
            .join(", ");
        let found = self
            .techniques
            .iter_mut()
            .find(|one| one.info().name == technique)
            .ok_or_else(|| RenderError::UnknownTechnique {
                name: technique.to_owned(),
                known,
            })?;
        let fail = |source| RenderError::Setting {
            technique: technique.to_owned(),
            source,
        };
        let before = found.settings()[name].clone();
        let names = found.names().to_owned();
        found.set(name, value).map_err(fail)?;
        let objects = &self.scene.objects;
        let known = objects.iter().map(|object| object.name.as_str());
        // Names that were known may be gone from the scene meanwhile.
        if found.names() != names
            && let Err(unknown) = check_names(found.names(), known)
        {
            // What is refused is not kept.
            let before = before.as_str().unwrap_or_default();
            found.set(name, before).map_err(fail)?;
            return Err(fail(SettingError::Value {
                name: name.to_owned(),
                value: value.to_owned(),
                reason: unknown.to_string(),
            }));
        }
        self.settings_version += 1;
        self.assign();
        Ok(())
    }

    /// Seeds everything stochastic. The same seed gives the same picture on the same adapter, of a new renderer: maps that become finer from
    /// frame to frame are kept when accumulation begins anew.
    pub fn set_seed(&mut self, seed: u32) {
        self.seed = seed;
        self.samples = 0;
    }

    /// Width and height of the picture (pixels).
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Light that the techniques in use add.
    pub fn light_paths(&self) -> Vec<LightPaths> {
        let techniques = self.techniques.iter();
        techniques
            .flat_map(|technique| technique.paths())
            .cloned()
            .collect()
    }

    /// Classes of light that the scene has.
    pub fn light_classes(&self) -> Vec<LightClass> {
        light_classes(&self.scene)
    }

    /// Bytes that the picture takes: surface points and radiance.
    pub fn picture_bytes(&self) -> u64 {
        self.surface_points().size() + self.target.radiance.size()
    }

    /// The techniques in use.
    pub fn techniques(&self) -> &[Box<dyn Technique>] {
        &self.techniques
    }

    /// The scene on the GPU.
    pub fn scene(&self) -> &GpuScene {
        &self.scene
    }

    /// Follows changes of the scene; accumulation begins anew.
    ///
    /// # Errors
    /// [`RenderError::Scene`], [`RenderError::Gpu`].
    pub fn update(&mut self, before: &Scene, after: &Scene) -> Result<(), RenderError> {
        check_environment(after.environment.as_ref())?;
        self.samples = 0;
        self.scene.update(&self.gpu, before, after)?;
        self.assign();
        Ok(())
    }

    /// Light that exists in the scene and that no technique in use adds: a few words each.
    pub fn left_out(&self) -> Vec<String> {
        left_out(&self.light_paths(), &self.light_classes())
    }

    /// What the techniques in use have to say of the picture, once a sample is rendered.
    ///
    /// # Errors
    /// [`RenderError::Gpu`].
    pub fn warnings(&self) -> Result<Vec<String>, RenderError> {
        let mut all = Vec::new();
        for technique in &self.techniques {
            let name = technique.info().name;
            let warnings = technique.warnings(&self.gpu)?.into_iter();
            all.extend(warnings.map(|warning| format!("{name}: {warning}")));
        }
        Ok(all)
    }

    /// Samples accumulated so far.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Forgets the accumulated samples.
    pub fn restart(&mut self) {
        self.samples = 0;
    }

    /// Makes every map out of date, so that the next sample generates all of them: for measuring.
    pub fn invalidate(&mut self) {
        self.scene.invalidate();
    }

    /// As if every instance had moved: maps that depend on geometry are out of date.
    pub fn invalidate_geometry(&mut self) {
        self.scene.invalidate_geometry();
    }

    /// Renders one more sample of the picture that `camera` sees: the first through pixel centres when it is to be the only one of
    /// `of`, otherwise spread over the pixel by a box filter. With `display`, ends with the display pass.
    ///
    /// # Errors
    /// [`RenderError::Gpu`].
    pub fn render_sample(
        &mut self,
        camera: &Camera,
        of: u32,
        display: Option<&DisplaySettings>,
        timed: bool,
    ) -> Result<Vec<Timing>, RenderError> {
        let jitter = if of <= 1 {
            Vec2::ZERO
        } else {
            crate::sequences::low_discrepancy(self.samples) - 0.5
        };
        let view = View::new(
            camera,
            self.size,
            jitter,
            self.samples,
            self.seed,
            self.scene.diagonal(),
        );
        let gpu = self.gpu.clone();
        let mut frame = Frame::new(&gpu, timed);
        self.scene.merge(&mut frame);
        self.capture
            .record(&mut frame, &self.scene, &view, |draw| draw.seen)?;
        self.generate(&mut frame, &view, false)?;
        let points = &self.capture.points;
        self.emission
            .record(&mut frame, &self.scene, points, &self.target)?;
        for technique in &mut self.techniques {
            technique.gather(&mut frame, &self.scene, points, &self.target)?;
        }
        self.samples += 1;
        if let Some(settings) = display {
            self.display
                .record(&mut frame, &self.target.radiance, self.samples, settings)?;
        }
        Ok(frame.submit()?)
    }

    /// Brings the maps of all techniques up to date; `in_bake`: for texels that the camera does not see.
    fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        view: &View,
        in_bake: bool,
    ) -> Result<(), GpuError> {
        self.impostors.begin_frame();
        let mut techniques = self.techniques.iter();
        let beyond_camera = in_bake || techniques.any(|one| one.lights_own_points());
        for index in 0..self.techniques.len() {
            let (earlier, rest) = self.techniques.split_at_mut(index);
            let mut lit = Lit::new(
                &mut self.emission,
                earlier,
                &mut self.impostors,
                self.settings_version,
            );
            lit.beyond_camera = beyond_camera;
            rest[0].generate(frame, &self.scene, view, &mut lit)?;
        }
        Ok(())
    }

    /// Brings the techniques' maps of a still scene one frame further, without a picture; returns how far they are, 0 to 1. `view`: what maps that
    /// follow a camera follow.
    ///
    /// # Errors
    /// [`GpuError`].
    pub(crate) fn refine(&mut self, view: &View) -> Result<f32, GpuError> {
        let gpu = self.gpu.clone();
        let mut frame = Frame::new(&gpu, false);
        self.scene.merge(&mut frame);
        self.generate(&mut frame, view, true)?;
        frame.submit()?;
        let progress = self.techniques.iter().map(|one| one.progress());
        Ok(progress.fold(1.0, f32::min))
    }

    /// What techniques save of their maps, by name.
    ///
    /// # Errors
    /// [`GpuError`].
    pub(crate) fn save_maps(&self) -> Result<BTreeMap<String, Vec<u8>>, GpuError> {
        let mut saved = BTreeMap::new();
        for technique in &self.techniques {
            if let Some(bytes) = technique.save(&self.gpu)? {
                saved.insert(technique.info().name.to_owned(), bytes);
            }
        }
        Ok(saved)
    }

    /// Lets techniques go on from what they saved, once maps are generated; returns what waits for the next time.
    ///
    /// # Errors
    /// [`GpuError`].
    pub(crate) fn resume_maps(
        &mut self,
        mut saved: BTreeMap<String, Vec<u8>>,
    ) -> Result<BTreeMap<String, Vec<u8>>, GpuError> {
        for technique in &mut self.techniques {
            let name = technique.info().name;
            if let Some(bytes) = saved.get(name)
                && technique.resume(&self.gpu, bytes)?
            {
                saved.remove(name);
            }
        }
        Ok(saved)
    }

    /// Adds a sample of light at the texels of `tile`: emission, and what the techniques add whose names `adds` accepts. `view`: what maps that follow a camera
    /// follow.
    ///
    /// # Errors
    /// [`GpuError`].
    pub(crate) fn light_tile(
        &mut self,
        frame: &mut Frame<'_>,
        view: &View,
        tile: &mut Tile,
        adds: impl Fn(&str) -> bool,
    ) -> Result<(), GpuError> {
        self.scene.merge(frame);
        tile.capture.look(frame.gpu, tile.samples, self.seed);
        tile.capture.record(frame, &self.scene)?;
        tile.leaks.record(frame, &self.scene, &tile.capture);
        self.generate(frame, view, true)?;
        for (points, target) in tile.capture.points().zip(&tile.targets) {
            self.emission.record(frame, &self.scene, points, target)?;
            for technique in &mut self.techniques {
                if adds(technique.info().name) {
                    technique.gather(frame, &self.scene, points, target)?;
                }
            }
        }
        tile.samples += 1;
        Ok(())
    }

    /// The display picture: 8-bit sRGB, RGBA, row by row from the top. Of the last sample rendered with display settings.
    ///
    /// # Errors
    /// [`RenderError::Gpu`].
    pub fn pixels(&self) -> Result<Vec<u8>, RenderError> {
        Ok(self.display.pixels(&self.gpu)?)
    }

    /// Mean linear radiance, three floats a pixel, row by row from the top.
    ///
    /// # Errors
    /// [`RenderError::Gpu`].
    pub fn radiance(&self) -> Result<Vec<f32>, RenderError> {
        let scale = 1.0 / self.samples.max(1) as f32;
        let sums: Vec<[f32; 4]> = read_buffer(
            &self.gpu,
            &self.target.radiance,
            self.target.radiance.size(),
        )?;
        let count = (self.size[0] * self.size[1]) as usize;
        Ok(sums[..count]
            .iter()
            .flat_map(|sum| [sum[0], sum[1], sum[2]].map(|value| value * scale))
            .collect())
    }

    /// The packed surface points of the last sample (48 bytes each).
    pub fn surface_points(&self) -> &wgpu::Buffer {
        &self.capture.points.points
    }

    /// Bytes that techniques hold to make their maps.
    pub fn work_bytes(&self) -> u64 {
        let techniques = self.techniques.iter();
        techniques.map(|technique| technique.work_bytes()).sum()
    }

    /// Every map that exists now.
    pub fn maps(&self) -> Vec<Map> {
        self.techniques
            .iter()
            .flat_map(|technique| technique.maps())
            .collect()
    }
}

/// Classes of light that a scene has.
fn light_classes(scene: &GpuScene) -> Vec<LightClass> {
    let punctual = !scene.lights.is_empty();
    [
        (punctual, LightClass::Punctual),
        (!scene.emitters.is_empty(), LightClass::Area),
        (scene.environment.is_some(), LightClass::Environment),
    ]
    .into_iter()
    .filter_map(|(present, class)| present.then_some(class))
    .collect()
}
