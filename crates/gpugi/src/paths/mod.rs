//! Paths that leave a point and look for light, step by step: what the path tracer and techniques that trace paths share.
//! A pool holds the paths; one kernel traces their rays, another one processes the vertices where these end (trace.wesl,
//! shade.wesl). Lights are sampled from a table ([`LightTable`]), the sky from a grid ([`Sky`]).

pub(crate) mod alias;
pub(crate) mod gpu;
#[cfg(test)]
mod light_tests;
mod light_tree;
pub(crate) mod lights;
mod sky;

use std::collections::BTreeSet;

use gpugi_scene::{Light, LightKind, Scene};

use crate::gpu::{Gpu, GpuError, Kernel, KernelOptions};
use crate::scene::GpuScene;
use crate::shader;

pub(crate) use lights::{LightBuffers, LightTable};
pub(crate) use sky::Sky;

/// Whether the scene has surfaces that pass light without bending it: thin panes, or solids with the refractive index of
/// air. Without them, shadow rays need not look for any, and the light tracer finds what passes a solid in another of the
/// same index.
pub(crate) fn has_straight(scene: &Scene) -> bool {
    let materials = scene.instances.iter().map(|instance| instance.material);
    let used: BTreeSet<usize> = materials.collect();
    used.iter().any(|&index| {
        let material = &scene.materials[index];
        material.transmission > 0.0 && (material.volume.is_none() || material.ior == 1.0)
    })
}

/// Whether paths choose among the lights of `scene` by a tree: only if several are near. Two triangles count as one light.
/// Kernels for either kind of scene are right for the other, too.
pub(crate) fn has_light_tree(scene: &GpuScene) -> bool {
    let near = |light: &&Light| light.kind != LightKind::Directional;
    let lights = scene.lights.iter().filter(near).count();
    lights + scene.emitters.len().div_ceil(2) > 1
}

/// Rows of 16 bytes per path in `rows` of pool.wesl, excluding the results.
pub(crate) const PATH_ROWS: u64 = 16;

/// The kernels of a step: `plan` (one lane, which counts paths and rays), `trace` (the shadow rays of the step before, and
/// the paths' rays) and `shade` (the vertices; lists the paths and shadow rays to continue with).
#[derive(Debug)]
pub(crate) struct Kernels {
    pub plan: Kernel,
    pub trace: Kernel,
    pub shade: Kernel,
}

impl Kernels {
    /// `constants` are those of path_state.wesl, bvh.wesl and media.wesl.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, constants: &[(&str, f64)]) -> Result<Self, GpuError> {
        let hot = |shader, without: &[&str]| {
            let constants = constants.iter().copied();
            let constants: Vec<_> = constants
                .filter(|(name, _)| !without.contains(name))
                .collect();
            let options = KernelOptions {
                constants: &constants,
                // Worth 3 to 7 percent on an H200. Indices are in range: those of the scene's tables because the host
                // wrote them, those of the traversal's stack because the host knows its depth, and those of the pool
                // because `plan` respects its capacity, and those of media because they are clamped to grids that
                // the host wrote. Loops terminate: traversal because a hierarchy is a tree, and tracking after a number
                // of steps.
                unchecked: true,
            };
            Kernel::with_options(gpu, &shader, "main", Some(&scene.ray_layout), &options)
        };
        Ok(Self {
            plan: Kernel::new(gpu, &shader!("paths.plan"), "main", None)?,
            trace: hot(
                shader!("paths.trace"),
                &[
                    "HAS_PATH_FILTER",
                    "LIGHT_TRACER_HAS_LAMPS",
                    "LIGHT_TRACER_MERGES",
                    "HAS_KNOWN_LIGHT",
                    "HAS_LIGHT_TREE",
                ],
            )?,
            shade: hot(
                shader!("paths.shade"),
                &["SCENE_HAS_ALPHA", "SCENE_HAS_SPHERES"],
            )?,
        })
    }
}
