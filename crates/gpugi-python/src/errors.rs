//! Errors of the library as exceptions, which `gpugi/_errors.py` declares.

use gpugi::LightingError;
use gpugi::gpu::GpuError;
use gpugi::measure::MeasureError;
use gpugi_arguments::Usage;
use gpugi_scene::ImportError;
use pyo3::prelude::*;

/// The name of the exception for an error.
fn class_of(error: &anyhow::Error) -> &'static str {
    let of_gpu = |error: &LightingError| match error {
        // What the caller gave is not finite, or empty.
        LightingError::Gpu(GpuError::Input { .. }) => "ArgumentError",
        LightingError::Gpu(_) => "GpuError",
        _ => "ArgumentError",
    };
    if error.is::<Usage>() {
        "ArgumentError"
    } else if error.is::<ImportError>() {
        "SceneError"
    } else if let Some(error) = error.downcast_ref::<GpuError>() {
        of_gpu(&LightingError::Gpu(error.clone()))
    } else if let Some(error) = error.downcast_ref::<LightingError>() {
        of_gpu(error)
    } else if let Some(MeasureError::Render(error)) = error.downcast_ref::<MeasureError>() {
        of_gpu(error)
    } else {
        "Error"
    }
}

/// An exception of gpugi by the name of its class.
pub fn exception(class: &str, message: String) -> PyErr {
    Python::attach(|py| {
        let made = py
            .import("gpugi._errors")
            .and_then(|module| module.getattr(class))
            .and_then(|class| class.call1((message,)));
        made.map_or_else(|error| error, PyErr::from_value)
    })
}

/// An error of the library as an exception.
pub fn raised(error: impl Into<anyhow::Error>) -> PyErr {
    let error = error.into();
    exception(class_of(&error), format!("{error:#}"))
}

/// An argument that makes no sense: `ArgumentError`.
pub fn wrong(argument: &str, reason: impl std::fmt::Display) -> PyErr {
    exception("ArgumentError", format!("{argument}: {reason}"))
}
