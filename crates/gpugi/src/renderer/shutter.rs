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
    maps: Option<Maps>,
}

/// What maps show.
#[derive(Debug, Clone, Copy)]
struct Maps {
    /// The step, and of how many.
    step: [u32; 2],
    /// Its middle, after the shutter opened (s).
    seconds: f32,
    are_final: bool,
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

    /// Goes back to where the scene was before the shutter opened, and forgets what moves.
    pub(super) fn end_motion(&mut self) -> Result<(), LightingError> {
        self.close_shutter()?;
        self.moving = None;
        Ok(())
    }

    /// Goes back to where the scene was before the shutter opened.
    fn close_shutter(&mut self) -> Result<(), LightingError> {
        let Some(moving) = &mut self.moving else {
            return Ok(());
        };
        if let Some(maps) = moving.maps.take() {
            let shown = moving.motion.after(maps.seconds);
            self.scene.displace(&self.gpu, &shown)?;
            self.scene.update(&self.gpu, moving.motion.scene())?;
            self.restart();
        }
        Ok(())
    }

    /// Moves what maps show to the step of the next sample of `of`. The camera, if they are final and it may be taken.
    pub(super) fn open_shutter(
        &mut self,
        camera: &Camera,
        of: u32,
    ) -> Result<Moment, LightingError> {
        if camera.shutter == 0.0 || of <= 1 {
            self.close_shutter()?;
            return Ok(Moment::Now);
        }
        let Some(moving) = &mut self.moving else {
            return Ok(Moment::Now);
        };
        let steps = moving.steps.min(of);
        // Samples beyond those that were asked for begin again.
        let sample = self.samples % of;
        let step = (u64::from(sample) * u64::from(steps) / u64::from(of)) as u32;
        let of_step = camera.shutter / steps as f32;
        let motion = &moving.motion;
        let maps = match moving.maps {
            Some(maps) if maps.step == [step, steps] => maps,
            before => {
                if let Some(maps) = before {
                    self.scene
                        .displace(&self.gpu, &motion.after(maps.seconds))?;
                }
                let seconds = of_step * (step as f32 + 0.5);
                self.scene.update(&self.gpu, &motion.after(seconds))?;
                *moving.maps.insert(Maps {
                    step: [step, steps],
                    seconds,
                    are_final: false,
                })
            }
        };
        if !maps.are_final {
            return Ok(Moment::Maps(motion.camera_after(camera, maps.seconds)));
        }
        let first = (u64::from(step) * u64::from(of)).div_ceil(u64::from(steps)) as u32;
        let seconds = of_step * (step as f32 + moment(sample - first));
        self.scene.displace(&self.gpu, &motion.after(seconds))?;
        Ok(Moment::Sample(motion.camera_after(camera, seconds)))
    }

    /// Notes how far the maps of a step are. No sample is taken yet.
    pub(super) fn followed(&mut self, readiness: Readiness) -> Readiness {
        let maps = self.moving.as_mut().and_then(|moving| moving.maps.as_mut());
        if let Some(maps) = maps.filter(|_| readiness == Readiness::Ready) {
            maps.are_final = true;
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
