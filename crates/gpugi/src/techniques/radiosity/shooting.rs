//! Iterates by shooting: texels chosen by their power shoot the power of all texels through their hemicubes.

use crate::capture::depth::{DepthAtlas, DepthKernels, DepthViewSpec};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, join};
use crate::lights::gpu::LightSample;
use crate::scene::GpuScene;
use crate::shader;
use glam::{Mat4, Vec3};

/// Texels by which faces extend beyond their field of view: one comparison reads four.
const GUTTER: u32 = 2;

/// Number and resolution of shooters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Batch {
    /// Texels that shoot per iterate.
    pub shooters: u32,
    /// Side of their hemicubes (texels).
    pub side: u32,
}

/// Shooters, and their hemicubes.
#[derive(Debug)]
pub(super) struct Shooting {
    pub batch: Batch,
    /// Bytes of buffers and of the hemicubes' depth.
    pub bytes: u64,
    depth: DepthKernels,
    atlas: DepthAtlas,
    aim: Kernel,
    receive: Kernel,
    samples: wgpu::Buffer,
    /// How texels of a hemicube lie: `hemicube` of hemicubes.wesl.
    hemicube: wgpu::Buffer,
    comparison: wgpu::Sampler,
    texels: wgpu::Sampler,
}

impl Shooting {
    /// Room for the shooters of a batch.
    pub fn new(gpu: &Gpu, scene: &GpuScene, batch: Batch) -> Result<Self, GpuError> {
        let Batch { shooters, side } = batch;
        let depth = DepthKernels::of_lamps(gpu, scene)?;
        let near = scene.near();
        let hemicube = DepthViewSpec::hemicube(Vec3::ZERO, Vec3::Z, Vec3::X, near, side, GUTTER);
        // The GPU sets the views, so the host cannot cull.
        let unseen = hemicube.map(|face| DepthViewSpec {
            clip_from_world: Mat4::ZERO,
            ..face
        });
        let specs = (0..shooters).flat_map(|_| unseen).collect();
        let atlas = DepthAtlas::new(gpu, &depth, specs)?;
        let aim = shader!("techniques.radiosity.hemicubes");
        let receive = shader!("techniques.radiosity.receive");
        let constants = [("HAS_TRANSMITTANCE", depth.has_transmittance().into())];
        let bytes = u64::from(shooters) * size_of::<LightSample>() as u64;
        let samples = gpu.room("shooters [bytes]", bytes)?;
        let inner = (side - 2 * GUTTER) as f32;
        let kept = (side / 2 + GUTTER) as f32 / side as f32;
        let hemicube = [side as f32 / inner, kept, 0.0, 0.0_f32];
        Ok(Self {
            bytes: atlas.bytes() + atlas.views.size() + samples.size(),
            batch,
            depth,
            atlas,
            aim: Kernel::new(gpu, &aim, "main", None)?,
            receive: Kernel::with_constants(gpu, &receive, "main", None, &constants)?,
            samples,
            hemicube: gpu.uniform("hemicube", &hemicube)?,
            comparison: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("hemicube comparison"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                compare: Some(wgpu::CompareFunction::GreaterEqual),
                ..Default::default()
            }),
            texels: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("hemicube texels"),
                ..Default::default()
            }),
        })
    }

    /// Computes one iterate by shooting from the chosen texels: passes `radiosity.hemicubes` and `radiosity.receive`.
    pub fn iterate(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        pieces: &[(u32, [Named<'_>; 8])],
    ) -> Result<(), GpuError> {
        let Some((_, first)) = pieces.first() else {
            return Ok(());
        };
        let own: [Named<'_>; 7] = [
            ("shooters", &self.samples),
            ("views", &self.atlas.views),
            ("hemicube", &self.hemicube),
            ("depth_atlas", &self.atlas.view),
            ("depth_comparison", &self.comparison),
            ("hemicube_transmittance", self.atlas.transmittance()),
            ("texels_unfilterable", &self.texels),
        ];
        let (name, shooters) = ("radiosity.hemicubes", [self.batch.shooters, 1, 1]);
        frame.run(name, &self.aim, None, &join(first, &own), shooters)?;
        self.atlas.record(frame, name, &self.depth, scene.casters());
        frame.compute("radiosity.receive", |pass| {
            pieces.iter().try_for_each(|(count, of_piece)| {
                let resources = join(of_piece, &own);
                self.receive.run(pass, None, &resources, [*count, 1, 1])
            })
        })
    }
}
