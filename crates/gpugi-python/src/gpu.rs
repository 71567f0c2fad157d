//! Devices.

use std::collections::HashMap;
use std::sync::{LazyLock, Mutex, OnceLock};

use gpugi::gpu::{AdapterChoice, Gpu};
use pyo3::prelude::*;

use crate::errors::{raised, wrong};

/// One device per adapter for the whole process: it keeps compiled shaders, which take longer than most pictures.
static DEVICES: LazyLock<Mutex<HashMap<String, Gpu>>> = LazyLock::new(Mutex::default);

/// The process that has opened the devices: another, forked from it, cannot use them.
static PROCESS: OnceLock<u32> = OnceLock::new();

/// Refuses to go on in a process that was forked after a device was opened: it would wait forever.
pub fn check_process() -> anyhow::Result<()> {
    let this = std::process::id();
    anyhow::ensure!(
        *PROCESS.get_or_init(|| this) == this,
        "a process that was forked from one that has rendered cannot render: start it with multiprocessing's spawn"
    );
    Ok(())
}

/// The device of an adapter: part of its name, `software`, `discrete`, or `best`.
pub fn device(py: Python<'_>, adapter: &str) -> PyResult<Gpu> {
    let choice: AdapterChoice = adapter.parse().map_err(|error| wrong("adapter", error))?;
    check_process().map_err(raised)?;
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
