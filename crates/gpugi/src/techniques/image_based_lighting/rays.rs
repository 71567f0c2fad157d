//! The gather with shadows by rays, without maps.

use super::Reflectivity;
use super::gpu::{Direction, Range};
use crate::capture::{PerReceiver, Receiver, ReceiverKernel};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::scene::{GpuScene, RayConstants};
use crate::shader;

/// Most rays per dispatch: about 100 ms on a slow GPU.
const DISPATCH_WORK: u64 = 1 << 24;

/// What the gather is compiled for.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Variant {
    reflectivity: Reflectivity,
    has_clear: bool,
    has_media: bool,
    constants: RayConstants,
}

impl Variant {
    fn new(scene: &GpuScene, reflectivity: Reflectivity) -> Self {
        Self {
            reflectivity,
            has_clear: scene.has_clear_objects(),
            has_media: !scene.media.is_empty(),
            constants: scene.ray_constants(),
        }
    }
}

/// Directions, and the pass that traces a ray from each point to each of them.
#[derive(Debug)]
pub struct RayGather {
    variant: Variant,
    kernel: ReceiverKernel,
    count: u32,
    /// The directions, and bind group 2; `None` if there are none.
    directions: Option<(wgpu::Buffer, wgpu::BindGroup)>,
    bound: PerReceiver<ReceiverGroups>,
}

/// Bind groups for one set of points and one target.
#[derive(Debug)]
struct ReceiverGroups {
    group: wgpu::BindGroup,
    /// One bind group per dispatch.
    ranges: Vec<wgpu::BindGroup>,
}

impl RayGather {
    /// Compiles the pass.
    ///
    /// # Errors
    /// [`GpuError::Pass`], also if the scene was uploaded without rays.
    pub fn new(gpu: &Gpu, scene: &GpuScene, reflectivity: Reflectivity) -> Result<Self, GpuError> {
        scene.check_rays(super::INFO.name, "visibility=rays")?;
        let variant = Variant::new(scene, reflectivity);
        let more = [
            ("REFLECTIVITY", f64::from(reflectivity as u32)),
            ("HAS_CLEAR", f64::from(u8::from(variant.has_clear))),
            scene.media_constant(),
        ];
        let shader = shader!("techniques.image_based_lighting.rays");
        Ok(Self {
            variant,
            kernel: ReceiverKernel::tracing_rays(gpu, scene, &shader, &more)?,
            count: 0,
            directions: None,
            bound: PerReceiver::default(),
        })
    }

    /// Whether the pass suits the scene as it is now.
    pub fn suits(&self, scene: &GpuScene, reflectivity: Reflectivity) -> bool {
        self.variant == Variant::new(scene, reflectivity)
    }

    /// Sets the directions.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn set(&mut self, gpu: &Gpu, directions: &[Direction]) -> Result<(), GpuError> {
        let count = directions.len() as u32;
        if let Some((buffer, _)) = self.directions.as_ref().filter(|_| count == self.count) {
            gpu.write(buffer, 0, directions);
            return Ok(());
        }
        self.bound.clear();
        self.directions = None;
        self.count = count;
        if count > 0 {
            let buffer = gpu.storage("directions [bytes]", directions)?;
            let resources = [("directions", buffer.as_entire_binding())];
            let group = self.kernel.to_bind().bind(gpu, 2, &resources)?;
            self.directions = Some((buffer, group));
        }
        Ok(())
    }

    /// Adds the light of every direction to the receiver's target: see rays.wesl.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        receiver: &Receiver,
    ) -> Result<(), GpuError> {
        let Some((_, directions)) = &self.directions else {
            return Ok(());
        };
        let gpu = frame.gpu;
        let kernel = self.kernel.of(gpu, &receiver.points)?;
        let count = self.count;
        let bound = self.bound.of(receiver, || {
            let Receiver { points, target, .. } = receiver;
            let at_once = (DISPATCH_WORK / u64::from(points.count.max(1))).max(1) as usize;
            let ranges = (0..count).step_by(at_once).map(|first| {
                let range = Range {
                    first,
                    end: (first + at_once as u32).min(count),
                    padding_0: 0,
                    padding_1: 0,
                };
                let range = gpu.uniform("range of directions", &range)?;
                let resources = [
                    ("range", range.as_entire_binding()),
                    ("sums", target.radiance.as_entire_binding()),
                ];
                kernel.bind(gpu, 3, &resources)
            });
            Ok(ReceiverGroups {
                group: points.bind(gpu, kernel)?,
                ranges: ranges.collect::<Result<_, _>>()?,
            })
        })?;
        frame.compute("image-based-lighting.gather", |pass| {
            for range in &bound.ranges {
                let groups = [
                    (0, &scene.ray_bind_group),
                    (1, &bound.group),
                    (2, directions),
                    (3, range),
                ];
                kernel.dispatch(pass, &groups, [receiver.points.count, 1, 1]);
            }
        });
        Ok(())
    }
}
