//! What default sets ask techniques: whether they suit an occasion, and with which settings.

use std::collections::BTreeSet;

use gpugi_scene::Scene;

use super::Needs;
use crate::gpu::AdapterSummary;
use crate::light_paths::{LightClass, LightPaths};
use crate::scene::{emit_light, has_emitters, has_glossy_objects};

/// A still picture of more distinct triangles than this does not wait for an atlas by default: instances share the
/// unwrapping of their mesh. Unwrapping 94,722 triangles takes 2 to 3 s on two cores, unwrapping 145,917 takes 8 s
/// (docs/atlas.md).
pub(crate) const MOST_UNWRAPPED: u64 = 100_000;

/// Nor does one of more triangles in all instances than this: each has texels of its own.
pub(crate) const MOST_IN_TEXELS: u64 = 250_000;

/// Meshes of more connected pieces than this, such as foliage, are not unwrapped by default: each piece takes a chart
/// with its gutter, which fill the pages, and packing them takes a minute for 20,000.
pub(crate) const MOST_PIECES: usize = 4_000;

/// No rays are traced by default in a still picture of more triangles than this: the smallest bindings that WebGPU
/// promises hold the hierarchy of two million (docs/bvh.md).
pub(crate) const MOST_TRACED: u64 = 1_000_000;

/// Settings that differ from their defaults: names, and values as text.
pub type Values = Vec<(&'static str, String)>;

/// What light is computed for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// One picture of a scene that stands still. It may wait seconds for its maps
    /// ([`Renderer::converge`](crate::Renderer::converge)).
    StillPicture,
    /// Frames in motion. Each is due within milliseconds, and nothing may stall it.
    LiveView,
    /// Light that is stored in textures. It may take minutes.
    Bake,
}

/// What the kind of an adapter promises.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Speed {
    /// A processor.
    Software,
    /// A GPU that shares the processor's memory, or one of which nothing is known, as in browsers.
    Modest,
    /// A GPU with memory of its own.
    Fast,
}

impl Speed {
    /// That of an adapter.
    pub fn of(adapter: &AdapterSummary) -> Self {
        match adapter.device_type {
            wgpu::DeviceType::Cpu => Self::Software,
            wgpu::DeviceType::DiscreteGpu => Self::Fast,
            _ => Self::Modest,
        }
    }
}

/// What a default set is for.
#[derive(Debug, Clone)]
pub struct Occasion<'a> {
    /// What its light is computed for.
    pub purpose: Purpose,
    /// What it lights.
    pub scene: &'a Scene,
    /// What computes it.
    pub speed: Speed,
    /// Triangles of all instances.
    pub triangles: u64,
    /// Classes of light that the scene has.
    pub classes: Vec<LightClass>,
    /// Whether what is chosen for gloss or indirect light traces rays, so that hierarchies are there anyway. Known when
    /// settings are asked for.
    pub has_rays: bool,
    /// Whether the scene can be unwrapped, as far as is known.
    pub has_atlas: bool,
}

impl<'a> Occasion<'a> {
    /// Light of `scene` for `purpose`, computed by `adapter`.
    pub fn new(scene: &'a Scene, adapter: &AdapterSummary, purpose: Purpose) -> Self {
        Self {
            purpose,
            scene,
            speed: Speed::of(adapter),
            triangles: scene.statistics().triangles,
            classes: light_classes(scene),
            has_rays: false,
            has_atlas: true,
        }
    }

    /// The reason for a technique that adds `paths`: the scene has such lights.
    pub fn has_lights(&self, paths: &[LightPaths]) -> String {
        let added = |class: &&LightClass| paths.iter().any(|paths| paths.class == **class);
        let lights = self.classes.iter().filter(added);
        let lights: Vec<String> = lights.map(LightClass::to_string).collect();
        format!("the scene has lights ({})", lights.join(", "))
    }

    /// The reason for a technique that shows all that surfaces reflect and refract, if it is one here: samples of a still
    /// picture share the work of wide lobes. Others show mirrors and glass.
    pub fn has_wide_lobes(&self) -> Option<String> {
        let is_shown = self.purpose == Purpose::StillPicture && has_glossy_objects(self.scene);
        is_shown.then(|| "surfaces reflect or refract their surroundings".to_owned())
    }

    /// Triangles of the meshes in use, each once: instances share an unwrapping.
    pub fn distinct_triangles(&self) -> u64 {
        let meshes = meshes_in_use(self.scene).into_iter();
        let indices = meshes.map(|mesh| self.scene.meshes[mesh].indices.len());
        indices.map(|count| count as u64 / 3).sum()
    }

    /// Why a still picture does not wait for what `needs` asks for, if so. A live view waits for nothing, and a bake for
    /// everything.
    pub(crate) fn refusal(&self, needs: Needs) -> Option<String> {
        if self.purpose != Purpose::StillPicture {
            return None;
        }
        let triangles = self.triangles;
        if needs.texels && triangles > MOST_IN_TEXELS {
            return Some(format!("texels for {triangles} triangles take long"));
        }
        if needs.texels {
            let distinct = self.distinct_triangles();
            let meshes = meshes_in_use(self.scene).into_iter();
            let pieces: usize = meshes.map(|mesh| self.scene.meshes[mesh].pieces()).sum();
            if distinct > MOST_UNWRAPPED || pieces > MOST_PIECES {
                return Some(format!(
                    "unwrapping {distinct} triangles in {pieces} pieces takes long"
                ));
            }
        }
        (needs.rays && triangles > MOST_TRACED)
            .then(|| format!("{triangles} triangles are too many for rays"))
    }
}

/// The meshes that instances show.
fn meshes_in_use(scene: &Scene) -> BTreeSet<usize> {
    let instances = scene.instances.iter();
    instances.map(|instance| instance.mesh).collect()
}

/// Classes of light that a scene has.
fn light_classes(scene: &Scene) -> Vec<LightClass> {
    let is_present = |class: &LightClass| match class {
        LightClass::Punctual => !scene.lights.is_empty(),
        LightClass::Area => has_emitters(scene) || emit_light(&scene.media),
        LightClass::Environment => scene.environment.is_some(),
    };
    LightClass::ALL.into_iter().filter(is_present).collect()
}
