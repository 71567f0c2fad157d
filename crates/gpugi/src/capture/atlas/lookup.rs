//! Where in an atlas the points of triangles lie: for shaders that have a hit, of a ray or a camera, and need the light
//! kept in texels.

use gpugi_scene::{Atlas, Scene, Side};

use super::blocks::ordered_corners;
use crate::gpu::{Gpu, GpuError};

/// `HEADER_WORDS` and `INSTANCE_WORDS` of capture/atlas/lookup.wesl.
const HEADER_WORDS: usize = 2;
const INSTANCE_WORDS: usize = 4;
/// `NO_TRIANGLES` of the same shader.
const NO_TRIANGLES: u32 = u32::MAX;

/// The corners of all triangles of an atlas: `atlas` of capture/atlas/lookup.wesl.
#[derive(Debug)]
pub struct AtlasLookup {
    /// The words that shaders read.
    pub words: wgpu::Buffer,
}

impl AtlasLookup {
    /// Uploads the corners of `atlas`, which must belong to `scene`.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, scene: &Scene, atlas: &Atlas) -> Result<Self, GpuError> {
        let tables = HEADER_WORDS + INSTANCE_WORDS * atlas.instances.len();
        let mut words = vec![atlas.size, atlas.instances.len() as u32];
        words.resize(tables, NO_TRIANGLES);
        for (index, side, uvs) in atlas.sides() {
            let instance = &scene.instances[index];
            let at = HEADER_WORDS + INSTANCE_WORDS * index + 2 * usize::from(side == Side::Back);
            words[at] = words.len() as u32;
            words[at + 1] = uvs.page * atlas.size;
            for corner in ordered_corners(&scene.meshes[instance.mesh], uvs)
                .into_iter()
                .flatten()
            {
                let texels = corner * atlas.size as f32;
                words.extend(texels.to_array().map(f32::to_bits));
            }
        }
        Ok(Self {
            words: gpu.storage("corners of an atlas [bytes]", &words)?,
        })
    }
}
