//! Objects: which of an instance's light is one technique's own affair.
//!
//! Techniques that light some objects and not others claim them. A claim is a bit in the instance's row, so that every gather can tell
//! whose affair a surface point is.

use std::ops::BitOr;

use gpugi_scene::{AlphaMode, Material, MaterialModel, names};

use super::DrawClass;

/// What techniques may want to know of an instance before they claim it.
#[derive(Debug, Clone, PartialEq)]
pub struct Object {
    /// The instance's name.
    pub name: String,
    /// Light passes through its surface.
    pub is_transmissive: bool,
    /// Its surface bounds a solid (KHR_materials_volume); else it is a thin wall.
    pub is_solid: bool,
    /// Its surface reflects and refracts ideally, as far as the material's factors say: `is_delta` of shared/brdf.wesl.
    pub is_smooth: bool,
}

impl Object {
    pub(super) fn new(name: &str, material: &Material) -> Self {
        Self {
            name: name.to_owned(),
            is_transmissive: material.transmission > 0.0,
            is_solid: material.volume.is_some(),
            is_smooth: !matches!(material.model, MaterialModel::Phong { .. })
                && material.roughness < DELTA_ROUGHNESS,
        }
    }

    /// Whether `list` names it: names separated by commas, in which `*` stands for any characters.
    pub fn is_named_by(&self, list: &str) -> bool {
        names::is_named_by(&self.name, list)
    }
}

/// `DELTA_ROUGHNESS` of shared/brdf.wesl.
const DELTA_ROUGHNESS: f32 = 0.01;

/// Claims on an object: the `CLAIM_` bits of scene/tables.wesl.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Claims(pub(super) u32);

impl Claims {
    /// None.
    pub const NONE: Self = Self(0);
    /// environment-map adds all of the environment's light on it, without occlusion, and nobody else any.
    pub const ENVIRONMENT: Self = Self(1);
    /// Somebody adds what passes through its surface: cameras see it whole, from both sides.
    pub const TRANSMISSION: Self = Self(2);
    /// distance-impostor adds what it mirrors, and nobody else any.
    pub const SPECULAR: Self = Self(4);
    /// distance-impostor adds what passes through its surface, and nobody else any.
    pub const REFRACTION: Self = Self(8);
    /// caustics adds the light that passes through it and arrives elsewhere: its shadow is whole.
    pub const SHADOW: Self = Self(16);

    /// Whether all of `other` is in this.
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

impl BitOr for Claims {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// How cameras see an instance that shadow maps draw as `class`.
pub(super) fn seen_class(
    class: DrawClass,
    alpha_mode: AlphaMode,
    transmissive: bool,
    claims: Claims,
) -> DrawClass {
    if !(transmissive && claims.contains(Claims::TRANSMISSION)) {
        class
    } else if alpha_mode == AlphaMode::Opaque {
        DrawClass::DoubleSided
    } else {
        DrawClass::AlphaDoubleSided
    }
}
