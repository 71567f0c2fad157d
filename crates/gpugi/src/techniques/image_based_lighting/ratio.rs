//! Reflectivity as a ratio: the reflection of prefiltered environment maps, times the fraction that domains see.

use super::gpu::LobeSums;
use crate::capture::{PerReceiver, Receiver, Target};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named};
use crate::prefiltered::{Lookup, Prefiltered};
use crate::scene::GpuScene;
use crate::shader;

/// Sums over domains at surface points, and the pass that multiplies them with the maps of the environment.
#[derive(Debug)]
pub struct RatioPass {
    apply: Kernel,
    maps: Prefiltered,
    sums: PerReceiver<Target>,
}

impl RatioPass {
    /// Compiles the pass, which reads `maps`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, maps: &Prefiltered) -> Result<Self, GpuError> {
        let shader = shader!("techniques.image_based_lighting.ratio");
        Ok(Self {
            apply: Kernel::new(gpu, &shader, "main", Some(&scene.layout))?,
            maps: maps.clone(),
            sums: PerReceiver::default(),
        })
    }

    /// The receiver's points with a cleared target for the sums of each: see lobe_sums.wesl.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn begin(
        &mut self,
        frame: &mut Frame<'_>,
        receiver: &Receiver,
    ) -> Result<Receiver, GpuError> {
        let sums = self.sums(frame.gpu, receiver)?;
        frame.clear(&sums.radiance);
        Ok(Receiver::new(&receiver.points, sums))
    }

    /// Adds the product, once the sums are complete.
    ///
    /// # Errors
    /// As [`RatioPass::begin`].
    pub fn apply(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
    ) -> Result<(), GpuError> {
        let sums = self.sums(frame.gpu, receiver)?.clone();
        let settings = self.maps.settings(frame.gpu, Lookup::default())?;
        let own: [Named<'_>; 1] = [("sums", &sums)];
        let maps = self.maps.resources(&settings);
        let resources = [&receiver.resources()[..], &maps, &own].concat();
        let (name, scene) = ("image-based-lighting.apply", Some(&scene.bind_group));
        let count = [receiver.points.lit, 1, 1];
        frame.run(name, &self.apply, scene, &resources, count)
    }

    fn sums(&mut self, gpu: &Gpu, receiver: &Receiver) -> Result<&Target, GpuError> {
        let size = u64::from(receiver.points.count) * size_of::<LobeSums>() as u64;
        let usage = wgpu::BufferUsages::STORAGE;
        self.sums.of(receiver, || {
            let radiance = gpu.buffer("sums over directions [bytes]", size, usage)?;
            Target::of(gpu, radiance)
        })
    }
}
