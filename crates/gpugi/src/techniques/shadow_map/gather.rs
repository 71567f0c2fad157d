//! The pass that sums up the light of all samples.

use super::gpu::GatherSettings;
use crate::capture::{PerReceiver, Receiver, ReceiverKernel};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::lights::Shadows;
use crate::scene::GpuScene;
use crate::shader;

/// Light x point x comparison products that one dispatch may hold: about 100 ms on a slow GPU.
fn dispatch_work(gpu: &Gpu) -> u64 {
    match gpu.adapter.device_type {
        wgpu::DeviceType::DiscreteGpu => 1 << 30,
        _ => 1 << 27,
    }
}

/// Densities that are looked up on the way to a light, roughly.
const MEDIA_LOOKUPS: u32 = 64;

/// The pass, and what it is bound to.
#[derive(Debug)]
pub struct ShadowGather {
    kernel: ReceiverKernel,
    /// Whether the kernel looks for media.
    pub knows_media: bool,
    lights: Option<Lights>,
    bound: PerReceiver<ReceiverGroups>,
}

/// What is summed up, and how.
#[derive(Debug)]
struct Lights {
    group: wgpu::BindGroup,
    count: u32,
    settings: GatherSettings,
}

/// Bind groups for one set of points and one target.
#[derive(Debug)]
struct ReceiverGroups {
    group: wgpu::BindGroup,
    chunks: Vec<(u32, wgpu::BindGroup)>,
}

impl ShadowGather {
    /// Compiles the pass for lookups in `shadows`.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, shadows: &Shadows) -> Result<Self, GpuError> {
        let shader = shader!("techniques.shadow_map.gather");
        let constants = [
            ("HAS_TRANSMITTANCE", shadows.has_transmittance().into()),
            scene.media_constant(),
        ];
        Ok(Self {
            kernel: ReceiverKernel::new(gpu, scene, &shader, &constants)?,
            knows_media: !scene.media.is_empty(),
            lights: None,
            bound: PerReceiver::default(),
        })
    }

    /// Sums up the lights of `shadows` from now on. `settings`: all but the range.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn look_up(
        &mut self,
        gpu: &Gpu,
        shadows: &Shadows,
        settings: GatherSettings,
    ) -> Result<(), GpuError> {
        self.bound.clear();
        let group = shadows.bind(gpu, self.kernel.to_bind())?;
        self.lights = group.map(|group| Lights {
            group,
            count: shadows.light_count(),
            settings,
        });
        Ok(())
    }

    /// Adds the light of every sample.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        pass: &str,
        receiver: &Receiver,
    ) -> Result<(), GpuError> {
        let Some(lights) = &self.lights else {
            return Ok(());
        };
        let gpu = frame.gpu;
        let kernel = self.kernel.of(gpu, &receiver.points)?;
        let bound = self.bound.of(receiver, || {
            bind(gpu, kernel, receiver, lights, self.knows_media)
        })?;
        frame.compute(pass, |compute| {
            for (count, range) in &bound.chunks {
                let groups = [
                    (0, &scene.bind_group),
                    (1, &bound.group),
                    (2, &lights.group),
                    (3, range),
                ];
                kernel.dispatch(compute, &groups, [*count, 1, 1]);
            }
        });
        Ok(())
    }
}

/// Cuts points x lights into dispatches short enough for any driver's watchdog.
fn bind(
    gpu: &Gpu,
    kernel: &Kernel,
    receiver: &Receiver,
    lights: &Lights,
    knows_media: bool,
) -> Result<ReceiverGroups, GpuError> {
    let Receiver { points, target, .. } = receiver;
    let group = points.bind(gpu, kernel)?;
    let settings = &lights.settings;
    let taps = if settings.kind == 0 {
        1
    } else {
        settings.taps.max(settings.area_taps)
    };
    // Densities on the way to a light count like comparisons.
    let lookups = taps + if knows_media { MEDIA_LOOKUPS } else { 0 };
    let work = dispatch_work(gpu);
    let per_light = u64::from(points.count) * u64::from(lookups);
    let lights_at_once = (work / per_light.max(1)).clamp(1, u64::from(lights.count)) as u32;
    let points_at_once = (work / u64::from(lookups))
        .min(u64::from(points.count))
        .max(1) as u32;
    let mut chunks = Vec::new();
    for first_light in (0..lights.count).step_by(lights_at_once as usize) {
        for first_point in (0..points.count).step_by(points_at_once as usize) {
            let of_chunk = GatherSettings {
                first_light,
                end_light: (first_light + lights_at_once).min(lights.count),
                first_point,
                end_point: (first_point + points_at_once).min(points.count),
                is_brief: receiver.is_brief.into(),
                ..*settings
            };
            let buffer = gpu.uniform("shadow settings", &of_chunk)?;
            let chunk = kernel.bind(
                gpu,
                3,
                &[
                    ("settings", buffer.as_entire_binding()),
                    ("radiance", target.radiance.as_entire_binding()),
                ],
            )?;
            chunks.push((of_chunk.end_point - first_point, chunk));
        }
    }
    Ok(ReceiverGroups { group, chunks })
}
