//! What files without materials look like.

use glam::Vec3;

use crate::Material;

/// The material of surfaces that have none: grey, or a matt one that shows the colours of their vertices as they are.
pub(crate) fn default_material(is_colored: bool) -> Material {
    if is_colored {
        return Material::matt("default", Vec3::ONE);
    }
    Material {
        name: "default".to_owned(),
        base_color: Vec3::splat(0.6).extend(1.0),
        roughness: 0.5,
        ..Material::default()
    }
}
