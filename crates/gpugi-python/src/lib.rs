//! gpugi for Python. `python/gpugi` wraps this module: the public names, their types and their documentation are there.

mod bake;
mod busy;
mod camera;
mod compare;
mod errors;
mod gpu;
mod held;
mod json;
mod light;
mod material;
mod object;
mod pickle;
mod render;
mod report;
mod scene;
mod values;

use std::ffi::OsString;

use pyo3::prelude::*;

/// The compiled part of gpugi.
#[pymodule]
mod _gpugi {
    #[pymodule_export]
    use super::bake::{PySharedBake, bake, export};
    #[pymodule_export]
    use super::camera::PyCamera;
    #[pymodule_export]
    use super::compare::{compare, develop, measure, png, read};
    #[pymodule_export]
    use super::gpu::adapter_of;
    #[pymodule_export]
    use super::held::List;
    #[pymodule_export]
    use super::light::PyLight;
    #[pymodule_export]
    use super::material::PyMaterial;
    #[pymodule_export]
    use super::object::PyPlaced;
    #[pymodule_export]
    use super::pickle::{camera_from_bytes, scene_from_bytes};
    #[pymodule_export]
    use super::render::{PyPathTracer, PyRenderer};
    #[pymodule_export]
    use super::scene::PyScene;
    #[pymodule_export]
    use super::{adapters, builtin_scenes, command, techniques};

    use pyo3::prelude::*;
    use pyo3::types::PyModule;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}

/// The command `gpugi`, with these arguments; returns its exit code.
#[pyfunction]
fn command(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| gpugi_cli::run(arguments))
}

/// Names of the built-in scenes, and what they show.
#[pyfunction]
fn builtin_scenes() -> Vec<(&'static str, &'static str)> {
    let scenes = gpugi_scene::builtin::SCENES.iter();
    scenes.map(|scene| (scene.name, scene.summary)).collect()
}

/// Names of the techniques, and what they do.
#[pyfunction]
fn techniques() -> Vec<(&'static str, &'static str)> {
    let registry = gpugi::techniques::Registry::default();
    let infos = registry.all().iter().map(|registration| registration.info);
    let infos = infos.chain([&gpugi::reference::INFO]);
    infos.map(|info| (info.name, info.summary)).collect()
}

/// Names of the adapters of this machine.
#[pyfunction]
fn adapters(py: Python<'_>) -> Vec<String> {
    let adapters = py.detach(gpugi::gpu::list_adapters).into_iter();
    adapters.map(|adapter| adapter.name).collect()
}
