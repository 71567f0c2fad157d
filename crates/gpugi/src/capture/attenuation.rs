//! Receivers that are seen through something: what gathers add is multiplied by a transmittance per point.

use super::{PerReceiver, Receiver, Target};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named};
use crate::shader;

/// Gathers of such receivers add to a target of their own; at the end, one pass adds it, attenuated, to the receiver's.
/// So no gather reads transmittances.
#[derive(Debug, Default)]
pub(crate) struct Attenuation {
    kernel: Option<Kernel>,
    /// The same points with a target of their own.
    unattenuated: PerReceiver<Receiver>,
}

impl Attenuation {
    /// The receiver for gathers: with a cleared target of its own if `receiver` is seen through something.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn begin(
        &mut self,
        frame: &mut Frame<'_>,
        receiver: &Receiver,
    ) -> Result<Receiver, GpuError> {
        if receiver.transmittance.is_none() {
            return Ok(receiver.clone());
        }
        let kernel = match self.kernel.take() {
            Some(kernel) => kernel,
            None => Kernel::new(frame.gpu, &shader!("capture.attenuation"), "main", None)?,
        };
        self.kernel = Some(kernel);
        let unattenuated = self.of(frame.gpu, receiver)?;
        frame.clear(&unattenuated.target.radiance);
        Ok(unattenuated)
    }

    /// Adds the light that was gathered since [`Attenuation::begin`]: pass `frame.attenuation`, if `receiver` is seen
    /// through something.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn end(&mut self, frame: &mut Frame<'_>, receiver: &Receiver) -> Result<(), GpuError> {
        let Some(transmittance) = &receiver.transmittance else {
            return Ok(());
        };
        let gathered = self.of(frame.gpu, receiver)?.target;
        let Some(kernel) = &self.kernel else {
            return Ok(());
        };
        let resources: [Named<'_>; 4] = [
            ("seen", &receiver.points.view),
            ("transmittance", transmittance),
            ("gathered", &gathered),
            ("radiance", &receiver.target),
        ];
        let points = [receiver.points.lit, 1, 1];
        frame.run("frame.attenuation", kernel, None, &resources, points)
    }

    fn of(&mut self, gpu: &Gpu, receiver: &Receiver) -> Result<Receiver, GpuError> {
        let Receiver { points, target, .. } = receiver;
        let size = target.radiance.size();
        let make = || {
            let radiance =
                gpu.buffer("gathered light [bytes]", size, wgpu::BufferUsages::STORAGE)?;
            Ok(Receiver::new(points, &Target::of(gpu, radiance)?))
        };
        let made = self.unattenuated.of(receiver, make)?;
        // Which points are lit may have changed.
        Ok(Receiver::new(points, &made.target))
    }
}
