//! Fills the empty texels of images of an atlas, so that filters and downsampling read no black.

use bytemuck::{Pod, Zeroable};

use crate::capture::Target;
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::shader;

/// `Levels` of capture/atlas/dilate.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct LevelsUniform {
    pub starts: [u32; 4],
    pub size: [u32; 2],
    pub padding: [u32; 2],
}

/// `BLOCK` of capture/atlas/dilate.wesl.
const BLOCK: u32 = 8;

/// Lanes of a workgroup with one lane per texel of a block.
const LANES: u32 = BLOCK * BLOCK;

/// Lanes of the workgroup that fills the top of the pyramid.
const TOP_LANES: u32 = 256;

/// Most texels of the level at which the top begins.
const TOP_TEXELS: u32 = 32 * 32;

/// Fills images of one size.
#[derive(Debug)]
pub struct Dilation {
    load: Kernel,
    pull: Kernel,
    top: Kernel,
    push: Kernel,
    store: Kernel,
    levels: wgpu::Buffer,
    /// Four adjacent levels each, the finest first; the coarsest of each four is the finest of the next.
    fours: Vec<(LevelsUniform, wgpu::Buffer)>,
}

impl Dilation {
    /// For images of `size` texels: those of a piece of an atlas ([`super::AtlasPiece`]), or of a page.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the adapter cannot hold four thirds of an image.
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let shader = shader!("capture.atlas.dilate");
        let kernel = |entry| Kernel::new(gpu, &shader, entry, None);
        let texels = |size: [u32; 2]| size[0] * size[1];
        let above = |size: [u32; 2]| size.map(|side| side.div_ceil(2));
        let mut fours = Vec::new();
        let (mut start, mut finest) = (0, size);
        loop {
            let mut starts = [start; 4];
            let mut level = finest;
            for k in 1..4 {
                starts[k] = starts[k - 1] + texels(level);
                level = above(level);
            }
            let four = LevelsUniform {
                starts,
                size: finest,
                padding: [0; 2],
            };
            fours.push((four, gpu.uniform("levels", &four)?));
            (start, finest) = (starts[3], level);
            if texels(level) <= TOP_TEXELS {
                break;
            }
        }
        let mut end = u64::from(start) + u64::from(texels(finest));
        while finest.iter().any(|side| *side > 1) {
            finest = above(finest);
            end += u64::from(texels(finest));
        }
        Ok(Self {
            load: kernel("load")?,
            pull: kernel("pull")?,
            top: kernel("top")?,
            push: kernel("push")?,
            store: kernel("store")?,
            levels: gpu.buffer(
                "levels of an image [bytes]",
                end * 16,
                wgpu::BufferUsages::STORAGE,
            )?,
            fours,
        })
    }

    /// Bytes of the levels.
    pub fn bytes(&self) -> u64 {
        self.levels.size()
    }

    /// Fills every texel of `image` whose a is 0 with a mean of the texels around it, and 1 in a; the others are kept.
    /// Pass `capture.atlas.dilate`. An image in which all texels are empty stays black.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn record(&self, frame: &mut Frame<'_>, image: &Target) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let bind = |kernel: &Kernel, four: &wgpu::Buffer| {
            let resources = [
                ("four", four.as_entire_binding()),
                ("levels", self.levels.as_entire_binding()),
                ("image", image.radiance.as_entire_binding()),
            ];
            kernel.bind(gpu, 0, &resources)
        };
        let (first, others) = (&self.fours[0], &self.fours[1..]);
        let up = others.iter().map(|four| (&self.pull, four));
        let down = others.iter().rev().map(|four| (&self.push, four));
        let last = self.fours.last().map(|four| (&self.top, four));
        let all = [(&self.load, first)].into_iter().chain(up).chain(last);
        let all = all.chain(down).chain([(&self.store, first)]);
        let steps: Vec<_> = all
            .map(|(kernel, (four, buffer))| {
                let [columns, rows] = four.size.map(|side| side.div_ceil(BLOCK));
                let lanes = match std::ptr::eq(kernel, &self.top) {
                    true => [TOP_LANES, 1, 1],
                    false => [columns * LANES, rows, 1],
                };
                Ok((kernel, bind(kernel, buffer)?, lanes))
            })
            .collect::<Result<_, GpuError>>()?;
        frame.compute("capture.atlas.dilate", |pass| {
            for (kernel, group, lanes) in &steps {
                kernel.dispatch(pass, &[(0, group)], *lanes);
            }
        });
        Ok(())
    }
}
