//! The viewer without a window: what is on show, and what is being opened to take its place.

use std::path::Path;
use std::sync::Arc;

use gpugi::gpu::Gpu;
use gpugi::picture::Effects;
use gpugi_arguments::files::Files;
use gpugi_arguments::scene_argument::{self, SceneArguments};
use gpugi_scene::{Edit, Scene};

use crate::arguments::{is_view_file, of_view_file};
use crate::camera_control::CameraControl;
use crate::game::ball::{self, Finish};
use crate::opening::{self, Opening};
use crate::session::{Loaded, Session};
use crate::technique_set::TechniqueSet;

/// How the viewer starts.
#[derive(Debug, Clone)]
pub struct Start {
    /// The scene.
    pub scene: SceneArguments,
    /// Its techniques.
    pub set: TechniqueSet,
    /// How it is shown.
    pub look: Look,
}

/// How a scene is shown.
#[derive(Debug, Clone)]
pub struct Look {
    /// The camera, as `gpugi render --camera`.
    pub camera: Option<String>,
    /// Exposure and tone mapping.
    pub effects: Effects,
    /// Samples per pixel of a picture at rest, if people chose them.
    pub samples: Option<u32>,
    /// Frames per second that are wanted in motion.
    pub frame_rate: u32,
    /// Whether its animation runs from the beginning.
    pub plays: bool,
    /// Whether somebody walks.
    pub walks: Option<Walks>,
}

/// Somebody who walks from the beginning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Walks {
    /// Height of the eye above the ground (m), if it is not to suit the scene.
    pub eye_height: Option<f32>,
}

impl Default for Look {
    fn default() -> Self {
        Self {
            camera: None,
            effects: Effects::of_live_view(),
            samples: None,
            frame_rate: 60,
            plays: false,
            walks: None,
        }
    }
}

/// What is being opened.
enum Kind {
    /// Another scene, with these techniques.
    Scene(SceneArguments, TechniqueSet),
    /// Another environment for the scene on show, which had this revision.
    Environment(SceneArguments, u64),
    /// Other techniques for the scene on show, which had this revision.
    Techniques(u64),
    /// Balls for the scene on show, which had this revision: the index of the first. It is thrown.
    Balls(u64, usize),
    /// What was on show on a device that is lost.
    Renewed(Box<Session>),
}

/// What is on show, and what is being opened.
pub struct Viewer {
    gpu: Gpu,
    /// How the scene that is being opened is shown, if not like the one before.
    look: Option<Look>,
    /// What selects the scene on show.
    scene: SceneArguments,
    session: Option<Session>,
    opening: Option<(Opening, Kind)>,
    wake: Arc<dyn Fn() + Send + Sync>,
}

impl Viewer {
    /// Begins to open a scene. `wake` is called, on other threads, when there is something new to show.
    pub fn new(gpu: &Gpu, start: Start, wake: impl Fn() + Send + Sync + 'static) -> Self {
        let mut viewer = Self {
            gpu: gpu.clone(),
            look: None,
            scene: start.scene.clone(),
            session: None,
            opening: None,
            wake: Arc::new(wake),
        };
        viewer.start(start);
        viewer
    }

    /// Begins to open a scene, to be shown in its own way.
    pub fn start(&mut self, start: Start) {
        self.start_among(start, Files::default());
    }

    fn start_among(&mut self, start: Start, files: Files) {
        self.open_among(start.scene, files, &start.set);
        self.look = Some(start.look);
    }

    /// Begins to make what was on show anew, on another device, after its own was lost. What was to take its place is
    /// given up.
    pub fn renew(&mut self, gpu: &Gpu, wake: impl Fn() + Send + Sync + 'static) {
        gpu.replace_shaders(self.gpu.replaced_shaders());
        self.gpu = gpu.clone();
        self.wake = Arc::new(wake);
        match (self.session.take(), self.opening.take()) {
            (Some(session), _) => {
                let wake = self.wake.clone();
                let done = move || wake();
                let (loaded, set) = (session.loaded(), session.loaded().set.clone());
                let opening = opening::upload_again(gpu, "a new device", loaded, set, done);
                self.opening = Some((opening, Kind::Renewed(Box::new(session))));
            }
            (None, Some((_, Kind::Scene(scene, set)))) => {
                let look = self.look.take();
                self.open(scene, &set);
                self.look = look;
            }
            (None, _) => {}
        }
    }

    /// Loses the device, as a driver does that resets the GPU. For tests.
    pub fn lose_device(&self) {
        self.gpu.device.destroy();
        // wgpu tells of it once the queue is empty: this is the error that is asked for.
        let _ = self.gpu.wait();
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The scene on show.
    pub fn session(&mut self) -> Option<&mut Session> {
        self.session.as_mut()
    }

    /// What is being opened.
    pub fn opening(&self) -> Option<&Opening> {
        self.opening.as_ref().map(|(opening, _)| opening)
    }

    /// Begins to open a scene; what is on show stays until it is ready.
    pub fn open(&mut self, scene: SceneArguments, set: &TechniqueSet) {
        self.open_among(scene, Files::default(), set);
    }

    fn open_among(&mut self, scene: SceneArguments, files: Files, set: &TechniqueSet) {
        let wake = self.wake.clone();
        let done = move || wake();
        let opening = opening::open(&self.gpu, &scene, files, set, done);
        self.opening = Some((opening, Kind::Scene(scene, set.clone())));
        self.look = None;
    }

    /// Begins to open a file: a scene, a view file, or an environment for the scene on show. It and what it refers to
    /// are in `files`, or else on the disk.
    ///
    /// # Errors
    /// What is wrong with a view file.
    pub fn open_file(&mut self, file: &Path, files: Files) -> Result<(), String> {
        if is_view_file(file) {
            let name = file.display().to_string();
            let failed = |reason: String| format!("{name}: {reason}");
            let start = match files.get(&name) {
                Some(text) => of_view_file(text),
                None => std::fs::read(file)
                    .map_err(|error| error.to_string())
                    .and_then(|text| of_view_file(&text)),
            };
            self.start_among(start.map_err(failed)?, files);
            return Ok(());
        }
        let scene = opening::dropped(&self.scene, file);
        let (Some(session), true) = (&self.session, scene.environment.is_some()) else {
            self.open_among(scene, files, &TechniqueSet::default());
            return Ok(());
        };
        let wake = self.wake.clone();
        let done = move || wake();
        let current = session.loaded();
        let opening = opening::change_environment(&self.gpu, current, &scene, files, done);
        self.opening = Some((
            opening,
            Kind::Environment(scene, current.document.revision()),
        ));
        Ok(())
    }

    /// Begins to light the scene on show with other techniques.
    pub fn change_set(&mut self, set: TechniqueSet) {
        let Some(session) = &self.session else { return };
        let wake = self.wake.clone();
        let done = move || wake();
        let loaded = session.loaded();
        let opening = opening::upload_again(&self.gpu, "techniques", loaded, set, done);
        self.opening = Some((opening, Kind::Techniques(loaded.document.revision())));
    }

    /// Throws a ball. The first adds balls to the scene, which is uploaded again with them, and flies when that is done.
    ///
    /// # Errors
    /// Why there can be none.
    pub fn throw(&mut self) -> Result<(), String> {
        let Some(session) = &mut self.session else {
            return Ok(());
        };
        if session.throw() || self.opening.is_some() {
            return Ok(());
        }
        let (center, radius) = session.hand()?;
        let loaded = session.loaded();
        let mut scene = loaded.scene().clone();
        let first = ball::add_to(&mut scene, session.finish, center, radius);
        let kind = Kind::Balls(loaded.document.revision(), first);
        self.upload(scene, kind);
        Ok(())
    }

    /// Makes the balls of something else: those in the scene, which is uploaded again, and those to come.
    pub fn polish(&mut self, finish: Finish) {
        let Some(session) = &mut self.session else {
            return;
        };
        session.finish = finish;
        let (balls, loaded) = (session.balls(), session.loaded());
        if balls.is_empty() || self.opening.is_some() {
            return;
        }
        let mut scene = loaded.scene().clone();
        let material = scene.instances[balls.start].material;
        scene.materials[material] = finish.material();
        let kind = Kind::Techniques(loaded.document.revision());
        self.upload(scene, kind);
    }

    /// Begins to upload the scene on show with other balls.
    fn upload(&mut self, scene: Scene, kind: Kind) {
        let Some(session) = &self.session else { return };
        let wake = self.wake.clone();
        let done = move || wake();
        let (loaded, set) = (session.loaded(), session.loaded().set.clone());
        let opening = opening::upload_as(&self.gpu, "balls", loaded, scene, set, done);
        self.opening = Some((opening, kind));
    }

    /// Gives up what is being opened.
    pub fn cancel(&mut self) {
        self.opening = None;
    }

    /// Shows what has been opened, if it is ready. Returns whether something took place.
    ///
    /// # Errors
    /// Why it cannot be shown; what was on show stays.
    pub fn take_opened(&mut self) -> Result<bool, String> {
        let Some(result) = self.opening().and_then(Opening::result) else {
            return Ok(false);
        };
        self.take(result).map(|()| true)
    }

    /// As [`Viewer::take_opened`], and waits for it. Not for pages, which never block.
    ///
    /// # Errors
    /// As [`Viewer::take_opened`].
    #[cfg(not(target_arch = "wasm32"))]
    pub fn finish_opening(&mut self) -> Result<(), String> {
        match self.opening().map(Opening::wait) {
            Some(result) => self.take(result),
            None => Ok(()),
        }
    }

    fn take(&mut self, result: Option<Result<Loaded, String>>) -> Result<(), String> {
        let Some((_, kind)) = self.opening.take() else {
            return Ok(());
        };
        let loaded = result.unwrap_or_else(|| Err("gpugi failed; please report it".into()))?;
        match (kind, &mut self.session) {
            (Kind::Scene(scene, _), _) => {
                self.show(loaded)?;
                if let Some(session) = &mut self.session {
                    session.clock.seconds = scene.time;
                }
                self.scene = scene;
            }
            (Kind::Environment(scene, revision), Some(session)) => {
                let mut edits = session.loaded().document.since(revision);
                edits.retain(|edit| !matches!(edit, Edit::Environment(_)));
                session
                    .replace(loaded, &edits)
                    .map_err(|error| error.to_string())?;
                self.scene = scene;
            }
            (Kind::Techniques(revision), Some(session)) => {
                let edits = session.loaded().document.since(revision);
                session
                    .replace(loaded, &edits)
                    .map_err(|error| error.to_string())?;
            }
            (Kind::Balls(revision, first), Some(session)) => {
                let edits = session.loaded().document.since(revision);
                session
                    .replace(loaded, &edits)
                    .map_err(|error| error.to_string())?;
                session.take_balls(first..first + ball::COUNT);
                session.throw();
            }
            (Kind::Environment(..) | Kind::Techniques(_) | Kind::Balls(..), None) => {}
            (Kind::Renewed(session), _) => {
                let wake = self.wake.clone();
                let session = session.renewed(&self.gpu, loaded, move || wake());
                self.session = Some(session.map_err(|error| error.to_string())?);
            }
        }
        Ok(())
    }

    fn show(&mut self, loaded: Loaded) -> Result<(), String> {
        let look = self.look.take();
        let choice = look.as_ref().and_then(|look| look.camera.as_deref());
        let view = scene_argument::view(loaded.scene(), choice, 4.0 / 3.0);
        let (camera, target) = view.map_err(|error| format!("{error:#}"))?;
        let mut camera = CameraControl::new(&camera, &loaded.scene().bounds());
        if let Some(target) = target {
            camera = camera.around(target);
        }
        match &mut self.session {
            Some(session) => session.open(loaded, camera),
            None => {
                let wake = self.wake.clone();
                let session = Session::new(&self.gpu, loaded, camera, move || wake());
                self.session = Some(session.map_err(|error| error.to_string())?);
            }
        }
        if let (Some(session), Some(look)) = (&mut self.session, look) {
            session.effects = look.effects;
            let default = session.loaded().set.default_samples();
            session.samples = look.samples.unwrap_or(default);
            session.pace.target_rate = look.frame_rate;
            session.clock.is_playing = look.plays;
            if let Some(walks) = look.walks {
                session.walk(walks.eye_height)?;
            }
        }
        Ok(())
    }
}
