//! Visibility buffers that several small views share.

use super::hits::{HitKernels, Image, Matrices, depth_texture, hit_texture};
use super::{CaptureKernels, View};
use crate::gpu::{Frame, Gpu, GpuError};
use crate::scene::{Draw, DrawClass, GpuScene};

/// Square images in one visibility buffer: one render pass draws them all, which costs the host much less than a
/// capture of its own for each.
#[derive(Debug)]
pub struct HitImages {
    /// Hit records: the provoking merged vertex of each pixel's triangle; all ones where there is none.
    pub hits: wgpu::TextureView,
    /// Top left pixel of each image.
    pub corners: Vec<[u32; 2]>,
    /// Pixels per side of each image.
    pub sides: Vec<u32>,
    /// Pixels of the buffer.
    pub pixels: u64,
    depth: wgpu::TextureView,
    kernels: HitKernels,
    matrices: Matrices,
}

impl HitImages {
    /// Allocates images of `sides` pixels per side. Images of one size should follow each other: they share a grid.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] when the adapter cannot hold them.
    pub fn new(gpu: &Gpu, kernels: &CaptureKernels, sides: Vec<u32>) -> Result<Self, GpuError> {
        let (corners, size) = place(&sides);
        let view = |texture: wgpu::Texture| texture.create_view(&Default::default());
        let (read, unread) = (
            wgpu::TextureUsages::TEXTURE_BINDING,
            wgpu::TextureUsages::empty(),
        );
        Ok(Self {
            hits: view(hit_texture(gpu, size, read)?),
            depth: view(depth_texture(gpu, size, unread)?),
            matrices: Matrices::new(gpu, &kernels.hits, sides.len() as u32)?,
            kernels: kernels.hits.clone(),
            pixels: u64::from(size[0]) * u64::from(size[1]),
            corners,
            sides,
        })
    }

    /// Draws what each view sees into its image: pass `capture.hits`. Without any view nothing is drawn. `class_of`
    /// gives the class as which each draw is drawn.
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        views: &[Option<&View>],
        class_of: impl Fn(&Draw) -> DrawClass,
    ) {
        // The matrix of an image without a view does not matter.
        let Some(any) = views.iter().flatten().next() else {
            return;
        };
        let written = views.iter().map(|view| {
            let view = view.unwrap_or(any);
            (&view.clip_from_world, &view.uniform)
        });
        self.matrices.write(frame.gpu, written);
        frame.render("capture.hits", &[&self.hits], &self.depth, |pass| {
            let images = views.iter().enumerate().filter_map(|(index, view)| {
                let side = self.sides[index];
                Some(Image {
                    corner: self.corners[index],
                    size: [side, side],
                    clip_from_world: &view.as_ref()?.clip_from_world,
                    groups: &self.matrices.groups[index],
                })
            });
            let class_of = |draw: &Draw| Some(class_of(draw));
            self.kernels.draw(pass, scene, images, class_of);
        });
    }
}

/// The top left pixels of square images, and the size of the buffer that holds them: runs of equal images lie in square
/// grids, one below the other.
fn place(sides: &[u32]) -> (Vec<[u32; 2]>, [u32; 2]) {
    let mut corners = Vec::with_capacity(sides.len());
    let mut size = [1, 0];
    for run in sides.chunk_by(|a, b| a == b) {
        let (count, side) = (run.len() as u32, run[0]);
        let columns = f64::from(count).sqrt().ceil() as u32;
        let top = size[1];
        corners.extend((0..count).map(|n| [n % columns * side, top + n / columns * side]));
        size = [
            size[0].max(columns * side),
            top + count.div_ceil(columns) * side,
        ];
    }
    (corners, [size[0], size[1].max(1)])
}

#[cfg(test)]
mod tests {
    use super::place;

    #[test]
    fn images_lie_side_by_side_without_overlap() {
        let sides = [[8; 7].as_slice(), &[4; 10], &[8]].concat();
        let (corners, [width, height]) = place(&sides);
        let mut taken = vec![false; (width * height) as usize];
        for ([x, y], side) in corners.into_iter().zip(&sides) {
            for pixel in (0..side * side).map(|n| (y + n / side) * width + x + n % side) {
                assert!(x + side <= width && y + side <= height);
                assert!(!std::mem::replace(&mut taken[pixel as usize], true));
            }
        }
        assert_eq!([width, height], [24, 24 + 12 + 8]);
        // 256 points on lamps beside a light.
        let (_, size) = place(&[[2048].as_slice(), &[128; 256]].concat());
        assert_eq!(size, [2048, 4096]);
    }
}
