//! Baked light, as files that other programs show.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context;
use gpugi_cli::bake::{Baked, SceneOptions, SharedBake, Subject, bake as bake_scene};
use gpugi_cli::progress::Progress;
use gpugi_scene::export::export_scene;
use gpugi_scene::image::replace_file;
use pyo3::prelude::*;
use pyo3::types::{PyAny, PyBytes, PyDict};

use crate::busy::Busy;
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
            scene: Arc::unwrap_or_clone(kept.scene),
            notes: Vec::new(),
            source: kept.source.as_ref(),
            program,
        };
        let order = (&techniques[..], &settings[..], &options);
        let mut call = |part: f64, words: &str| report.step(part, words);
        bake_scene(&gpu, subject, &output, order, Progress::told_to(&mut call))
    });
    report.end()?;
    described(py, baked.map_err(raised)?)
}

/// A share in a bake: see `gpugi.distributed`.
#[pyclass(name = "SharedBake", module = "gpugi._gpugi", frozen)]
pub struct PySharedBake(Busy<Option<SharedBake>>);

impl PySharedBake {
    /// Does something with it, without Python's lock.
    fn with<R: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut SharedBake) -> anyhow::Result<R> + Send,
    ) -> PyResult<R> {
        py.detach(|| {
            let mut bake = self.0.lock()?;
            work(bake.as_mut().context("the bake is finished")?)
        })
        .map_err(raised)
    }
}

#[pymethods]
impl PySharedBake {
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        scene: &Bound<'_, PyScene>,
        techniques: Vec<String>,
        settings: Vec<String>,
        options: Vec<String>,
        adapter: &str,
        output: Option<PathBuf>,
        atlas: Option<Vec<u8>>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let options = SceneOptions::of_words(&options).map_err(raised)?;
        let gpu = device(py, adapter)?;
        let kept = lock(&scene.get().shared).clone();
        let mut report = Report::new(progress);
        let made = py.detach(|| {
            let subject = Subject {
                scene: Arc::unwrap_or_clone(kept.scene),
                notes: Vec::new(),
                source: kept.source.as_ref(),
                program: PathBuf::new(),
            };
            let order = (&techniques[..], &settings[..], &options);
            let mut call = |part: f64, words: &str| report.step(part, words);
            SharedBake::new(
                &gpu,
                subject,
                order,
                output.as_deref(),
                atlas.as_deref(),
                Progress::told_to(&mut call),
            )
        });
        report.end()?;
        Ok(Self(Busy::new(Some(made.map_err(raised)?))))
    }

    fn atlas<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let atlas = self.with(py, |bake| bake.atlas())?;
        Ok(PyBytes::new(py, &atlas))
    }

    fn tasks<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyBytes>>> {
        let tasks = self.with(py, |bake| bake.tasks())?.into_iter();
        Ok(tasks.map(|task| PyBytes::new(py, &task)).collect())
    }

    #[pyo3(signature = (task, progress = None))]
    fn run<'py>(
        &self,
        py: Python<'py>,
        task: Vec<u8>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let mut report = Report::new(progress);
        let result = self.with(py, |bake| {
            let mut call = |part: f64, words: &str| report.step(part, words);
            bake.run(&task, Progress::told_to(&mut call))
        });
        report.end()?;
        Ok(PyBytes::new(py, &result?))
    }

    fn merge(&self, py: Python<'_>, result: &Bound<'_, PyBytes>) -> PyResult<()> {
        let result = result.as_bytes();
        self.with(py, |bake| bake.merge(result))
    }

    #[getter]
    fn is_complete(&self, py: Python<'_>) -> PyResult<bool> {
        self.with(py, |bake| Ok(bake.is_complete()))
    }

    fn finish<'py>(&self, py: Python<'py>, output: PathBuf) -> PyResult<Bound<'py, PyDict>> {
        let finished = py.detach(|| {
            let mut bake = self.0.lock()?;
            bake.take().context("the bake is finished")?.finish(&output)
        });
        described(py, finished.map_err(raised)?)
    }
}

/// A bake that is done, for Python.
fn described(py: Python<'_>, baked: Baked) -> PyResult<Bound<'_, PyDict>> {
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
