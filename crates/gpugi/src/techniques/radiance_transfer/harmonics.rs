//! Spherical harmonics: rays that find transfer vectors, and the light's coefficients.

use glam::Quat;

use super::Settings;
use super::gpu::{LANES, MOST_FUNCTIONS};
use super::light::ProjectedLight;
use super::places::Places;
use super::rotation::matrices;
use super::transfer::Tile;
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named};
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
        Ok(Self {
            first_bounce: kernel(true)?,
            further_bounces: kernel(false)?,
        })
    }

    /// Computes a bounce of a tile's vectors: pass `radiance-transfer.rays`.
    pub fn record(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        tile: Tile,
        resources: &[Named<'_>],
    ) -> Result<(), GpuError> {
        let kernel = if tile.is_first_bounce {
            &self.first_bounce
        } else {
            &self.further_bounces
        };
        let (name, scene) = ("radiance-transfer.rays", Some(&scene.ray_bind_group));
        frame.run(name, kernel, scene, resources, [tile.points * LANES, 1, 1])
    }
}

/// The kernels that compute the light's coefficients.
#[derive(Debug)]
pub(super) struct Projection {
    functions: u32,
    /// Coefficients of the environment without rotation and intensity.
    environment: wgpu::Buffer,
    /// Sums of its parts.
    parts: wgpu::Buffer,
    project: Kernel,
    sum: Kernel,
    turn: Kernel,
    window: Kernel,
}

impl Projection {
    pub fn new(gpu: &Gpu, scene: &GpuScene, order: u32) -> Result<Self, GpuError> {
        let bytes = u64::from(MOST_FUNCTIONS) * 16;
        let kernel = |shader, entry, layout| {
            let order = [("ORDER", f64::from(order))];
            Kernel::with_constants(gpu, &shader, entry, layout, &order)
        };
        let project = shader!("techniques.radiance_transfer.project");
        let turn = shader!("techniques.radiance_transfer.light");
        let parts = u64::from(PROJECT_WORKGROUPS) * bytes;
        Ok(Self {
            functions: order * order,
            environment: gpu.room("environment in harmonics [bytes]", bytes)?,
            parts: gpu.room("parts of the environment [bytes]", parts)?,
            project: kernel(project.clone(), "main", None)?,
            sum: kernel(project, "sum", None)?,
            turn: kernel(turn, "main", Some(&scene.layout))?,
            window: kernel(shader!("techniques.radiance_transfer.window"), "main", None)?,
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

    /// Projects the environment's radiance, without rotation and intensity, which the cube holds: pass
    /// `radiance-transfer.project`.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn project(&self, frame: &mut Frame<'_>, cube: &wgpu::TextureView) -> Result<(), GpuError> {
        let resources: [Named<'_>; 3] = [
            ("radiance", cube),
            ("parts", &self.parts),
            ("environment", &self.environment),
        ];
        frame.compute("radiance-transfer.project", |pass| {
            let lanes = [PROJECT_WORKGROUPS * PROJECT_LANES, 1, 1];
            self.project.run(pass, None, &resources, lanes)?;
            self.sum.run(pass, None, &resources, [PROJECT_LANES, 1, 1])
        })
    }

    /// Adds up the environment, turned, and directional lights, in `light`: passes `radiance-transfer.light` and
    /// `radiance-transfer.window`.
    pub fn sum(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        directionals: &wgpu::Buffer,
        light: &wgpu::Buffer,
        made: ProjectedLight,
    ) -> Result<(), GpuError> {
        let rotation = scene.environment.as_ref();
        let rotation = rotation.map_or(Quat::IDENTITY, |environment| environment.rotation);
        let order = self.functions.isqrt();
        let rotation = matrices(rotation, order);
        let rotation = frame
            .gpu
            .storage("rotation of harmonics [bytes]", &rotation)?;
        let resources: [Named<'_>; 4] = [
            ("environment", &self.environment),
            ("rotation", &rotation),
            ("directionals", directionals),
            ("light", light),
        ];
        let (name, scene) = ("radiance-transfer.light", Some(&scene.bind_group));
        frame.run(name, &self.turn, scene, &resources, [MOST_FUNCTIONS, 1, 1])?;
        if made.window {
            let name = "radiance-transfer.window";
            frame.run(name, &self.window, None, &resources, [1, 1, 1])?;
        }
        Ok(())
    }
}
