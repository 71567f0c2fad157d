//! Still pictures while the shutter is open: each sample is taken at a moment of its own. Maps follow in a few steps, which
//! share the shutter's time equally.

use gpugi_scene::Camera;

use super::Renderer;
use crate::lighting::{LightingError, Readiness};
use crate::shutter::{Motion, moment};

/// What moves while the shutter is open, and how far a picture is.
#[derive(Debug)]
pub(super) struct Moving {
    motion: Motion,
    /// Steps in which maps follow.
    pub steps: u32,
    /// The step that maps show, of so many, and whether they are final.
    maps: Option<([u32; 2], bool)>,
}

/// While the maps of a step are made.
const FOLLOWING: Readiness = Readiness::Pending {
    progress: 0.0,
    what: "maps of the next moment",
};

impl Renderer {
    /// Moves the scene while the shutter of the camera is open, in pictures of several samples: at the moment of each
    /// sample, the camera, instances and meshes that deform are where the animation has them, for the eye and for rays.
    /// Maps, lights and media follow in so many `steps`. `None`: nothing moves. To be set before the first sample, and
    /// again after edits.
    ///
    /// # Errors
    /// [`LightingError::Gpu`].
    pub fn set_motion(&mut self, motion: Option<Motion>, steps: u32) -> Result<(), LightingError> {
        self.end_motion()?;
        self.moving = motion.map(|motion| Moving {
            motion,
            steps: steps.max(1),
            maps: None,
        });
        Ok(())
    }

    /// Goes back to where the scene was before the shutter opened.
    pub(super) fn end_motion(&mut self) -> Result<(), LightingError> {
        let moved = self.moving.take().filter(|moving| moving.maps.is_some());
        moved.map_or(Ok(()), |moving| {
            self.scene.update(&self.gpu, moving.motion.scene())?;
            self.restart();
            Ok(())
        })
    }

    /// Moves what maps show to the step of the next sample of `of`. The camera, if they are final and it may be taken.
    pub(super) fn open_shutter(
        &mut self,
        camera: &Camera,
        of: u32,
    ) -> Result<Moment, LightingError> {
        let Some(moving) = self
            .moving
            .as_mut()
            .filter(|_| camera.shutter > 0.0 && of > 1)
        else {
            return Ok(Moment::Now);
        };
        let steps = moving.steps.min(of);
        // Samples beyond those that were asked for begin again.
        let sample = self.samples % of;
        let step = sample * steps / of;
        let middle = camera.shutter * (step as f32 + 0.5) / steps as f32;
        match moving.maps {
            Some((maps, true)) if maps == [step, steps] => {
                let of_step = sample - (step * of).div_ceil(steps);
                let seconds = camera.shutter * (step as f32 + moment(of_step)) / steps as f32;
                self.scene
                    .displace(&self.gpu, &moving.motion.after(seconds))?;
                Ok(Moment::Sample(moving.motion.camera_after(camera, seconds)))
            }
            Some((maps, false)) if maps == [step, steps] => {
                Ok(Moment::Maps(moving.motion.camera_after(camera, middle)))
            }
            _ => {
                self.scene.update(&self.gpu, &moving.motion.after(middle))?;
                moving.maps = Some(([step, steps], false));
                Ok(Moment::Maps(moving.motion.camera_after(camera, middle)))
            }
        }
    }

    /// Notes how far the maps of a step are. No sample is taken yet.
    pub(super) fn followed(&mut self, readiness: Readiness) -> Readiness {
        match &mut self.moving {
            Some(Moving {
                maps: Some((_, are_final)),
                ..
            }) if readiness == Readiness::Ready => *are_final = true,
            _ => {}
        }
        match readiness {
            Readiness::Pending { .. } => readiness,
            Readiness::Ready | Readiness::Refining { .. } => FOLLOWING,
        }
    }
}

/// What the next frame is for.
#[derive(Debug)]
pub(super) enum Moment {
    /// Nothing moves.
    Now,
    /// A sample, which this camera sees.
    Sample(Camera),
    /// Maps for what this camera sees.
    Maps(Camera),
}
