//! Atlases that techniques keep light in: laid out when one first asks, which may take minutes, and the same for all that ask for the same.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use gpugi_scene::{Atlas, AtlasOptions, TexelDensity};

use super::GpuScene;
use crate::gpu::{Gpu, GpuError};

/// Of more triangles than this, unwrapping takes longer than anybody expects.
const MOST_TRIANGLES: usize = 500_000;

/// The atlases of a scene's meshes that somebody keeps.
#[derive(Debug, Default)]
pub(super) struct Atlases(Mutex<Vec<Kept>>);

#[derive(Debug)]
struct Kept {
    size: u32,
    density: f32,
    atlas: Weak<Atlas>,
}

impl GpuScene {
    /// The atlas for a technique that keeps `texel_bytes` a texel in one buffer, in pages of `size` texels a side, with so many texels per metre, or, if
    /// that is 0, as many as one page holds. It stays the same until meshes change, however instances move or are stretched and whatever they are made of,
    /// as long as anybody keeps it.
    ///
    /// # Errors
    /// [`GpuError::Pass`], [`GpuError::TooLarge`]: what would take too long or too much memory, what has no atlas.
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
        let limits = gpu.device.limits();
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
        let is_asked_for = |kept: &&Kept| (kept.size, kept.density) == (size, density);
        let kept = all.iter().find(is_asked_for);
        if let Some(atlas) = kept.and_then(|kept| kept.atlas.upgrade()) {
            // Who asked for it may keep less in a texel.
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
        all.push(Kept {
            size,
            density,
            atlas: Arc::downgrade(&atlas),
        });
        Ok(atlas)
    }
}
