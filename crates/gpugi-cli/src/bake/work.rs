//! The long-running work of a bake: its progress, timings and checkpoint.

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::Context;
use gpugi::bake::{Checkpoint, CheckpointKey};
use gpugi::gpu::Gpu;
use gpugi_scene::Scene;
use gpugi_scene::image::replace_file;

use crate::progress::Progress;
use crate::{Common, interrupt};

/// Interval between checkpoints.
const SAVE_EVERY: Duration = Duration::from_secs(60);

/// A running bake: its results so far, and where to save them if it is stopped.
#[derive(Debug)]
pub struct Work<'a> {
    pub gpu: &'a Gpu,
    pub progress: Progress,
    pub done: Checkpoint,
    pub path: PathBuf,
    key: CheckpointKey,
    saved: Instant,
    /// Duration of each part, in words.
    pub times: Vec<String>,
    part: Instant,
}

impl<'a> Work<'a> {
    pub fn new(common: &Common, gpu: &'a Gpu, output: &Path, key: CheckpointKey) -> Self {
        let mut path = output.as_os_str().to_owned();
        path.push(".checkpoint");
        Self {
            gpu,
            progress: Progress::new(common.quiet),
            done: Checkpoint::default(),
            path: path.into(),
            key,
            saved: Instant::now(),
            times: Vec::new(),
            part: Instant::now(),
        }
    }

    /// Reads the checkpoint. Returns whether there is one: without, the bake begins, so that a script can call the same
    /// line until it succeeds.
    pub fn resume(&mut self, scene: &Scene) -> anyhow::Result<bool> {
        let path = self.path.display();
        let bytes = match std::fs::read(&self.path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(false),
            read => read.with_context(|| format!("{path}: cannot be read"))?,
        };
        let read = Checkpoint::from_bytes(&bytes, &self.key, scene);
        self.done = read.with_context(|| {
            format!("{path}: nothing to go on from; without --resume the bake starts anew")
        })?;
        Ok(true)
    }

    /// Ends a part and records its duration.
    pub fn timed(&mut self, part: &str) {
        let seconds = self.part.elapsed().as_secs_f64();
        self.times.push(format!("{part} {seconds:.2} s"));
        self.part = Instant::now();
    }

    /// Waits for the GPU, so that progress bars are accurate, the queue stays short and Ctrl-C is noticed. Saves what
    /// `now` puts into the checkpoint every `SAVE_EVERY`, and when the user stops the bake.
    pub fn after_step(
        &mut self,
        now: impl FnOnce(&mut Checkpoint) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        self.gpu.wait()?;
        let is_asked = interrupt::asked();
        if !is_asked && self.saved.elapsed() < SAVE_EVERY {
            return Ok(());
        }
        now(&mut self.done)?;
        let path = self.path.display();
        let bytes = self.done.to_bytes(&self.key);
        let written = replace_file(&self.path, |file| file.write_all(&bytes));
        written.with_context(|| format!("{path}: cannot be written"))?;
        self.saved = Instant::now();
        anyhow::ensure!(
            !is_asked,
            "interrupted: {path} has what is done, the same command with --resume goes on"
        );
        Ok(())
    }

    /// Deletes the checkpoint of a finished bake.
    pub fn forget(&self) {
        std::fs::remove_file(&self.path).ok();
    }
}
