//! The pass that sums up the light of all samples.

use super::gpu::GatherSettings;
use crate::capture::{Gather, Receiver};
use crate::gpu::{Frame, Gpu, GpuError, join};
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

/// The pass.
#[derive(Debug)]
pub struct ShadowGather {
    gather: Gather,
    /// Lookups on the way to a light, where light passes media.
    media_lookups: u32,
}

impl ShadowGather {
    /// Compiles the pass for lookups in `shadows`, or for light `unshadowed` by surfaces.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        shadows: &Shadows,
        unshadowed: bool,
    ) -> Result<Self, GpuError> {
        let shader = shader!("techniques.shadow_map.gather");
        let constants = [
            ("HAS_TRANSMITTANCE", shadows.has_transmittance().into()),
            ("UNSHADOWED", f64::from(u8::from(unshadowed))),
            scene.media_constant(),
        ];
        Ok(Self {
            gather: Gather::new(gpu, scene, &shader, &constants)?,
            media_lookups: if scene.media.is_empty() {
                0
            } else {
                MEDIA_LOOKUPS
            },
        })
    }

    /// Adds the light of every sample of `shadows`, in dispatches short enough for any driver's watchdog. `settings`: all
    /// but the range.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        name: &str,
        scene: &GpuScene,
        receiver: &Receiver,
        (shadows, settings): (&Shadows, &GatherSettings),
    ) -> Result<(), GpuError> {
        let Some(maps) = shadows.resources() else {
            return Ok(());
        };
        let gpu = frame.gpu;
        let (lights, points) = (shadows.light_count(), receiver.points.lit);
        let taps = if settings.kind == 0 {
            1
        } else {
            settings.taps.max(settings.area_taps)
        };
        // Densities on the way to a light count like comparisons.
        let lookups = u64::from(taps + self.media_lookups);
        let work = dispatch_work(gpu);
        let per_light = u64::from(points) * lookups;
        let lights_at_once = (work / per_light.max(1)).clamp(1, u64::from(lights)) as u32;
        let points_at_once = (work / lookups).min(u64::from(points)).max(1) as u32;
        frame.compute(name, |pass| {
            for first_light in (0..lights).step_by(lights_at_once as usize) {
                for first_point in (0..points).step_by(points_at_once as usize) {
                    let of_part = GatherSettings {
                        first_light,
                        end_light: (first_light + lights_at_once).min(lights),
                        first_point,
                        end_point: (first_point + points_at_once).min(points),
                        is_brief: receiver.is_brief.into(),
                        ..*settings
                    };
                    let count = of_part.end_point - first_point;
                    let of_part = gpu.constant("shadow settings", &of_part)?;
                    let more = join(&maps, &[("settings", &of_part)]);
                    self.gather.run(gpu, pass, scene, receiver, &more, count)?;
                }
            }
            Ok(())
        })
    }
}
