//! Haar wavelets on a cube map: rays that find transfer vectors, of which the largest terms are kept, and the light's
//! coefficients (Ng, Ramamoorthi and Hanrahan 2003).

use wgpu::BindingResource::TextureView;

use super::Settings;
use super::gpu::{CUBE_SIDE, CUBE_TEXELS};
use super::places::Places;
use super::transfer::{Tile, Vectors};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions};
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
    transform: (Kernel, wgpu::BindGroup),
    reflect: Kernel,
    select: Kernel,
    /// Bind group of the atlas lookup.
    corners: wgpu::BindGroup,
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
        let storage = wgpu::BufferUsages::STORAGE;
        let dense = gpu.buffer("wavelets of a tile [bytes]", bytes, storage)?;
        let terms = [("TERMS", f64::from(settings.coefficients))];
        let options = KernelOptions {
            constants: &terms,
            ..Default::default()
        };
        let transform = shader!("techniques.radiance_transfer.haar.transform");
        let transform = Kernel::new(gpu, &transform, "main", None)?;
        let select = shader!("techniques.radiance_transfer.haar.select");
        let visibility = shader!("techniques.radiance_transfer.haar.visibility");
        let reflect = shader!("techniques.radiance_transfer.haar.reflect");
        let reflect = scene.ray_kernel(gpu, &reflect, &[terms[0], places.constant()])?;
        let corners = [("atlas", places.lookup().as_entire_binding())];
        let of_tile = [("dense", dense.as_entire_binding())];
        let transform_group = transform.bind(gpu, 3, &of_tile)?;
        Ok(Self {
            visibility: scene.ray_kernel(gpu, &visibility, &[])?,
            transform: (transform, transform_group),
            select: Kernel::with_options(gpu, &select, "main", None, &options)?,
            corners: reflect.bind(gpu, 2, &corners)?,
            reflect,
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
        tile: &Tile<'_>,
        vectors: &Vectors<'_>,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let dense = ("dense", self.dense.as_entire_binding());
        let albedos = ("albedos", vectors.albedos.as_entire_binding());
        let before = ("before", vectors.before.as_entire_binding());
        let after = ("after", vectors.after.as_entire_binding());
        let bind = |kernel: &Kernel, of_texels: &[_]| {
            let of_points = kernel.bind(gpu, 1, &tile.bindings())?;
            Ok::<_, GpuError>((of_points, kernel.bind(gpu, 3, of_texels)?))
        };
        let visibility = bind(&self.visibility, &[dense.clone(), albedos.clone()])?;
        let reflect = bind(&self.reflect, &[dense.clone(), albedos, before])?;
        let select = bind(&self.select, &[dense, after])?;
        frame.compute("radiance-transfer.rays", |pass| {
            let groups = [
                (0, &scene.ray_bind_group),
                (1, &visibility.0),
                (3, &visibility.1),
            ];
            let invocations = [CUBE_TEXELS, tile.points, 1];
            self.visibility.dispatch(pass, &groups, invocations);
        });
        frame.compute("radiance-transfer.wavelets", |pass| {
            let (kernel, group) = &self.transform;
            kernel.dispatch(pass, &[(3, group)], [6 * LANES, tile.points, 1]);
        });
        if !tile.is_first_bounce {
            frame.compute("radiance-transfer.rays", |pass| {
                let groups = [
                    (0, &scene.ray_bind_group),
                    (1, &reflect.0),
                    (2, &self.corners),
                    (3, &reflect.1),
                ];
                let invocations = [REFLECT_LANES, tile.points, 1];
                self.reflect.dispatch(pass, &groups, invocations);
            });
        }
        frame.compute("radiance-transfer.wavelets", |pass| {
            let groups = [(1, &select.0), (3, &select.1)];
            self.select.dispatch(pass, &groups, [LANES, tile.points, 1]);
        });
        Ok(())
    }
}

/// The kernel that computes the light's coefficients.
#[derive(Debug)]
pub(super) struct Projection {
    project: Kernel,
    cube: wgpu::TextureView,
    into: wgpu::BindGroup,
}

impl Projection {
    /// `cube`: the environment's radiance, turned, without intensity. `coefficients`: those of all light.
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        cube: &wgpu::TextureView,
        coefficients: &wgpu::Buffer,
    ) -> Result<Self, GpuError> {
        let project = shader!("techniques.radiance_transfer.haar.light");
        let project = Kernel::new(gpu, &project, "main", Some(&scene.layout))?;
        let into = [("light", coefficients.as_entire_binding())];
        Ok(Self {
            into: project.bind(gpu, 3, &into)?,
            project,
            cube: cube.clone(),
        })
    }

    /// Projects the environment, which the cube holds, and directional lights: pass `radiance-transfer.light`.
    pub fn sum(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        directionals: &wgpu::Buffer,
    ) -> Result<(), GpuError> {
        let light = [
            ("radiance", TextureView(&self.cube)),
            ("directionals", directionals.as_entire_binding()),
        ];
        let light = self.project.bind(frame.gpu, 1, &light)?;
        frame.compute("radiance-transfer.light", |pass| {
            let groups = [(0, &scene.bind_group), (1, &light), (3, &self.into)];
            self.project.dispatch(pass, &groups, [6 * LANES, 1, 1]);
        });
        Ok(())
    }
}

/// Side of the picture of the light's coefficients (texels): the faces of the cube one below the other.
pub(super) const MAP_SIZE: [u32; 2] = [CUBE_SIDE, 6 * CUBE_SIDE];
