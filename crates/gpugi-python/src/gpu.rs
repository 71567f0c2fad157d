//! Devices.

use std::collections::HashMap;
use std::sync::{LazyLock, Mutex};

use gpugi::gpu::{AdapterChoice, Gpu};
use pyo3::prelude::*;

use crate::errors::{raised, wrong};

/// One device per adapter for the whole process: it keeps compiled shaders, which take longer than most pictures.
static DEVICES: LazyLock<Mutex<HashMap<String, Gpu>>> = LazyLock::new(Mutex::default);

/// The device of an adapter: part of its name, `software`, `discrete`, or `best`.
pub fn device(py: Python<'_>, adapter: &str) -> PyResult<Gpu> {
    let choice: AdapterChoice = adapter.parse().map_err(|error| wrong("adapter", error))?;
    py.detach(|| {
        let mut devices = DEVICES.lock().unwrap_or_else(|broken| broken.into_inner());
        if let Some(gpu) = devices.get(adapter) {
            // A device that is lost is opened anew.
            if gpu.check_lost().is_ok() {
                return Ok(gpu.clone());
            }
        }
        let gpu = Gpu::open(&choice).map_err(raised)?;
        devices.insert(adapter.to_owned(), gpu.clone());
        Ok(gpu)
    })
}

/// Name and driver of the adapter that a choice means.
#[pyfunction]
pub fn adapter_of(py: Python<'_>, adapter: &str) -> PyResult<String> {
    let gpu = device(py, adapter)?;
    Ok(format!("{} ({})", gpu.adapter.name, gpu.adapter.driver))
}
