//! Lights, materials, objects and cameras: of their own, or in a scene, which changes with them.

use std::sync::Mutex;

use gpugi_scene::{Camera, Instance, Light, Material, Scene};
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::{PyIndexError, PyKeyError};
use pyo3::prelude::*;
use pyo3::types::{PyAny, PyList};

use crate::camera::PyCamera;
use crate::errors::exception;
use crate::light::PyLight;
use crate::material::PyMaterial;
use crate::object::PyPlaced;
use crate::scene::{Shared, lock};

/// What a scene has lists of.
pub trait Thing: Clone {
    /// Its list.
    fn all(scene: &Scene) -> &[Self];
    /// Its list, to change.
    fn all_mut(scene: &mut Scene) -> &mut Vec<Self>;
    /// Its name; not unique.
    fn name(&self) -> &str;
}

macro_rules! things {
    ($($thing:ident in $list:ident;)+) => { $(
        impl Thing for $thing {
            fn all(scene: &Scene) -> &[Self] {
                &scene.$list
            }
            fn all_mut(scene: &mut Scene) -> &mut Vec<Self> {
                &mut scene.$list
            }
            fn name(&self) -> &str {
                &self.name
            }
        }
    )+ };
}

things! {
    Light in lights;
    Material in materials;
    Instance in instances;
    Camera in cameras;
}

/// A value of its own, or one of a scene.
pub enum Held<T> {
    Own(Mutex<T>),
    /// Its scene, its index there, and how often something had been removed.
    Of(Shared, usize, u64),
}

impl<T: Thing> Held<T> {
    pub fn own(value: T) -> Self {
        Self::Own(Mutex::new(value))
    }

    pub fn of(scene: Shared, index: usize) -> Self {
        let removals = lock(&scene).removals;
        Self::Of(scene, index, removals)
    }

    /// The value.
    pub fn get(&self) -> PyResult<T> {
        match self {
            Self::Own(value) => {
                let value = value.lock().unwrap_or_else(|broken| broken.into_inner());
                Ok(value.clone())
            }
            Self::Of(scene, index, removals) => {
                let found = {
                    let kept = lock(scene);
                    let is_there = kept.removals == *removals;
                    is_there
                        .then(|| T::all(&kept.scene).get(*index).cloned())
                        .flatten()
                };
                found.ok_or_else(gone)
            }
        }
    }

    /// Changes the value; if that fails, it stays as it was.
    pub fn change(&self, change: impl FnOnce(&mut T) -> PyResult<()>) -> PyResult<()> {
        let mut value = self.get()?;
        change(&mut value)?;
        match self {
            Self::Own(own) => {
                *own.lock().unwrap_or_else(|broken| broken.into_inner()) = value;
            }
            // Another thread may have removed something meanwhile.
            Self::Of(scene, index, removals) => {
                let is_there = {
                    let mut kept = lock(scene);
                    let is_there = kept.removals == *removals;
                    kept.change(|scene| {
                        let place = T::all_mut(scene).get_mut(*index);
                        place
                            .filter(|_| is_there)
                            .map(|place| *place = value)
                            .is_some()
                    })
                };
                if !is_there {
                    return Err(gone());
                }
            }
        }
        Ok(())
    }
}

fn gone() -> PyErr {
    let reason = "something was removed from its scene since: get it from the scene once more";
    exception("Error", reason.to_owned())
}

/// Which list of a scene.
#[derive(Debug, Clone, Copy)]
pub enum Kind {
    Lights,
    Materials,
    Objects,
    Cameras,
}

/// A list of a scene's lights, materials, objects or cameras. Takes an index or a name.
#[pyclass(name = "SceneList", module = "gpugi", frozen, sequence)]
pub struct List {
    scene: Shared,
    kind: Kind,
}

impl List {
    pub fn new(scene: Shared, kind: Kind) -> Self {
        Self { scene, kind }
    }

    fn names_of<T: Thing>(&self) -> Vec<String> {
        let kept = lock(&self.scene);
        let all = T::all(&kept.scene).iter();
        all.map(|thing| thing.name().to_owned()).collect()
    }

    fn item(&self, py: Python<'_>, index: usize) -> PyResult<Py<PyAny>> {
        let scene = self.scene.clone();
        match self.kind {
            Kind::Lights => PyLight(Held::of(scene, index)).into_py_any(py),
            Kind::Materials => PyMaterial(Held::of(scene, index)).into_py_any(py),
            Kind::Objects => PyPlaced(Held::of(scene, index)).into_py_any(py),
            Kind::Cameras => PyCamera(Held::of(scene, index)).into_py_any(py),
        }
    }
}

#[pymethods]
impl List {
    /// The names, in order; several may be the same.
    #[getter]
    fn names(&self) -> Vec<String> {
        match self.kind {
            Kind::Lights => self.names_of::<Light>(),
            Kind::Materials => self.names_of::<Material>(),
            Kind::Objects => self.names_of::<Instance>(),
            Kind::Cameras => self.names_of::<Camera>(),
        }
    }

    fn __len__(&self) -> usize {
        self.names().len()
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let items = (0..self.names().len()).map(|index| self.item(py, index));
        let items = items.collect::<PyResult<Vec<_>>>()?;
        Ok(PyList::new(py, items)?.try_iter()?.into_any())
    }

    fn __getitem__(&self, py: Python<'_>, which: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
        let names = self.names();
        if let Ok(name) = which.extract::<String>() {
            let found = names.iter().position(|known| *known == name);
            let some: Vec<&str> = names.iter().take(20).map(String::as_str).collect();
            let message = || {
                format!(
                    "there is no {name:?} among these {}: {}",
                    names.len(),
                    some.join(", ")
                )
            };
            return self.item(py, found.ok_or_else(|| PyKeyError::new_err(message()))?);
        }
        let index: isize = which
            .extract()
            .map_err(|_| PyIndexError::new_err("an index or a name is needed"))?;
        let count = names.len() as isize;
        let from_start = if index < 0 { index + count } else { index };
        match (0..count).contains(&from_start) {
            true => self.item(py, from_start as usize),
            false => {
                let message = format!("there is no index {index} among {count}");
                Err(PyIndexError::new_err(message))
            }
        }
    }

    fn __repr__(&self) -> String {
        format!("{:?}: {:?}", self.kind, self.names())
    }
}
