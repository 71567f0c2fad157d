//! The light that transfer vectors are multiplied by, in spherical harmonics.

use bytemuck::Zeroable;
use gpugi_scene::LightKind;
use wgpu::BindingResource::TextureView;

use super::gpu::{Directional, MOST_FUNCTIONS};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions};
use crate::scene::GpuScene;
use crate::shader;

/// Side of the cube that the environment is projected from (texels).
const CUBE_SIDE: u32 = 64;
/// `WORKGROUPS` of project.wesl, and its lanes.
const PROJECT_WORKGROUPS: u32 = 96;
const PROJECT_LANES: u32 = 64;
/// Lookups of the environment's image that filling the cube takes per texel, roughly.
const LOOKUPS_PER_TEXEL: u64 = 64;

/// The light of a scene in spherical harmonics.
#[derive(Debug)]
pub(super) struct Light {
    functions: u32,
    /// The environment's radiance.
    cube: wgpu::Texture,
    /// Coefficients of the environment without rotation and intensity.
    environment: wgpu::Buffer,
    /// Coefficients of all light: `vec4f` per function.
    pub coefficients: wgpu::Buffer,
    fill: (Kernel, wgpu::BindGroup),
    project: (Kernel, wgpu::BindGroup),
    sum: (Kernel, wgpu::BindGroup),
    turn: Kernel,
    window: (Kernel, wgpu::BindGroup),
    /// Version of the environment's image that was projected.
    projected: Option<u64>,
    /// Versions of environment, sky and lights, and what was made of them.
    lit: Option<([u64; 3], Made)>,
}

/// What is made of a scene's light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Made {
    /// Whether directional lights are projected.
    pub directional_lights: bool,
    /// See [`super::Settings::window`].
    pub window: bool,
}

impl Light {
    pub fn new(gpu: &Gpu, scene: &GpuScene, order: u32) -> Result<Self, GpuError> {
        let cube = gpu.texture(&wgpu::TextureDescriptor {
            label: Some("radiance-transfer.environment"),
            size: wgpu::Extent3d {
                width: CUBE_SIDE,
                height: CUBE_SIDE,
                depth_or_array_layers: 6,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba16Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING,
            view_formats: &[],
        })?;
        let faces = cube.create_view(&Default::default());
        let bytes = u64::from(MOST_FUNCTIONS) * 16;
        let storage = wgpu::BufferUsages::STORAGE;
        let environment = gpu.buffer("environment in harmonics [bytes]", bytes, storage)?;
        let coefficients = gpu.buffer(
            "light in harmonics [bytes]",
            bytes,
            storage | wgpu::BufferUsages::UNIFORM,
        )?;
        let options = KernelOptions {
            constants: &[("ORDER", f64::from(order))],
            ..Default::default()
        };
        let fill = Kernel::new(
            gpu,
            &shader!("prefiltered.radiance"),
            "main",
            Some(&scene.layout),
        )?;
        let project = shader!("techniques.radiance_transfer.project");
        let kernel = |entry| Kernel::with_options(gpu, &project, entry, None, &options);
        let (project, sum) = (kernel("main")?, kernel("sum")?);
        let parts = u64::from(PROJECT_WORKGROUPS) * bytes;
        let parts = gpu.buffer("parts of the environment [bytes]", parts, storage)?;
        let turn = shader!("techniques.radiance_transfer.light");
        let window = shader!("techniques.radiance_transfer.window");
        let window = Kernel::with_options(gpu, &window, "main", None, &options)?;
        let light = ("light", coefficients.as_entire_binding());
        let window_group = window.bind(gpu, 3, &[light])?;
        let radiance = ("radiance", TextureView(&faces));
        let fill_group = fill.bind(gpu, 3, std::slice::from_ref(&radiance))?;
        let parts = ("parts", parts.as_entire_binding());
        let into = ("environment", environment.as_entire_binding());
        let project_group = [radiance, parts, into];
        let sum_group = sum.bind(gpu, 3, &project_group)?;
        let project_group = project.bind(gpu, 3, &project_group)?;
        Ok(Self {
            functions: order * order,
            turn: Kernel::with_options(gpu, &turn, "main", Some(&scene.layout), &options)?,
            fill: (fill, fill_group),
            project: (project, project_group),
            sum: (sum, sum_group),
            window: (window, window_group),
            cube,
            environment,
            coefficients,
            projected: None,
            lit: None,
        })
    }

    /// Bytes of all buffers and textures.
    pub fn bytes(&self) -> u64 {
        let cube = self
            .cube
            .format()
            .theoretical_memory_footprint(self.cube.size());
        cube + self.environment.size() + self.coefficients.size()
    }

    /// Brings the coefficients up to date, and returns the work if there was any: passes `radiance-transfer.project`,
    /// when the environment's image has changed, `radiance-transfer.light` and `radiance-transfer.window`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn follow(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        made: Made,
    ) -> Result<Option<u64>, GpuError> {
        let versions = scene.versions;
        let now = Some(([versions.environment, versions.sky, versions.lights], made));
        if self.lit == now {
            return Ok(None);
        }
        self.lit = now;
        let texels = 6 * u64::from(CUBE_SIDE).pow(2);
        let mut work = 0;
        if self.projected != Some(versions.environment) {
            self.projected = Some(versions.environment);
            work += texels * (LOOKUPS_PER_TEXEL + u64::from(self.functions));
            frame.compute("radiance-transfer.project", |pass| {
                let (kernel, group) = &self.fill;
                let groups = [(0, &scene.bind_group), (3, group)];
                kernel.dispatch(pass, &groups, [CUBE_SIDE, CUBE_SIDE, 6]);
                for ((kernel, group), workgroups) in
                    [(&self.project, PROJECT_WORKGROUPS), (&self.sum, 1)]
                {
                    let lanes = workgroups * PROJECT_LANES;
                    kernel.dispatch(pass, &[(3, group)], [lanes, 1, 1]);
                }
            });
        }
        let directionals = if made.directional_lights {
            directionals(scene)
        } else {
            vec![Directional::zeroed()]
        };
        let gpu = frame.gpu;
        let directionals = gpu.storage("directional lights [bytes]", &directionals)?;
        let light = [
            ("environment", self.environment.as_entire_binding()),
            ("directionals", directionals.as_entire_binding()),
        ];
        let light = self.turn.bind(gpu, 1, &light)?;
        let into = [("light", self.coefficients.as_entire_binding())];
        let into = self.turn.bind(gpu, 3, &into)?;
        frame.compute("radiance-transfer.light", |pass| {
            let groups = [(0, &scene.bind_group), (1, &light), (3, &into)];
            self.turn.dispatch(pass, &groups, [MOST_FUNCTIONS, 1, 1]);
        });
        if made.window {
            frame.compute("radiance-transfer.window", |pass| {
                let (kernel, group) = &self.window;
                kernel.dispatch(pass, &[(3, group)], [1, 1, 1]);
            });
        }
        Ok(Some(work + 1))
    }
}

/// The directional lights of a scene; a dark one if there are none.
fn directionals(scene: &GpuScene) -> Vec<Directional> {
    let lights = scene.lights.iter();
    let lights = lights.filter(|light| light.kind == LightKind::Directional);
    let mut rows: Vec<Directional> = lights
        .map(|light| Directional {
            toward: (-light.direction()).to_array(),
            irradiance: light.intensity.to_array(),
            ..Zeroable::zeroed()
        })
        .collect();
    if rows.is_empty() {
        rows.push(Directional::zeroed());
    }
    rows
}
