//! The area lights of all reference points, and the passes that write and read them.

use super::gpu;
use super::places::Places;
use super::settings::{Settings, Visibility};
use crate::capture::{Gather, Output, Receiver, SurfacePoints, Target};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions, Named};
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
            Kernel::with_constants(gpu, shader, entry, layout, constants)
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
    distances_view: wgpu::TextureView,
    uniform: wgpu::Buffer,
    /// Stands in for obscurances; nothing reads it.
    unattenuated: wgpu::Buffer,
}

impl Maps {
    /// Allocates the lights of the reference points that `probes` describes.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, settings: &Settings, probes: gpu::Probes) -> Result<Self, GpuError> {
        let count = u64::from(probes.count);
        let bytes = probes.light_bytes();
        let lights = gpu.room("final-gather.lights [bytes]", bytes)?;
        let bytes = probes.source_bytes();
        let sources = gpu.room("final-gather.sources [bytes]", bytes)?;
        let ways_out = gpu.room("final-gather.ways-out", 16 * count)?;
        let cube = [6 * probes.resolution, probes.resolution];
        let [width, height] = match settings.visibility {
            Visibility::None => [1, 1],
            Visibility::Distance => [
                cube[0] * probes.cubes_per_row.min(probes.count),
                cube[1] * probes.count.div_ceil(probes.cubes_per_row),
            ],
        };
        let distances = gpu.texture_2d(
            "final-gather.distances",
            [width, height, 1],
            wgpu::TextureFormat::R32Float,
            wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::STORAGE_BINDING
                | wgpu::TextureUsages::COPY_SRC,
        )?;
        Ok(Self {
            uniform: gpu.uniform("reference points", &probes)?,
            unattenuated: gpu.room("no obscurances", 16)?,
            distances_view: distances.create_view(&Default::default()),
            probes,
            lights,
            sources,
            ways_out,
            distances,
        })
    }

    /// What passes bind. Some write the lights and distances that others read.
    pub fn resources(&self) -> [Named<'_>; 8] {
        [
            ("probes", &self.uniform),
            ("lights_of_points", &self.lights),
            ("stored", &self.lights),
            ("sources", &self.sources),
            ("ways_out", &self.ways_out),
            ("distances", &self.distances_view),
            ("distances_unfilterable", &self.distances_view),
            ("obscurances", &self.unattenuated),
        ]
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
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn bounce(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        kernels: &Kernels,
        times: u32,
    ) -> Result<(), GpuError> {
        let (count, scene) = (self.probes.surfaces(), Some(&scene.bind_group));
        let resources = self.resources();
        frame.compute("final-gather.bounce", |pass| {
            for _ in 0..times {
                let lanes = [BOUNCE_LANES * count, 1, 1];
                kernels.bounce.run(pass, scene, &resources, lanes)?;
                let lights = [count, 1, 1];
                kernels.light_points.run(pass, scene, &resources, lights)?;
            }
            Ok(())
        })
    }
}

/// What it takes to light faces that were captured, and to downsample them.
#[derive(Debug)]
pub struct Bench(Target);

impl Bench {
    /// A bench for cubes with faces of `side` x `side` texels.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, side: u32) -> Result<Self, GpuError> {
        Target::new(gpu, 6 * side * side).map(Self)
    }

    /// Lights the points of some faces by the techniques before this one, and downsamples them: pass
    /// `final-gather.downsample`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn light(
        &self,
        frame: &mut Frame<'_>,
        making: FrameInputs<'_>,
        earlier: &mut Earlier<'_>,
        points: &SurfacePoints,
        work: &gpu::Work,
    ) -> Result<(), GpuError> {
        let FrameInputs {
            scene,
            kernels,
            maps,
            ..
        } = making;
        let receiver = Receiver::new(points, &self.0);
        earlier.gather(frame, scene, &receiver, false)?;
        let to_do = frame.gpu.constant("work", work)?;
        let own: [Named<'_>; 1] = [("to_do", &to_do)];
        let resources = [&receiver.resources()[..], &maps.resources(), &own].concat();
        let faces = points.count / (work.resolution * work.resolution);
        let scene = Some(&scene.bind_group);
        frame.compute("final-gather.downsample", |pass| {
            // A workgroup of 64 per light.
            let lights = [64 * work.side, work.side, faces];
            kernels.downsample.run(pass, scene, &resources, lights)?;
            kernels.state.run(pass, scene, &resources, [1, 1, 1])
        })
    }

    /// Bytes of the light of a cube's points.
    pub fn bytes(&self) -> u64 {
        self.0.radiance.size()
    }
}

/// Inputs shared by all cubes of a frame.
#[derive(Debug, Clone, Copy)]
pub struct FrameInputs<'a> {
    pub scene: &'a GpuScene,
    pub kernels: &'a Kernels,
    pub maps: &'a Maps,
    /// What the techniques before this one are asked for at the cubes' points.
    pub output: Output,
    /// What is the same for all cubes.
    pub work: gpu::Work,
}
