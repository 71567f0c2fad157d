//! Punctual lights. Area lights are emissive triangles: see [`crate::Material::emissive`].

use glam::{Mat4, Vec3};
use serde::{Deserialize, Serialize};

use crate::names::Name;

/// The shape of a punctual light's emission. Units: [`Light::intensity`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum LightKind {
    /// Emits equally in all directions.
    Point,
    /// Emits into a cone around its local -Z.
    Spot {
        /// Half-angle inside which the intensity is full (rad).
        inner_cone_angle: f32,
        /// Half-angle outside which the intensity is zero (rad); at least the inner angle and at most pi/2. Equal angles
        /// are a hard edge.
        outer_cone_angle: f32,
    },
    /// Parallel light along its local -Z. Its intensity is the irradiance on a surface that faces it.
    Directional,
}

/// A punctual light (KHR_lights_punctual).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Light {
    /// Name for reports.
    pub name: Name,
    /// Point, spot or directional.
    pub kind: LightKind,
    /// Linear Rec. 709 intensity [W/sr] (point, spot) or irradiance [W/m^2] (directional), including colour.
    ///
    /// Files state them in candela and lux. Their numbers are taken and written as they are, as those of emissive
    /// surfaces are (nits as W/sr/m^2): gpugi computes the same with either units, and never converts between them.
    pub intensity: Vec3,
    /// Distance at which the light fades to zero (m); `None` means no limit.
    pub range: Option<f32>,
    /// Radius of the emitter that soft shadows assume: metres for point and spot lights, a half-angle in radians for
    /// directional lights. In glTF: `extras.gpugi.radius` on the light. 0 is an ideal light.
    pub radius: f32,
    /// Rigid transform of the light, which shines along its local -Z.
    pub world_from_light: Mat4,
    /// The animation node that carries the light, if any.
    pub node: Option<usize>,
}

impl Light {
    /// A light of the given kind at the origin, with its intensity in linear RGB (units: [`Light::intensity`]).
    pub fn new(name: &str, kind: LightKind, intensity: Vec3) -> Self {
        Self {
            name: name.into(),
            kind,
            intensity,
            range: None,
            radius: 0.0,
            world_from_light: Mat4::IDENTITY,
            node: None,
        }
    }

    /// The same light at `position`, shining toward `target` (both in world space (m)).
    pub fn aimed(mut self, position: Vec3, target: Vec3) -> Self {
        self.world_from_light = crate::Camera::look_at("", position, target, 1.0).world_from_view;
        self
    }

    /// Position in world space (m).
    pub fn position(&self) -> Vec3 {
        self.world_from_light.w_axis.truncate()
    }

    /// Unit direction in which the light shines, in world space.
    pub fn direction(&self) -> Vec3 {
        (-self.world_from_light.z_axis.truncate()).normalize_or(Vec3::NEG_Z)
    }
}
