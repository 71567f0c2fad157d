//! Iterates by shooting: texels chosen by their power shoot the power of all texels through their hemicubes.

use super::solution::ForStep;
use crate::capture::depth::{DepthAtlas, DepthKernels, DepthViewSpec};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions};
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
    aimed: wgpu::BindGroup,
    pieces: Vec<PieceGroups>,
    seen: wgpu::BindGroup,
}

#[derive(Debug)]
struct PieceGroups {
    count: u32,
    receive: wgpu::BindGroup,
    /// By the index of the buffer that holds the last iterate.
    receive_texels: [wgpu::BindGroup; 2],
}

impl Shooting {
    /// The first texels of `chosen` shoot; `steps`: the inputs of each piece's passes.
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        batch: Batch,
        chosen: &wgpu::Buffer,
        iterates: &[wgpu::Buffer; 2],
        steps: &[ForStep<'_>],
    ) -> Result<Self, GpuError> {
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
        let aim = Kernel::new(gpu, &aim, "main", None)?;
        let receive = shader!("techniques.radiosity.receive");
        let constants = [("HAS_TRANSMITTANCE", depth.has_transmittance().into())];
        let options = KernelOptions {
            constants: &constants,
            ..Default::default()
        };
        let receive = Kernel::with_options(gpu, &receive, "main", None, &options)?;
        let bytes = u64::from(shooters) * size_of::<LightSample>() as u64;
        let samples = gpu.buffer("shooters [bytes]", bytes, wgpu::BufferUsages::STORAGE)?;
        let inner = (side - 2 * GUTTER) as f32;
        let kept = (side / 2 + GUTTER) as f32 / side as f32;
        let hemicube = [side as f32 / inner, kept, 0.0, 0.0_f32];
        let hemicube = gpu.uniform("hemicube", &hemicube)?;
        let resources = [
            ("chosen_texels", chosen.as_entire_binding()),
            ("shooters", samples.as_entire_binding()),
            ("views", atlas.views.as_entire_binding()),
            ("hemicube", hemicube.as_entire_binding()),
        ];
        let aimed = aim.bind(gpu, 1, &resources)?;
        let comparison = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("hemicube comparison"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            compare: Some(wgpu::CompareFunction::GreaterEqual),
            ..Default::default()
        });
        let texels = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("hemicube texels"),
            ..Default::default()
        });
        let resources = [
            (
                "depth_atlas",
                wgpu::BindingResource::TextureView(&atlas.view),
            ),
            (
                "depth_comparison",
                wgpu::BindingResource::Sampler(&comparison),
            ),
            ("views", atlas.views.as_entire_binding()),
            ("shooters", samples.as_entire_binding()),
            (
                "hemicube_transmittance",
                wgpu::BindingResource::TextureView(atlas.transmittance()),
            ),
            (
                "texels_unfilterable",
                wgpu::BindingResource::Sampler(&texels),
            ),
        ];
        let seen = receive.bind(gpu, 2, &resources)?;
        let piece = |step: &ForStep<'_>| {
            let with_direct = [
                ("work", step.work.as_entire_binding()),
                ("points", step.points.as_entire_binding()),
                ("direct", step.direct.as_entire_binding()),
            ];
            let receive_of = |last: usize| {
                let resources = [
                    ("before", iterates[last].as_entire_binding()),
                    ("after", iterates[1 - last].as_entire_binding()),
                ];
                receive.bind(gpu, 3, &resources)
            };
            Ok(PieceGroups {
                count: step.count,
                receive: receive.bind(gpu, 1, &with_direct)?,
                receive_texels: [receive_of(0)?, receive_of(1)?],
            })
        };
        Ok(Self {
            bytes: atlas.bytes() + atlas.views.size() + samples.size(),
            pieces: steps.iter().map(piece).collect::<Result<_, GpuError>>()?,
            batch,
            depth,
            atlas,
            aim,
            receive,
            aimed,
            seen,
        })
    }

    /// Computes one iterate by shooting from the chosen texels: passes `radiosity.hemicubes` and `radiosity.receive`.
    /// `last`: index of the buffer that holds the previous iterate.
    pub fn iterate(&self, frame: &mut Frame<'_>, scene: &GpuScene, last: usize) {
        let name = "radiosity.hemicubes";
        frame.compute(name, |pass| {
            let count = [self.batch.shooters, 1, 1];
            self.aim.dispatch(pass, &[(1, &self.aimed)], count);
        });
        self.atlas.record(frame, name, &self.depth, scene.casters());
        frame.compute("radiosity.receive", |pass| {
            for piece in &self.pieces {
                let groups = [
                    (1, &piece.receive),
                    (2, &self.seen),
                    (3, &piece.receive_texels[last]),
                ];
                self.receive.dispatch(pass, &groups, [piece.count, 1, 1]);
            }
        });
    }
}
