//! Atlases in which techniques keep light. An atlas is laid out at the first request, beside the frames that wait for
//! it, because it may take minutes; all techniques that request the same share it.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use gpugi_scene::{Atlas, AtlasOptions, Scene, TexelDensity};
use serde::{Deserialize, Serialize};

use super::GpuScene;
use crate::gpu::{Gpu, GpuError};
use crate::jobs::{self, Running};

/// With more triangles than this, unwrapping takes longer than anybody expects.
const MOST_TRIANGLES: usize = 500_000;

/// The atlases of a scene's meshes that techniques keep, and the one that is being laid out.
#[derive(Debug, Default)]
pub(super) struct Atlases(Mutex<AtlasCache>);

#[derive(Debug, Default, Clone)]
struct AtlasCache {
    shared: Vec<SharedAtlas>,
    /// One at a time: dragging a setting, or bending a mesh in every frame, would start many.
    job: Option<Job>,
    /// The latest finished job that made room for another before its atlas was asked for again.
    finished: Option<Job>,
}

impl Clone for Atlases {
    fn clone(&self) -> Self {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        Self(Mutex::new(kept.clone()))
    }
}

impl Atlases {
    /// To be called when meshes have changed: keeps only a job that still runs, whose result is stale.
    pub fn of_other_meshes(self) -> Self {
        let mut kept = self.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        kept.shared.clear();
        kept.finished = None;
        if let Some(job) = &mut kept.job {
            job.is_stale = true;
        }
        Self(Mutex::new(kept))
    }
}

#[derive(Debug, Clone)]
struct SharedAtlas {
    size: u32,
    density: f32,
    atlas: Weak<Atlas>,
}

/// Lays out an atlas: of a scene's meshes, instances and materials.
#[derive(Debug, Serialize, Deserialize)]
pub struct LayOut {
    pub(super) scene: Scene,
    pub(super) options: AtlasOptions,
}

impl jobs::Job for LayOut {
    const NAME: &'static str = "lay out an atlas";
    type Result = Result<Arc<Atlas>, String>;

    fn run(self, goes_on: &(dyn Fn(f32) -> bool + Sync)) -> Self::Result {
        let atlas = Atlas::with_progress(&self.scene, &self.options, goes_on);
        atlas.map(Arc::new).map_err(|error| error.to_string())
    }
}

/// An atlas that is being laid out beside the frames.
#[derive(Debug, Clone)]
struct Job {
    size: u32,
    density: f32,
    running: Running<Result<Arc<Atlas>, String>>,
    /// Whether meshes have changed since it was started.
    is_stale: bool,
}

impl Job {
    fn start(scene: &Scene, size: u32, density: f32, most_pages: u32) -> Self {
        let options = AtlasOptions {
            size,
            density: if density > 0.0 {
                TexelDensity::PerMetre(density)
            } else {
                TexelDensity::OnePage
            },
            most_pages,
            backs: true,
            ..AtlasOptions::default()
        };
        let scene = Scene {
            meshes: scene.meshes.clone(),
            instances: scene.instances.clone(),
            materials: scene.materials.clone(),
            ..Scene::default()
        };
        Self {
            size,
            density,
            running: jobs::start(LayOut { scene, options }),
            is_stale: false,
        }
    }

    fn is_of(&self, size: u32, density: f32) -> bool {
        !self.is_stale && (self.size, self.density) == (size, density)
    }
}

impl GpuScene {
    /// The atlas for a technique that keeps `texel_bytes` bytes per texel in one buffer; `None` while it is being laid
    /// out. Its pages have `size` texels per side; `density` is in texels per metre, or 0 for as many as one page
    /// holds. As long as anybody keeps it, the atlas stays the same until meshes change, however instances move or
    /// stretch and whatever they are made of.
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
    ) -> Result<Option<Arc<Atlas>>, GpuError> {
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

        let mut kept = self.kept_atlases();
        let AtlasCache {
            shared,
            job,
            finished,
        } = &mut *kept;
        shared.retain(|shared| shared.atlas.strong_count() > 0);
        let mut known = shared.iter();
        let known = known.find(|shared| (shared.size, shared.density) == (size, density));
        if let Some(atlas) = known.and_then(|shared| shared.atlas.upgrade()) {
            // The technique that requested it first may keep fewer bytes per texel.
            if atlas.pages > most_pages {
                return Err(GpuError::TooLarge {
                    what: format!("pages of {technique} (lower the density)"),
                    needed: u64::from(atlas.pages),
                    limit: u64::from(most_pages),
                    adapter: gpu.adapter.name.clone(),
                });
            }
            return Ok(Some(atlas));
        }
        let instances = scene.instances.iter();
        let triangles = instances.map(|instance| scene.meshes[instance.mesh].indices.len() / 3);
        let triangles: usize = triangles.sum();
        if triangles > MOST_TRIANGLES {
            return Err(refused(format!(
                "unwrapping {triangles} triangles would take too long, {MOST_TRIANGLES} are allowed: leave some objects out"
            )));
        }
        let is_mine =
            |slot: &&mut Option<Job>| slot.as_ref().is_some_and(|job| job.is_of(size, density));
        let Some(mine) = [&mut *job, &mut *finished].into_iter().find(is_mine) else {
            if job
                .as_ref()
                .is_none_or(|job| job.running.result().is_some())
            {
                let before = job.replace(Job::start(scene, size, density, most_pages));
                if before.as_ref().is_some_and(|before| !before.is_stale) {
                    *finished = before;
                }
            }
            return Ok(None);
        };
        let Some(result) = mine.as_ref().and_then(|job| job.running.result()) else {
            return Ok(None);
        };
        // A failed job stays: asked again, it fails again without the work.
        let result = result.ok_or_else(|| refused("unwrapping failed".into()))?;
        let atlas = result.clone().map_err(refused)?;
        *mine = None;
        shared.push(SharedAtlas {
            size,
            density,
            atlas: Arc::downgrade(&atlas),
        });
        Ok(Some(atlas))
    }

    /// As long as the caller keeps `atlas`, requests for pages of its size and density 0 get it. It must belong to the
    /// scene.
    pub(crate) fn provide_atlas(&self, atlas: &Arc<Atlas>) {
        self.kept_atlases().shared.push(SharedAtlas {
            size: atlas.size,
            density: 0.0,
            atlas: Arc::downgrade(atlas),
        });
    }

    /// How far the atlas is that is being laid out (0 to 1).
    pub(crate) fn atlas_progress(&self) -> f32 {
        let kept = self.kept_atlases();
        kept.job.as_ref().map_or(0.0, |job| job.running.progress())
    }

    /// Blocks until no atlas is being laid out; in browsers, which may not block, it does nothing.
    pub(crate) fn wait_for_atlas(&self) {
        let job = self.kept_atlases().job.clone();
        #[cfg(not(target_arch = "wasm32"))]
        if let Some(job) = job {
            job.running.wait();
        }
        #[cfg(target_arch = "wasm32")]
        let _ = job;
    }

    fn kept_atlases(&self) -> std::sync::MutexGuard<'_, AtlasCache> {
        let atlases = &self.atlases.0;
        atlases.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
