//! A bake of light in tasks that many processes share. All set it up alike: from the same scene, order and atlas. Tasks,
//! results and the atlas are bytes, which may travel; results merge to the same bits as the plain bake.

use std::path::Path;

use anyhow::Context;
use gpugi::bake::{Bake, LightBake, Task};
use gpugi::gpu::Gpu;
use gpugi::picture::Effects;
use gpugi::techniques::Role;
use gpugi_scene::export::{BakedPage, Changes, export_bake};
use gpugi_scene::{Atlas, Scene};

use super::lights::{self, Lights};
use super::options::SceneOptions;
use super::scene::{
    Baked, Order, Subject, check, check_denoise, dropped, leave_out, light_bake, light_of_pages,
    moved, notes_of, nothing_to_bake, too_thin, write,
};
use super::work::unwrap;
use crate::Usage;
use crate::progress::Progress;
use crate::scene_argument::SceneArguments;

/// A share in a bake.
pub struct SharedBake {
    gpu: Gpu,
    /// As it was given, and as it is lit: flat surfaces face the light.
    original: Scene,
    scene: Scene,
    turned: Vec<usize>,
    source: Option<SceneArguments>,
    options: SceneOptions,
    effects: Effects,
    /// All charts, and those that are lit.
    whole: Atlas,
    atlas: Atlas,
    bake: LightBake,
    /// Of the file.
    changes: Changes,
    notes: Vec<String>,
}

impl SharedBake {
    /// Sets it up. `output`: the file, if this share is the one that writes it. `atlas`: that of another share; without, it is
    /// laid out.
    ///
    /// # Errors
    /// [`Usage`], or why the GPU does not hold the scene.
    pub fn new(
        gpu: &Gpu,
        subject: Subject<'_>,
        (techniques, settings, options): Order<'_>,
        output: Option<&Path>,
        atlas: Option<&[u8]>,
        mut progress: Progress<'_>,
    ) -> anyhow::Result<Self> {
        match output {
            Some(output) => check(output, (techniques, settings, options))?,
            None => lights::check(techniques)?,
        }
        if let Some(name) = techniques
            .iter()
            .find(|name| lights::role_of(name) == Some(Role::Factor))
        {
            let message = format!("{name} is baked by one process: it takes no share of others");
            return Err(Usage(message).into());
        }
        let (effects, settings) = (options.display).effects(Effects::default(), settings)?;
        let Subject {
            scene: original,
            mut notes,
            source,
            ..
        } = subject;
        let (scene, turned) = original.with_lit_fronts();
        let lights = Lights::new(gpu, &scene, techniques, &options.include, &settings);
        check_denoise(options, &lights)?;
        let whole: Atlas = match atlas {
            Some(bytes) => postcard::from_bytes(bytes).context("the atlas is none")?,
            None => unwrap(&scene, options, &mut progress)?,
        };
        notes.extend(progress.notes());
        notes.extend(too_thin(whole.slivers(&scene)));
        let mut atlas = whole.clone();
        leave_out(&scene, &mut atlas, options.bake_mode, options.lobes);
        if atlas.sides().next().is_none() {
            atlas.pages = 0;
            notes.push(nothing_to_bake(&scene, options).to_owned());
        }
        let bake = light_bake(gpu, &scene, &atlas, &lights, &settings, options)?;
        notes.extend(notes_of(&bake, options));
        Ok(Self {
            gpu: gpu.clone(),
            original,
            scene,
            turned,
            source: source.cloned(),
            options: options.clone(),
            effects,
            whole,
            atlas,
            bake,
            changes: options.changes(Some(&lights)),
            notes,
        })
    }

    /// The atlas, for other shares.
    ///
    /// # Errors
    /// None that is known.
    pub fn atlas(&self) -> anyhow::Result<Vec<u8>> {
        Ok(postcard::to_allocvec(&self.whole)?)
    }

    /// The tasks: first the maps, which the others need, then the samples of texels.
    ///
    /// # Errors
    /// None that is known.
    pub fn tasks(&self) -> anyhow::Result<Vec<Vec<u8>>> {
        let tasks = self.bake.tasks();
        let tasks = tasks.iter().map(|task| Ok(postcard::to_allocvec(task)?));
        tasks.collect()
    }

    /// Runs a task; returns its result. `progress` may stop maps between the steps that solve them; a
    /// later call goes on.
    ///
    /// # Errors
    /// If the task is of another bake, the GPU fails, or `progress` breaks off.
    pub fn run(&mut self, task: &[u8], mut progress: Progress<'_>) -> anyhow::Result<Vec<u8>> {
        let task: Task = postcard::from_bytes(task).context("the task is none")?;
        while self.bake.is_refining() {
            let Some(step) = self.bake.step()? else {
                break;
            };
            progress.show(step.done.into(), "maps");
            anyhow::ensure!(!progress.is_asked_to_stop(), "the maps were not finished");
        }
        Ok(postcard::to_allocvec(&self.bake.run(&task)?)?)
    }

    /// Takes the result of a task, in any order, and more than once.
    ///
    /// # Errors
    /// If it is of another bake, or of another adapter.
    pub fn merge(&mut self, result: &[u8]) -> anyhow::Result<()> {
        let part = postcard::from_bytes(result).context("the result is none")?;
        Ok(self.bake.merge(part)?)
    }

    /// Whether all results are there.
    pub fn is_complete(&self) -> bool {
        self.bake.is_complete()
    }

    /// Writes the file, completely or not at all.
    ///
    /// # Errors
    /// If results are missing, or it cannot be written.
    pub fn finish(self, output: &Path) -> anyhow::Result<Baked> {
        anyhow::ensure!(self.is_complete(), "results of tasks are missing");
        let Self {
            gpu,
            original,
            scene,
            turned,
            source,
            options,
            effects,
            atlas,
            bake,
            changes,
            mut notes,
            ..
        } = self;
        let lit = bake.finish();
        notes.extend(moved(&lit.leaks.report));
        let how = (&options, &effects);
        let light = light_of_pages(&gpu, (&scene, &atlas), lit.pages, how, output)?;
        let of_page = |light| BakedPage {
            light: Some(light),
            ..BakedPage::default()
        };
        let pages: Vec<BakedPage> = light.into_iter().map(of_page).collect();
        notes.extend(dropped(&changes, &scene).map(str::to_owned));
        notes.extend(write(source.as_ref(), output, |file| {
            export_bake(file, &original, &atlas.clone().turned(&turned), &pages)?.changed(&changes)
        })?);
        Ok(Baked {
            pages: [atlas.pages, atlas.size],
            notes,
            times: Vec::new(),
        })
    }
}
