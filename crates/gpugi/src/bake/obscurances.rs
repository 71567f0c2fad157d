//! The obscurances of an atlas.

use gpugi_scene::{Atlas, Scene};

use super::Leaks;
use crate::capture::atlas::{AtlasCapture, AtlasCaptureOptions, LeakTest};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::scene::GpuScene;
use crate::techniques::obscurances::{ObscurancePage, ObscuranceState, Settings, Solution};

/// Computes the obscurances of an atlas.
#[derive(Debug)]
pub struct ObscuranceBake {
    gpu: Gpu,
    on_gpu: GpuScene,
    capture: AtlasCapture,
    leaks: LeakTest,
    solution: Solution,
}

impl ObscuranceBake {
    /// Allocates the bake of `atlas`, an atlas of `scene`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        atlas: &Atlas,
        settings: &Settings,
    ) -> Result<Self, GpuError> {
        let on_gpu = GpuScene::with_texels(gpu, scene)?;
        let options = AtlasCaptureOptions::default();
        let capture = AtlasCapture::new(gpu, scene, &on_gpu, atlas, &options)?;
        Ok(Self {
            leaks: LeakTest::new(gpu, &on_gpu, &capture)?,
            solution: Solution::new(gpu, scene, &on_gpu, atlas, &capture, settings)?,
            gpu: gpu.clone(),
            on_gpu,
            capture,
        })
    }

    /// Takes a step; returns the part of the work that is done afterwards (0 to 1).
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn step(&mut self) -> Result<f32, GpuError> {
        let mut frame = Frame::new(&self.gpu, false);
        self.on_gpu.merge(&mut frame);
        self.capture.record(&mut frame, &self.on_gpu)?;
        self.leaks.record(&mut frame, &self.on_gpu, &self.capture);
        self.solution
            .record(&mut frame, &self.on_gpu, &self.capture)?;
        frame.submit()?;
        Ok(self.solution.progress())
    }

    /// Whether there is nothing left to do.
    pub fn is_done(&self) -> bool {
        self.solution.is_done()
    }

    /// What has been computed so far. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn save(&self) -> Result<ObscuranceState, GpuError> {
        self.solution.save(&self.gpu)
    }

    /// Resumes from the saved state of a bake of the same scene, atlas and settings.
    ///
    /// # Errors
    /// [`GpuError`]; [`GpuError::Pass`] when the state does not fit such a bake.
    pub fn resume(&mut self, state: &ObscuranceState) -> Result<(), GpuError> {
        // The first step finds out which texels have room for samples.
        self.step()?;
        self.solution.resume(&self.gpu, state)
    }

    /// Texels that lie inside other objects. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn leaks(&self) -> Result<Leaks, GpuError> {
        Ok(Leaks::new(&self.leaks.map(&self.gpu)?, self.capture.size))
    }

    /// The pages as they stand now. Waits for the GPU.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn pages(&mut self) -> Result<Vec<ObscurancePage>, GpuError> {
        self.solution.pages(&self.gpu)
    }
}
