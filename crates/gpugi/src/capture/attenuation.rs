//! Receivers that are seen through something: what gathers add is multiplied by a transmittance per point.

use super::{PerReceiver, Receiver, Target};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::shader;

/// Gathers of such receivers add to a target of their own; at the end, one pass adds it, attenuated, to the receiver's.
/// So no gather reads transmittances.
#[derive(Debug, Default)]
pub(crate) struct Attenuation {
    kernel: Option<Kernel>,
    kept: PerReceiver<Unattenuated>,
}

/// The same points with a target of their own, and bind groups 1 and 3 of the pass.
#[derive(Debug)]
struct Unattenuated {
    receiver: Receiver,
    groups: [wgpu::BindGroup; 2],
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
        let Some(transmittance) = &receiver.transmittance else {
            return Ok(receiver.clone());
        };
        let gpu = frame.gpu;
        let kernel = match self.kernel.take() {
            Some(kernel) => kernel,
            None => Kernel::new(gpu, &shader!("capture.attenuation"), "main", None)?,
        };
        let kernel = self.kernel.insert(kernel);
        let made = self.kept.of(receiver, || {
            Unattenuated::new(gpu, kernel, receiver, transmittance)
        })?;
        frame.clear(&made.receiver.target.radiance);
        Ok(made.receiver.clone())
    }

    /// Adds the light that was gathered since [`Attenuation::begin`]: pass `frame.attenuation`, if `receiver` is seen
    /// through something.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn end(&mut self, frame: &mut Frame<'_>, receiver: &Receiver) -> Result<(), GpuError> {
        let (Some(transmittance), Some(kernel)) = (&receiver.transmittance, &self.kernel) else {
            return Ok(());
        };
        let gpu = frame.gpu;
        let made = self.kept.of(receiver, || {
            Unattenuated::new(gpu, kernel, receiver, transmittance)
        })?;
        let [seen, added] = &made.groups;
        frame.compute("frame.attenuation", |pass| {
            let points = [receiver.points.count, 1, 1];
            kernel.dispatch(pass, &[(1, seen), (3, added)], points);
        });
        Ok(())
    }
}

impl Unattenuated {
    fn new(
        gpu: &Gpu,
        kernel: &Kernel,
        receiver: &Receiver,
        transmittance: &wgpu::Buffer,
    ) -> Result<Self, GpuError> {
        let Receiver { points, target, .. } = receiver;
        let size = target.radiance.size();
        let radiance = gpu.buffer("gathered light [bytes]", size, wgpu::BufferUsages::STORAGE)?;
        let seen = [("seen", points.view.as_entire_binding())];
        let resources = [
            ("transmittance", transmittance.as_entire_binding()),
            ("gathered", radiance.as_entire_binding()),
            ("radiance", target.radiance.as_entire_binding()),
        ];
        Ok(Self {
            groups: [
                kernel.bind(gpu, 1, &seen)?,
                kernel.bind(gpu, 3, &resources)?,
            ],
            receiver: Receiver::new(points, &Target { radiance }),
        })
    }
}
