//! The own surface of an object, whose lit parts light its other parts.

use super::gpu::Work;
use super::maps::{Kernels, Making, Maps};
use crate::capture::{
    Capture, CaptureKernels, CubeView, Output, PerReceiver, Receiver, SurfacePoints, Target,
};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::techniques::Earlier;

/// Captures an object from outside, from the six sides of its box, and makes area lights of what is seen.
#[derive(Debug)]
pub struct OwnSurface {
    capture: Capture,
    target: Target,
    /// Bind group 3 of the pass that makes the lights.
    written: wgpu::BindGroup,
    seen: PerReceiver<wgpu::BindGroup>,
}

impl OwnSurface {
    /// Allocates a capture with `side` x `side` texels per face. `work`: the uniform that says which reference point it
    /// is.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        capture: &CaptureKernels,
        kernels: &Kernels,
        maps: &Maps,
        work: &wgpu::Buffer,
        side: u32,
    ) -> Result<Self, GpuError> {
        let target = Target::new(gpu, 6 * side * side)?;
        let resources = [
            ("to_do", work.as_entire_binding()),
            ("radiance", target.radiance.as_entire_binding()),
            ("stored", maps.lights.as_entire_binding()),
            ("sources", maps.sources.as_entire_binding()),
        ];
        Ok(Self {
            capture: Capture::of_cube(gpu, capture, side)?,
            written: kernels.own.bind(gpu, 3, &resources)?,
            target,
            seen: PerReceiver::default(),
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
        making: Making<'_>,
        earlier: &mut Earlier<'_>,
        work: &Work,
    ) -> Result<(), GpuError> {
        let Making { scene, kernels, .. } = making;
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
        let gpu = frame.gpu;
        let seen = self.seen.of(&receiver, || points.bind(gpu, &kernels.own))?;
        frame.compute("final-gather.own", |pass| {
            let groups = [(0, &scene.bind_group), (1, seen), (3, &self.written)];
            // A workgroup of 64 per light.
            kernels
                .own
                .dispatch(pass, &groups, [64 * work.side, work.side, 6]);
        });
        Ok(())
    }

    /// Bytes of the light of its points.
    pub fn bytes(&self) -> u64 {
        self.target.radiance.size()
    }
}
