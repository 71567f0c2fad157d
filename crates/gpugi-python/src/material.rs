//! Materials.

use glam::Vec3;
use gpugi_scene::Material;
use pyo3::prelude::*;
use pyo3::types::PyAny;

use crate::held::Held;
use crate::values::{color, number_in};

/// A surface as glTF 2.0 describes it, with extensions. Colours are linear Rec. 709.
#[pyclass(name = "Material", module = "gpugi", frozen)]
pub struct PyMaterial(pub Held<Material>);

/// Part of a whole.
const SHARE: [f32; 2] = [0.0, 1.0];

macro_rules! shares {
    ($($(#[doc = $help:literal])+ $name:ident, $set:ident: $range:expr;)+) => {
        #[pymethods]
        impl PyMaterial {
            #[new]
            #[pyo3(signature = (*, name = "", base_color = None, emission = None, $($name = None),+))]
            #[allow(clippy::too_many_arguments)]
            fn new(
                name: &str,
                base_color: Option<&Bound<'_, PyAny>>,
                emission: Option<&Bound<'_, PyAny>>,
                $($name: Option<&Bound<'_, PyAny>>),+
            ) -> PyResult<Self> {
                let material = Material { name: name.to_owned(), ..Material::default() };
                let made = Self(Held::own(material));
                if let Some(value) = base_color {
                    made.set_base_color(value)?;
                }
                if let Some(value) = emission {
                    made.set_emission(value)?;
                }
                $(if let Some(value) = $name {
                    made.$set(value)?;
                })+
                Ok(made)
            }

            #[getter]
            fn name(&self) -> PyResult<String> {
                Ok(self.0.get()?.name)
            }

            /// Albedo, or what a metal reflects.
            #[getter]
            fn base_color(&self) -> PyResult<[f32; 3]> {
                Ok(self.0.get()?.base_color.truncate().to_array())
            }

            #[setter]
            fn set_base_color(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
                let color = at_most_one(color("base_color", value)?)?;
                self.0.change(|material| {
                    material.base_color = color.extend(material.base_color.w);
                    Ok(())
                })
            }

            /// Radiance that the front emits [W/sr/m²].
            #[getter]
            fn emission(&self) -> PyResult<[f32; 3]> {
                Ok(self.0.get()?.emissive.to_array())
            }

            #[setter]
            fn set_emission(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
                let color = color("emission", value)?;
                self.0.change(|material| {
                    material.emissive = color;
                    Ok(())
                })
            }

            $(
                $(#[doc = $help])+
                #[getter]
                fn $name(&self) -> PyResult<f32> {
                    Ok(self.0.get()?.$name)
                }

                #[setter]
                fn $set(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
                    let number = number_in(stringify!($name), value, $range)?;
                    self.0.change(|material| {
                        material.$name = number;
                        Ok(())
                    })
                }
            )+

            /// Both sides are visible.
            #[getter]
            fn double_sided(&self) -> PyResult<bool> {
                Ok(self.0.get()?.double_sided)
            }

            #[setter]
            fn set_double_sided(&self, value: bool) -> PyResult<()> {
                self.0.change(|material| {
                    material.double_sided = value;
                    Ok(())
                })
            }

            fn __repr__(&self) -> PyResult<String> {
                let material = self.0.get()?;
                Ok(format!(
                    "Material(name={:?}, base_color={:?}, metallic={}, roughness={})",
                    material.name,
                    material.base_color.truncate().to_array(),
                    material.metallic,
                    material.roughness
                ))
            }
        }
    };
}

shares! {
    /// 0 dielectric, 1 metal.
    metallic, set_metallic: SHARE;
    /// Perceptual roughness; GGX's alpha is its square.
    roughness, set_roughness: SHARE;
    /// Index of refraction.
    ior, set_ior: [1.0, 10.0];
    /// Strength of the dielectric reflection; 0 gives a pure Lambert surface.
    specular, set_specular: SHARE;
    /// Share of the light that enters the surface.
    transmission, set_transmission: SHARE;
    /// Share of the diffuse light that leaves on the other side.
    diffuse_transmission, set_diffuse_transmission: SHARE;
}

fn at_most_one(color: Vec3) -> PyResult<Vec3> {
    match color.max_element() <= 1.0 {
        true => Ok(color),
        false => Err(crate::errors::wrong(
            "base_color",
            format!("{} is above 1", color.max_element()),
        )),
    }
}
