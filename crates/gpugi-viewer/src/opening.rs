//! Scenes to open: read, uploaded and given a renderer while something else is on show.

use std::path::{Path, PathBuf};

use gpugi::gpu::Gpu;
use gpugi::lighting::{LightingError, Readiness};
use gpugi::picture::Effects;
use gpugi::renderer::Renderer;
use gpugi_arguments::files::Files;
use gpugi_arguments::scene_argument::{self, SceneArguments};
use gpugi_scene::{Camera, Document, Scene};
use web_time::Instant;

use crate::pace::{Pace, Purpose};
use crate::reading::{ReadEnvironment, ReadScene, result_of};
use crate::session::Loaded;
use crate::task::{Stage, Task, compiled, gpu_done};
use crate::technique_set::TechniqueSet;

/// A scene on its way, or why there is none.
pub type Opening = Task<Result<Loaded, String>>;

/// What dropping a file means: a scene to open in place of the one on show, or an environment for it.
pub fn dropped(current: &SceneArguments, file: &Path) -> SceneArguments {
    let extension = file.extension().unwrap_or_default().to_string_lossy();
    let is_image = ["hdr", "exr", "ktx2", "png", "jpg", "jpeg"]
        .iter()
        .any(|image| extension.eq_ignore_ascii_case(image));
    if is_image {
        SceneArguments {
            environment: Some(PathBuf::from(file)),
            ..current.clone()
        }
    } else {
        SceneArguments {
            limits: current.limits.clone(),
            ..SceneArguments::of(&file.to_string_lossy())
        }
    }
}

/// Opens a scene, from `files` or from the disk, with the techniques of `set`.
pub fn open(
    gpu: &Gpu,
    arguments: &SceneArguments,
    files: Files,
    set: &TechniqueSet,
    done: impl FnOnce() + Send + 'static,
) -> Opening {
    let (gpu, arguments, set) = (gpu.clone(), arguments.clone(), set.clone());
    Task::start(&arguments.scene.clone(), done, move |stage| async move {
        stage.set("reading").await;
        let (words, edits) = (arguments.in_words(), arguments.edit.clone());
        let (scene, notes) = result_of(ReadScene { arguments, files }).await?;
        stage.set("uploading").await;
        let source = (words, edits, notes);
        renderer(&gpu, scene, set, source, stage).await
    })
}

/// The scene on show in the environment of `arguments`, from `files` or from the disk.
pub fn change_environment(
    gpu: &Gpu,
    current: &Loaded,
    arguments: &SceneArguments,
    files: Files,
    done: impl FnOnce() + Send + 'static,
) -> Opening {
    let (gpu, arguments) = (gpu.clone(), arguments.clone());
    let (mut scene, set) = (current.scene().clone(), current.set.clone());
    let (edits, notes) = (current.edits.clone(), current.notes.clone());
    let file = arguments.environment.clone().unwrap_or_default();
    Task::start(&file.display().to_string(), done, move |stage| async move {
        stage.set("reading").await;
        let limits = arguments.limits.clone();
        let read = ReadEnvironment {
            file,
            files,
            limits,
        };
        scene.environment = Some(result_of(read).await?);
        stage.set("uploading").await;
        let source = (arguments.in_words(), edits, notes);
        renderer(&gpu, scene, set, source, stage).await
    })
}

/// The scene on show with the techniques of `set`, on any device. `subject` says why.
pub fn upload_again(
    gpu: &Gpu,
    subject: &str,
    current: &Loaded,
    set: TechniqueSet,
    done: impl FnOnce() + Send + 'static,
) -> Opening {
    upload_as(gpu, subject, current, current.scene().clone(), set, done)
}

/// As [`upload_again`], with what `scene` has that the scene on show has not.
pub fn upload_as(
    gpu: &Gpu,
    subject: &str,
    current: &Loaded,
    scene: Scene,
    set: TechniqueSet,
    done: impl FnOnce() + Send + 'static,
) -> Opening {
    let gpu = gpu.clone();
    let arguments = current.arguments.clone();
    let source = (arguments, current.edits.clone(), current.notes.clone());
    Task::start(subject, done, move |stage| async move {
        stage.set("uploading").await;
        renderer(&gpu, scene, set, source, stage).await
    })
}

async fn renderer(
    gpu: &Gpu,
    scene: Scene,
    set: TechniqueSet,
    (arguments, edits, notes): (Vec<String>, Vec<String>, Vec<String>),
    stage: Stage,
) -> Result<Loaded, String> {
    // The first frame in the window gives it a size.
    let renderer = set.renderer(gpu, &scene, [1, 1]);
    let mut renderer = renderer.map_err(|error| error.to_string())?;
    compiled(gpu, &stage, || renderer.is_compiling()).await;
    let camera = scene_argument::camera(&scene, None, 1.0);
    let camera = camera.map_err(|error| format!("{error:#}"))?;
    let lit = first_light(gpu, &mut renderer, &camera, &stage).await;
    lit.map_err(|error| error.to_string())?;
    Ok(Loaded {
        arguments,
        edits,
        renderer,
        document: Document::new(scene),
        set,
        notes,
    })
}

/// Frames of a single pixel, beside those of what is on show, until there is light to see: they lay out atlases, begin the
/// maps, and compile the shaders that techniques make late.
async fn first_light(
    gpu: &Gpu,
    renderer: &mut Renderer,
    camera: &Camera,
    stage: &Stage,
) -> Result<(), LightingError> {
    let mut pace = Pace::default();
    let effects = Effects::of_live_view();
    loop {
        renderer.set_budget(pace.budget(Purpose::Maps));
        let began = Instant::now();
        let (readiness, _) = renderer.try_render_sample(camera, 1, Some(&effects), false)?;
        let Readiness::Pending { progress, what } = readiness else {
            return Ok(());
        };
        gpu_done(gpu).await?;
        let (seconds, work) = (began.elapsed().as_secs_f32(), renderer.work());
        pace.measure(seconds, work, 0, Purpose::Maps);
        #[cfg(not(target_arch = "wasm32"))]
        if work == 0 {
            // Other threads are at work.
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        stage.set_progress(what, Some(progress)).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_that_are_dropped_are_environments_and_other_files_scenes() {
        let current = SceneArguments {
            limits: "side=64".into(),
            detail: 3,
            ..SceneArguments::of("spheres")
        };
        let sky = dropped(&current, Path::new("a/Sky.EXR"));
        assert_eq!(
            sky.in_words().join(" "),
            "spheres --detail 3 --environment a/Sky.EXR --limits side=64"
        );
        let scene = dropped(&sky, Path::new("b/cube.glb"));
        assert_eq!(scene.in_words().join(" "), "b/cube.glb --limits side=64");
    }
}
