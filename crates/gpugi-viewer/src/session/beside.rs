//! The path tracer's picture beside that of the techniques, or in its place.

use gpugi::LightingError;
use gpugi::gpu::GpuError;
use gpugi::picture::Compared;

use super::{Radiance, Session};
use crate::technique_set::PATH_TRACER;
use crate::truth::{Reference, Truth, View};

impl Session {
    /// What is shown of the path tracer's picture: all of it where it takes the place of the techniques.
    pub(super) fn beside(&self) -> Option<Compared> {
        match self.loaded.set.is_path_tracer() {
            true => Some(Compared::Split(0.0)),
            false => self.compared,
        }
    }

    /// Samples per pixel that the techniques take at rest. Where the path tracer takes their place, what their picture
    /// is needed for, such as clicks, needs one.
    pub(super) fn samples_of_techniques(&self) -> u32 {
        match self.loaded.set.is_path_tracer() {
            true => 1,
            false => self.samples,
        }
    }

    /// What the path tracer is to trace.
    fn truth_view(&self) -> View {
        View {
            revision: self.loaded.document.revision(),
            camera: self.camera.camera(),
            size: self.loaded.renderer.size(),
            samples: match self.loaded.set.is_path_tracer() {
                true => self.samples,
                false => self.truth_samples,
            },
            is_denoised: self.denoises_truth,
        }
    }

    /// Whether the path tracer has something to do.
    pub(super) fn is_tracing(&self) -> bool {
        let truth = self.truth.as_ref();
        self.beside().is_some() && truth.is_none_or(|truth| !truth.is_done(&self.truth_view()))
    }

    /// Lets the path tracer work on what is seen: beside the picture, only at rest; alone, in motion, too, with as many
    /// pixels as its pictures are quick with. Returns whether there is something new to show.
    pub(super) fn follow_truth(
        &mut self,
        is_moving: bool,
        seconds: f32,
    ) -> Result<bool, LightingError> {
        if self.beside().is_none() {
            let truth = self.truth.take();
            return Ok(truth.is_some_and(|truth| truth.reference().is_some()));
        }
        let is_alone = self.loaded.set.is_path_tracer();
        let view = self.truth_view();
        let mut truth = match self.truth.take() {
            Some(truth) => truth,
            None => {
                let settings = self.loaded.set.path_tracer_settings()?;
                Truth::new(&self.gpu, settings, self.wake.clone())
            }
        };
        let has_begun = truth.tracer(&view).is_some();
        let was_shown = truth.reference().is_some();
        if !is_alone && !has_begun {
            truth.forget();
        }
        let done = match is_moving && !is_alone {
            true => Ok(false),
            false => truth.frame(&self.loaded.document, &view, is_moving, seconds),
        };
        if let Some(seconds) = truth.first_sample()
            && is_moving
        {
            self.pace.measure_traced(seconds);
        }
        let is_shown = truth.reference().is_some();
        self.truth = Some(truth);
        Ok(done? || was_shown != is_shown)
    }

    /// The path tracer's picture, if it is of what is seen.
    pub fn reference(&self) -> Option<&Reference> {
        let truth = self.truth.as_ref()?;
        truth.tracer(&self.truth_view())?;
        truth.reference()
    }

    /// Linear radiance of what is seen, three floats per pixel, row by row from the top, when it arrives: that of the
    /// techniques, or of the path tracer in their place.
    ///
    /// # Errors
    /// [`LightingError`].
    pub fn begin_radiance(&self) -> Result<Radiance, LightingError> {
        if self.lit_share().is_some() {
            return Err(LightingError::Gpu(GpuError::Input {
                what: "not all pixels are lit yet".into(),
            }));
        }
        if !self.loaded.set.is_path_tracer() {
            return Ok(Box::pin(self.loaded.renderer.begin_radiance()?));
        }
        let truth = self.truth.as_ref();
        match truth.and_then(|truth| truth.tracer(&self.truth_view())) {
            Some(tracer) => Ok(Box::pin(tracer.begin_radiance()?)),
            None => Err(LightingError::Gpu(GpuError::Input {
                what: format!("{PATH_TRACER} has traced nothing yet of what is seen"),
            })),
        }
    }
}
