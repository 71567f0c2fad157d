//! What has changed in a scene, and what depends on it.

use std::ops::BitOr;

/// Counters that increase when something changes: a map made at other counts is stale.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub struct Versions {
    /// Meshes and the instances' placements.
    pub geometry: u64,
    /// Materials.
    pub materials: u64,
    /// Punctual lights and emitters.
    pub lights: u64,
    /// How the environment is turned, and its intensity.
    pub sky: u64,
    /// Only the environment's texels.
    pub environment: u64,
    /// [`super::GpuScene::media`].
    pub media: u64,
    /// Which triangles there are and how they are drawn, however they move.
    pub topology: u64,
    /// Which triangles each instance has, however it moves and whatever it is made of.
    pub meshes: u64,
    /// Which instances there are, of which mesh and material, however they move and deform.
    pub instances: u64,
    /// [`super::GpuScene::objects`]: what techniques know of instances before they claim them.
    pub objects: u64,
}

/// Some of the [`Versions`]: those that something depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Inputs(u16);

impl Inputs {
    /// [`Versions::geometry`].
    pub const GEOMETRY: Self = Self(1 << 0);
    /// [`Versions::materials`].
    pub const MATERIALS: Self = Self(1 << 1);
    /// [`Versions::lights`].
    pub const LIGHTS: Self = Self(1 << 2);
    /// [`Versions::sky`].
    pub const SKY: Self = Self(1 << 3);
    /// [`Versions::environment`].
    pub const ENVIRONMENT: Self = Self(1 << 4);
    /// [`Versions::media`].
    pub const MEDIA: Self = Self(1 << 5);
    /// [`Versions::topology`].
    pub const TOPOLOGY: Self = Self(1 << 6);
    /// [`Versions::meshes`].
    pub const MESHES: Self = Self(1 << 7);
    /// [`Versions::instances`].
    pub const INSTANCES: Self = Self(1 << 8);
    /// [`Versions::objects`].
    pub const OBJECTS: Self = Self(1 << 9);
    /// Where surfaces are, and what they are made of.
    pub const SURFACES: Self = Self(Self::GEOMETRY.0 | Self::MATERIALS.0);

    /// All but these.
    pub const fn without(self) -> Self {
        Self(!self.0)
    }

    const fn contain(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }
}

impl BitOr for Inputs {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl Versions {
    /// The versions of `inputs`, and 0 for all others: the same as long as nothing changes that depends on these.
    pub fn of(&self, inputs: Inputs) -> Self {
        let only = |input: Inputs, version: u64| match inputs.contain(input) {
            true => version,
            false => 0,
        };
        Self {
            geometry: only(Inputs::GEOMETRY, self.geometry),
            materials: only(Inputs::MATERIALS, self.materials),
            lights: only(Inputs::LIGHTS, self.lights),
            sky: only(Inputs::SKY, self.sky),
            environment: only(Inputs::ENVIRONMENT, self.environment),
            media: only(Inputs::MEDIA, self.media),
            topology: only(Inputs::TOPOLOGY, self.topology),
            meshes: only(Inputs::MESHES, self.meshes),
            instances: only(Inputs::INSTANCES, self.instances),
            objects: only(Inputs::OBJECTS, self.objects),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_leaves_its_inputs() {
        let versions = Versions {
            geometry: 1,
            materials: 2,
            lights: 3,
            sky: 4,
            environment: 5,
            media: 6,
            topology: 7,
            meshes: 8,
            instances: 9,
            objects: 10,
        };
        let surfaces = Versions {
            geometry: 1,
            materials: 2,
            ..Versions::default()
        };
        assert_eq!(versions.of(Inputs::SURFACES), surfaces);
        let light = Inputs::LIGHTS | Inputs::SKY;
        let rest = Versions {
            lights: 0,
            sky: 0,
            ..versions
        };
        assert_eq!(versions.of(light.without()), rest);
        let [one, other] = [light, light.without()].map(|inputs| versions.of(inputs));
        assert_eq!((one.sky, other.sky), (4, 0));
    }
}
