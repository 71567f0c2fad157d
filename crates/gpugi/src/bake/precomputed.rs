//! Bakes what techniques compute once for an atlas's texels, for programs that relight the scene (tutorial section 7).

use std::marker::PhantomData;
use std::sync::Arc;

use glam::{Vec2, Vec3};
use gpugi_scene::{Atlas, Camera, Projection, Scene};

use super::solver::Solver;
use super::tasks::{
    Bake, BakeKey, Part, Progress, SavedMaps, Task, TaskResult, digest, result_of, unfit,
};
use crate::capture::View;
use crate::gpu::Gpu;
use crate::lighting::{Lighting, LightingError};
use crate::scene::GpuScene;
use crate::settings::SettingError;
use crate::techniques::light_path_map::LightPathMap;
use crate::techniques::radiance_transfer::RadianceTransfer;
use crate::techniques::{Precomputed, Registry};

/// The saved state of a [`PrecomputedBake`].
pub type PrecomputedState = SavedMaps;

/// Computes transfer vectors.
pub type TransferBake<'a> = PrecomputedBake<'a, RadianceTransfer>;

/// Computes the panes of a light path map.
pub type PaneBake<'a> = PrecomputedBake<'a, LightPathMap>;

/// Computes the maps of a technique, a frame's work per step.
#[derive(Debug)]
pub struct PrecomputedBake<'a, T> {
    technique: PhantomData<T>,
    scene: &'a Scene,
    atlas: Arc<Atlas>,
    /// [`digest`] of the scene and the atlas.
    digest: [u8; 32],
    solver: Solver,
}

impl<'a, T: Precomputed> PrecomputedBake<'a, T> {
    /// A bake of `scene`, which stays as it is, into `atlas`, an atlas of that scene.
    ///
    /// # Errors
    /// [`LightingError`], also for an atlas without pages.
    pub fn new(gpu: &Gpu, scene: &'a Scene, atlas: Atlas) -> Result<Self, LightingError> {
        if atlas.pages == 0 {
            return Err(unfit("the scene has no surface for texels"));
        }
        let digest = digest(scene, &atlas);
        let atlas = Arc::new(atlas);
        let mut on_gpu = GpuScene::with_texels(gpu, scene)?;
        on_gpu.provide_atlas(&atlas);
        let names = [T::INFO.name.to_owned()];
        let lighting = Lighting::new(gpu, &mut on_gpu, &names, &Registry::default())?;
        gpu.check()?;
        let diagonal = on_gpu.diagonal();
        let center = scene.bounds().center();
        let all = Camera {
            projection: Projection::Orthographic { height: diagonal },
            ..Camera::look_at("all", center + Vec3::Y * diagonal, center, 1.0)
        };
        let view = View::new(&all, [1, 1], Vec2::ZERO, View::NO_SAMPLE, 0, diagonal);
        let mut bake = Self {
            technique: PhantomData,
            scene,
            digest,
            solver: Solver::new(gpu, on_gpu, lighting, view),
            atlas,
        };
        let size = bake.atlas.size.to_string();
        for (name, value) in [
            ("resolution", &size[..]),
            ("density", "0"),
            ("stored", "false"),
        ] {
            bake.set(name, value)?;
        }
        Ok(bake)
    }

    /// Sets a setting of the technique from text, before the first step. `resolution`, `density` and `stored` follow
    /// from the atlas.
    ///
    /// # Errors
    /// Those of [`Lighting::set`], and for what files do not hold ([`Precomputed::refusal`]).
    pub fn set(&mut self, name: &str, value: &str) -> Result<(), LightingError> {
        if let Some(reason) = T::refusal(name, value) {
            return Err(LightingError::Setting {
                technique: T::INFO.name.to_owned(),
                source: SettingError::Value {
                    name: name.to_owned(),
                    value: value.to_owned(),
                    reason: reason.to_owned(),
                },
            });
        }
        self.solver.set(T::INFO.name, name, value)
    }

    /// Saves the state of the bake. Waits for the GPU.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn save(&mut self) -> Result<PrecomputedState, LightingError> {
        self.solver.save()
    }

    /// Resumes from the saved state of a bake of the same scene, atlas and settings, before the first step. State that
    /// does not fit is an error of a later step.
    pub fn resume(&mut self, state: PrecomputedState) {
        self.solver.saved = state;
    }

    /// What files hold, once the bake is complete.
    ///
    /// # Errors
    /// [`LightingError::Gpu`], also if the bake is not complete.
    pub fn finish(mut self) -> Result<T::Stored, LightingError> {
        if self.solver.is_refining {
            return Err(unfit("the maps are not final"));
        }
        let Solver { gpu, lighting, .. } = &mut self.solver;
        let technique = lighting.technique_mut::<T>();
        let technique = technique.ok_or_else(|| unfit("the technique is not in use"))?;
        Ok(technique.finished(gpu, self.scene, self.atlas)?)
    }
}

impl<T: Precomputed> Bake for PrecomputedBake<'_, T> {
    type Samples = ();

    fn tasks(&self) -> Vec<Task> {
        vec![Task::Maps]
    }

    fn step(&mut self) -> Result<Option<Progress>, LightingError> {
        if !self.solver.is_refining {
            return Ok(None);
        }
        Ok(Some(self.solver.refine()?))
    }

    fn run(&mut self, task: &Task) -> Result<Part<()>, LightingError> {
        if *task != Task::Maps {
            return Err(unfit("this is a task of another bake"));
        }
        self.solver.solve()?;
        Ok(Part {
            bake: self.key(),
            result: TaskResult::Maps(self.solver.save()?),
        })
    }

    fn merge(&mut self, part: Part<()>) -> Result<(), LightingError> {
        if let TaskResult::Maps(maps) = result_of(part, self.key())?
            && self.solver.is_refining
        {
            self.solver.saved = maps;
        }
        Ok(())
    }

    fn is_complete(&self) -> bool {
        !self.solver.is_refining
    }
}

impl<T: Precomputed> PrecomputedBake<'_, T> {
    fn key(&self) -> BakeKey {
        let how = ("precomputed", self.solver.techniques());
        BakeKey::new(&self.solver.gpu, &self.digest, &how)
    }
}
