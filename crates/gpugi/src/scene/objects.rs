//! Objects: which parts of an instance's light only one technique handles.
//!
//! Techniques that light only some objects claim those objects. A claim is a bit in the instance's row, so that every
//! gather can tell which technique handles a surface point.

use std::ops::BitOr;

use glam::Vec3;
use gpugi_scene::{AlphaMode, Instance, Material, MaterialModel, Name, Scene, names};

use super::DrawClass;

/// What techniques may need to know about an instance before they claim it.
#[derive(Debug, Clone, PartialEq)]
pub struct Object {
    /// The instance's name.
    pub name: Name,
    /// The node of a file, and its copy, that the instance is a part of: a node has one instance per material.
    pub part_of: Option<(usize, Option<usize>)>,
    /// Whether light passes straight through its surface.
    pub is_transmissive: bool,
    /// Whether its surface transmits light diffusely (KHR_materials_diffuse_transmission).
    pub is_translucent: bool,
    /// Whether its surface bounds a solid (KHR_materials_volume); otherwise it is a thin wall.
    pub is_solid: bool,
    /// Whether its surface reflects and refracts ideally, as far as the material's factors tell: `is_delta` of
    /// shared/brdf.wesl.
    pub is_smooth: bool,
    /// Its roughness, 0 if a texture may lower it. Phong, Blinn: the roughness of a GGX lobe that is about as wide.
    pub least_roughness: f32,
    /// Whether its surface only scatters light diffusely.
    pub is_diffuse: bool,
}

impl Object {
    pub(super) fn new(instance: &Instance, material: &Material) -> Self {
        let part_of = instance.origin.map(|origin| (origin.node, origin.place));
        Self {
            name: instance.name.clone(),
            part_of,
            ..Self::of(material)
        }
    }

    /// A nameless object.
    pub(super) fn of(material: &Material) -> Self {
        Self {
            name: Name::default(),
            part_of: None,
            is_transmissive: material.transmission > 0.0,
            is_translucent: material.is_translucent(),
            is_solid: material.volume.is_some(),
            is_smooth: is_smooth(material),
            least_roughness: least_roughness(material),
            is_diffuse: is_diffuse(material),
        }
    }

    /// Whether `list` names the object: names separated by commas, in which `*` stands for any characters.
    pub fn is_named_by(&self, list: &str) -> bool {
        names::is_named_by(&self.name, list)
    }
}

fn is_diffuse(material: &Material) -> bool {
    match material.model {
        MaterialModel::MetallicRoughness => {
            material.transmission <= 0.0 && material.metallic <= 0.0 && material.specular <= 0.0
        }
        MaterialModel::Phong { ks, .. } | MaterialModel::Blinn { ks, .. } => {
            ks.max_element() <= 0.0
        }
        MaterialModel::Conductor { .. } => false,
    }
}

fn least_roughness(material: &Material) -> f32 {
    match material.model {
        // The squared width alpha^2 of a lobe cos^n is about 2 / (n + 2), and alpha is the squared roughness.
        MaterialModel::Phong { shininess, .. } => (2.0 / (shininess + 2.0)).powf(0.25),
        // As wide as Phong's of a quarter of the exponent.
        MaterialModel::Blinn { shininess, .. } => (2.0 / (0.25 * shininess + 2.0)).powf(0.25),
        _ if material.metallic_roughness_texture.is_some() => 0.0,
        _ => material.roughness,
    }
}

fn is_smooth(material: &Material) -> bool {
    !material.model.has_exponent() && material.roughness < DELTA_ROUGHNESS
}

/// Whether the surface has a diffuse, a glossy and an ideal lobe, as far as the material's factors tell.
pub(super) fn lobes(material: &Material) -> [bool; 3] {
    let (diffuse, specular) = match material.model {
        MaterialModel::Phong { kd, ks, .. } | MaterialModel::Blinn { kd, ks, .. } => {
            (kd != Vec3::ZERO, ks != Vec3::ZERO)
        }
        MaterialModel::Conductor { .. } => (false, true),
        MaterialModel::MetallicRoughness => {
            let is_metal =
                material.metallic >= 1.0 && material.metallic_roughness_texture.is_none();
            let reflects = material.specular > 0.0 && material.specular_color != Vec3::ZERO;
            (
                !is_metal && material.transmission < 1.0,
                reflects || material.metallic > 0.0 || material.transmission > 0.0,
            )
        }
    };
    let is_smooth = is_smooth(material);
    [diffuse, specular && !is_smooth, specular && is_smooth]
}

/// Whether any surface of the scene reflects or refracts ideally ([`Object::is_smooth`]).
pub(crate) fn has_smooth_objects(scene: &Scene) -> bool {
    let mut instances = scene.instances.iter();
    instances.any(|instance| is_smooth(&scene.materials[instance.material]))
}

/// `DELTA_ROUGHNESS` of shared/brdf.wesl.
pub const DELTA_ROUGHNESS: f32 = 0.01;

/// Whether any surface of the scene reflects or transmits light other than diffusely.
pub(crate) fn has_glossy_objects(scene: &Scene) -> bool {
    let mut instances = scene.instances.iter();
    instances.any(|instance| !is_diffuse(&scene.materials[instance.material]))
}

/// Claims on an object: the `CLAIM_` bits of scene/tables.wesl. The owner of a claim is the technique whose plan makes it
/// ([`Plan::claims`](crate::techniques::Plan::claims)); all others leave that light to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Claims(pub(super) u32);

impl Claims {
    /// No claims.
    pub const NONE: Self = Self(0);
    /// Only the owner adds the environment's light on the object, all of it and without occlusion.
    pub const ENVIRONMENT: Self = Self(1);
    /// The owner adds what passes through the object's surface, so cameras see the object whole, from both sides.
    pub const TRANSMISSION: Self = Self(2);
    /// Only the owner adds what the object mirrors.
    pub const SPECULAR: Self = Self(4);
    /// Only the owner adds what passes through the object's surface.
    pub const REFRACTION: Self = Self(8);
    /// The owner adds the light that the object sends elsewhere, so the object's shadow is whole.
    pub const SHADOW: Self = Self(16);
    /// Only the owner adds indirect light on the object.
    pub const INDIRECT: Self = Self(32);
    /// Only the owner adds what the object's glossy lobes reflect of lit surroundings.
    pub const GLOSSY: Self = Self(64);
    /// The owner follows rays from the object's surface: only it adds what the object reflects and refracts, whatever a
    /// later technique would claim.
    pub const RAYS: Self = Self(128);

    /// Number of the first bit of [`Claims::with_impostor`].
    const IMPOSTOR_SHIFT: u32 = 8;

    /// These claims, for an object whose surroundings are in the cube `number`, from 1 on.
    pub fn with_impostor(self, number: u32) -> Self {
        Self(self.0 | (number << Self::IMPOSTOR_SHIFT))
    }

    /// The `CLAIM_` bits.
    pub(crate) fn bits(self) -> u32 {
        self.0
    }

    /// Whether these claims contain all of `other`.
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

/// How cameras draw an instance that shadow maps draw as `class`.
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
