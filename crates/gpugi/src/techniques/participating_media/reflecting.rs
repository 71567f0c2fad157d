//! What surfaces reflect to particles: light paths L[DG]V+E.

use bytemuck::Zeroable;

use super::network::{Kernels, Network};
use crate::capture::{Output, Receiver, SurfacePoints, Target, ViewUniform};
use crate::gpu::{Frame, Gpu, GpuError, Named};
use crate::scene::GpuScene;
use crate::techniques::Earlier;

/// Points per row of their hit records.
const WIDTH: u32 = 1024;
/// Links whose surface points are lit at once, at most: a part.
const MOST_LINKS: u32 = 1 << 15;
/// How often light that is drawn by chance is gathered at each link. It is also a mean over directions and over particles.
const ROUNDS: u32 = 8;
/// `view::RAYS`.
const RAYS: u32 = 2;

/// The surface points at the ends of links, some links at a time.
#[derive(Debug)]
pub struct Reflecting {
    receiver: Receiver,
    view: ViewUniform,
    links: u32,
    /// Parts gathered since the light changed, and the next one.
    gathered: u32,
    next: u32,
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
        let uniform = gpu.uniform("view of ends of links", &view)?;
        let (label, output) = ("ends of links [bytes]", Output::RadianceToEye);
        let points = SurfacePoints::room(gpu, label, [WIDTH, rows], uniform, output)?;
        Ok(Self {
            receiver: Receiver::new(&points, &Target::new(gpu, points.count)?),
            view,
            links,
            gathered: 0,
            next: 0,
        })
    }

    fn parts(&self) -> u32 {
        self.links.div_ceil(self.receiver.points.count)
    }

    /// Begins again, because the light has changed.
    pub fn begin(&mut self) {
        self.gathered = 0;
    }

    /// Whether all light has been gathered, as often as it takes if it is drawn by chance (`is_noisy`).
    pub fn is_done(&self, is_noisy: bool) -> bool {
        let rounds = if is_noisy { ROUNDS } else { 1 };
        self.gathered >= rounds * self.parts()
    }

    /// Gathers the light that the techniques before add at the ends of links, at one part of them or at each of them once:
    /// passes `participating-media.reflecting` and `.mean`, and those of other techniques.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        (kernels, network): (&Kernels, &Network),
        earlier: &mut Earlier<'_>,
        is_whole: bool,
    ) -> Result<(), GpuError> {
        let count = self.receiver.points.count;
        let parts = self.parts();
        for _ in 0..if is_whole { parts } else { 1 } {
            let first = self.next * count;
            let links = count.min(self.links - first);
            let round = self.gathered / parts;
            let weight = 1.0 / (1 + round) as f32;
            let part = [first, links, weight.to_bits(), 0];
            let part = frame.gpu.constant("part of the links", &part)?;
            self.view.sample_index = round * parts + self.next;
            let view = frame.gpu.constant("view of ends of links", &self.view)?;
            let bytes = size_of::<ViewUniform>() as u64;
            frame.copy(&view, &self.receiver.points.view, [0, bytes]);
            let own: [Named<'_>; 2] = [
                ("part", &part),
                ("gathered", &self.receiver.target.radiance),
            ];
            let points = self.receiver.points.resources();
            let resources = [&network.resources()[..], &points, &own].concat();
            let name = "participating-media.reflecting";
            let (kernel, rays) = (&kernels.reflecting, Some(&scene.ray_bind_group));
            frame.run(name, kernel, rays, &resources, [count, 1, 1])?;
            earlier.budget.count(count.into());
            earlier.gather(frame, scene, &self.receiver, false)?;
            let name = "participating-media.mean";
            frame.run(name, &kernels.mean, None, &resources, [links, 1, 1])?;
            self.gathered += 1;
            self.next = (self.next + 1) % parts;
        }
        Ok(())
    }

    /// Bytes of all buffers and hit records.
    pub fn bytes(&self) -> u64 {
        let Receiver { points, target, .. } = &self.receiver;
        points.points.size() + target.radiance.size() + u64::from(points.count) * 4
    }
}
