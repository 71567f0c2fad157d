//! The own surface of an object, whose lit parts light its other parts.

use super::gpu::Work;
use super::maps::FrameInputs;
use crate::capture::{Capture, CaptureKernels, CubeView, Output, Receiver, SurfacePoints, Target};
use crate::gpu::{Frame, Gpu, GpuError, Named};
use crate::techniques::Earlier;

/// Captures an object from outside, from the six sides of its box, and makes area lights of what is seen.
#[derive(Debug)]
pub struct OwnSurface {
    capture: Capture,
    target: Target,
}

impl OwnSurface {
    /// Allocates a capture with `side` x `side` texels per face.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, capture: &CaptureKernels, side: u32) -> Result<Self, GpuError> {
        Ok(Self {
            capture: Capture::of_cube(gpu, capture, side)?,
            target: Target::new(gpu, 6 * side * side)?,
        })
    }

    /// Captures the object as it is, lights it by the techniques before this one, and makes area lights of it: pass
    /// `final-gather.own`. Does nothing if it is not drawn.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn light(
        &mut self,
        frame: &mut Frame<'_>,
        making: FrameInputs<'_>,
        earlier: &mut Earlier<'_>,
        work: &Work,
    ) -> Result<(), GpuError> {
        let FrameInputs {
            scene,
            kernels,
            maps,
            ..
        } = making;
        let output = Output::Irradiance;
        let is_own = |instance: u32| instance == work.instance;
        let draws = scene.draws.iter().filter(|draw| is_own(draw.instance));
        let Some(bounds) = draws.map(|draw| draw.bounds).reduce(|a, b| a.union(b)) else {
            return Ok(());
        };
        let mut view = CubeView::of_box(&bounds, self.capture.size()[0]);
        output.write(&mut view.uniform);
        self.capture.record_cube(frame, scene, &view, |draw| {
            is_own(draw.instance).then(|| scene.whole_class(draw).from_both_sides())
        })?;
        let points = SurfacePoints {
            output,
            ..self.capture.points.clone()
        };
        let receiver = Receiver::new(&points, &self.target);
        earlier.gather(frame, scene, &receiver, false)?;
        let to_do = frame.gpu.constant("work", work)?;
        let own: [Named<'_>; 1] = [("to_do", &to_do)];
        let resources = [&receiver.resources()[..], &maps.resources(), &own].concat();
        // A workgroup of 64 per light.
        let lights = [64 * work.side, work.side, 6];
        let (name, scene) = ("final-gather.own", Some(&scene.bind_group));
        frame.run(name, &kernels.own, scene, &resources, lights)
    }

    /// Bytes of the light of its points.
    pub fn bytes(&self) -> u64 {
        self.target.radiance.size()
    }
}
