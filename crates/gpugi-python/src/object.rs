//! Placed meshes.

use std::sync::Arc;

use gpugi_scene::Instance;
use pyo3::prelude::*;
use pyo3::types::PyAny;

use crate::errors::wrong;
use crate::held::Held;
use crate::material::PyMaterial;
use crate::scene::lock;
use crate::values::{array_of, matrix, vector};

/// A mesh in a place. Several objects may share a mesh and a material.
#[pyclass(name = "Object", module = "gpugi", frozen)]
pub struct PyPlaced(pub Held<Instance>);

#[pymethods]
impl PyPlaced {
    #[getter]
    fn name(&self) -> PyResult<String> {
        Ok(self.0.get()?.name.as_str().to_owned())
    }

    /// World space (m) from the mesh's: a 4x4 matrix.
    #[getter]
    fn transform<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        array_of(py, &self.0.get()?.world_from_mesh)
    }

    #[setter]
    fn set_transform(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let place = matrix("transform", value)?;
        self.0.change(|object| {
            object.world_from_mesh = place;
            Ok(())
        })
    }

    /// Where the mesh's origin is, in world space (m).
    #[getter]
    fn position(&self) -> PyResult<[f32; 3]> {
        let place = self.0.get()?.world_from_mesh;
        Ok(place.w_axis.truncate().to_array())
    }

    #[setter]
    fn set_position(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let position = vector("position", value)?;
        self.0.change(|object| {
            object.world_from_mesh.w_axis = position.extend(1.0);
            Ok(())
        })
    }

    /// Its material, which other objects may share.
    #[getter]
    fn material(&self) -> PyResult<PyMaterial> {
        let index = self.0.get()?.material;
        match &self.0 {
            Held::Of(scene, ..) => Ok(PyMaterial(Held::of(scene.clone(), index))),
            Held::Own(_) => Err(wrong("material", "the object is in no scene")),
        }
    }

    /// Gives it a material of its scene, or a copy of another one.
    #[setter]
    fn set_material(&self, material: &Bound<'_, PyMaterial>) -> PyResult<()> {
        let of_scene = match (&material.get().0, &self.0) {
            (Held::Of(its, index, _), Held::Of(scene, ..)) if Arc::ptr_eq(its, scene) => {
                Some(*index)
            }
            _ => None,
        };
        let material = material.get().0.get()?;
        let Held::Of(scene, ..) = &self.0 else {
            return Err(wrong("material", "the object is in no scene"));
        };
        let index =
            of_scene.unwrap_or_else(|| lock(scene).change(|scene| scene.add_material(material)));
        self.0.change(|object| {
            object.material = index;
            Ok(())
        })
    }

    fn __repr__(&self) -> PyResult<String> {
        Ok(format!(
            "Object({:?}, position={:?})",
            self.name()?,
            self.position()?
        ))
    }
}
