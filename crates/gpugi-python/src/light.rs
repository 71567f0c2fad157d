//! Lights.

use glam::Vec3;
use gpugi_scene::{Light, LightKind};
use pyo3::prelude::*;
use pyo3::types::PyAny;

use crate::errors::wrong;
use crate::held::Held;
use crate::values::{color, number_in, vector};

/// A light without extent: a point, a spot or a direction.
///
/// intensity: linear Rec. 709, W/sr for points and spots, W/m² for directions. radius: of the emitter that soft shadows
/// assume, metres, or radians for directions. cone: half angles (rad) at which a spot begins to fade, and ends.
#[pyclass(name = "Light", module = "gpugi", frozen)]
pub struct PyLight(pub Held<Light>);

fn kind_of(kind: &str, cone: Option<[f32; 2]>) -> PyResult<LightKind> {
    let [inner_cone_angle, outer_cone_angle] = cone.unwrap_or([0.0, std::f32::consts::FRAC_PI_4]);
    let kind = match kind {
        "point" => LightKind::Point,
        "directional" => LightKind::Directional,
        "spot" => LightKind::Spot {
            inner_cone_angle,
            outer_cone_angle,
        },
        _ => return Err(wrong("kind", "the choices are point, spot, directional")),
    };
    let is_cone = 0.0 <= inner_cone_angle
        && inner_cone_angle < outer_cone_angle
        && outer_cone_angle <= std::f32::consts::FRAC_PI_2;
    match (kind, cone) {
        (LightKind::Spot { .. }, _) if !is_cone => {
            Err(wrong("cone", "0 <= inner < outer <= pi/2 is needed"))
        }
        (LightKind::Spot { .. }, _) | (_, None) => Ok(kind),
        _ => Err(wrong("cone", "only spots have one")),
    }
}

/// The light at a position, shining in a direction, which is exact far from the origin, too.
fn aimed(light: Light, position: Vec3, direction: Vec3) -> Light {
    let mut light = light.aimed(Vec3::ZERO, direction);
    light.world_from_light.w_axis = position.extend(1.0);
    light
}

#[pymethods]
impl PyLight {
    #[new]
    #[pyo3(signature = (kind, *, position = None, target = None, direction = None, intensity = None, radius = None, cone = None, name = ""))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        kind: &str,
        position: Option<&Bound<'_, PyAny>>,
        target: Option<&Bound<'_, PyAny>>,
        direction: Option<&Bound<'_, PyAny>>,
        intensity: Option<&Bound<'_, PyAny>>,
        radius: Option<&Bound<'_, PyAny>>,
        cone: Option<&Bound<'_, PyAny>>,
        name: &str,
    ) -> PyResult<Self> {
        let cone = cone
            .map(|value| crate::values::numbers("cone", value))
            .transpose()?;
        let kind = kind_of(kind, cone)?;
        let intensity = intensity.map_or(Ok(Vec3::ONE), |value| color("intensity", value))?;
        let position = position.map_or(Ok(Vec3::ZERO), |value| vector("position", value))?;
        let toward = match (target, direction) {
            (Some(_), Some(_)) => return Err(wrong("direction", "give it or a target")),
            (Some(target), None) => vector("target", target)? - position,
            (None, Some(direction)) => vector("direction", direction)?,
            (None, None) => Vec3::NEG_Y,
        };
        let toward = toward.try_normalize();
        let toward = toward.ok_or_else(|| wrong("direction", "it points nowhere"))?;
        let mut light = aimed(Light::new(name, kind, intensity), position, toward);
        if let Some(radius) = radius {
            light.radius = number_in("radius", radius, [0.0, f32::MAX])?;
        }
        Ok(Self(Held::own(light)))
    }

    #[getter]
    fn name(&self) -> PyResult<String> {
        Ok(self.0.get()?.name.as_str().to_owned())
    }

    /// point, spot or directional.
    #[getter]
    fn kind(&self) -> PyResult<&'static str> {
        Ok(match self.0.get()?.kind {
            LightKind::Point => "point",
            LightKind::Spot { .. } => "spot",
            LightKind::Directional => "directional",
        })
    }

    /// World space (m).
    #[getter]
    fn position(&self) -> PyResult<[f32; 3]> {
        Ok(self.0.get()?.position().to_array())
    }

    #[setter]
    fn set_position(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let position = vector("position", value)?;
        self.0.change(|light| {
            light.world_from_light.w_axis = position.extend(1.0);
            Ok(())
        })
    }

    /// Where it shines to: a unit vector.
    #[getter]
    fn direction(&self) -> PyResult<[f32; 3]> {
        Ok(self.0.get()?.direction().to_array())
    }

    #[setter]
    fn set_direction(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let direction = vector("direction", value)?.try_normalize();
        let direction = direction.ok_or_else(|| wrong("direction", "it points nowhere"))?;
        self.0.change(|light| {
            *light = aimed(light.clone(), light.position(), direction);
            Ok(())
        })
    }

    /// Linear Rec. 709: W/sr, or W/m² of directions.
    #[getter]
    fn intensity(&self) -> PyResult<[f32; 3]> {
        Ok(self.0.get()?.intensity.to_array())
    }

    #[setter]
    fn set_intensity(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let intensity = color("intensity", value)?;
        self.0.change(|light| {
            light.intensity = intensity;
            Ok(())
        })
    }

    /// Radius of the emitter (m), or half its angle (rad) for directions.
    #[getter]
    fn radius(&self) -> PyResult<f32> {
        Ok(self.0.get()?.radius)
    }

    #[setter]
    fn set_radius(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let radius = number_in("radius", value, [0.0, f32::MAX])?;
        self.0.change(|light| {
            light.radius = radius;
            Ok(())
        })
    }

    fn __repr__(&self) -> PyResult<String> {
        Ok(format!(
            "Light({:?}, name={:?}, position={:?}, intensity={:?})",
            self.kind()?,
            self.name()?,
            self.position()?,
            self.intensity()?
        ))
    }
}
