//! What is seen: a scene, its renderer and a camera, and the loop that shows frame after frame. It knows nothing of
//! windows, so that tests and headless runs drive the same loop.

mod beside;
mod play;

use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;

use gpugi::capture::VisiblePoint;
use gpugi::gpu::{Frame, Gpu, GpuError, ReadBack};
use gpugi::picture::{Compared, Effects, Present, Quantity, Shown as Source, Surfaces};
use gpugi::scene::Edit;
use gpugi::techniques::Technique;
use gpugi::{LightingError, Readiness, Renderer};
use gpugi_arguments::edits;
use gpugi_scene::{Document, Scene};

use crate::camera_control::CameraControl;
use crate::game::ball::Finish;
use crate::game::{Game, Intent};
use crate::pace::{Detail, Pace, Purpose};
use crate::technique_set::{PATH_TRACER, TechniqueSet};
use crate::timings::PassTimes;
use crate::truth::Truth;

/// Time that passes at most from frame to frame for a camera that is steered, and for animations and effects (s).
const LONGEST_STEERED: f32 = 0.1;
const LONGEST_FRAME: f32 = 0.25;
/// Time at rest after which a picture gets all its pixels (s).
const REST_SECONDS: f32 = 0.2;
/// While maps are refined at rest, the time between two pictures is this multiple of what a picture takes, within these
/// limits (s).
const MAPS_PER_PICTURE: f32 = 3.0;
const MAPS_SECONDS: [f32; 2] = [0.1, 2.0];

/// Format of the picture, as egui wants it.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// Radiance on its way to the host.
pub type Radiance = Pin<Box<dyn Future<Output = Result<Vec<f32>, GpuError>> + Send>>;

/// A scene that is ready to be shown.
#[derive(Debug)]
pub struct Loaded {
    /// The arguments of `gpugi render` that select the scene.
    pub arguments: Vec<String>,
    /// What was edited since it was read, as `--edit` takes it.
    pub edits: Vec<String>,
    /// The scene.
    pub document: Document,
    /// Its renderer, which has seen all edits of the document.
    pub renderer: Renderer,
    /// Its techniques.
    pub set: TechniqueSet,
    /// What is to be known about it, one sentence each.
    pub notes: Vec<String>,
}

impl Loaded {
    /// The scene as it is now.
    pub fn scene(&self) -> &Scene {
        self.document.scene()
    }

    /// Makes edits that the renderer does not refuse.
    fn edit(&mut self, edits: &[Edit]) -> Result<(), LightingError> {
        self.renderer.edit(edits)?;
        self.document.edit(edits);
        Ok(())
    }
}

/// A texture with the last picture.
#[derive(Debug)]
pub struct Picture {
    /// The texture's view.
    pub view: wgpu::TextureView,
    /// Width and height (pixels).
    pub size: [u32; 2],
}

fn has_size(picture: &Option<Picture>, size: [u32; 2]) -> bool {
    picture.as_ref().is_some_and(|picture| picture.size == size)
}

/// Animation of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Clock {
    /// Whether it runs.
    pub is_playing: bool,
    /// Time of the pose (s).
    pub seconds: f32,
}

/// What a frame did.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Shown {
    /// Whether the picture changed.
    pub is_new: bool,
    /// Whether another frame would change nothing, until something is done or what is opened is ready.
    pub is_final: bool,
}

/// A scene on show.
pub struct Session {
    gpu: Gpu,
    present: Present,
    loaded: Loaded,
    /// The camera before somebody steered.
    first: CameraControl,
    /// The camera.
    pub camera: CameraControl,
    /// What happens to the picture before it is shown, such as exposure and tone mapping.
    pub effects: Effects,
    /// Pace of frames.
    pub pace: Pace,
    /// Samples per pixel of a picture at rest.
    pub samples: u32,
    /// The animation.
    pub clock: Clock,
    /// Whether time stands still: neither camera nor animation move.
    pub is_held: bool,
    /// Whether the GPU has other work, such as what is being opened: a picture at rest then leaves it to that.
    pub is_disturbed: bool,
    /// Whether passes are timed.
    pub is_timed: bool,
    /// GPU times of passes.
    pub pass_times: PassTimes,
    /// What is shown of the surfaces in place of the picture, if anything.
    pub quantity: Option<Quantity>,
    surfaces: Option<([u32; 2], Surfaces)>,
    /// What is shown of the path tracer's picture beside it, if anything. The surfaces go first. Without meaning where
    /// the path tracer takes the place of all techniques.
    pub compared: Option<Compared>,
    truth: Option<Truth>,
    /// Samples that the path tracer takes per pixel beside the picture.
    pub truth_samples: u32,
    /// Whether the noise of the path tracer's picture is filtered out of what is shown; never out of what is saved.
    pub denoises_truth: bool,
    /// Wakes the window when the truth begins.
    wake: Arc<dyn Fn() + Send + Sync>,
    readiness: Readiness,
    picture: Option<Picture>,
    displayed: (Effects, Option<Compared>, Option<Quantity>),
    is_edited: bool,
    at_rest: f32,
    /// Time that has passed for effects since the last change (s). None passes while time stands still.
    passed: f32,
    /// Width and height of the window's last picture (pixels).
    window: [u32; 2],
    detail: Detail,
    /// Width and height of the picture (pixels), and how many of its pixels a frame lights at most.
    pixels: ([u32; 2], u32),
    /// What the last frame was for, if its time says something.
    was_for: Option<Purpose>,
    /// Time since the last frame with a new picture ended (s).
    unchanged: f32,
    /// Time that the last frame with a new picture took (s), once it is known.
    picture_took: Option<f32>,
    /// Whether the next click focuses the lens.
    pub is_focusing: bool,
    /// Whether who walks and what was thrown stand still, as an animation does that is paused.
    pub is_game_paused: bool,
    /// What somebody who walks wants.
    pub intent: Intent,
    /// What balls are made of.
    pub finish: Finish,
    game: Option<Game>,
    /// Clicks at pixels that are not lit yet.
    asked: Vec<(Pick, [f32; 2])>,
    picks: Vec<(Pick, ReadBack<Option<VisiblePoint>>)>,
    /// What is seen in the middle of the picture, for the camera to orbit around.
    middle: Option<ReadBack<Option<VisiblePoint>>>,
}

/// What a click was for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pick {
    /// To turn the camera there.
    Focus,
    /// To focus the lens there.
    Sharpen,
    /// To select the object.
    Select,
}

impl Session {
    /// Shows `loaded` as `camera` sees it. `wake` is called when there is something new to show.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn new(
        gpu: &Gpu,
        loaded: Loaded,
        camera: CameraControl,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> Result<Self, LightingError> {
        Ok(Self {
            gpu: gpu.clone(),
            present: Present::new(gpu, FORMAT)?,
            first: camera.clone(),
            camera,
            effects: Effects::of_live_view(),
            pace: Pace::default(),
            samples: loaded.set.default_samples(),
            clock: Clock::default(),
            is_held: false,
            is_disturbed: false,
            is_timed: false,
            pass_times: PassTimes::default(),
            quantity: None,
            surfaces: None,
            compared: None,
            truth: None,
            truth_samples: 1024,
            denoises_truth: true,
            wake: Arc::new(wake),
            readiness: Readiness::Refining { progress: 0.0 },
            picture: None,
            displayed: (Effects::default(), None, None),
            is_edited: true,
            at_rest: 0.0,
            passed: 0.0,
            window: [1, 1],
            detail: Detail::Moving,
            pixels: (loaded.renderer.size(), u32::MAX),
            was_for: None,
            unchanged: 0.0,
            picture_took: Some(0.0),
            is_focusing: false,
            is_game_paused: false,
            intent: Intent::default(),
            finish: Finish::default(),
            game: None,
            asked: Vec::new(),
            picks: Vec::new(),
            middle: None,
            loaded,
        })
    }

    /// The same view on another device, with `loaded` in place of its scene: what people chose stays.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn renewed(
        self,
        gpu: &Gpu,
        loaded: Loaded,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> Result<Self, LightingError> {
        let mut session = Self {
            camera: self.camera,
            effects: self.effects,
            pace: self.pace,
            samples: self.samples,
            clock: self.clock,
            is_held: self.is_held,
            is_timed: self.is_timed,
            quantity: self.quantity,
            compared: self.compared,
            truth_samples: self.truth_samples,
            denoises_truth: self.denoises_truth,
            finish: self.finish,
            game: self.game,
            ..Self::new(gpu, loaded, self.first, wake)?
        };
        session.renew_game(session.balls());
        Ok(session)
    }

    /// Shows another scene as `camera` sees it; exposure, pace and the like stay.
    pub fn open(&mut self, loaded: Loaded, camera: CameraControl) {
        self.first = camera.clone();
        self.camera = camera;
        self.clock = Clock::default();
        self.game = None;
        self.take(loaded);
    }

    /// Shows the same scene with another renderer, from where the camera stands. `edits` are those that were made
    /// meanwhile.
    ///
    /// # Errors
    /// [`LightingError`]; what was on show stays.
    pub fn replace(&mut self, mut loaded: Loaded, edits: &[Edit]) -> Result<(), LightingError> {
        loaded.edit(edits)?;
        loaded.edits.clone_from(&self.loaded.edits);
        self.take(loaded);
        Ok(())
    }

    fn take(&mut self, loaded: Loaded) {
        if self.samples == self.loaded.set.default_samples() {
            self.samples = loaded.set.default_samples();
        }
        self.loaded = loaded;
        self.renew_game(self.balls());
        self.readiness = Readiness::Refining { progress: 0.0 };
        self.is_edited = true;
        // The next one has the shaders of today.
        self.truth = None;
        self.pass_times.clear();
        self.asked.clear();
        self.picks.clear();
        self.middle = None;
    }

    /// Stands where a camera of the scene stands.
    pub fn stand_at(&mut self, camera: usize) {
        let scene = self.loaded.scene();
        if let Some(camera) = scene.cameras.get(camera) {
            self.first = CameraControl::new(camera, &scene.bounds());
            self.reset_camera();
        }
    }

    /// Goes back to where the camera stood before somebody steered.
    pub fn reset_camera(&mut self) {
        self.loaded.renderer.forget();
        self.camera = self.first.clone();
        self.middle = None;
        self.is_edited = true;
        self.walk_on();
    }

    /// The scene as it is now, with its techniques and where it comes from.
    pub fn loaded(&self) -> &Loaded {
        &self.loaded
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The last picture.
    pub fn picture(&self) -> Option<&Picture> {
        self.picture.as_ref()
    }

    /// How far the maps are.
    pub fn readiness(&self) -> Readiness {
        self.readiness
    }

    /// Changes the scene.
    ///
    /// # Errors
    /// [`LightingError`]; the scene is as before then.
    pub fn edit(&mut self, edit: &Edit) -> Result<(), LightingError> {
        let words = edits::in_words(edit, self.loaded.scene());
        self.loaded.edit(std::slice::from_ref(edit))?;
        self.loaded.edits = edits::followed_by(&self.loaded.edits, words);
        self.is_edited = true;
        Ok(())
    }

    /// The edits of lights, objects, materials and environment that are on show, as `--edit` takes them.
    pub fn edits(&self) -> Vec<String> {
        edits::holding(&self.loaded.edits, self.loaded.scene())
    }

    /// Changes a setting of a technique in use.
    ///
    /// # Errors
    /// [`LightingError`]; the setting is as before then.
    pub fn set(&mut self, technique: &str, name: &str, value: &str) -> Result<(), LightingError> {
        if technique == PATH_TRACER {
            let mut set = self.loaded.set.clone();
            set.set(technique, name, value);
            set.path_tracer_settings()?;
            self.truth = None;
        } else {
            self.loaded.renderer.set(technique, name, value)?;
        }
        self.loaded.set.set(technique, name, value);
        self.is_edited = true;
        Ok(())
    }

    /// The technique, if it is in use.
    pub fn technique(&self, name: &str) -> Option<&dyn Technique> {
        let mut all = self.loaded.renderer.techniques().iter();
        let found = all.find(|technique| technique.info().name == name);
        found.map(AsRef::as_ref)
    }

    /// Names of the techniques in use, or that of the path tracer in their place.
    pub fn technique_names(&self) -> Vec<&'static str> {
        if self.loaded.set.is_path_tracer() {
            return vec![PATH_TRACER];
        }
        let all = self.loaded.renderer.techniques().iter();
        all.map(|technique| technique.info().name).collect()
    }

    /// Poses the scene at a time of its animation (s).
    ///
    /// # Errors
    /// [`LightingError`]; the scene is as before then.
    pub fn pose(&mut self, seconds: f32) -> Result<(), LightingError> {
        let scene = self.loaded.scene();
        let rig = match &self.game {
            Some(game) => game.rig(scene),
            None => scene.rig.as_ref(),
        };
        let edits = rig.map_or_else(Vec::new, |rig| scene.posed_by(rig, seconds));
        self.loaded.edit(&edits)?;
        let bounds = self.loaded.renderer.scene().bounds;
        self.camera.follow(&self.loaded.scene().cameras, &bounds);
        self.clock.seconds = seconds;
        self.is_edited = true;
        Ok(())
    }

    /// Asks what is seen at a place of the picture (0 to 1 from the top left); [`Session::picked`] answers later.
    pub fn pick(&mut self, purpose: Pick, place: [f32; 2]) {
        self.asked.push((purpose, place));
        self.pick_lit();
    }

    /// Asks the GPU for what was asked of pixels that are lit by now.
    fn pick_lit(&mut self) {
        let renderer = &self.loaded.renderer;
        self.asked.retain(|(purpose, place)| {
            let point = point_at(renderer, *place);
            let is_waiting = point.is_none();
            self.picks.extend(point.map(|point| (*purpose, point)));
            is_waiting
        });
    }

    /// Whether it is yet to be told what a place of the picture shows.
    pub fn is_picking(&self) -> bool {
        !self.picks.is_empty() || !self.asked.is_empty() || self.middle.is_some()
    }

    /// What was picked, as far as it is known by now. The camera learns what it orbits around.
    pub fn picked(&mut self) -> Vec<(Pick, Option<VisiblePoint>)> {
        if let Some(seen) = self.middle.as_ref().and_then(ReadBack::get) {
            let point = seen.ok().flatten();
            self.camera.take_target(point.map(|point| point.position));
            self.middle = None;
        }
        let mut picked = Vec::new();
        self.picks.retain(|(purpose, pick)| match pick.get() {
            None => true,
            Some(point) => {
                picked.push((*purpose, point.ok().flatten()));
                false
            }
        });
        picked
    }

    /// The next frame, for a window of `window` pixels, `seconds` after the one before, which took as long on the GPU.
    /// Never waits for the GPU.
    ///
    /// # Errors
    /// [`LightingError`].
    pub fn frame(&mut self, window: [u32; 2], seconds: f32) -> Result<Shown, LightingError> {
        self.frame_after(window, seconds, seconds)
    }

    /// As [`Session::frame`], where the frame before `took` another time (s) than cameras and animations move on.
    ///
    /// # Errors
    /// [`LightingError`].
    pub fn frame_after(
        &mut self,
        window: [u32; 2],
        seconds: f32,
        took: f32,
    ) -> Result<Shown, LightingError> {
        if let Some(purpose) = self.was_for.take() {
            let renderer = &self.loaded.renderer;
            let (work, points) = (renderer.work(), renderer.lit_points());
            self.pace.measure(took, work, points, purpose);
        }
        if !self.is_held {
            let is_driven = !self.is_game_paused && self.drive(seconds.min(LONGEST_STEERED));
            if self.clock.is_playing {
                self.pose(self.clock.seconds + seconds.min(LONGEST_FRAME))?;
            } else if is_driven {
                self.pose(self.clock.seconds)?;
            }
            if !self.is_game_paused {
                self.live(seconds.min(LONGEST_STEERED))?;
            }
        }
        let is_steered = !self.is_held && self.camera.advance(seconds.min(LONGEST_STEERED));
        let is_moving = is_steered | self.is_edited;
        self.is_edited = false;
        self.at_rest = if is_moving {
            0.0
        } else {
            self.at_rest + seconds
        };
        if is_moving {
            self.passed = 0.0;
        }
        let is_moving_still = self.at_rest < REST_SECONDS;
        let is_other = self.choose_pixels(window, is_moving_still);
        let (size, most_points) = self.pixels;
        let renderer = &mut self.loaded.renderer;
        match self.picture_took {
            Some(_) => self.unchanged += took,
            None => self.picture_took = Some(took),
        }
        if is_other || size != renderer.size() {
            match most_points < u32::MAX {
                true => renderer.resize_in_strips(size, most_points)?,
                false => renderer.resize(size)?,
            }
            self.unchanged = f32::INFINITY;
        }
        // Strips of a sample belong together, also while maps become better.
        let is_refined = self.readiness != Readiness::Ready && renderer.progress() == 0.0;
        if is_moving || is_refined {
            restart(renderer, self.is_held);
        }
        self.pass_times.update();
        let is_truth_new = self.follow_truth(is_moving_still, seconds)?;
        let is_tracing = self.is_tracing();
        let wanted = self.samples_of_techniques();
        let quantity = self.quantity;
        let beside = self.beside();
        // Pictures of a recording stand alone.
        let mut effects = self.effects.clone();
        if self.is_held {
            effects.temporal_antialiasing.frames = 1;
        }
        let interval = &mut effects.temporal_antialiasing.interval;
        *interval = self.pace.interval(*interval);
        let is_settled = self.is_settled();
        let renderer = &mut self.loaded.renderer;
        let reference = self.truth.as_ref().and_then(Truth::reference);
        let comparison = reference.map(|reference| &reference.comparison);
        let compared = beside.zip(comparison);
        let compared =
            compared.filter(|(_, comparison)| comparison.size() == size && quantity.is_none());
        // Where the path tracer is alone, its last picture stays until there is one of the new size.
        let is_late = self.loaded.set.is_path_tracer()
            && quantity.is_none()
            && comparison.is_some_and(|comparison| comparison.size() != size);
        let is_plain = compared.is_none() && quantity.is_none() && !is_late;
        let to_display = (
            effects.clone(),
            compared.map(|(compared, _)| compared),
            quantity,
        );
        let mut shown = Shown::default();
        let is_displayed = self.displayed == to_display && !is_truth_new;
        // Time that a picture at rest stays on show is not time between it and the next one.
        let is_current = is_displayed && is_settled;
        let is_idle = renderer.samples() >= wanted && is_current;
        if !self.is_held && !is_idle {
            renderer.pass_time(seconds.min(LONGEST_FRAME));
            self.passed += seconds.min(LONGEST_FRAME);
        }
        // At rest, maps need not wait for pictures that are soon replaced.
        let is_refining = matches!(self.readiness, Readiness::Refining { .. });
        let [least, most] = MAPS_SECONDS;
        let picture_took = self.picture_took.unwrap_or_default();
        let seconds_of_maps = (MAPS_PER_PICTURE * picture_took).clamp(least, most);
        let makes_maps = is_refining
            && !is_moving_still
            && is_displayed
            && self.picture.is_some()
            && self.unchanged < seconds_of_maps;
        let is_shown = is_displayed && self.readiness.is_usable() && has_size(&self.picture, size);
        if self.is_disturbed && is_shown && !is_moving_still {
            // Further samples can wait.
            shown.is_final = !is_tracing;
        } else if makes_maps {
            renderer.set_budget(self.pace.budget(Purpose::Maps));
            self.readiness = renderer.try_converge(&self.camera.camera())?;
            restart(renderer, self.is_held);
            self.was_for = Some(Purpose::Maps);
        } else if renderer.samples() < wanted {
            let is_timed = self.is_timed && self.pass_times.wants_more();
            let purpose = match (self.readiness, is_moving_still) {
                (Readiness::Pending { .. }, _) => Purpose::Maps,
                (_, true) => Purpose::Moving,
                (_, false) => Purpose::Still,
            };
            renderer.set_budget(self.pace.budget(purpose));
            let to_show = &effects;
            let effects = is_plain.then_some(&effects);
            let camera = self.camera.camera();
            let is_refining = self.readiness != Readiness::Ready && most_points == u32::MAX;
            let is_alone = is_moving || is_refining || self.detail == Detail::Coarse;
            let of = if is_alone { 1 } else { wanted };
            let (readiness, timings) =
                renderer.try_render_sample(&camera, of, effects, is_timed)?;
            self.readiness = readiness;
            let is_usable = readiness.is_usable();
            let is_whole = renderer.progress() == 0.0;
            let is_lit = if is_plain {
                renderer.is_displayed()
            } else {
                is_whole
            };
            shown.is_new = is_usable && is_lit && !is_late;
            if is_usable && !is_lit && !is_displayed && !is_late && renderer.samples() > 0 {
                // What was asked for meanwhile is not to wait for the last strip.
                shown.is_new = true;
                if is_plain {
                    renderer.display(Source::Picture, to_show)?;
                }
            }
            let has_purpose = is_usable != (purpose == Purpose::Maps);
            self.was_for = has_purpose.then_some(purpose);
            if is_timed {
                self.pass_times.follow(timings);
            }
            if is_usable && self.camera.wants_target() && self.middle.is_none() {
                self.middle = point_at(renderer, [0.5, 0.5]);
            }
        } else if !is_current && !is_late {
            shown.is_new = true;
            if is_plain {
                renderer.display(Source::Picture, &effects)?;
            }
        } else {
            let is_read = self.picks.is_empty() && self.asked.is_empty() && self.middle.is_none();
            shown.is_final = is_read && !is_tracing && !is_moving_still;
        }
        // A frame's time says nothing about its own work while something else takes a part of it.
        if is_tracing {
            self.was_for = None;
        }
        if shown.is_new {
            (self.unchanged, self.picture_took) = (0.0, None);
            if let Some(quantity) = quantity {
                let surfaces = match self.surfaces.take() {
                    Some((of_size, surfaces)) if of_size == size => surfaces,
                    Some((_, surfaces)) => surfaces.resized(&self.gpu, size)?,
                    None => Surfaces::new(&self.gpu, size)?,
                };
                renderer.display(Source::Surfaces(&surfaces, quantity), &effects)?;
                self.surfaces = Some((size, surfaces));
            } else if let Some((compared, comparison)) = compared {
                renderer.display(Source::Compared(comparison, compared), &effects)?;
            }
            self.displayed = to_display;
            self.show()?;
        }
        self.pick_lit();
        Ok(shown)
    }

    /// Chooses how many pixels the picture has, in parts of how many: in motion few, at rest more, and when there is such a
    /// picture with final maps all. Returns whether that changed.
    fn choose_pixels(&mut self, window: [u32; 2], is_moving: bool) -> bool {
        let renderer = &self.loaded.renderer;
        let has_new_window = std::mem::replace(&mut self.window, window) != window;
        let is_seen = self.readiness == Readiness::Ready
            && renderer.samples() > 0
            && has_size(&self.picture, renderer.size());
        let full = self.pace.size(window, Detail::Full);
        let is_slow =
            !self.loaded.set.is_path_tracer() && self.pace.size(window, Detail::Coarse) != full;
        let is_whole = self.pixels.1 == u32::MAX;
        let is_ready = self.readiness == Readiness::Ready;
        // A whole picture may be slower than those were by which its pixels were chosen.
        let points = self.pace.points_at_rest();
        let is_too_slow = is_whole && renderer.samples() <= 2 && points < renderer.lit_points() / 2;
        let before = self.detail;
        self.detail = match before {
            _ if is_moving => Detail::Moving,
            Detail::Moving if is_slow => Detail::Coarse,
            Detail::Coarse if is_slow && (!is_seen || self.is_disturbed) => Detail::Coarse,
            Detail::Full if is_slow && is_too_slow && !is_ready => Detail::Coarse,
            _ => Detail::Full,
        };
        let is_chosen = self.detail == before && !has_new_window;
        let pixels = match self.detail {
            Detail::Moving => (self.pace.size(window, Detail::Moving), u32::MAX),
            // Their times would change the choice from frame to frame.
            Detail::Coarse if is_chosen => self.pixels,
            Detail::Coarse => (self.pace.size(window, Detail::Coarse), u32::MAX),
            Detail::Full
                if is_chosen
                    && self.pixels.0 == full
                    && !is_too_slow
                    && (self.pace.is_adaptive || is_whole) =>
            {
                self.pixels
            }
            Detail::Full if is_slow => (full, points),
            Detail::Full => (full, u32::MAX),
        };
        std::mem::replace(&mut self.pixels, pixels) != pixels
    }

    /// Share of the pixels that are there, while a picture at rest gets them.
    pub fn lit_share(&self) -> Option<f32> {
        let renderer = &self.loaded.renderer;
        let is_first = self.detail == Detail::Full && renderer.samples() == 0;
        (is_first && self.pixels.1 < u32::MAX).then(|| renderer.progress())
    }

    /// Whether effects that change over time have come to their end, or time stands still.
    fn is_settled(&self) -> bool {
        self.is_held || self.passed >= self.effects.exposure.settling_seconds()
    }

    /// Whether another frame would change nothing: maps are made, and all samples taken, those of the path tracer, too,
    /// with the pixels that a picture has at rest.
    pub fn is_complete(&self) -> bool {
        let renderer = &self.loaded.renderer;
        self.readiness == Readiness::Ready
            && renderer.samples() >= self.samples_of_techniques()
            && renderer.size() == self.pace.size(self.window, Detail::Full)
            && (self.detail == Detail::Full || self.pixels.1 == u32::MAX)
            && !self.is_tracing()
            && self.is_settled()
    }

    /// Draws the renderer's picture onto the texture.
    fn show(&mut self) -> Result<(), LightingError> {
        let renderer = &self.loaded.renderer;
        let size = renderer.size();
        if !has_size(&self.picture, size) {
            let texture = self.gpu.texture(&wgpu::TextureDescriptor {
                label: Some("viewer.picture"),
                size: wgpu::Extent3d {
                    width: size[0],
                    height: size[1],
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: FORMAT,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                    | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            })?;
            let view = texture.create_view(&Default::default());
            self.picture = Some(Picture { view, size });
        }
        let mut frame = Frame::new(&self.gpu, false);
        if let Some(picture) = &self.picture {
            renderer.present(&mut frame, &self.present, &picture.view)?;
        }
        frame.submit()?;
        Ok(())
    }
}

/// Begins another picture, or the same one again while time stands still.
fn restart(renderer: &mut Renderer, is_held: bool) {
    match is_held {
        true => renderer.begin_again(),
        false => renderer.restart(),
    }
}

/// What is seen at a place of the picture (0 to 1 from the top left), when it is known.
fn point_at(renderer: &Renderer, place: [f32; 2]) -> Option<ReadBack<Option<VisiblePoint>>> {
    let size = renderer.size();
    let lit_rows = match renderer.samples() {
        0 => (renderer.progress() * size[1] as f32) as u32,
        _ => size[1],
    };
    let pixel = [0, 1].map(|axis| {
        let at = (place[axis].clamp(0.0, 1.0) * size[axis] as f32) as u32;
        at.min(size[axis] - 1)
    });
    (pixel[1] < lit_rows).then(|| renderer.pick(pixel).ok())?
}
