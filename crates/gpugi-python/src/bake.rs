//! Baked light, as files that other programs show.

use std::path::PathBuf;

use gpugi_cli::bake::{SceneOptions, Subject, bake as bake_scene};
use gpugi_cli::progress::Progress;
use gpugi_scene::export::export_scene;
use gpugi_scene::image::replace_file;
use pyo3::prelude::*;
use pyo3::types::{PyAny, PyDict};

use crate::errors::{raised, wrong};
use crate::gpu::device;
use crate::report::Report;
use crate::scene::{PyScene, lock, scene_of};

/// Bakes a scene's light into the textures of a .glb. `options` are words of the command's.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn bake<'py>(
    py: Python<'py>,
    scene: &Bound<'py, PyAny>,
    output: PathBuf,
    techniques: Vec<String>,
    settings: Vec<String>,
    options: Vec<String>,
    adapter: &str,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let options = SceneOptions::of_words(&options).map_err(raised)?;
    let shared = scene_of(scene)?;
    let gpu = device(py, adapter)?;
    let kept = lock(&shared).clone();
    let program: PathBuf = py.import("gpugi._gpugi")?.getattr("__file__")?.extract()?;
    let mut report = Report::new(progress);
    let baked = py.detach(|| {
        let subject = Subject {
            scene: kept.scene,
            notes: Vec::new(),
            source: kept.source.as_ref(),
            program,
        };
        let order = (&techniques[..], &settings[..], &options);
        let mut call = |part: f64, words: &str| report.step(part, words);
        bake_scene(&gpu, subject, &output, order, Progress::told_to(&mut call))
    });
    report.end()?;
    let baked = baked.map_err(raised)?;
    let result = PyDict::new(py);
    let [pages, size] = baked.pages;
    result.set_item("pages", pages)?;
    result.set_item("size", size)?;
    result.set_item("notes", baked.notes)?;
    Ok(result)
}

/// Writes a scene as a .glb; returns what the file cannot hold, one sentence each.
#[pyfunction]
pub fn export(
    py: Python<'_>,
    scene: &Bound<'_, PyScene>,
    output: PathBuf,
) -> PyResult<Vec<String>> {
    if output
        .extension()
        .is_none_or(|extension| extension != "glb")
    {
        return Err(wrong(
            "path",
            format!("{} must end in .glb", output.display()),
        ));
    }
    let kept = lock(&scene.get().shared).clone();
    py.detach(|| {
        let exported = export_scene(&kept.scene)?;
        replace_file(&output, |file| {
            std::io::Write::write_all(file, &exported.glb)
        })?;
        anyhow::Ok(exported.warnings)
    })
    .map_err(raised)
}
