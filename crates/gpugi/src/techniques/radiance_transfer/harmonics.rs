//! Spherical harmonics: rays that find transfer vectors, and the light's coefficients.

use wgpu::BindingResource::TextureView;

use super::Settings;
use super::gpu::{LANES, MOST_FUNCTIONS};
use super::light::Made;
use super::places::Places;
use super::transfer::{Tile, Vectors};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions};
use crate::scene::GpuScene;
use crate::shader;

/// `WORKGROUPS` of project.wesl, and its lanes.
const PROJECT_WORKGROUPS: u32 = 96;
const PROJECT_LANES: u32 = 64;

/// The kernels that compute transfer vectors.
#[derive(Debug)]
pub(super) struct Rays {
    first_bounce: Kernel,
    further_bounces: Kernel,
    /// Bind group of the atlas lookup.
    corners: wgpu::BindGroup,
}

impl Rays {
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        settings: &Settings,
        places: &Places,
    ) -> Result<Self, GpuError> {
        let shader = shader!("techniques.radiance_transfer.transfer");
        let order = ("ORDER", f64::from(settings.order));
        let kernel = |is_first: bool| {
            let is_first = ("IS_FIRST", f64::from(u8::from(is_first)));
            scene.ray_kernel(gpu, &shader, &[order, is_first, places.constant()])
        };
        let (first_bounce, further_bounces) = (kernel(true)?, kernel(false)?);
        let corners = [("atlas", places.lookup().as_entire_binding())];
        Ok(Self {
            corners: further_bounces.bind(gpu, 2, &corners)?,
            first_bounce,
            further_bounces,
        })
    }

    /// Computes a bounce of a tile's vectors: pass `radiance-transfer.rays`.
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        tile: &Tile<'_>,
        vectors: &Vectors<'_>,
    ) -> Result<(), GpuError> {
        let gpu = frame.gpu;
        let kernel = if tile.is_first_bounce {
            &self.first_bounce
        } else {
            &self.further_bounces
        };
        let of_texels = [
            ("before", vectors.before.as_entire_binding()),
            ("after", vectors.after.as_entire_binding()),
            ("albedos", vectors.albedos.as_entire_binding()),
        ];
        let of_points = kernel.bind(gpu, 1, &tile.bindings())?;
        let of_texels = kernel.bind(gpu, 3, &of_texels)?;
        frame.compute("radiance-transfer.rays", |pass| {
            let groups = [
                (0, &scene.ray_bind_group),
                (1, &of_points),
                (2, &self.corners),
                (3, &of_texels),
            ];
            kernel.dispatch(pass, &groups, [tile.points * LANES, 1, 1]);
        });
        Ok(())
    }
}

/// The kernels that compute the light's coefficients.
#[derive(Debug)]
pub(super) struct Projection {
    functions: u32,
    /// Coefficients of the environment without rotation and intensity.
    environment: wgpu::Buffer,
    project: (Kernel, wgpu::BindGroup),
    sum: (Kernel, wgpu::BindGroup),
    turn: Kernel,
    into: wgpu::BindGroup,
    window: (Kernel, wgpu::BindGroup),
}

impl Projection {
    /// `cube`: the environment's radiance, without rotation and intensity. `coefficients`: those of all light.
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        order: u32,
        cube: &wgpu::TextureView,
        coefficients: &wgpu::Buffer,
    ) -> Result<Self, GpuError> {
        let bytes = u64::from(MOST_FUNCTIONS) * 16;
        let storage = wgpu::BufferUsages::STORAGE;
        let environment = gpu.buffer("environment in harmonics [bytes]", bytes, storage)?;
        let options = KernelOptions {
            constants: &[("ORDER", f64::from(order))],
            ..Default::default()
        };
        let project = shader!("techniques.radiance_transfer.project");
        let kernel = |entry| Kernel::with_options(gpu, &project, entry, None, &options);
        let (project, sum) = (kernel("main")?, kernel("sum")?);
        let parts = u64::from(PROJECT_WORKGROUPS) * bytes;
        let parts = gpu.buffer("parts of the environment [bytes]", parts, storage)?;
        let project_group = [
            ("radiance", TextureView(cube)),
            ("parts", parts.as_entire_binding()),
            ("environment", environment.as_entire_binding()),
        ];
        let sum_group = sum.bind(gpu, 3, &project_group)?;
        let project_group = project.bind(gpu, 3, &project_group)?;
        let turn = shader!("techniques.radiance_transfer.light");
        let turn = Kernel::with_options(gpu, &turn, "main", Some(&scene.layout), &options)?;
        let window = shader!("techniques.radiance_transfer.window");
        let window = Kernel::with_options(gpu, &window, "main", None, &options)?;
        let light = [("light", coefficients.as_entire_binding())];
        let window_group = window.bind(gpu, 3, &light)?;
        Ok(Self {
            functions: order * order,
            environment,
            into: turn.bind(gpu, 3, &light)?,
            turn,
            project: (project, project_group),
            sum: (sum, sum_group),
            window: (window, window_group),
        })
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        self.environment.size()
    }

    /// Functions.
    pub fn functions(&self) -> u32 {
        self.functions
    }

    /// Projects the environment's image, which the cube holds: pass `radiance-transfer.project`.
    pub fn project(&self, frame: &mut Frame<'_>) {
        frame.compute("radiance-transfer.project", |pass| {
            for ((kernel, group), workgroups) in
                [(&self.project, PROJECT_WORKGROUPS), (&self.sum, 1)]
            {
                let lanes = workgroups * PROJECT_LANES;
                kernel.dispatch(pass, &[(3, group)], [lanes, 1, 1]);
            }
        });
    }

    /// Adds up the environment, turned, and directional lights: passes `radiance-transfer.light` and
    /// `radiance-transfer.window`.
    pub fn sum(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        directionals: &wgpu::Buffer,
        made: Made,
    ) -> Result<(), GpuError> {
        let light = [
            ("environment", self.environment.as_entire_binding()),
            ("directionals", directionals.as_entire_binding()),
        ];
        let light = self.turn.bind(frame.gpu, 1, &light)?;
        frame.compute("radiance-transfer.light", |pass| {
            let groups = [(0, &scene.bind_group), (1, &light), (3, &self.into)];
            self.turn.dispatch(pass, &groups, [MOST_FUNCTIONS, 1, 1]);
        });
        if made.window {
            frame.compute("radiance-transfer.window", |pass| {
                let (kernel, group) = &self.window;
                kernel.dispatch(pass, &[(3, group)], [1, 1, 1]);
            });
        }
        Ok(())
    }
}
