//! The long-running work of a bake: its progress, timings and checkpoint.

use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::Context;
use gpugi::bake::{Checkpoint, CheckpointKey};
use gpugi::gpu::Gpu;
use gpugi_scene::image::replace_file;
use gpugi_scene::{Atlas, AtlasError, AtlasOptions, Scene, TexelDensity};

use super::options::SceneOptions;
use crate::Usage;
use crate::progress::Progress;

/// Interval between checkpoints.
const SAVE_EVERY: Duration = Duration::from_secs(60);

/// Maximum number of texels over all pages: 16 bytes of memory each, three times as much while a checkpoint is written.
const MOST_TEXELS: u64 = 1 << 28;
/// Maximum number of pages, however small.
const MOST_PAGES: u64 = 1024;

/// A running bake: its results so far, and where to save them if it is stopped.
pub struct Work<'a> {
    pub gpu: &'a Gpu,
    pub progress: Progress<'a>,
    pub done: Checkpoint,
    pub path: PathBuf,
    key: CheckpointKey,
    saved: Instant,
    /// Duration of each part, in words.
    pub times: Vec<String>,
    part: Instant,
}

impl<'a> Work<'a> {
    pub fn new(progress: Progress<'a>, gpu: &'a Gpu, output: &Path, key: CheckpointKey) -> Self {
        let mut path = output.as_os_str().to_owned();
        path.push(".checkpoint");
        Self {
            gpu,
            progress,
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
        let is_asked = self.progress.is_asked_to_stop();
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

/// What decides a bake, besides the scene and the adapter: techniques, settings and options.
type How<'a> = (&'a [String], &'a [String], &'a SceneOptions);

/// Begins a bake, or resumes it: either way, its atlas is laid out. `program`: the file of the program that runs.
pub fn begin<'a>(
    progress: Progress<'a>,
    gpu: &'a Gpu,
    [output, program]: [&Path; 2],
    scene: &Scene,
    (techniques, settings, options): How<'_>,
) -> anyhow::Result<Work<'a>> {
    let key = format!(
        "{:?}",
        (
            scene.digest(),
            &gpu.adapter.name,
            &gpu.adapter.driver,
            techniques,
            settings,
            options.of_result()
        )
    );
    // Before the bake begins: the program may be replaced while it runs.
    let build = hash_of(program).context("this program's own file cannot be read")?;
    let key = CheckpointKey::new(&build, &key);
    let mut work = Work::new(progress, gpu, output, key);
    if options.resume && work.resume(scene)? {
        let kept = &work.done.atlas;
        anyhow::ensure!(
            kept.size == options.page_size() && kept.pages <= most_pages(kept.size),
            "{}: its atlas is not as asked for",
            work.path.display()
        );
    } else {
        if options.resume {
            let path = work.path.display();
            let note = format!("{path}: there is no checkpoint yet; the bake starts");
            work.progress.note(note);
        }
        work.done.atlas = unwrap(scene, options, &mut work.progress)?;
        let Atlas { pages, size, .. } = work.done.atlas;
        if pages > 1 && options.texel_density.is_none() {
            let note = format!(
                "one page of {size}x{size} texels does not hold all charts with their gutters, at any density: there are {pages}; a larger --atlas-size or a smaller --gutter saves pages"
            );
            work.progress.note(note);
        }
    }
    work.timed("unwrapping");
    Ok(work)
}

/// The hash of a program, which holds all its shaders.
fn hash_of(program: &Path) -> io::Result<[u8; 32]> {
    Ok(*blake3::hash(&std::fs::read(program)?).as_bytes())
}

/// Number of pages of `size` texels per side that fit in memory.
fn most_pages(size: u32) -> u32 {
    (MOST_TEXELS / u64::from(size.max(1)).pow(2)).clamp(1, MOST_PAGES) as u32
}

/// Lays out the atlas of a scene.
pub fn unwrap(
    scene: &Scene,
    options: &SceneOptions,
    progress: &mut Progress<'_>,
) -> anyhow::Result<Atlas> {
    let layout = AtlasOptions {
        size: options.page_size(),
        density: match options.texel_density {
            Some(density) => TexelDensity::PerMetre(density),
            None => TexelDensity::OnePage,
        },
        gutter: options.gutter,
        most_pages: most_pages(options.page_size()),
        ..AtlasOptions::default()
    };
    progress.show(0.0, "unwrapping");
    Atlas::with_progress(scene, &layout, |_| !progress.is_asked_to_stop()).map_err(|error| {
        match error {
            AtlasError::TooManyPages { .. } | AtlasError::PageTooSmall { .. } => Usage(format!(
                "{error} (--atlas-size{})",
                match options.texel_density {
                    Some(_) => ", --texel-density",
                    None => "",
                }
            ))
            .into(),
            AtlasError::Option { .. } => Usage(error.to_string()).into(),
            error => error.into(),
        }
    })
}
