//! Reflectivity as a ratio: the reflection of prefiltered environment maps, times the fraction that domains see.

use super::gpu::LobeSums;
use crate::capture::{PerReceiver, Receiver, Target};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::prefiltered::{Lookup, Prefiltered};
use crate::scene::GpuScene;
use crate::shader;

/// Sums over domains at surface points, and the pass that multiplies them with the maps of the environment.
#[derive(Debug)]
pub struct RatioPass {
    apply: Kernel,
    maps: Prefiltered,
    group: wgpu::BindGroup,
    bound: PerReceiver<LobeSumTarget>,
}

/// Sums and bind groups for one set of points and one target.
#[derive(Debug)]
struct LobeSumTarget {
    sums: Target,
    groups: [wgpu::BindGroup; 2],
}

impl RatioPass {
    /// Compiles the pass, which reads `maps`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, maps: &Prefiltered) -> Result<Self, GpuError> {
        let apply = Kernel::new(
            gpu,
            &shader!("techniques.image_based_lighting.ratio"),
            "main",
            Some(&scene.layout),
        )?;
        Ok(Self {
            group: maps.bind(gpu, &apply, Lookup::default(), &[])?,
            maps: maps.clone(),
            apply,
            bound: PerReceiver::default(),
        })
    }

    /// Whether it reads these maps.
    pub fn reads(&self, maps: &Prefiltered) -> bool {
        self.maps == *maps
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
        let sums = self.bound(frame.gpu, receiver)?.sums.clone();
        frame.clear(&sums.radiance);
        Ok(Receiver::new(&receiver.points, &sums))
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
        let [seen, added] = self.bound(frame.gpu, receiver)?.groups.clone();
        let groups = [
            (0, &scene.bind_group),
            (1, &seen),
            (2, &self.group),
            (3, &added),
        ];
        frame.compute("image-based-lighting.apply", |pass| {
            self.apply
                .dispatch(pass, &groups, [receiver.points.count, 1, 1]);
        });
        Ok(())
    }

    fn bound(&mut self, gpu: &Gpu, receiver: &Receiver) -> Result<&LobeSumTarget, GpuError> {
        let Receiver { points, target, .. } = receiver;
        self.bound.of(receiver, || {
            let size = u64::from(points.count) * size_of::<LobeSums>() as u64;
            let usage = wgpu::BufferUsages::STORAGE;
            let radiance = gpu.buffer("sums over directions [bytes]", size, usage)?;
            let resources = [
                ("sums", radiance.as_entire_binding()),
                ("radiance", target.radiance.as_entire_binding()),
            ];
            let groups = [
                points.bind(gpu, &self.apply)?,
                self.apply.bind(gpu, 3, &resources)?,
            ];
            Ok(LobeSumTarget {
                sums: Target { radiance },
                groups,
            })
        })
    }
}
