//! Haar wavelets on a cube map: rays that find transfer vectors, of which the largest terms are kept, and the light's
//! coefficients (Ng, Ramamoorthi and Hanrahan 2003).

use super::Settings;
use super::gpu::{CUBE_SIDE, CUBE_TEXELS};
use super::places::Places;
use super::transfer::Tile;
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named, join};
use crate::scene::GpuScene;
use crate::shader;

/// `LANES` of wavelets.wesl and select.wesl, and those of reflect.wesl.
const LANES: u32 = 256;
const REFLECT_LANES: u32 = 64;

/// Rays that a texel traces if `rays` are asked for: the same number in each texel of the cube.
pub(super) fn rays_per_texel(rays: u32) -> u32 {
    rays.next_multiple_of(CUBE_TEXELS)
}

/// The kernels that compute transfer vectors.
#[derive(Debug)]
pub(super) struct Rays {
    visibility: Kernel,
    transform: Kernel,
    reflect: Kernel,
    select: Kernel,
    /// All coefficients of a tile's points.
    dense: wgpu::Buffer,
}

impl Rays {
    /// `most_points`: points of the largest tile.
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        settings: &Settings,
        places: &Places,
        most_points: u32,
    ) -> Result<Self, GpuError> {
        let bytes = u64::from(most_points) * u64::from(CUBE_TEXELS) * 16;
        let dense = gpu.room("wavelets of a tile [bytes]", bytes)?;
        let terms = [("TERMS", f64::from(settings.coefficients))];
        let transform = shader!("techniques.radiance_transfer.haar.transform");
        let select = shader!("techniques.radiance_transfer.haar.select");
        let visibility = shader!("techniques.radiance_transfer.haar.visibility");
        let reflect = shader!("techniques.radiance_transfer.haar.reflect");
        Ok(Self {
            visibility: scene.ray_kernel(gpu, &visibility, &[])?,
            transform: Kernel::new(gpu, &transform, "main", None)?,
            reflect: scene.ray_kernel(gpu, &reflect, &[terms[0], places.constant()])?,
            select: Kernel::with_constants(gpu, &select, "main", None, &terms)?,
            dense,
        })
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        self.dense.size()
    }

    /// Computes a bounce of a tile's vectors: passes `radiance-transfer.rays` and `radiance-transfer.wavelets`.
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        tile: Tile,
        resources: &[Named<'_>],
    ) -> Result<(), GpuError> {
        let resources = join(resources, &[("dense", &self.dense)]);
        let scene = Some(&scene.ray_bind_group);
        let (rays, wavelets) = ("radiance-transfer.rays", "radiance-transfer.wavelets");
        let lanes = |lanes: u32| [lanes, tile.points, 1];
        frame.run(
            rays,
            &self.visibility,
            scene,
            &resources,
            lanes(CUBE_TEXELS),
        )?;
        frame.run(
            wavelets,
            &self.transform,
            None,
            &resources,
            lanes(6 * LANES),
        )?;
        if !tile.is_first_bounce {
            frame.run(rays, &self.reflect, scene, &resources, lanes(REFLECT_LANES))?;
        }
        frame.run(wavelets, &self.select, None, &resources, lanes(LANES))
    }
}

/// The kernel that computes the light's coefficients.
#[derive(Debug)]
pub(super) struct Projection(Kernel);

impl Projection {
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let project = shader!("techniques.radiance_transfer.haar.light");
        Kernel::new(gpu, &project, "main", Some(&scene.layout)).map(Self)
    }

    /// Projects the environment's radiance, turned, without intensity, which the cube holds, and directional lights, in
    /// `light`: pass `radiance-transfer.light`.
    pub fn sum(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        directionals: &wgpu::Buffer,
        light: &wgpu::Buffer,
        cube: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        let resources: [Named<'_>; 3] = [
            ("radiance", cube),
            ("directionals", directionals),
            ("light", light),
        ];
        let (name, scene) = ("radiance-transfer.light", Some(&scene.bind_group));
        frame.run(name, &self.0, scene, &resources, [6 * LANES, 1, 1])
    }
}

/// Side of the picture of the light's coefficients (texels): the faces of the cube one below the other.
pub(super) const MAP_SIZE: [u32; 2] = [CUBE_SIDE, 6 * CUBE_SIDE];
