//! A recording of what a window shows: frames at fixed times, each complete, as PNGs of which other programs make films.

use std::path::{Path, PathBuf};

use gpugi_scene::image::save_png;

use crate::session::{Session, Shown};
use crate::task::Task;

/// Time from frame to frame of cameras and animations (s).
pub const STEP_SECONDS: f32 = 1.0 / 60.0;

/// A recording that goes on. Between its frames, time stands still until the next one is complete.
#[derive(Debug)]
pub struct Recording {
    folder: PathBuf,
    frames: u32,
    writing: Option<Task<Result<(), String>>>,
    was_adaptive: bool,
}

impl Recording {
    /// Begins with what is on show, in a new folder within `parent`. All frames have the window's pixels.
    ///
    /// # Errors
    /// Why there is no folder.
    pub fn begin(session: &mut Session, parent: &Path) -> Result<Self, String> {
        let mut folders = (1..).map(|number| parent.join(format!("gpugi-frames-{number}")));
        let folder = folders.find(|folder| !folder.exists());
        let folder = folder.ok_or("the folder is full of recordings")?;
        let failed = |error| format!("{}: {error}", folder.display());
        std::fs::create_dir_all(&folder).map_err(failed)?;
        let was_adaptive = std::mem::take(&mut session.pace.is_adaptive);
        session.is_held = true;
        Ok(Self {
            folder,
            frames: 0,
            writing: None,
            was_adaptive,
        })
    }

    /// Number of frames that are written.
    pub fn frames(&self) -> u32 {
        self.frames
    }

    /// The window's next frame, in place of [`Session::frame`]: writes the picture once it is complete, then goes on by a
    /// step.
    ///
    /// # Errors
    /// Why nothing is shown or written.
    pub fn frame(&mut self, session: &mut Session, window: [u32; 2]) -> Result<Shown, String> {
        let written = self.writing.as_ref().and_then(Task::result);
        if let Some(written) = written {
            written.unwrap_or_else(|| Err("a frame could not be written".into()))?;
            self.writing = None;
            self.frames += 1;
            session.is_held = false;
        }
        let shown = session.frame(window, STEP_SECONDS);
        session.is_held = true;
        if self.writing.is_none() && session.is_complete() {
            self.write(session)?;
        }
        shown.map_err(|error| error.to_string())
    }

    /// Begins to write the picture.
    fn write(&mut self, session: &Session) -> Result<(), String> {
        let renderer = &session.loaded().renderer;
        let [width, height] = renderer.size();
        let pixels = renderer.begin_pixels().map_err(|error| error.to_string())?;
        let path = self.folder.join(format!("{:04}.png", self.frames));
        let write = move |_| async move {
            let pixels = pixels.await.map_err(|error| error.to_string())?;
            save_png(&path, width, height, &pixels).map_err(|error| error.to_string())
        };
        self.writing = Some(Task::start("PNG", || {}, write));
        Ok(())
    }

    /// Ends it; time goes on as it did before. Says what was written.
    pub fn end(self, session: &mut Session) -> String {
        session.is_held = false;
        session.pace.is_adaptive = self.was_adaptive;
        format!(
            "{} frames are written to {}",
            self.frames,
            self.folder.display()
        )
    }
}
