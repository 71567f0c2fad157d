//! The area lights of all reference points, and the passes that write and read them.

use wgpu::BindingResource::TextureView;

use super::gpu;
use super::places::Places;
use super::settings::{Settings, Visibility};
use crate::capture::{Gather, Output, PerReceiver, Receiver, SurfacePoints, Target};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions};
use crate::scene::GpuScene;
use crate::shader;
use crate::techniques::Earlier;

/// Invocations that sum for one light: LANES of bounce.wesl.
const BOUNCE_LANES: u32 = 32;

/// The passes, for one choice of settings.
#[derive(Debug)]
pub struct Kernels {
    downsample: Kernel,
    state: Kernel,
    /// Makes lights of objects' own surfaces.
    pub own: Kernel,
    bounce: Kernel,
    light_points: Kernel,
    pub gather: Gather,
}

impl Kernels {
    /// Compiles the passes. `has_own`: whether objects' own surfaces are lights.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        settings: &Settings,
        has_own: bool,
    ) -> Result<Self, GpuError> {
        let layout = Some(&scene.layout);
        let flag = |is_on: bool| f64::from(u8::from(is_on));
        let solid_angle = ("SOLID_ANGLE", f64::from(settings.solid_angle as u8));
        let visibility = ("VISIBILITY", f64::from(settings.visibility as u8));
        let glossy = ("GLOSSY", flag(settings.glossy));
        let has_own = ("OWN", flag(has_own));
        let media = scene.media_constant();
        let kernel = |shader, entry, constants| {
            let options = KernelOptions {
                constants,
                ..Default::default()
            };
            Kernel::with_options(gpu, shader, entry, layout, &options)
        };
        let downsample = shader!("techniques.final_gather.downsample");
        let bounce = shader!("techniques.final_gather.bounce");
        let light_points = shader!("techniques.final_gather.light_points");
        let gather = [
            solid_angle,
            visibility,
            has_own,
            glossy,
            ("DRAWN", f64::from(settings.blend as u8)),
            ("NORMALIZE", flag(settings.normalize)),
            ("LOCALIZE", flag(settings.localize)),
            ("OCCLUSION", flag(settings.occlusion)),
            media,
        ];
        let shader = shader!("techniques.final_gather.gather");
        Ok(Self {
            downsample: kernel(&downsample, "main", &[solid_angle])?,
            state: kernel(&downsample, "state", &[solid_angle])?,
            own: kernel(&shader!("techniques.final_gather.own"), "main", &[glossy])?,
            bounce: kernel(&bounce, "main", &[solid_angle, visibility, has_own, media])?,
            light_points: kernel(&light_points, "main", &[])?,
            // Every index in range: that of a point ends at the view's last; those of reference points, lights and
            // texels are clamped to counts by which their buffers and the map were made. The exception is obscurances,
            // which may not be there yet.
            gather: Gather::with_options(
                gpu,
                scene,
                &shader,
                &KernelOptions {
                    constants: &gather,
                    unchecked: !settings.occlusion,
                },
            )?,
        })
    }
}

/// The lights on the GPU.
#[derive(Debug)]
pub struct Maps {
    pub probes: gpu::Probes,
    pub lights: wgpu::Buffer,
    pub sources: wgpu::Buffer,
    /// Ways out of solids (m), four floats per reference point.
    pub ways_out: wgpu::Buffer,
    /// Distance cubes of all reference points, side by side; one texel where nothing asks for them.
    pub distances: wgpu::Texture,
    /// Bind group 2 of the gather, and the obscurances in it.
    gathered: (wgpu::BindGroup, wgpu::Buffer),
    uniform: wgpu::Buffer,
    bounced: [wgpu::BindGroup; 2],
    lit: [wgpu::BindGroup; 2],
}

impl Maps {
    /// Allocates the lights of the reference points that `probes` describes.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        kernels: &Kernels,
        settings: &Settings,
        probes: gpu::Probes,
    ) -> Result<Self, GpuError> {
        let count = u64::from(probes.count);
        let storage = wgpu::BufferUsages::STORAGE;
        let bytes = probes.light_bytes();
        let lights = gpu.buffer("final-gather.lights [bytes]", bytes, storage)?;
        let bytes = probes.source_bytes();
        let sources = gpu.buffer("final-gather.sources [bytes]", bytes, storage)?;
        let ways_out = gpu.buffer("final-gather.ways-out", 16 * count, storage)?;
        let cube = [6 * probes.resolution, probes.resolution];
        let [width, height] = match settings.visibility {
            Visibility::None => [1, 1],
            Visibility::Distance => [
                cube[0] * probes.cubes_per_row.min(probes.count),
                cube[1] * probes.count.div_ceil(probes.cubes_per_row),
            ],
        };
        let distances = gpu.texture(&wgpu::TextureDescriptor {
            label: Some("final-gather.distances"),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::R32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::STORAGE_BINDING
                | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        })?;
        let uniform = gpu.uniform("reference points", &probes)?;
        let view = distances.create_view(&Default::default());
        let read = read(&uniform, &lights, &view);
        // Nothing reads it.
        let obscurances = gpu.buffer("no obscurances", 16, storage)?;
        let of_gather = [("obscurances", obscurances.as_entire_binding())];
        let of_gather = [&read[..], &of_gather].concat();
        let gather = kernels.gather.kernel();
        let [bounce, light_points] = [&kernels.bounce, &kernels.light_points];
        let source = ("sources", sources.as_entire_binding());
        let probes_alone = [("probes", uniform.as_entire_binding())];
        let stored = [source.clone(), ("stored", lights.as_entire_binding())];
        Ok(Self {
            gathered: (gather.bind(gpu, 2, &of_gather)?, obscurances),
            bounced: [bounce.bind(gpu, 2, &read)?, bounce.bind(gpu, 3, &[source])?],
            lit: [
                light_points.bind(gpu, 2, &probes_alone)?,
                light_points.bind(gpu, 3, &stored)?,
            ],
            probes,
            uniform: uniform.clone(),
            lights,
            sources,
            ways_out,
            distances,
        })
    }

    /// Bind group 2 of the gather.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn gathered(
        &mut self,
        gpu: &Gpu,
        kernels: &Kernels,
        obscurances: Option<&wgpu::Buffer>,
    ) -> Result<&wgpu::BindGroup, GpuError> {
        if let Some(obscurances) = obscurances
            && self.gathered.1 != *obscurances
        {
            let view = self.distances.create_view(&Default::default());
            let read = read(&self.uniform, &self.lights, &view);
            let more = [("obscurances", obscurances.as_entire_binding())];
            let resources = [&read[..], &more].concat();
            let group = kernels.gather.kernel().bind(gpu, 2, &resources)?;
            self.gathered = (group, obscurances.clone());
        }
        Ok(&self.gathered.0)
    }

    /// Lights that one bounce looks up: each light those of one or eight reference points.
    pub fn lookups_of_bounce(&self) -> u64 {
        let of_point = 6 * u64::from(self.probes.side).pow(2);
        let points = if self.probes.places == Places::Grid as u32 {
            8
        } else {
            1
        };
        u64::from(self.probes.surfaces()) * of_point * points
    }

    /// Lets light bounce this often between all lights: pass `final-gather.bounce`.
    pub fn bounce(&self, frame: &mut Frame<'_>, scene: &GpuScene, kernels: &Kernels, times: u32) {
        let count = self.probes.surfaces();
        frame.compute("final-gather.bounce", |pass| {
            for _ in 0..times {
                for (kernel, [read, written], invocations) in [
                    (&kernels.bounce, &self.bounced, BOUNCE_LANES * count),
                    (&kernels.light_points, &self.lit, count),
                ] {
                    let groups = [(0, &scene.bind_group), (2, read), (3, written)];
                    kernel.dispatch(pass, &groups, [invocations, 1, 1]);
                }
            }
        });
    }
}

/// What passes that sum over lights read.
fn read<'a>(
    uniform: &'a wgpu::Buffer,
    lights: &'a wgpu::Buffer,
    distances: &'a wgpu::TextureView,
) -> [(&'static str, wgpu::BindingResource<'a>); 3] {
    [
        ("probes", uniform.as_entire_binding()),
        ("lights_of_points", lights.as_entire_binding()),
        ("distances_unfilterable", TextureView(distances)),
    ]
}

/// What it takes to light faces that were captured, and to downsample them.
#[derive(Debug)]
pub struct Bench {
    target: Target,
    /// What is to be made of the faces.
    pub work: wgpu::Buffer,
    written: wgpu::BindGroup,
    seen: PerReceiver<wgpu::BindGroup>,
}

impl Bench {
    /// A bench for cubes with faces of `side` x `side` texels.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, kernels: &Kernels, maps: &Maps, side: u32) -> Result<Self, GpuError> {
        let target = Target::new(gpu, 6 * side * side)?;
        let bytes = size_of::<gpu::Work>() as u64;
        let work = gpu.buffer("work", bytes, wgpu::BufferUsages::UNIFORM)?;
        let distances = maps.distances.create_view(&Default::default());
        let resources = [
            ("to_do", work.as_entire_binding()),
            ("radiance", target.radiance.as_entire_binding()),
            ("stored", maps.lights.as_entire_binding()),
            ("sources", maps.sources.as_entire_binding()),
            ("distances", TextureView(&distances)),
            ("ways_out", maps.ways_out.as_entire_binding()),
        ];
        Ok(Self {
            written: kernels.downsample.bind(gpu, 3, &resources)?,
            work,
            target,
            seen: PerReceiver::default(),
        })
    }

    /// Lights the points of some faces by the techniques before this one, and downsamples them: pass
    /// `final-gather.downsample`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn light(
        &mut self,
        frame: &mut Frame<'_>,
        making: Making<'_>,
        earlier: &mut Earlier<'_>,
        points: &SurfacePoints,
        work: &gpu::Work,
    ) -> Result<(), GpuError> {
        let Making { scene, kernels, .. } = making;
        let receiver = Receiver::new(points, &self.target);
        earlier.gather(frame, scene, &receiver, false)?;
        let gpu = frame.gpu;
        gpu.write(&self.work, 0, std::slice::from_ref(work));
        let seen = self
            .seen
            .of(&receiver, || points.bind(gpu, &kernels.downsample))?;
        let faces = points.count / (work.resolution * work.resolution);
        frame.compute("final-gather.downsample", |pass| {
            let groups = [(0, &scene.bind_group), (1, seen), (3, &self.written)];
            // A workgroup of 64 per light.
            let lights = [64 * work.side, work.side, faces];
            kernels.downsample.dispatch(pass, &groups, lights);
            kernels.state.dispatch(pass, &groups, [1, 1, 1]);
        });
        Ok(())
    }

    /// Bytes of the light of a cube's points.
    pub fn bytes(&self) -> u64 {
        self.target.radiance.size()
    }
}

/// Inputs shared by all cubes of a frame.
#[derive(Debug, Clone, Copy)]
pub struct Making<'a> {
    pub scene: &'a GpuScene,
    pub kernels: &'a Kernels,
    /// What the techniques before this one are asked for at the cubes' points.
    pub output: Output,
    /// What is the same for all cubes.
    pub work: gpu::Work,
}
