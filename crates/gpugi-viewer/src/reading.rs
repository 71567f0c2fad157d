//! What is read for the viewer, as jobs: a page has its workers do them.

use std::path::PathBuf;

use gpugi::jobs::Job;
use gpugi_arguments::files::Files;
use gpugi_arguments::scene_argument::{self, SceneArguments};
use gpugi_scene::{Environment, Scene};
use serde::{Deserialize, Serialize};

/// Reads a scene, from `files` or from the disk, and builds the trees of its meshes: other techniques and the path
/// tracer need not build them again.
#[derive(Debug, Serialize, Deserialize)]
pub struct ReadScene {
    /// What selects it.
    pub arguments: SceneArguments,
    /// What was dropped on a page.
    pub files: Files,
}

impl Job for ReadScene {
    const NAME: &'static str = "read a scene";
    /// The scene and notes for people, or what is wrong.
    type Result = Result<(Scene, Vec<String>), String>;

    fn run(self, _: &(dyn Fn(f32) -> bool + Sync)) -> Self::Result {
        let read = scene_argument::load_among(&self.arguments, &self.files);
        let (mut scene, notes) = read.map_err(|error| format!("{error:#}"))?;
        scene.build_trees();
        Ok((scene, notes))
    }
}

/// Reads an environment, from `files` or from the disk.
#[derive(Debug, Serialize, Deserialize)]
pub struct ReadEnvironment {
    /// Its file.
    pub file: PathBuf,
    /// What was dropped on a page.
    pub files: Files,
    /// What the file may ask for, as `--limits` says it.
    pub limits: String,
}

impl Job for ReadEnvironment {
    const NAME: &'static str = "read an environment";
    type Result = Result<Environment, String>;

    fn run(self, _: &(dyn Fn(f32) -> bool + Sync)) -> Self::Result {
        let read = scene_argument::parse_limits(&self.limits)
            .and_then(|limits| scene_argument::environment_of(&self.file, &self.files, &limits));
        read.map_err(|error| format!("{error:#}"))
    }
}

/// What comes of a job that a task does itself. On a page it is done elsewhere, and frames go on.
pub async fn result_of<J: Job<Result = Result<T, String>>, T: Clone>(job: J) -> Result<T, String> {
    #[cfg(not(target_arch = "wasm32"))]
    {
        job.run(&|_| true)
    }
    #[cfg(target_arch = "wasm32")]
    {
        let running = gpugi::jobs::start(job);
        loop {
            if let Some(result) = running.result() {
                let failed = || Err("gpugi failed; please report it".to_owned());
                return result.cloned().unwrap_or_else(failed);
            }
            crate::browser::pause().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_that_was_read_brings_its_trees() {
        let job = ReadScene {
            arguments: SceneArguments::of("cornell"),
            files: Files::default(),
        };
        let (scene, _) = job.run(&|_| true).unwrap();
        assert!(scene.meshes.iter().all(|mesh| mesh.tree.is_some()));
    }
}
