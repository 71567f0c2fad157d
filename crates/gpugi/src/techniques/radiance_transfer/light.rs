//! The light that transfer vectors are multiplied by.

use bytemuck::Zeroable;
use gpugi_scene::LightKind;
use wgpu::BindingResource::TextureView;

use super::gpu::{CUBE_SIDE, CUBE_TEXELS, Directional, MOST_FUNCTIONS};
use super::{Basis, Settings, haar, harmonics};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, KernelOptions};
use crate::scene::GpuScene;
use crate::shader;

/// Lookups of the environment's image that filling the cube takes per texel, roughly.
const LOOKUPS_PER_TEXEL: u64 = 64;

/// The light of a scene, in the functions of the transfer vectors.
#[derive(Debug)]
pub(super) struct Light {
    /// The environment's radiance without intensity: for harmonics as in its image, for wavelets turned.
    cube: wgpu::Texture,
    /// Coefficients of all light: `vec4f` per function.
    pub coefficients: wgpu::Buffer,
    fill: (Kernel, wgpu::BindGroup),
    projection: Projection,
    /// Versions of the image, and for wavelets of its rotation, that the cube holds.
    filled: Option<[u64; 2]>,
    /// Versions of environment, sky and lights, and what was made of them.
    lit: Option<([u64; 3], Made)>,
}

/// Kernels of a basis.
#[derive(Debug)]
enum Projection {
    Harmonics(Box<harmonics::Projection>),
    Wavelets(Box<haar::Projection>),
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
    pub fn new(gpu: &Gpu, scene: &GpuScene, settings: &Settings) -> Result<Self, GpuError> {
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
        let buffer = |functions: u32, usage| {
            let bytes = u64::from(functions) * 16;
            gpu.buffer("coefficients of the light [bytes]", bytes, usage)
        };
        let storage = wgpu::BufferUsages::STORAGE;
        let (coefficients, projection) = match settings.basis {
            Basis::Harmonics => {
                let light = buffer(MOST_FUNCTIONS, storage | wgpu::BufferUsages::UNIFORM)?;
                let of = harmonics::Projection::new(gpu, scene, settings.order, &faces, &light)?;
                (light, Projection::Harmonics(Box::new(of)))
            }
            Basis::Haar => {
                let light = buffer(CUBE_TEXELS, storage)?;
                let of = haar::Projection::new(gpu, scene, &faces, &light)?;
                (light, Projection::Wavelets(Box::new(of)))
            }
        };
        let is_turned = matches!(projection, Projection::Wavelets(_));
        let options = KernelOptions {
            constants: &[("IS_TURNED", f64::from(u8::from(is_turned)))],
            ..Default::default()
        };
        let fill = shader!("prefiltered.radiance");
        let fill = Kernel::with_options(gpu, &fill, "main", Some(&scene.layout), &options)?;
        let fill_group = fill.bind(gpu, 3, &[("radiance", TextureView(&faces))])?;
        Ok(Self {
            fill: (fill, fill_group),
            cube,
            coefficients,
            projection,
            filled: None,
            lit: None,
        })
    }

    /// Bytes of all buffers and textures.
    pub fn bytes(&self) -> u64 {
        let cube = self
            .cube
            .format()
            .theoretical_memory_footprint(self.cube.size());
        let work = match &self.projection {
            Projection::Harmonics(of) => of.bytes(),
            Projection::Wavelets(_) => 0,
        };
        cube + work + self.coefficients.size()
    }

    /// Size of the coefficients as a picture (texels).
    pub fn map_size(&self) -> [u32; 2] {
        match self.projection {
            Projection::Harmonics(_) => [MOST_FUNCTIONS, 1],
            Projection::Wavelets(_) => haar::MAP_SIZE,
        }
    }

    /// Brings the coefficients up to date, and returns the work if there was any: passes `radiance-transfer.project`,
    /// when the environment's image has changed, for wavelets also when it has turned, `radiance-transfer.light` and
    /// `radiance-transfer.window`.
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
        let mut work = 1;
        let sky = match self.projection {
            Projection::Harmonics(_) => 0,
            Projection::Wavelets(_) => versions.sky,
        };
        if self.filled != Some([versions.environment, sky]) {
            self.filled = Some([versions.environment, sky]);
            work += u64::from(CUBE_TEXELS) * LOOKUPS_PER_TEXEL;
            frame.compute("radiance-transfer.project", |pass| {
                let (kernel, group) = &self.fill;
                let groups = [(0, &scene.bind_group), (3, group)];
                kernel.dispatch(pass, &groups, [CUBE_SIDE, CUBE_SIDE, 6]);
            });
            if let Projection::Harmonics(of) = &self.projection {
                work += u64::from(CUBE_TEXELS) * u64::from(of.functions());
                of.project(frame);
            }
        }
        let directionals = if made.directional_lights {
            directionals(scene)
        } else {
            vec![Directional::zeroed()]
        };
        let directionals = frame
            .gpu
            .storage("directional lights [bytes]", &directionals)?;
        match &self.projection {
            Projection::Harmonics(of) => of.sum(frame, scene, &directionals, made)?,
            Projection::Wavelets(of) => {
                work += u64::from(CUBE_TEXELS);
                of.sum(frame, scene, &directionals)?;
            }
        }
        Ok(Some(work))
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
