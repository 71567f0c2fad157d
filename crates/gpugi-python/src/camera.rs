//! Cameras.

use glam::Vec3;
use gpugi_scene::{Camera, Lens, Projection, lens};
use pyo3::prelude::*;
use pyo3::types::{PyAny, PyBytes};

use crate::errors::wrong;
use crate::held::Held;
use crate::values::{array_of, matrix, number, number_in, vector};

/// A camera that looks along its local -Z; +Y is up.
#[pyclass(name = "Camera", module = "gpugi", frozen)]
pub struct PyCamera(pub Held<Camera>);

/// Allowed fields of view (degrees).
const FIELDS: [f32; 2] = [1.0, 170.0];

#[pymethods]
impl PyCamera {
    /// A perspective camera at `eye` that looks at `target` (world space (m)). fov: vertical, degrees. aperture: radius of
    /// the lens (m); focus: the distance that it sees sharply (m), that of the target without; shutter: how long it is
    /// open (s).
    #[staticmethod]
    #[pyo3(signature = (eye, target, *, up = None, fov = None, aperture = None, focus = None, shutter = None, name = ""))]
    #[allow(clippy::too_many_arguments)]
    fn look_at(
        eye: &Bound<'_, PyAny>,
        target: &Bound<'_, PyAny>,
        up: Option<&Bound<'_, PyAny>>,
        fov: Option<&Bound<'_, PyAny>>,
        aperture: Option<&Bound<'_, PyAny>>,
        focus: Option<&Bound<'_, PyAny>>,
        shutter: Option<&Bound<'_, PyAny>>,
        name: &str,
    ) -> PyResult<Self> {
        let (eye, target) = (vector("eye", eye)?, vector("target", target)?);
        if eye.distance(target) <= 1e-9 {
            return Err(wrong("target", "eye and target must differ"));
        }
        let fov = fov.map_or(Ok(35.0), |value| number_in("fov", value, FIELDS))?;
        let mut camera = Camera::look_at(name, eye, target, fov.to_radians());
        if let Some(up) = up {
            let backward = camera.world_from_view.z_axis.truncate();
            let right = vector("up", up)?.normalize_or_zero().cross(backward);
            if right.length() <= 1e-6 {
                return Err(wrong("up", "it must point aside of the view"));
            }
            let right = right.normalize();
            camera.world_from_view.x_axis = right.extend(0.0);
            camera.world_from_view.y_axis = backward.cross(right).extend(0.0);
        }
        if let Some(aperture) = aperture {
            let focus = focus.map_or(Ok(eye.distance(target)), |value| {
                number_in("focus", value, [1e-6, f32::MAX])
            })?;
            let lens = Lens::new(number("aperture", aperture)?, focus, 0);
            camera.lens = lens.map_err(|error| wrong("aperture", error))?;
        } else if focus.is_some() {
            return Err(wrong("focus", "it takes an aperture"));
        }
        if let Some(seconds) = shutter {
            let seconds = lens::shutter(number("shutter", seconds)?);
            camera.shutter = seconds.map_err(|error| wrong("shutter", error))?;
        }
        Ok(Self(Held::own(camera)))
    }

    #[getter]
    fn name(&self) -> PyResult<String> {
        Ok(self.0.get()?.name.as_str().to_owned())
    }

    /// World space (m) from the camera's: a 4x4 matrix whose columns are right, up, backward and the eye.
    #[getter]
    fn transform<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        array_of(py, &self.0.get()?.world_from_view)
    }

    #[setter]
    fn set_transform(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let place = matrix("transform", value)?;
        let axes = [place.x_axis, place.y_axis, place.z_axis].map(glam::Vec4::truncate);
        let [x, y, z] = axes;
        let is_rigid =
            axes.iter().all(|axis| (axis.length() - 1.0).abs() < 1e-3) && x.cross(y).dot(z) > 0.999;
        if !is_rigid {
            return Err(wrong(
                "transform",
                "a camera is turned and moved, nothing else",
            ));
        }
        self.0.change(|camera| {
            camera.world_from_view = place;
            Ok(())
        })
    }

    /// Where it is, in world space (m).
    #[getter]
    fn position(&self) -> PyResult<[f32; 3]> {
        let place = self.0.get()?.world_from_view;
        Ok(place.w_axis.truncate().to_array())
    }

    /// Where it looks: a unit vector.
    #[getter]
    fn direction(&self) -> PyResult<[f32; 3]> {
        let place = self.0.get()?.world_from_view;
        let forward: Vec3 = -place.z_axis.truncate();
        Ok(forward.to_array())
    }

    /// Vertical field of view (degrees); `None` for parallel projections.
    #[getter]
    fn fov(&self) -> PyResult<Option<f32>> {
        Ok(match self.0.get()?.projection {
            Projection::Perspective { vertical_fov } => Some(vertical_fov.to_degrees()),
            Projection::Orthographic { .. } => None,
        })
    }

    #[setter]
    fn set_fov(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let degrees = number_in("fov", value, FIELDS)?;
        self.0.change(|camera| {
            camera.projection = Projection::Perspective {
                vertical_fov: degrees.to_radians(),
            };
            Ok(())
        })
    }

    /// Pickles hold the camera, not its scene.
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let bytes = crate::pickle::bytes_of_camera(&self.0.get()?)?;
        let read = py.import("gpugi._gpugi")?.getattr("camera_from_bytes")?;
        Ok((read, (PyBytes::new(py, &bytes),)))
    }

    fn __repr__(&self) -> PyResult<String> {
        Ok(format!(
            "Camera(name={:?}, position={:?}, direction={:?})",
            self.name()?,
            self.position()?,
            self.direction()?
        ))
    }
}
