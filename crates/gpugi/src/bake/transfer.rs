//! Bakes the transfer vectors of an atlas's texels, for programs that relight the scene (tutorial section 7).

use std::sync::Arc;

use glam::{Vec2, Vec3};
use gpugi_scene::{Atlas, Camera, Projection, Scene, TransferVectors};

use super::solver::Solver;
use super::tasks::{
    Bake, BakeKey, Part, Progress, SavedMaps, Task, TaskResult, digest, result_of, unfit,
};
use crate::capture::View;
use crate::gpu::Gpu;
use crate::lighting::{Lighting, LightingError};
use crate::scene::GpuScene;
use crate::techniques::Registry;
use crate::techniques::radiance_transfer::{self, RadianceTransfer};

/// The saved state of a [`TransferBake`].
pub type TransferState = SavedMaps;

/// Computes transfer vectors, a frame's work per step.
#[derive(Debug)]
pub struct TransferBake<'a> {
    scene: &'a Scene,
    atlas: Arc<Atlas>,
    /// [`digest`] of the scene and the atlas.
    digest: [u8; 32],
    solver: Solver,
}

impl<'a> TransferBake<'a> {
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
        let names = [radiance_transfer::INFO.name.to_owned()];
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

    /// Sets a setting of radiance-transfer from text, before the first step. `resolution`, `density` and `stored`
    /// follow from the atlas.
    ///
    /// # Errors
    /// Those of [`Lighting::set`], and for what files do not hold: wavelets, compressed vectors, those of vertices, and
    /// matrices.
    pub fn set(&mut self, name: &str, value: &str) -> Result<(), LightingError> {
        let is_glossy = name == "glossy" && !value.is_empty();
        let refused = [
            ("basis", "haar"),
            ("compressed", "true"),
            ("at", "vertices"),
        ];
        if is_glossy || refused.contains(&(name, value)) {
            let held = "files hold harmonics of texels that are not compressed, and no matrices";
            return Err(unfit(held));
        }
        self.solver.set(radiance_transfer::INFO.name, name, value)
    }

    /// Saves the state of the bake. Waits for the GPU.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn save(&mut self) -> Result<TransferState, LightingError> {
        self.solver.save()
    }

    /// Resumes from the saved state of a bake of the same scene, atlas and settings, before the first step. State that
    /// does not fit is an error of a later step.
    pub fn resume(&mut self, state: TransferState) {
        self.solver.saved = state;
    }

    /// The vectors, once the bake is complete.
    ///
    /// # Errors
    /// [`LightingError::Gpu`], also if the bake is not complete.
    pub fn finish(mut self) -> Result<TransferVectors, LightingError> {
        let saved = self.solver.save()?;
        let saved = saved.get(radiance_transfer::INFO.name);
        let saved = saved.ok_or_else(|| unfit("the transfer vectors are not complete"))?;
        let Solver { gpu, lighting, .. } = &mut self.solver;
        let technique = lighting.technique_mut::<RadianceTransfer>();
        let technique = technique.ok_or_else(|| unfit("there is no radiance-transfer"))?;
        let vectors = technique.finished(gpu, self.scene, self.atlas, saved)?;
        Ok(vectors)
    }
}

impl Bake for TransferBake<'_> {
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

impl TransferBake<'_> {
    fn key(&self) -> BakeKey {
        let how = ("transfer", self.solver.techniques());
        BakeKey::new(&self.solver.gpu, &self.digest, &how)
    }
}
