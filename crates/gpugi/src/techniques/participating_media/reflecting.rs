//! What surfaces reflect to particles: light paths L[DG]V+E.

use bytemuck::Zeroable;

use super::network::{Kernels, Network};
use crate::capture::{Output, Receiver, SurfacePoints, Target, ViewUniform};
use crate::gpu::{Frame, Gpu, GpuError, Named};
use crate::scene::GpuScene;
use crate::techniques::Earlier;

/// Points per row of their hit records.
const WIDTH: u32 = 1024;
/// Links whose surface points are lit at once, at most.
const MOST_LINKS: u32 = 1 << 17;
/// `view::RAYS`.
const RAYS: u32 = 2;

/// The surface points at the ends of links, some links at a time.
#[derive(Debug)]
pub struct Reflecting {
    receiver: Receiver,
}

impl Reflecting {
    /// Room for surface points at the ends of the network's links.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, network: &Network) -> Result<Self, GpuError> {
        let links = network.entries();
        let rows = links.min(MOST_LINKS).div_ceil(WIDTH);
        let view = ViewUniform {
            width: WIDTH,
            height: rows,
            faces: RAYS,
            ..Zeroable::zeroed()
        };
        let view = gpu.uniform("view of ends of links", &view)?;
        let (label, output) = ("ends of links [bytes]", Output::RadianceToEye);
        let points = SurfacePoints::room(gpu, label, [WIDTH, rows], view, output)?;
        Ok(Self {
            receiver: Receiver::new(&points, &Target::new(gpu, points.count)?),
        })
    }

    /// Gathers the light that the techniques before add at the ends of links: pass `participating-media.reflecting`,
    /// and theirs.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        kernels: &Kernels,
        network: &Network,
        earlier: &mut Earlier<'_>,
    ) -> Result<(), GpuError> {
        let count = self.receiver.points.count;
        let links = network.entries();
        for first in (0..links).step_by(count as usize) {
            let of_pass = frame.gpu.constant("first link", &[first, 0, 0, 0])?;
            let own: [Named<'_>; 1] = [("first", &of_pass)];
            let points = self.receiver.points.resources();
            let resources = [&network.resources()[..], &points, &own].concat();
            let name = "participating-media.reflecting";
            let (kernel, rays) = (&kernels.reflecting, Some(&scene.ray_bind_group));
            frame.run(name, kernel, rays, &resources, [count, 1, 1])?;
            earlier.budget.count(count.into());
            earlier.gather(frame, scene, &self.receiver, false)?;
            let links = count.min(links - first);
            frame.copy(
                &self.receiver.target.radiance,
                &network.reflected,
                [u64::from(first) * 16, u64::from(links) * 16],
            );
        }
        Ok(())
    }

    /// Bytes of all buffers and hit records.
    pub fn bytes(&self) -> u64 {
        let Receiver { points, target, .. } = &self.receiver;
        points.points.size() + target.radiance.size() + u64::from(points.count) * 4
    }
}
