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
/// Invocations per coefficient of `project`.
const PROJECT_LANES: u32 = 256;
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
    turn: Kernel,
    /// Version of the environment's image that was projected.
    projected: Option<u64>,
    /// Versions of sky and lights, and whether lights were projected.
    lit: Option<([u64; 3], bool)>,
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
        let project = Kernel::with_options(gpu, &project, "main", None, &options)?;
        let turn = shader!("techniques.radiance_transfer.light");
        let radiance = ("radiance", TextureView(&faces));
        let fill_group = fill.bind(gpu, 3, std::slice::from_ref(&radiance))?;
        let into = ("environment", environment.as_entire_binding());
        let project_group = project.bind(gpu, 3, &[radiance, into])?;
        Ok(Self {
            functions: order * order,
            turn: Kernel::with_options(gpu, &turn, "main", Some(&scene.layout), &options)?,
            fill: (fill, fill_group),
            project: (project, project_group),
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
    /// when the environment's image has changed, and `radiance-transfer.light`.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn follow(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        with_directional_lights: bool,
    ) -> Result<Option<u64>, GpuError> {
        let versions = scene.versions;
        let now = Some((
            [versions.environment, versions.sky, versions.lights],
            with_directional_lights,
        ));
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
                let (kernel, group) = &self.project;
                let invocations = [self.functions * PROJECT_LANES, 1, 1];
                kernel.dispatch(pass, &[(3, group)], invocations);
            });
        }
        let directionals = if with_directional_lights {
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
