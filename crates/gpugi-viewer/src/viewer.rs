//! The viewer without a window: what is on show, and what is being opened to take its place.

use std::path::Path;
use std::sync::Arc;

use gpugi::gpu::Gpu;
use gpugi_cli::scene_argument::{self, SceneArguments};

use crate::opening::{self, Opening};
use crate::session::{Loaded, Session};
use crate::technique_set::TechniqueSet;

/// How the viewer starts.
#[derive(Debug, Clone)]
pub struct Start {
    /// The scene.
    pub scene: SceneArguments,
    /// The camera, as `gpugi render --camera`.
    pub camera: Option<String>,
    /// Its techniques.
    pub set: TechniqueSet,
}

/// What is on show, and what is being opened.
pub struct Viewer {
    gpu: Gpu,
    /// The camera of the first scene.
    camera: Option<String>,
    /// What selects the scene on show.
    scene: SceneArguments,
    session: Option<Session>,
    /// With what selects the scene, if it is another one.
    opening: Option<(Opening, Option<SceneArguments>)>,
    wake: Arc<dyn Fn() + Send + Sync>,
}

impl Viewer {
    /// Begins to open a scene. `wake` is called, on other threads, when there is something new to show.
    pub fn new(gpu: &Gpu, start: Start, wake: impl Fn() + Send + Sync + 'static) -> Self {
        let mut viewer = Self {
            gpu: gpu.clone(),
            camera: start.camera,
            scene: start.scene.clone(),
            session: None,
            opening: None,
            wake: Arc::new(wake),
        };
        viewer.open(start.scene, &start.set);
        viewer
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
        let wake = self.wake.clone();
        let opening = opening::open(&self.gpu, &scene, set, self.size(), move || wake());
        self.opening = Some((opening, Some(scene)));
    }

    /// Begins to open a file: a scene, or an environment for the scene on show.
    pub fn open_file(&mut self, file: &Path) {
        let scene = opening::dropped(&self.scene, file);
        let set = match &self.session {
            Some(session) if scene.scene == self.scene.scene => session.loaded().set.clone(),
            _ => TechniqueSet::default(),
        };
        self.open(scene, &set);
    }

    /// Begins to light the scene on show with other techniques.
    pub fn change_set(&mut self, set: TechniqueSet) {
        let Some(session) = &self.session else { return };
        let wake = self.wake.clone();
        let done = move || wake();
        let opening = opening::change_set(&self.gpu, session.loaded(), set, self.size(), done);
        self.opening = Some((opening, None));
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

    /// As [`Viewer::take_opened`], and waits for it.
    ///
    /// # Errors
    /// As [`Viewer::take_opened`].
    pub fn finish_opening(&mut self) -> Result<(), String> {
        match self.opening().map(Opening::wait) {
            Some(result) => self.take(result),
            None => Ok(()),
        }
    }

    fn take(&mut self, result: Option<Result<Loaded, String>>) -> Result<(), String> {
        let scene = self.opening.take().and_then(|(_, scene)| scene);
        let loaded = result.unwrap_or_else(|| Err("gpugi failed; please report it".into()))?;
        self.show(loaded, scene)
    }

    fn show(&mut self, loaded: Loaded, scene: Option<SceneArguments>) -> Result<(), String> {
        let Some(scene) = scene else {
            if let Some(session) = &mut self.session {
                session.replace(loaded);
            }
            return Ok(());
        };
        let choice = self.camera.take();
        let camera = scene_argument::camera(&loaded.scene, choice.as_deref(), 4.0 / 3.0);
        let camera = camera.map_err(|error| format!("{error:#}"))?;
        match &mut self.session {
            // Another environment: the camera stays.
            Some(session) if scene.scene == self.scene.scene => session.replace(loaded),
            Some(session) => session.open(loaded, &camera),
            None => {
                let wake = self.wake.clone();
                let session = Session::new(&self.gpu, loaded, &camera, move || wake());
                self.session = Some(session.map_err(|error| error.to_string())?);
            }
        }
        self.scene = scene;
        Ok(())
    }

    /// Size of the picture (pixels).
    fn size(&self) -> [u32; 2] {
        let session = self.session.as_ref();
        session.map_or([64, 64], |session| session.loaded().renderer.size())
    }
}
