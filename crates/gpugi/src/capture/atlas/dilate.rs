//! Fills the empty texels of images of an atlas, so that filters and downsampling read no black.

use bytemuck::{Pod, Zeroable};

use crate::capture::Target;
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::shader;

/// `Levels` of capture/atlas/dilate.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct LevelsUniform {
    pub fine: u32,
    pub coarse: u32,
    pub fine_size: [u32; 2],
    pub coarse_size: [u32; 2],
    pub padding: [u32; 2],
}

/// Fills images of one size.
#[derive(Debug)]
pub struct Dilation {
    load: Kernel,
    pull: Kernel,
    push: Kernel,
    store: Kernel,
    levels: wgpu::Buffer,
    /// Pairs of adjacent levels, the finest first.
    two: Vec<(LevelsUniform, wgpu::Buffer)>,
}

impl Dilation {
    /// For images of `size` texels: those of a piece of an atlas ([`super::AtlasPiece`]), or of a page.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the adapter cannot hold four thirds of an image.
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let shader = shader!("capture.atlas.dilate");
        let kernel = |entry| Kernel::new(gpu, &shader, entry, None);
        let mut two = Vec::new();
        let mut fine = LevelsUniform {
            coarse: size[0] * size[1],
            fine_size: size,
            coarse_size: size.map(|side| side.div_ceil(2)),
            ..Zeroable::zeroed()
        };
        loop {
            two.push((fine, gpu.uniform("levels", &fine)?));
            let [width, height] = fine.coarse_size;
            if width <= 1 && height <= 1 {
                break;
            }
            fine = LevelsUniform {
                fine: fine.coarse,
                coarse: fine.coarse + width * height,
                fine_size: fine.coarse_size,
                coarse_size: fine.coarse_size.map(|side| side.div_ceil(2)),
                ..fine
            };
        }
        let texels = u64::from(fine.coarse) + 1;
        Ok(Self {
            load: kernel("load")?,
            pull: kernel("pull")?,
            push: kernel("push")?,
            store: kernel("store")?,
            levels: gpu.buffer(
                "levels of an image [bytes]",
                texels * 16,
                wgpu::BufferUsages::STORAGE,
            )?,
            two,
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
        let bind = |kernel: &Kernel, two: &wgpu::Buffer| {
            let resources = [
                ("two", two.as_entire_binding()),
                ("levels", self.levels.as_entire_binding()),
                ("image", image.radiance.as_entire_binding()),
            ];
            kernel.bind(gpu, 0, &resources)
        };
        let texels = |[width, height]: [u32; 2]| [width * height, 1, 1];
        let down = self
            .two
            .iter()
            .rev()
            .map(|two| (&self.push, two, two.0.fine_size));
        let up = self
            .two
            .iter()
            .map(|two| (&self.pull, two, two.0.coarse_size));
        let ends = [&self.load, &self.store].map(|kernel| {
            let two = &self.two[0];
            (kernel, two, two.0.fine_size)
        });
        let [first, last] = ends;
        for (kernel, two, size) in [first].into_iter().chain(up).chain(down).chain([last]) {
            let group = bind(kernel, &two.1)?;
            frame.compute("capture.atlas.dilate", |pass| {
                kernel.dispatch(pass, &[(0, &group)], texels(size));
            });
        }
        Ok(())
    }
}
