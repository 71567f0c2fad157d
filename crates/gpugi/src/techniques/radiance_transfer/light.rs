//! The light that transfer vectors are multiplied by.

use bytemuck::Zeroable;
use gpugi_scene::LightKind;

use super::gpu::{CUBE_SIDE, CUBE_TEXELS, Directional, MOST_FUNCTIONS};
use super::{Basis, Settings, haar, harmonics};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named};
use crate::scene::{GpuScene, Inputs, Versions};
use crate::shader;
use crate::stage::Stage;

/// Lookups of the environment's image that filling the cube takes per texel, roughly.
const LOOKUPS_PER_TEXEL: u64 = 64;

/// The light of a scene, in the functions of the transfer vectors.
#[derive(Debug)]
pub(super) struct Light {
    /// The environment's radiance without intensity: for harmonics as in its image, for wavelets turned.
    cube: wgpu::Texture,
    /// Coefficients of all light: `vec4f` per function.
    pub coefficients: wgpu::Buffer,
    faces: wgpu::TextureView,
    fill: Kernel,
    projection: Projection,
    /// The image, and for wavelets its rotation, that the cube holds.
    filled: Stage<Versions>,
    /// Environment, sky and lights, and what was made of them.
    lit: Stage<(Versions, ProjectedLight)>,
}

/// Kernels of a basis.
#[derive(Debug)]
enum Projection {
    Harmonics(Box<harmonics::Projection>),
    Wavelets(Box<haar::Projection>),
}

/// What is made of a scene's light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ProjectedLight {
    /// Whether directional lights are projected.
    pub directional_lights: bool,
    /// See [`super::Settings::window`].
    pub window: bool,
}

impl Light {
    pub fn new(gpu: &Gpu, scene: &GpuScene, settings: &Settings) -> Result<Self, GpuError> {
        let cube = gpu.texture_2d(
            "radiance-transfer.environment",
            [CUBE_SIDE, CUBE_SIDE, 6],
            wgpu::TextureFormat::Rgba16Float,
            wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING,
        )?;
        let faces = cube.create_view(&Default::default());
        let buffer = |functions: u32, usage| {
            let bytes = u64::from(functions) * 16;
            gpu.buffer("coefficients of the light [bytes]", bytes, usage)
        };
        let storage = wgpu::BufferUsages::STORAGE;
        let (coefficients, projection) = match settings.basis {
            Basis::Harmonics => {
                let light = buffer(MOST_FUNCTIONS, storage | wgpu::BufferUsages::UNIFORM)?;
                let of = harmonics::Projection::new(gpu, scene, settings.order)?;
                (light, Projection::Harmonics(Box::new(of)))
            }
            Basis::Haar => {
                let light = buffer(CUBE_TEXELS, storage)?;
                let of = haar::Projection::new(gpu, scene)?;
                (light, Projection::Wavelets(Box::new(of)))
            }
        };
        let is_turned = matches!(projection, Projection::Wavelets(_));
        let is_turned = [("IS_TURNED", f64::from(u8::from(is_turned)))];
        let fill = shader!("prefiltered.radiance");
        let layout = Some(&scene.layout);
        Ok(Self {
            fill: Kernel::with_constants(gpu, &fill, "main", layout, &is_turned)?,
            faces,
            cube,
            coefficients,
            projection,
            filled: Stage::default(),
            lit: Stage::default(),
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
        made: ProjectedLight,
    ) -> Result<Option<u64>, GpuError> {
        let light = Inputs::ENVIRONMENT | Inputs::SKY | Inputs::LIGHTS;
        if !self.lit.renew((scene.versions.of(light), made)) {
            return Ok(None);
        }
        let mut work = 1;
        let in_cube = match self.projection {
            Projection::Harmonics(_) => Inputs::ENVIRONMENT,
            Projection::Wavelets(_) => Inputs::ENVIRONMENT | Inputs::SKY,
        };
        if self.filled.renew(scene.versions.of(in_cube)) {
            work += u64::from(CUBE_TEXELS) * LOOKUPS_PER_TEXEL;
            let resources: [Named<'_>; 1] = [("radiance", &self.faces)];
            let (name, scene) = ("radiance-transfer.project", Some(&scene.bind_group));
            let texels = [CUBE_SIDE, CUBE_SIDE, 6];
            frame.run(name, &self.fill, scene, &resources, texels)?;
            if let Projection::Harmonics(of) = &self.projection {
                work += u64::from(CUBE_TEXELS) * u64::from(of.functions());
                of.project(frame, &self.faces)?;
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
        let light = &self.coefficients;
        match &self.projection {
            Projection::Harmonics(of) => of.sum(frame, scene, &directionals, light, made)?,
            Projection::Wavelets(of) => {
                work += u64::from(CUBE_TEXELS);
                of.sum(frame, scene, &directionals, light, &self.faces)?;
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
