//! Scenes and cameras as bytes, so that they travel to other processes.

use gpugi_arguments::scene_argument::SceneArguments;
use gpugi_scene::{Camera, Scene};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::camera::PyCamera;
use crate::errors::raised;
use crate::held::Held;
use crate::scene::{Kept, PyScene};

/// All that a scene holds.
type State = (Scene, Option<SceneArguments>, f32, Vec<String>);

/// A scene as bytes.
pub fn bytes(kept: &Kept, notes: &[String]) -> PyResult<Vec<u8>> {
    let state = (&*kept.scene, &kept.source, kept.time, notes);
    postcard::to_allocvec(&state).map_err(|error| raised(anyhow::Error::new(error)))
}

/// The scene of [`bytes`]. As with all pickles: only of those whom you trust.
#[pyfunction]
pub fn scene_from_bytes(py: Python<'_>, bytes: &Bound<'_, PyBytes>) -> PyResult<PyScene> {
    let bytes = bytes.as_bytes();
    let read = py.detach(|| postcard::from_bytes::<State>(bytes));
    let (scene, source, time, notes) = read.map_err(|error| raised(anyhow::Error::new(error)))?;
    Ok(PyScene::of_state(Kept::new(scene, source, time), notes))
}

/// A camera as bytes.
pub fn bytes_of_camera(camera: &Camera) -> PyResult<Vec<u8>> {
    postcard::to_allocvec(camera).map_err(|error| raised(anyhow::Error::new(error)))
}

/// The camera of [`bytes_of_camera`].
#[pyfunction]
pub fn camera_from_bytes(bytes: &Bound<'_, PyBytes>) -> PyResult<PyCamera> {
    let read = postcard::from_bytes::<Camera>(bytes.as_bytes());
    let camera = read.map_err(|error| raised(anyhow::Error::new(error)))?;
    Ok(PyCamera(Held::own(camera)))
}
