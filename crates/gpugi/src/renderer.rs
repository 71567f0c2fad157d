//! Pictures: a camera's pixels as receivers of a scene's lighting, and their display.

mod shutter;
mod strips;
#[cfg(test)]
mod tests;

use std::ops::ControlFlow;

use glam::Vec2;
use gpugi_scene::{Camera, LightKind, Scene};

use crate::capture::{Lattice, SURFACE_POINT_BYTES, Target, View, VisiblePoint};
use crate::default_set::{Techniques, default_set};
use crate::denoise::{Features, OfPoints};
use crate::gpu::{
    Frame, Gpu, GpuError, ReadBack, Timing, Timings, begin_read_buffer, begin_read_part,
    read_buffer,
};
use crate::light_paths::{LightClass, LightPaths};
use crate::lighting::{Budget, Lighting, LightingError, Readiness};
use crate::picture::{Effects, Lit, Picture, Present, Shot, Shown, Strip};
use crate::scene::{Edit, GpuScene, Undo};
use crate::sequences::{low_discrepancy, sobol};
use crate::techniques::{Figure, Inspection, Map, Registry, Technique};
use shutter::{Moment, Moving};
use strips::{LitStrip, keep_features, strips};

/// Renders one scene with a set of techniques at one size.
#[derive(Debug)]
pub struct Renderer {
    gpu: Gpu,
    scene: GpuScene,
    lighting: Lighting,
    size: [u32; 2],
    strips: Vec<LitStrip>,
    /// Strips of the next sample that are lit.
    lit: usize,
    /// Strips that one call of [`Renderer::try_render_sample`] lights.
    at_once: usize,
    /// Pixels that the last frame lit, and whether it ended with the display.
    lit_points: u32,
    is_displayed: bool,
    picture: Picture,
    /// Adds what pixels see, if that is kept.
    features: Option<OfPoints>,
    samples: u32,
    /// Samples that the picture will have.
    of: u32,
    /// Whether the last picture was one of live pictures of one sample each.
    continues: bool,
    /// What moves while the shutter is open.
    moving: Option<Moving>,
    /// How the last sample's picture was seen.
    shot: Option<Shot>,
    is_through_lens: bool,
    /// Whether the next sample is the first one of the last picture once more.
    is_again: bool,
    /// Time that has passed since effects were last told (s).
    passed: f32,
    /// Time between the picture before and this one (s), as far as effects were told.
    seconds: f32,
    /// Index of this picture's first sample: live pictures continue those before them.
    first_sample: u32,
    seed: u32,
    budget: Budget,
}

/// Live pictures of one sample each repeat after so many: more than effects average.
const LIVE_SAMPLES: u32 = 64;

/// How often a first sample is displayed while its strips are lit, beside the first strip.
const PARTS_SHOWN: usize = 8;

/// While pipelines compile.
const COMPILING: Readiness = Readiness::Pending {
    progress: 0.0,
    what: "shaders",
};

impl Renderer {
    /// A renderer of `scene` at `size` pixels. `techniques`: a purpose, whose default set it takes, a set, or names.
    ///
    /// # Errors
    /// [`LightingError`].
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        size: [u32; 2],
        techniques: impl Into<Techniques>,
    ) -> Result<Self, LightingError> {
        Self::with_registry(gpu, scene, size, techniques, &Registry::default())
    }

    /// As [`Renderer::new`], with techniques of other crates.
    ///
    /// # Errors
    /// [`LightingError`].
    pub fn with_registry(
        gpu: &Gpu,
        scene: &Scene,
        size: [u32; 2],
        techniques: impl Into<Techniques>,
        registry: &Registry,
    ) -> Result<Self, LightingError> {
        let set = match techniques.into() {
            Techniques::Named(names) => return Self::of(gpu, scene, size, &names, registry),
            Techniques::Default(purpose) => default_set(scene, &gpu.adapter, purpose, registry),
            Techniques::Set(set) => set,
        };
        let mut renderer = Self::of(gpu, scene, size, &set.names(), registry)?;
        for choice in &set.choices {
            for (name, value) in &choice.settings {
                renderer.set(choice.technique, name, value)?;
            }
        }
        Ok(renderer)
    }

    fn of(
        gpu: &Gpu,
        scene: &Scene,
        size: [u32; 2],
        names: &[String],
        registry: &Registry,
    ) -> Result<Self, LightingError> {
        let gpu = &gpu.apart();
        let mut scene = Lighting::upload(gpu, scene, names, registry)?;
        let lighting = Lighting::new(gpu, &mut scene, names, registry)?;
        let strips = strips(gpu, &lighting, size, u32::MAX)?;
        // Errors of pipelines and bind groups belong to this call.
        gpu.check()?;
        Ok(Self {
            picture: Picture::new(gpu, size)?,
            gpu: gpu.clone(),
            scene,
            lighting,
            size,
            strips,
            lit: 0,
            at_once: usize::MAX,
            lit_points: 0,
            is_displayed: false,
            features: None,
            samples: 0,
            of: 1,
            continues: false,
            moving: None,
            shot: None,
            is_through_lens: false,
            is_again: false,
            passed: 0.0,
            seconds: 0.0,
            first_sample: 0,
            seed: 0,
            budget: Budget::UNLIMITED,
        })
    }

    /// Whether its pipelines are still being compiled: until then, [`Renderer::try_render_sample`] adds no sample. In a
    /// browser, each call compiles one.
    pub fn is_compiling(&self) -> bool {
        self.gpu.is_compiling()
    }

    /// Changes the size of the picture (pixels); accumulation restarts, maps stay, and so does what live pictures remember.
    ///
    /// # Errors
    /// [`LightingError::Gpu`]; the renderer keeps its size then.
    pub fn resize(&mut self, size: [u32; 2]) -> Result<(), LightingError> {
        self.cut(size, u32::MAX)
    }

    /// As [`Renderer::resize`], for live views at rest whose pixels take longer than a frame may: each call of
    /// [`Renderer::try_render_sample`] lights a strip of rows of no more than `most_points` pixels, but at least one row.
    /// While the first sample is on its way, other strips show what the picture showed before, at another size.
    ///
    /// # Errors
    /// As [`Renderer::resize`].
    pub fn resize_in_strips(
        &mut self,
        size: [u32; 2],
        most_points: u32,
    ) -> Result<(), LightingError> {
        self.cut(size, most_points)?;
        self.at_once = 1;
        Ok(())
    }

    /// How much of the next sample is lit (0 to 1), after [`Renderer::resize_in_strips`].
    pub fn progress(&self) -> f32 {
        self.lit as f32 / self.strips.len() as f32
    }

    /// Pixels that the last frame lit.
    pub fn lit_points(&self) -> u32 {
        self.lit_points
    }

    /// Whether the last frame that rendered a sample, or a strip of one, displayed it.
    pub fn is_displayed(&self) -> bool {
        self.is_displayed
    }

    /// As [`Renderer::resize`], in strips of no more than `most_points` pixels.
    pub(crate) fn cut(&mut self, size: [u32; 2], most_points: u32) -> Result<(), LightingError> {
        let limits = self.gpu.limits();
        let most_points = match &self.features {
            Some(_) => {
                let bytes = limits.max_storage_buffer_binding_size / size_of::<Features>() as u64;
                most_points.min(bytes.try_into().unwrap_or(u32::MAX))
            }
            None => most_points,
        };
        let mut strips = strips(&self.gpu, &self.lighting, size, most_points)?;
        if self.features.is_some() {
            keep_features(&self.gpu, &mut strips)?;
        }
        self.picture = self.picture.resized(&self.gpu, size)?;
        self.strips = strips;
        self.at_once = usize::MAX;
        self.size = size;
        self.restart();
        Ok(())
    }

    /// Sets one setting of one technique from text. What is refused is not kept.
    ///
    /// # Errors
    /// [`LightingError::UnknownTechnique`] when it is not among those in use, [`LightingError::Setting`],
    /// [`LightingError::Overlap`].
    pub fn set(&mut self, technique: &str, name: &str, value: &str) -> Result<(), LightingError> {
        self.picture.forget();
        self.lighting.set(&mut self.scene, technique, name, value)
    }

    /// Changes the technique of this type, if it is in use, by its struct: `renderer.change(|shadows: &mut ShadowMap|
    /// shadows.settings.taps = 32)`. Settings that are refused are not kept.
    ///
    /// # Errors
    /// [`LightingError::Overlap`].
    pub fn change<T: Technique>(
        &mut self,
        change: impl FnOnce(&mut T),
    ) -> Result<(), LightingError> {
        self.picture.forget();
        let Some(technique) = self.lighting.technique_mut::<T>() else {
            return Ok(());
        };
        let before = technique.settings().to_json();
        change(technique);
        let planned = self.lighting.validate(&mut self.scene);
        if planned.is_err()
            && let Some(technique) = self.lighting.technique_mut::<T>()
        {
            // These values were valid a moment ago.
            let _ = technique.settings_mut().replace(before);
            self.lighting.validate(&mut self.scene)?;
        }
        planned
    }

    /// Seeds everything stochastic. The same seed gives the same picture on the same adapter, of a new renderer: maps
    /// that improve from frame to frame are kept when accumulation restarts.
    pub fn set_seed(&mut self, seed: u32) {
        self.seed = seed;
        self.restart();
    }

    /// Limits the work on maps per frame, for live views; unlimited at first. Returns the limit before.
    pub fn set_budget(&mut self, budget: Budget) -> Budget {
        std::mem::replace(&mut self.budget, budget)
    }

    /// Work on maps in the last frame, in units of [`Budget`].
    pub fn work(&self) -> u64 {
        self.lighting.work()
    }

    /// How often it has waited for the GPU: never in [`Renderer::try_render_sample`] and [`Renderer::try_converge`].
    pub fn waits(&self) -> u64 {
        self.gpu.waits()
    }

    /// Width and height of the picture (pixels).
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Light that the techniques in use add.
    pub fn light_paths(&self) -> Vec<LightPaths> {
        self.lighting.light_paths()
    }

    /// Light that one technique adds; none when it is not in use.
    pub fn light_paths_of(&self, technique: &str) -> &[LightPaths] {
        self.lighting.light_paths_of(technique)
    }

    /// Classes of light that the scene has.
    pub fn light_classes(&self) -> Vec<LightClass> {
        self.scene.light_classes()
    }

    /// Bytes that the picture takes: surface points, radiance, how far away is what they mirror, and noise.
    pub fn picture_bytes(&self) -> u64 {
        let of_strip = |LitStrip { receiver, .. }: &LitStrip| {
            let Target {
                radiance,
                mirrored,
                noisy,
            } = &receiver.target;
            receiver.points.points.size() + radiance.size() + mirrored.size() + noisy.size()
        };
        self.strips.iter().map(of_strip).sum()
    }

    /// The techniques in use.
    pub fn techniques(&self) -> &[Box<dyn Technique>] {
        self.lighting.techniques()
    }

    /// The lighting of the scene.
    pub fn lighting(&self) -> &Lighting {
        &self.lighting
    }

    /// The scene on the GPU.
    pub fn scene(&self) -> &GpuScene {
        &self.scene
    }

    /// Follows the scene to its state `after` ([`GpuScene::update`]); accumulation restarts.
    ///
    /// # Errors
    /// [`LightingError::Gpu`]; [`LightingError::Overlap`] and [`LightingError::Needs`] when the techniques do not fit the
    /// scene as it would be. Nothing has changed then, and accumulation goes on.
    pub fn update(&mut self, after: &Scene) -> Result<(), LightingError> {
        self.end_motion()?;
        self.change_scene(|scene, gpu| scene.update_with_undo(gpu, after))
    }

    /// Edits the scene ([`GpuScene::edit`]); accumulation restarts.
    ///
    /// # Errors
    /// As [`Renderer::update`].
    pub fn edit(&mut self, edits: &[Edit]) -> Result<(), LightingError> {
        self.end_motion()?;
        self.change_scene(|scene, gpu| scene.edit_with_undo(gpu, edits))
    }

    /// Changes the scene. Techniques plan anew only if what they plan for has changed: that takes milliseconds, too long
    /// for every frame of an animation. They plan for the scene on the GPU, so what they refuse is taken back there.
    fn change_scene(
        &mut self,
        change: impl FnOnce(&mut GpuScene, &Gpu) -> Result<Undo, GpuError>,
    ) -> Result<(), LightingError> {
        let planned_for = |scene: &GpuScene| {
            let lights = scene.lights.iter().map(|light| light.kind);
            let has_kinds = lights.fold([false; 2], |[directional, other], kind| {
                let is_directional = kind == LightKind::Directional;
                [directional || is_directional, other || !is_directional]
            });
            let counts = [scene.lights.len(), scene.emitters.len(), scene.media.len()];
            (
                scene.versions.objects,
                scene.light_classes(),
                has_kinds,
                counts,
            )
        };
        let before = planned_for(&self.scene);
        let undo = change(&mut self.scene, &self.gpu)?;
        if planned_for(&self.scene) != before
            && let Err(refused) = self.lighting.validate(&mut self.scene)
        {
            self.scene.undo(&self.gpu, undo)?;
            // The techniques did fit this scene.
            self.lighting.validate(&mut self.scene)?;
            return Err(refused);
        }
        self.restart();
        Ok(())
    }

    /// Light that exists in the scene and that no technique in use adds: a few words each.
    pub fn left_out(&self) -> Vec<String> {
        self.lighting.left_out(&self.scene)
    }

    /// What is to be known of the picture beyond its light paths, as far as it is known yet: one sentence each.
    pub fn warnings(&self) -> Vec<String> {
        let inspections = self.lighting.inspect();
        let warnings = inspections.flat_map(|(name, inspection)| {
            let warnings = inspection.warnings.into_iter();
            warnings.map(move |warning| format!("{name}: {warning}"))
        });
        warnings.collect()
    }

    /// Samples accumulated so far.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Forgets the accumulated samples: another picture begins.
    pub fn restart(&mut self) {
        self.begin_again();
        self.is_again = false;
    }

    /// Forgets the accumulated samples: the same picture begins again, such as with better maps. The picture before it
    /// stays the one before.
    pub fn begin_again(&mut self) {
        self.is_again |= self.samples > 0 || self.lit > 0;
        self.first_sample = (self.first_sample + self.samples) % LIVE_SAMPLES;
        (self.samples, self.lit) = (0, 0);
    }

    /// Lets time pass (s), for effects that change over time, such as exposure that adapts: to be called before each frame,
    /// with the time since the one before. The library reads no clock. While no time passes, such effects are done at once.
    pub fn pass_time(&mut self, seconds: f32) {
        if seconds > 0.0 {
            self.passed += seconds.min(f32::MAX / 2.0 - self.passed);
        }
    }

    /// As [`Renderer::restart`], where the next picture has nothing to do with those before it, such as after a cut:
    /// effects forget them, too.
    pub fn forget(&mut self) {
        self.restart();
        self.picture.forget();
    }

    /// Makes every map stale, so that the next sample generates all of them: for measuring.
    pub fn invalidate(&mut self) {
        self.scene.invalidate();
    }

    /// Makes the maps stale that depend on geometry, as if every instance had moved.
    pub fn invalidate_geometry(&mut self) {
        self.scene.invalidate_geometry();
    }

    /// Brings the maps of all techniques to their final state for what `camera` sees, before the first sample of a
    /// still picture: otherwise the first samples show maps that are still refined, such as the first of 256 iterates
    /// of radiosity. Adds no sample. Calls `report` after each frame with how far the maps are and, if `timed`, the GPU
    /// times of the frame's passes; with [`ControlFlow::Break`] the maps stay as they are. Returns how far they are at
    /// the end: [`Readiness::Ready`] unless `report` broke off. The number of frames depends on scene and settings
    /// alone, never on the clock.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn converge(
        &mut self,
        camera: &Camera,
        timed: bool,
        mut report: impl FnMut(Readiness, Vec<Timing>) -> ControlFlow<()>,
    ) -> Result<Readiness, LightingError> {
        let gpu = self.gpu.clone();
        loop {
            let mut frame = Frame::new(&gpu, timed);
            let readiness = self.prepare(&mut frame, camera)?;
            let times = frame.submit()?;
            // Waiting after each frame keeps the queue short, so that progress is accurate and breaking off takes
            // effect at once.
            gpu.wait()?;
            let flow = report(readiness, times.wait()?);
            if readiness == Readiness::Ready || flow.is_break() {
                return Ok(readiness);
            }
            self.scene.wait_for_atlas();
        }
    }

    /// One frame of [`Renderer::converge`] that never waits, for loops that must not block: to be called until the maps
    /// are [`Readiness::Ready`].
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn try_converge(&mut self, camera: &Camera) -> Result<Readiness, LightingError> {
        if self.gpu.is_compiling() {
            return Ok(COMPILING);
        }
        let gpu = self.gpu.clone();
        let mut frame = Frame::without_waiting(&gpu, false);
        let readiness = self.prepare(&mut frame, camera)?;
        frame.submit()?;
        Ok(readiness)
    }

    /// Records a frame that only brings maps further, for the view through the pixels' centres.
    fn prepare(
        &mut self,
        frame: &mut Frame<'_>,
        camera: &Camera,
    ) -> Result<Readiness, LightingError> {
        // As for the first sample of several.
        let steps = self.moving.as_ref().map_or(1, |moving| moving.steps);
        let readiness = match self.open_shutter(camera, steps.max(2))? {
            Moment::Now => self.prepare_maps(frame, camera)?,
            Moment::Sample(camera) | Moment::Maps(camera) => {
                let readiness = self.prepare_maps(frame, &camera)?;
                self.followed(readiness);
                readiness
            }
        };
        Ok(readiness)
    }

    /// Records what brings maps further.
    fn prepare_maps(
        &mut self,
        frame: &mut Frame<'_>,
        camera: &Camera,
    ) -> Result<Readiness, GpuError> {
        let diagonal = self.scene.diagonal();
        let (index, seed) = (View::NO_SAMPLE, self.seed);
        let camera = View::behind_lens(camera, self.size, diagonal);
        let view = View::new(&camera, self.size, Vec2::ZERO, index, seed, diagonal);
        let budget = self.budget;
        self.lighting.prepare(frame, &mut self.scene, &view, budget)
    }

    /// Renders one more sample of the picture that `camera` sees: the first through pixel centres when it is to be the
    /// only one of `of`, otherwise spread over the pixel by a box filter. With `effects`, ends with these and the display.
    /// If they average frames, the only sample of a frame lies elsewhere in the pixel each time, and the first one of
    /// several begins a picture of its own. Waits for the GPU only while maps are pending.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn render_sample(
        &mut self,
        camera: &Camera,
        of: u32,
        effects: Option<&Effects>,
        timed: bool,
    ) -> Result<Timings, LightingError> {
        let gpu = self.gpu.clone();
        let mut timings = Timings::default();
        loop {
            let mut frame = Frame::new(&gpu, timed);
            let readiness = self.record(&mut frame, camera, of, effects, usize::MAX)?;
            timings = timings.then(frame.submit()?);
            if readiness.is_usable() {
                return Ok(timings);
            }
            gpu.wait()?;
            self.scene.wait_for_atlas();
        }
    }

    /// As [`Renderer::render_sample`], without ever waiting: while pipelines compile or maps are pending, no sample is
    /// added. After [`Renderer::resize_in_strips`], the last strip adds the sample.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn try_render_sample(
        &mut self,
        camera: &Camera,
        of: u32,
        effects: Option<&Effects>,
        timed: bool,
    ) -> Result<(Readiness, Timings), LightingError> {
        (self.lit_points, self.is_displayed) = (0, false);
        if self.gpu.is_compiling() {
            return Ok((COMPILING, Timings::default()));
        }
        let gpu = self.gpu.clone();
        let mut frame = Frame::without_waiting(&gpu, timed);
        let readiness = self.record(&mut frame, camera, of, effects, self.at_once)?;
        Ok((readiness, frame.submit()?))
    }

    /// Records the frame: prepare; then, when maps are usable, capture, resolve and gather of no more than `at_once`
    /// strips, effects and display.
    fn record(
        &mut self,
        frame: &mut Frame<'_>,
        camera: &Camera,
        of: u32,
        effects: Option<&Effects>,
        at_once: usize,
    ) -> Result<Readiness, LightingError> {
        let remembers = effects.is_some_and(|effects| effects.temporal_antialiasing.is_on());
        if let Some(effects) = effects {
            let of_light = (camera, self.lighting.is_noisy());
            (self.picture).prepare(&self.gpu, &self.scene, of_light, effects)?;
            if frame.awaits_shaders() {
                return Ok(COMPILING);
            }
        }
        if remembers {
            self.scene.keep_vertices(&self.gpu)?;
        }
        // Live pictures of one sample each continue those before them; others are as if there were none.
        let continues = remembers && of <= 1;
        if std::mem::replace(&mut self.continues, continues) && !continues {
            self.begin_again();
        }
        let index = match continues {
            true => self.first_sample,
            false => self.samples,
        };
        let moved;
        let camera = match self.open_shutter(camera, of)? {
            Moment::Now => camera,
            Moment::Sample(camera) => {
                moved = camera;
                &moved
            }
            Moment::Maps(camera) => {
                let readiness = self.prepare_maps(frame, &camera)?;
                return Ok(self.followed(readiness));
            }
        };
        let jitter = if of <= 1 && !remembers {
            Vec2::ZERO
        } else {
            low_discrepancy(index) - 0.5
        };
        let diagonal = self.scene.diagonal();
        // Frames that continue each other share the pixels.
        let lattice = match effects {
            Some(effects) if continues => {
                let lookups = self.lighting.lookups();
                Lattice::of_frame(effects.temporal_antialiasing.interval_of(lookups), index)
            }
            _ => Lattice::ALL,
        };
        // How often a pixel was lit before.
        let index = index / lattice.interval.pow(2);
        // A single sample sees through the middle of the lens.
        let sees_through_lens = of > 1 && !camera.lens.is_pinhole();
        let mut view = View::new(camera, self.size, jitter, index, self.seed, diagonal)
            .accumulating(self.samples > 0);
        let mut of_maps = view;
        if sees_through_lens {
            let behind = View::behind_lens(camera, self.size, diagonal);
            of_maps = View::new(&behind, self.size, jitter, index, self.seed, diagonal);
            view = view.through(camera.lens.sample(sobol(index)), camera.lens.focus);
        }
        let budget = self.budget;
        let readiness = self
            .lighting
            .prepare(frame, &mut self.scene, &of_maps, budget)?;
        if !readiness.is_usable() {
            return Ok(readiness);
        }
        // Gathers take the CPU longest: the GPU need not wait for them.
        if self.lighting.work() > 0 {
            frame.flush();
        }
        let is_noisy = remembers && self.lighting.is_noisy();
        let first = self.lit;
        self.lit_points = 0;
        let end = first.saturating_add(at_once).min(self.strips.len());
        for strip in &mut self.strips[first..end] {
            strip.expect_noise(frame, is_noisy, self.samples == 0)?;
            strip.samples = self.samples + 1;
            let lattice = lattice.below(strip.rows.start);
            let view = view.of_rows(&strip.rows).lit_on(lattice);
            strip.receiver.points.lit = lattice.count([view.uniform.width, view.uniform.height]);
            self.lit_points += strip.receiver.points.lit;
            strip
                .capture
                .record(frame, &self.scene, &view, |draw| draw.seen)?;
            frame.flush();
            frame.clear(&strip.receiver.target.mirrored);
            self.lighting.gather(frame, &self.scene, &strip.receiver)?;
            if let (Some(pass), Some(features)) = (&self.features, &strip.features) {
                pass.record(frame, &strip.receiver, features)?;
            }
        }
        if self.samples == 0 && first == 0 && !std::mem::take(&mut self.is_again) {
            self.picture.advance();
            self.seconds = 0.0;
        }
        let is_complete = end == self.strips.len();
        let is_first = self.samples == 0;
        self.lit = if is_complete { 0 } else { end };
        self.samples += u32::from(is_complete);
        self.of = of;
        self.is_through_lens = sees_through_lens;
        self.shot = Some(Shot::new(&view, camera, self.size, &self.scene));
        // Parts of later samples are hardly seen, and display takes as long as some strips.
        let shown_part = |strips: usize| strips * PARTS_SHOWN / self.strips.len();
        let is_part_seen = first == 0 || shown_part(end) > shown_part(first);
        let is_seen = is_first && remembers && is_part_seen;
        self.is_displayed = effects.is_some() && (is_complete || is_seen);
        if let Some(effects) = effects.filter(|_| self.is_displayed) {
            self.show(frame, Shown::Picture, effects)?;
        }
        Ok(readiness)
    }

    /// Records what turns the samples so far into the pixels of a display.
    fn show(
        &mut self,
        frame: &mut Frame<'_>,
        shown: Shown<'_>,
        effects: &Effects,
    ) -> Result<(), GpuError> {
        // Nothing is seen before the first sample.
        let Some(shot) = self.shot else {
            return Ok(());
        };
        self.seconds += std::mem::take(&mut self.passed);
        let lit = match self.samples {
            0 => &self.strips[..self.lit],
            _ => &self.strips,
        };
        let strips: Vec<Strip<'_>> = lit.iter().map(LitStrip::strip).collect();
        let lit = Lit {
            strips: &strips,
            samples: self.samples.max(1),
            of: self.of,
            is_through_lens: self.is_through_lens,
            shot,
            seconds: self.seconds,
        };
        self.picture.record(frame, &self.scene, lit, shown, effects)
    }

    /// Displays the samples accumulated so far, beside a reference or not, or what they see.
    ///
    /// # Errors
    /// [`GpuError`], also when what is shown has another size.
    pub fn display(&mut self, shown: Shown<'_>, effects: &Effects) -> Result<(), GpuError> {
        let gpu = self.gpu.clone();
        let mut frame = Frame::new(&gpu, false);
        self.show(&mut frame, shown, effects)?;
        frame.submit().map(|_| ())
    }

    /// Draws the display picture onto a colour target of its size, such as the texture of a window: pass
    /// [`Present`].
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn present(
        &self,
        frame: &mut Frame<'_>,
        present: &Present,
        target: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        present.record(frame, &self.picture, target)
    }

    /// The display picture: 8-bit sRGB, RGBA, row by row from the top. Of the last sample rendered with display
    /// settings.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn pixels(&self) -> Result<Vec<u8>, GpuError> {
        self.picture.pixels(&self.gpu)
    }

    /// The exposure value (EV) of the picture that was displayed last: the manual value, or the result of automatic
    /// exposure.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn exposure_value(&self) -> Result<f32, GpuError> {
        self.picture.exposure_value(&self.gpu)
    }

    /// The future of [`Renderer::pixels`].
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn begin_pixels(&self) -> Result<ReadBack<Vec<u8>>, GpuError> {
        self.picture.begin_pixels(&self.gpu)
    }

    /// Mean linear radiance, three floats per pixel, row by row from the top.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn radiance(&self) -> Result<Vec<f32>, GpuError> {
        let radiance = self.begin_radiance()?;
        self.gpu.wait()?;
        pollster::block_on(radiance)
    }

    /// Mean linear radiance as the last live picture shows it, filtered and averaged over frames, before lens and display:
    /// three floats per pixel, row by row from the top. Empty if no frame was shown with effects of a live view.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn live_radiance(&self) -> Result<Vec<f32>, GpuError> {
        self.picture.live_radiance(&self.gpu)
    }

    /// The future of [`Renderer::radiance`]: of the samples so far, whatever is rendered before it resolves.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn begin_radiance(
        &self,
    ) -> Result<impl Future<Output = Result<Vec<f32>, GpuError>> + use<>, GpuError> {
        let values = (self.size[0] * self.size[1] * 3) as usize;
        let read = |strip: &LitStrip| {
            let bytes = u64::from(strip.receiver.points.count) * 16;
            begin_read_buffer::<[f32; 4]>(&self.gpu, &strip.receiver.target.radiance, bytes)
        };
        let sums = (self.strips.iter()).map(|strip| Ok((strip.samples, read(strip)?)));
        let sums = sums.collect::<Result<Vec<_>, GpuError>>()?;
        Ok(async move {
            let mut all = Vec::with_capacity(values);
            for (samples, sums) in sums {
                let scale = 1.0 / samples.max(1) as f32;
                let rgb = |[r, g, b, _]: [f32; 4]| [r, g, b].map(|value| value * scale);
                all.extend(sums.await?.into_iter().flat_map(rgb));
            }
            Ok(all)
        })
    }

    /// The surface points of the last sample, row by row from the top; `None` where no surface is.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn surface_points(&self) -> Result<Vec<Option<VisiblePoint>>, GpuError> {
        let mut all = Vec::with_capacity((self.size[0] * self.size[1]) as usize);
        for strip in &self.strips {
            let bytes = u64::from(strip.receiver.points.count) * SURFACE_POINT_BYTES;
            let words: Vec<u32> = read_buffer(&self.gpu, &strip.receiver.points.points, bytes)?;
            all.extend(words.chunks_exact(12).map(VisiblePoint::unpack));
        }
        Ok(all)
    }

    /// Keeps what pixels see of surfaces ([`Renderer::features`]): 80 bytes per pixel. Accumulation restarts.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn keep_features(&mut self) -> Result<(), LightingError> {
        self.features = Some(OfPoints::new(&self.gpu)?);
        self.resize(self.size)
    }

    /// What the pixels see of surfaces, over all samples of the picture, row by row from the top; empty without
    /// [`Renderer::keep_features`].
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn features(&self) -> Result<Vec<Features>, GpuError> {
        let mut all = Vec::new();
        for strip in &self.strips {
            if let Some(features) = &strip.features {
                all.extend(read_buffer::<Features>(
                    &self.gpu,
                    features,
                    features.size(),
                )?);
            }
        }
        Ok(all)
    }

    /// The surface point that the last sample shows at `pixel` (from the top left), when it arrives; `None` where no
    /// surface is.
    ///
    /// # Errors
    /// [`GpuError::Input`] when the pixel is outside of the picture.
    pub fn pick(&self, pixel: [u32; 2]) -> Result<ReadBack<Option<VisiblePoint>>, GpuError> {
        let strip = self
            .strips
            .iter()
            .find(|strip| strip.rows.contains(&pixel[1]));
        let strip = strip
            .filter(|_| pixel[0] < self.size[0])
            .ok_or_else(|| GpuError::Input {
                what: format!("pixel {}, {} is outside of the picture", pixel[0], pixel[1]),
            })?;
        let index = (pixel[1] - strip.rows.start) * self.size[0] + pixel[0];
        let first = u64::from(index) * SURFACE_POINT_BYTES;
        let range = first..first + SURFACE_POINT_BYTES;
        begin_read_part(&self.gpu, &strip.receiver.points.points, range, |bytes| {
            VisiblePoint::unpack(&bytemuck::pod_collect_to_vec(&bytes))
        })
    }

    /// What exists of each technique on the GPU, with its name.
    pub fn inspect(&self) -> impl Iterator<Item = (&'static str, Inspection)> {
        self.lighting.inspect()
    }

    /// Numbers about the techniques' work since the last call. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn figures(&mut self) -> Result<Vec<Figure>, GpuError> {
        self.lighting.figures()
    }

    /// Bytes that techniques hold to make their maps.
    pub fn work_bytes(&self) -> u64 {
        self.lighting
            .inspect()
            .map(|(_, inspection)| inspection.work_bytes)
            .sum()
    }

    /// Every map that exists now.
    pub fn maps(&self) -> Vec<Map> {
        self.lighting.maps()
    }
}
