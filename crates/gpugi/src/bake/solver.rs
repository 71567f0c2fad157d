//! Makes the maps of techniques for bakes.

use super::tasks::{Progress, SavedMaps, Stage};
use crate::capture::View;
use crate::gpu::{Frame, Gpu};
use crate::lighting::{Budget, Lighting, LightingError, Readiness};
use crate::scene::GpuScene;

/// A scene on the GPU, and techniques that make their maps of it, frame by frame, until they are final.
#[derive(Debug)]
pub(super) struct Solver {
    pub gpu: Gpu,
    pub on_gpu: GpuScene,
    pub lighting: Lighting,
    pub view: View,
    /// Whether the maps are not final yet.
    pub is_refining: bool,
    /// Saved maps from which techniques have yet to resume.
    pub saved: SavedMaps,
}

impl Solver {
    /// Maps for what `view` sees, and for everything else in the scene.
    pub fn new(gpu: &Gpu, on_gpu: GpuScene, mut lighting: Lighting, view: View) -> Self {
        lighting.light_elsewhere();
        Self {
            gpu: gpu.clone(),
            on_gpu,
            lighting,
            view,
            is_refining: true,
            saved: SavedMaps::new(),
        }
    }

    /// Names and settings of the techniques, which decide what they make.
    pub fn techniques(&self) -> Vec<(&'static str, String)> {
        let techniques = self.lighting.techniques().iter();
        let settings =
            techniques.map(|technique| (technique.info().name, technique.settings().to_json()));
        settings
            .map(|(name, json)| (name, json.to_string()))
            .collect()
    }

    /// Sets one setting of one technique from text, before the first step.
    ///
    /// # Errors
    /// Those of [`Lighting::set`].
    pub fn set(&mut self, technique: &str, name: &str, value: &str) -> Result<(), LightingError> {
        self.lighting.set(&mut self.on_gpu, technique, name, value)
    }

    /// Refines the maps by one frame.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn refine(&mut self) -> Result<Progress, LightingError> {
        let mut frame = Frame::new(&self.gpu, false);
        let (lighting, scene) = (&mut self.lighting, &mut self.on_gpu);
        let readiness = lighting.prepare(&mut frame, scene, &self.view, Budget::UNLIMITED)?;
        frame.submit()?;
        if !readiness.is_usable() {
            self.gpu.wait()?;
            scene.wait_for_atlas();
        }
        self.saved = lighting.resume(std::mem::take(&mut self.saved))?;
        // Progress alone does not tell: it falls when light improves that other maps are made from.
        self.is_refining = readiness != Readiness::Ready;
        Ok(Progress {
            stage: Stage::Maps,
            done: readiness.progress(),
        })
    }

    /// Refines the maps until they are final. Waits for the GPU.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn solve(&mut self) -> Result<(), LightingError> {
        while self.is_refining {
            self.refine()?;
            self.gpu.wait()?;
        }
        Ok(())
    }

    /// Saved maps. Waits for the GPU.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn save(&mut self) -> Result<SavedMaps, LightingError> {
        // Saved maps that were not resumed yet are still the best that there are.
        let mut maps = self.lighting.save()?;
        maps.extend(self.saved.clone());
        Ok(maps)
    }
}
