//! Light samples with depth maps, and the gather over them.

use crate::capture::depth::{DepthAtlas, DepthKernels, DepthViewSpec};
use crate::capture::{PerReceiver, Receiver};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::scene::GpuScene;
use crate::shader;

use super::gpu::{GatherRange, GatherSettings, LightSample};

/// Light x point x comparison products that one dispatch may hold: about 100 ms on a slow GPU.
const DISPATCH_WORK: u64 = 1 << 27;

/// Light samples, their depth maps in one atlas, and the pass that gathers them.
#[derive(Debug)]
pub struct Shadows {
    kernels: DepthKernels,
    gather: Kernel,
    comparison: wgpu::Sampler,
    made: Option<Made>,
    bound: PerReceiver<Bound>,
}

/// What a set of lights needs.
#[derive(Debug)]
struct Made {
    atlas: DepthAtlas,
    samples: wgpu::Buffer,
    group: wgpu::BindGroup,
    light_count: u32,
    settings: GatherSettings,
}

/// Bind groups for one set of points and one target.
#[derive(Debug)]
struct Bound {
    group: wgpu::BindGroup,
    chunks: Vec<(u32, wgpu::BindGroup)>,
}

impl Shadows {
    /// Compiles the passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        Ok(Self {
            kernels: DepthKernels::new(gpu, scene)?,
            gather: Kernel::new(
                gpu,
                &shader!("techniques.shadow_map.gather"),
                "main",
                Some(&scene.layout),
            )?,
            comparison: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("shadow comparison"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                // Lit where the point is at least as near as what the map holds.
                compare: Some(wgpu::CompareFunction::GreaterEqual),
                ..Default::default()
            }),
            made: None,
            bound: PerReceiver::default(),
        })
    }

    /// Renders depth for `views` and keeps `lights` for the gather.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the views do not fit one atlas.
    pub fn generate(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        pass: &str,
        lights: &[LightSample],
        views: Vec<DepthViewSpec>,
        settings: &GatherSettings,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        if lights.is_empty() {
            self.made = None;
            self.bound.clear();
            return Ok(());
        }
        // A light that moved needs no new tiles: only what they see changes.
        let reused = self.made.as_mut().is_some_and(|made| {
            made.light_count as usize == lights.len()
                && made.settings == *settings
                && made.atlas.update(gpu, &views)
        });
        if !reused {
            self.bound.clear();
            self.made = Some(self.make(gpu, lights, views, settings)?);
        }
        if let Some(made) = &self.made {
            gpu.queue
                .write_buffer(&made.samples, 0, bytemuck::cast_slice(lights));
            made.atlas
                .record(frame, pass, &self.kernels, scene.casters());
        }
        Ok(())
    }

    fn make(
        &self,
        gpu: &Gpu,
        lights: &[LightSample],
        views: Vec<DepthViewSpec>,
        settings: &GatherSettings,
    ) -> Result<Made, GpuError> {
        let atlas = DepthAtlas::new(gpu, &self.kernels, views)?;
        let samples = gpu.storage("light samples [bytes]", lights)?;
        let settings_buffer = gpu.uniform("shadow settings", settings)?;
        let group = self.gather.bind(
            gpu,
            2,
            &[
                (
                    "shadow_atlas",
                    wgpu::BindingResource::TextureView(&atlas.view),
                ),
                (
                    "shadow_comparison",
                    wgpu::BindingResource::Sampler(&self.comparison),
                ),
                ("shadow_views", atlas.views.as_entire_binding()),
                ("light_samples", samples.as_entire_binding()),
                ("settings", settings_buffer.as_entire_binding()),
            ],
        )?;
        Ok(Made {
            atlas,
            samples,
            group,
            light_count: lights.len() as u32,
            settings: *settings,
        })
    }

    /// The depth atlas, once generated.
    pub fn atlas(&self) -> Option<&DepthAtlas> {
        self.made.as_ref().map(|made| &made.atlas)
    }

    /// Adds the light of every sample.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        pass: &str,
        receiver: &Receiver,
    ) -> Result<(), GpuError> {
        let Some(made) = &self.made else {
            return Ok(());
        };
        let (gpu, gather) = (frame.gpu, &self.gather);
        let bound = self.bound.of(receiver, || {
            let settings = &made.settings;
            let taps = if settings.kind == 0 {
                1
            } else {
                settings.taps.max(settings.area_taps)
            };
            bind(gpu, gather, receiver, made.light_count, taps)
        })?;
        frame.compute(pass, |compute| {
            for (count, range) in &bound.chunks {
                let groups = [
                    (0, &scene.bind_group),
                    (1, &bound.group),
                    (2, &made.group),
                    (3, range),
                ];
                gather.dispatch(compute, &groups, [*count, 1, 1]);
            }
        });
        Ok(())
    }
}

/// Cuts points x lights into dispatches short enough for any driver's watchdog.
fn bind(
    gpu: &Gpu,
    gather: &Kernel,
    receiver: &Receiver,
    light_count: u32,
    taps: u32,
) -> Result<Bound, GpuError> {
    let Receiver { points, target } = receiver;
    let group = points.bind(gpu, gather)?;
    let per_light = u64::from(points.count) * u64::from(taps);
    let lights_at_once = (DISPATCH_WORK / per_light.max(1)).clamp(1, u64::from(light_count)) as u32;
    let points_at_once = (DISPATCH_WORK / u64::from(taps))
        .min(u64::from(points.count))
        .max(1) as u32;
    let mut chunks = Vec::new();
    for first_light in (0..light_count).step_by(lights_at_once as usize) {
        for first_point in (0..points.count).step_by(points_at_once as usize) {
            let range = GatherRange {
                first_light,
                end_light: (first_light + lights_at_once).min(light_count),
                first_point,
                end_point: (first_point + points_at_once).min(points.count),
            };
            let buffer = gpu.storage("gather range", &[range])?;
            let chunk = gather.bind(
                gpu,
                3,
                &[
                    ("range", buffer.as_entire_binding()),
                    ("radiance", target.radiance.as_entire_binding()),
                ],
            )?;
            chunks.push((range.end_point - first_point, chunk));
        }
    }
    Ok(Bound { group, chunks })
}
