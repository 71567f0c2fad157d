//! The pyramid of least and greatest inverse depth over a distance cube, with which `shared/impostor.wesl` skips empty
//! space.

use wgpu::BindingResource::TextureView;

use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::shader;

/// Smallest side of a distance cube's faces (texels).
pub const LEAST_SIDE: u32 = 8;
/// Side of the pyramid's last level (cells).
const LAST_SIDE: u32 = 4;
/// Levels that one dispatch makes.
const LEVELS_AT_ONCE: usize = 3;
/// Least and greatest.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Float;

/// The passes of pyramids.
#[derive(Debug)]
pub struct PyramidKernels {
    first: Kernel,
    next: Kernel,
}

impl PyramidKernels {
    /// Compiles the passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let shader = shader!("capture.distance_pyramid");
        Ok(Self {
            first: Kernel::new(gpu, &shader, "first", None)?,
            next: Kernel::new(gpu, &shader, "next", None)?,
        })
    }
}

/// The pyramid of one distance cube.
#[derive(Debug)]
pub struct DistancePyramid {
    /// Least and greatest inverse depth of each cell (1/m), with as many layers as the distances. Levels go from half
    /// the cube's side down to four cells per side.
    pub texture: wgpu::Texture,
    steps: Vec<(Kernel, wgpu::BindGroup, u32)>,
}

impl DistancePyramid {
    /// A pyramid over `distances`: six square layers of 32-bit floats (m), faces in the order of `shared/cube.wesl`, or
    /// several times six.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when the faces' side is not a power of two or is less than [`LEAST_SIDE`];
    /// [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        kernels: &PyramidKernels,
        distances: &wgpu::Texture,
    ) -> Result<Self, GpuError> {
        let side = distances.width();
        if !side.is_power_of_two() || side < LEAST_SIDE || distances.height() != side {
            return Err(GpuError::Pass {
                pass: "distance pyramid".into(),
                reason: format!(
                    "a distance cube of {side}x{} texels a face; it must be square, a power of two, {LEAST_SIDE} or more",
                    distances.height()
                ),
            });
        }
        let levels = (side / 2 / LAST_SIDE).ilog2() + 1;
        let size = [side / 2, side / 2, distances.depth_or_array_layers()];
        let usage = wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::STORAGE_BINDING
            | wgpu::TextureUsages::COPY_SRC;
        let texture = gpu.texture_with_levels("distance pyramid", size, levels, FORMAT, usage)?;
        let steps = (0..levels)
            .step_by(LEVELS_AT_ONCE)
            .map(|level| {
                let (kernel, finer) = match level {
                    0 => (&kernels.first, faces(distances, 0)),
                    _ => (&kernels.next, faces(&texture, level - 1)),
                };
                let coarser = (level..).take(LEVELS_AT_ONCE).map(|level| {
                    if level < levels {
                        Ok(faces(&texture, level))
                    } else {
                        Ok(faces(&missing_level(gpu)?, 0))
                    }
                });
                let coarser = coarser.collect::<Result<Vec<_>, GpuError>>()?;
                let resources = [
                    ("finer_unfilterable", TextureView(&finer)),
                    ("coarser", TextureView(&coarser[0])),
                    ("coarser_by_4", TextureView(&coarser[1])),
                    ("coarser_by_8", TextureView(&coarser[2])),
                ];
                let group = kernel.bind(gpu, 3, &resources)?;
                Ok((kernel.clone(), group, side >> (level + 1)))
            })
            .collect::<Result<_, GpuError>>()?;
        Ok(Self { texture, steps })
    }

    /// Fills the pyramid from the distances.
    pub fn record(&self, frame: &mut Frame<'_>) {
        let layers = self.texture.depth_or_array_layers();
        frame.compute("distance pyramid", |pass| {
            for (kernel, group, side) in &self.steps {
                kernel.dispatch(pass, &[(3, group)], [*side, *side, layers]);
            }
        });
    }
}

/// Stands for a level that the pyramid does not have: a shader needs all of its textures bound.
fn missing_level(gpu: &Gpu) -> Result<wgpu::Texture, GpuError> {
    let usage = wgpu::TextureUsages::STORAGE_BINDING;
    gpu.texture_2d("missing level", [1, 1, 1], FORMAT, usage)
}

/// The faces of one level, as an array of layers.
fn faces(texture: &wgpu::Texture, level: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        base_mip_level: level,
        mip_level_count: Some(1),
        ..Default::default()
    })
}
