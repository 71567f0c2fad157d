//! Atlases in which techniques keep light. An atlas is laid out at the first request, which may take minutes, and
//! shared by all techniques that request the same.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use gpugi_scene::{Atlas, AtlasOptions, TexelDensity};

use super::GpuScene;
use crate::gpu::{Gpu, GpuError};

/// With more triangles than this, unwrapping takes longer than anybody expects.
const MOST_TRIANGLES: usize = 500_000;

/// The atlases of a scene's meshes that techniques keep.
#[derive(Debug, Default)]
pub(super) struct Atlases(Mutex<Vec<SharedAtlas>>);

#[derive(Debug)]
struct SharedAtlas {
    size: u32,
    density: f32,
    atlas: Weak<Atlas>,
}

impl GpuScene {
    /// The atlas for a technique that keeps `texel_bytes` bytes per texel in one buffer. Its pages have `size` texels
    /// per side; `density` is in texels per metre, or 0 for as many as one page holds. As long as anybody keeps it, the
    /// atlas stays the same until meshes change, however instances move or stretch and whatever they are made of.
    ///
    /// # Errors
    /// [`GpuError::Pass`], [`GpuError::TooLarge`]: if it would take too long or too much memory, or if there is no
    /// atlas for the scene.
    pub(crate) fn atlas(
        &self,
        gpu: &Gpu,
        technique: &str,
        size: u32,
        density: f32,
        texel_bytes: u64,
    ) -> Result<Arc<Atlas>, GpuError> {
        let refused = |reason: String| GpuError::Pass {
            pass: technique.to_owned(),
            reason,
        };
        let scene = self.host().ok_or_else(|| {
            refused("the scene was uploaded without what an atlas is laid out of".into())
        })?;
        let limits = gpu.limits();
        let bytes = limits
            .max_buffer_size
            .min(limits.max_storage_buffer_binding_size);
        let (most_texels, page) = (bytes / texel_bytes, u64::from(size).pow(2));
        if page > most_texels {
            return Err(GpuError::TooLarge {
                what: format!("texels in a page of {technique} (lower the resolution)"),
                needed: page,
                limit: most_texels,
                adapter: gpu.adapter.name.clone(),
            });
        }
        let most_pages = u32::try_from(most_texels / page).unwrap_or(u32::MAX);

        let mut all = self
            .atlases
            .0
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        all.retain(|kept| kept.atlas.strong_count() > 0);
        let is_asked_for = |kept: &&SharedAtlas| (kept.size, kept.density) == (size, density);
        let kept = all.iter().find(is_asked_for);
        if let Some(atlas) = kept.and_then(|kept| kept.atlas.upgrade()) {
            // The technique that requested it first may keep fewer bytes per texel.
            if atlas.pages > most_pages {
                return Err(GpuError::TooLarge {
                    what: format!("pages of {technique} (lower the density)"),
                    needed: u64::from(atlas.pages),
                    limit: u64::from(most_pages),
                    adapter: gpu.adapter.name.clone(),
                });
            }
            return Ok(atlas);
        }
        let instances = scene.instances.iter();
        let triangles = instances.map(|instance| scene.meshes[instance.mesh].indices.len() / 3);
        let triangles: usize = triangles.sum();
        if triangles > MOST_TRIANGLES {
            return Err(refused(format!(
                "unwrapping {triangles} triangles would take too long, {MOST_TRIANGLES} are allowed: leave some objects out"
            )));
        }
        let options = AtlasOptions {
            size,
            density: if density > 0.0 {
                TexelDensity::PerMetre(density)
            } else {
                TexelDensity::OnePage
            },
            most_pages,
            ..AtlasOptions::default()
        };
        let atlas = Atlas::new(scene, &options).map_err(|error| refused(error.to_string()))?;
        let atlas = Arc::new(atlas);
        all.push(SharedAtlas {
            size,
            density,
            atlas: Arc::downgrade(&atlas),
        });
        Ok(atlas)
    }
}
