//! Smooths seams of images that stay on the GPU and are refined from frame to frame. Seams of a bake's output are
//! solved on the host, to convergence ([`Seams::smooth`]).

use bytemuck::{Pod, Zeroable};
use gpugi_scene::atlas::Seams;

use crate::capture::Target;
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions};
use crate::shader;

/// Where iterations read and write: the image, then both halves of `values` in turn. `READ` and `WRITTEN` of
/// capture/atlas/seams.wesl.
const STEPS: [[u32; 2]; 4] = [[IMAGE, 0], [0, 1], [1, 0], [0, IMAGE]];

/// The steps of all iterations, after which a twentieth of the difference remains.
const ITERATIONS: [usize; 6] = [0, 1, 2, 1, 2, 3];

/// `Beside` of capture/atlas/seams.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct BesideRow {
    pub texel: u32,
    pub first: u32,
    pub end: u32,
}

/// `Entry` of capture/atlas/seams.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct EntryRow {
    pub column: u32,
    pub value: f32,
}

/// `SHARING` of capture/atlas/seams.wesl.
const SHARING: u32 = 8;

/// `IMAGE` of capture/atlas/seams.wesl.
const IMAGE: u32 = 2;

/// Makes both sides of seams agree.
#[derive(Debug)]
pub(crate) struct SeamFilter {
    /// One per step; none where there are no seams.
    steps: Vec<(Kernel, wgpu::BindGroup)>,
    /// Texels beside seams.
    count: u32,
    /// Bytes of all buffers.
    pub bytes: u64,
}

/// The rows of A of capture/atlas/seams.wesl, one per texel beside seams.
fn matrix(seams: &Seams) -> Vec<Vec<EntryRow>> {
    let mut samples_of = vec![Vec::new(); seams.texels().len()];
    for (number, sample) in seams.rows().iter().enumerate() {
        for &(texel, weight) in sample.iter().filter(|(_, weight)| *weight != 0.0) {
            samples_of[texel as usize].push((number, weight));
        }
    }
    let row = |samples: Vec<(usize, f32)>| {
        let of_column: f32 = samples.iter().map(|(_, weight)| weight.abs()).sum();
        let mut row: Vec<EntryRow> = Vec::new();
        for (sample, weight) in samples {
            // The weights of each side sum to 1, so |J| sums to 2 over a row of J.
            let factor = weight / (2.0 * of_column);
            for &(column, weight) in &seams.rows()[sample] {
                let value = factor * weight;
                match row.iter_mut().find(|entry| entry.column == column) {
                    Some(entry) => entry.value += value,
                    None if value != 0.0 => row.push(EntryRow { column, value }),
                    None => {}
                }
            }
        }
        row
    };
    samples_of.into_iter().map(row).collect()
}

impl SeamFilter {
    /// For one image of all pages of the atlas to which `seams` belong.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, seams: &Seams, image: &Target) -> Result<Self, GpuError> {
        if seams.is_empty() {
            return Ok(Self {
                steps: Vec::new(),
                count: 0,
                bytes: 0,
            });
        }
        let rows = matrix(seams);
        let mut end = 0;
        let of_row = |(&texel, row): (&u32, &Vec<EntryRow>)| {
            let first = end;
            end += row.len() as u32;
            BesideRow { texel, first, end }
        };
        let beside: Vec<BesideRow> = seams.texels().iter().zip(&rows).map(of_row).collect();
        let count = beside.len() as u32;
        let beside = gpu.storage("texels beside seams [bytes]", &beside)?;
        let entries = gpu.storage("matrix of seams [bytes]", &rows.concat())?;
        let values = gpu.buffer(
            "texels beside seams, twice [bytes]",
            u64::from(count) * 32,
            wgpu::BufferUsages::STORAGE,
        )?;
        let resources = [
            ("beside", beside.as_entire_binding()),
            ("entries", entries.as_entire_binding()),
            ("values", values.as_entire_binding()),
            ("image", image.radiance.as_entire_binding()),
        ];
        let shader = shader!("capture.atlas.seams");
        let step = |[read, written]: [u32; 2]| {
            let options = KernelOptions {
                constants: &[("READ", read.into()), ("WRITTEN", written.into())],
                ..Default::default()
            };
            let kernel = Kernel::with_options(gpu, &shader, "main", None, &options)?;
            let group = kernel.bind(gpu, 0, &resources)?;
            Ok((kernel, group))
        };
        Ok(Self {
            steps: STEPS
                .into_iter()
                .map(step)
                .collect::<Result<_, GpuError>>()?,
            count,
            bytes: beside.size() + entries.size() + values.size(),
        })
    }

    /// Changes the texels beside seams: pass `capture.atlas.seams`.
    pub fn record(&self, frame: &mut Frame<'_>) {
        if self.steps.is_empty() {
            return;
        }
        frame.compute("capture.atlas.seams", |pass| {
            for (kernel, group) in ITERATIONS.map(|step| &self.steps[step]) {
                kernel.dispatch(pass, &[(0, group)], [SHARING * self.count, 1, 1]);
            }
        });
    }
}
