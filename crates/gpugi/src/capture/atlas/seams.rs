//! Smooths seams of images that stay on the GPU and are refined from frame to frame. Seams of a bake's output are
//! solved on the host, to convergence ([`Seams::smooth`]).

use bytemuck::{Pod, Zeroable};
use gpugi_scene::atlas::Seams;

use crate::capture::Target;
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::shader;

/// After this many iterations, a twentieth of the difference remains.
const ITERATIONS: u32 = 6;

/// `Sample` of capture/atlas/seams.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct SampleRow {
    pub texels: [u32; 8],
    pub weights: [f32; 8],
}

/// `Beside` of capture/atlas/seams.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct BesideRow {
    pub texel: u32,
    pub first: u32,
    pub end: u32,
    pub weight: f32,
}

/// `Term` of capture/atlas/seams.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct TermRow {
    pub index: u32,
    pub weight: f32,
}

/// Makes both sides of seams agree.
#[derive(Debug)]
pub(crate) struct SeamFilter {
    /// Passes and their numbers of items; empty where there are no seams.
    passes: Vec<(Kernel, wgpu::BindGroup, u32)>,
    /// Bytes of all buffers.
    pub bytes: u64,
}

impl SeamFilter {
    /// For one image of all pages of the atlas to which `seams` belong.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, seams: &Seams, image: &Target) -> Result<Self, GpuError> {
        if seams.is_empty() {
            return Ok(Self {
                passes: Vec::new(),
                bytes: 0,
            });
        }
        let samples: Vec<SampleRow> = seams
            .rows()
            .iter()
            .map(|row| SampleRow {
                texels: row.map(|(index, _)| seams.texels()[index as usize]),
                weights: row.map(|(_, weight)| weight),
            })
            .collect();
        let mut of_texels = vec![Vec::new(); seams.texels().len()];
        for (index, row) in (0..).zip(seams.rows()) {
            for &(texel, weight) in row.iter().filter(|(_, weight)| *weight != 0.0) {
                of_texels[texel as usize].push(TermRow { index, weight });
            }
        }
        let mut terms = Vec::new();
        let mut beside = Vec::new();
        for (&texel, of_texel) in seams.texels().iter().zip(&of_texels) {
            let first = terms.len() as u32;
            terms.extend_from_slice(of_texel);
            beside.push(BesideRow {
                texel,
                first,
                end: terms.len() as u32,
                weight: of_texel.iter().map(|term| term.weight.abs()).sum(),
            });
        }
        let counts = [samples.len() as u32, beside.len() as u32];
        let samples = gpu.storage("samples of seams [bytes]", &samples)?;
        let beside = gpu.storage("texels beside seams [bytes]", &beside)?;
        let terms = gpu.storage("terms of seams [bytes]", &terms)?;
        let storage = wgpu::BufferUsages::STORAGE;
        let bytes = u64::from(counts[0]) * 16;
        let differences = gpu.buffer("differences across seams [bytes]", bytes, storage)?;
        let resources = [
            ("samples", samples.as_entire_binding()),
            ("beside", beside.as_entire_binding()),
            ("terms", terms.as_entire_binding()),
            ("differences", differences.as_entire_binding()),
            ("image", image.radiance.as_entire_binding()),
        ];
        let shader = shader!("capture.atlas.seams");
        let pass = |(entry, count): (&str, u32)| {
            let kernel = Kernel::new(gpu, &shader, entry, None)?;
            let group = kernel.bind(gpu, 0, &resources)?;
            Ok((kernel, group, count))
        };
        let passes = ["differ", "correct"].into_iter().zip(counts);
        Ok(Self {
            passes: passes.map(pass).collect::<Result<_, GpuError>>()?,
            bytes: bytes + samples.size() + beside.size() + terms.size(),
        })
    }

    /// Changes the texels beside seams: pass `capture.atlas.seams`.
    pub fn record(&self, frame: &mut Frame<'_>) {
        if self.passes.is_empty() {
            return;
        }
        frame.compute("capture.atlas.seams", |pass| {
            for _ in 0..ITERATIONS {
                for (kernel, group, count) in &self.passes {
                    kernel.dispatch(pass, &[(0, group)], [*count, 1, 1]);
                }
            }
        });
    }
}
