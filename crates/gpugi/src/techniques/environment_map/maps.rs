//! The environment's maps: `generate` fills them, and the gather reads them.

use wgpu::BindingResource::{Sampler, TextureView};

use super::gpu::{Lobe, LookupSettings};
use super::{Irradiance, Metals, Settings};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::scene::GpuScene;
use crate::shader;

/// Side of the irradiance cube, and of the level that it is summed from (texels).
pub const IRRADIANCE_SIDE: u32 = 32;
/// Side of the level that the spherical harmonics are summed from (texels).
const HARMONICS_SIDE: u32 = 64;
/// Side of the coarsest level of the glossy maps (texels).
const LAST_GLOSSY_SIDE: u32 = 8;
/// Side of the albedo table (texels).
pub const TABLE_SIDE: u32 = 64;

/// The passes that fill the maps.
#[derive(Debug)]
pub struct Generator {
    radiance: Kernel,
    coarser: Kernel,
    harmonics: Kernel,
    irradiance: Kernel,
    prefilter: Kernel,
    albedo: Kernel,
    sampler: wgpu::Sampler,
}

impl Generator {
    /// Compiles the passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let kernel = |shader, scene| Kernel::new(gpu, &shader, "main", scene);
        Ok(Self {
            radiance: kernel(
                shader!("techniques.environment_map.radiance"),
                Some(&scene.layout),
            )?,
            coarser: kernel(shader!("capture.downsample_cube"), None)?,
            harmonics: kernel(shader!("techniques.environment_map.harmonics"), None)?,
            irradiance: kernel(shader!("techniques.environment_map.irradiance"), None)?,
            prefilter: kernel(shader!("techniques.environment_map.prefilter"), None)?,
            albedo: kernel(shader!("techniques.environment_map.albedo"), None)?,
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("environment-map maps"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                mipmap_filter: wgpu::MipmapFilterMode::Linear,
                ..Default::default()
            }),
        })
    }
}

/// One dispatch of `generate`.
#[derive(Debug)]
struct Step {
    kernel: Kernel,
    group: wgpu::BindGroup,
    invocations: [u32; 3],
}

impl Step {
    fn new(
        gpu: &Gpu,
        kernel: &Kernel,
        resources: &[(&str, wgpu::BindingResource<'_>)],
        invocations: [u32; 3],
    ) -> Result<Self, GpuError> {
        Ok(Self {
            group: kernel.bind(gpu, 3, resources)?,
            kernel: kernel.clone(),
            invocations,
        })
    }
}

/// The maps for one choice of settings, without the environment's rotation and intensity.
#[derive(Debug)]
pub struct Maps {
    /// Radiance, all levels [W/sr/m^2].
    pub radiance: wgpu::Texture,
    /// Irradiance as a function of the normal [W/m^2].
    pub irradiance: wgpu::Texture,
    /// Radiance in nine spherical harmonics.
    pub harmonics: wgpu::Buffer,
    /// Means over GGX lobes and over Phong lobes; each level has its own roughness.
    pub glossy: [wgpu::Texture; 2],
    /// Albedos of glossy lobes.
    pub albedo: wgpu::Texture,
    steps: Vec<Step>,
    /// Bind group 2 of the gather.
    pub group: wgpu::BindGroup,
}

impl Maps {
    /// Creates empty maps, and the bind group for the pass `gather`.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        generator: &Generator,
        gather: &Kernel,
        settings: &Settings,
    ) -> Result<Self, GpuError> {
        let side = settings.resolution;
        let levels = side.ilog2() + 1;
        // Down to the level whose side is `LAST_GLOSSY_SIDE`, and at least two levels, smooth and rough, if the finest
        // is that small already.
        let glossy_levels = (side / LAST_GLOSSY_SIDE).max(2).ilog2() + 1;
        let cube = |name, side, levels| texture(gpu, name, side, 6, levels);
        let maps = [
            cube("environment-map.radiance", side, levels)?,
            cube("environment-map.irradiance", IRRADIANCE_SIDE, 1)?,
            cube("environment-map.ggx", side, glossy_levels)?,
            cube("environment-map.phong", side, glossy_levels)?,
            texture(gpu, "environment-map.albedo", TABLE_SIDE, 1, 1)?,
        ];
        let [radiance, irradiance, ggx, phong, albedo] = maps;
        let harmonics = gpu.buffer(
            "environment-map harmonics [bytes]",
            9 * 16,
            wgpu::BufferUsages::STORAGE,
        )?;

        let mut steps = Vec::new();
        let texels = |side: u32| [side, side, 6];
        steps.push(Step::new(
            gpu,
            &generator.radiance,
            &[("radiance", TextureView(&faces(&radiance, 0)))],
            texels(side),
        )?);
        for level in 1..levels {
            steps.push(Step::new(
                gpu,
                &generator.coarser,
                &[
                    ("finer", TextureView(&faces(&radiance, level - 1))),
                    ("coarser", TextureView(&faces(&radiance, level))),
                ],
                texels(side >> level),
            )?);
        }
        let level_of_side = |wanted: u32| (side / wanted).max(1).ilog2();
        steps.push(Step::new(
            gpu,
            &generator.harmonics,
            &[
                (
                    "radiance",
                    TextureView(&faces(&radiance, level_of_side(HARMONICS_SIDE))),
                ),
                ("harmonics", harmonics.as_entire_binding()),
            ],
            [9 * 256, 1, 1],
        )?);
        steps.push(Step::new(
            gpu,
            &generator.irradiance,
            &[
                (
                    "radiance",
                    TextureView(&faces(&radiance, level_of_side(IRRADIANCE_SIDE))),
                ),
                ("irradiance", TextureView(&faces(&irradiance, 0))),
            ],
            texels(IRRADIANCE_SIDE),
        )?);
        for (kind, map) in [(Lobe::GGX, &ggx), (Lobe::PHONG, &phong)] {
            for level in 0..glossy_levels {
                let lobe =
                    gpu.uniform("glossy lobe", &lobe(kind, level, glossy_levels, settings))?;
                steps.push(Step::new(
                    gpu,
                    &generator.prefilter,
                    &[
                        ("radiance", TextureView(&cube_view(&radiance))),
                        ("radiance_sampler", Sampler(&generator.sampler)),
                        ("lobe", lobe.as_entire_binding()),
                        ("filtered", TextureView(&faces(map, level))),
                    ],
                    texels(side >> level),
                )?);
            }
        }
        steps.push(Step::new(
            gpu,
            &generator.albedo,
            &[(
                "albedo",
                TextureView(&albedo.create_view(&Default::default())),
            )],
            [TABLE_SIDE, TABLE_SIDE, 1],
        )?);

        let lookup = gpu.uniform(
            "environment-map lookup settings",
            &LookupSettings {
                irradiance: match settings.irradiance {
                    Irradiance::Cube => 0,
                    Irradiance::Harmonics => 1,
                },
                phong_cosine: u32::from(settings.phong_cosine),
                last_level: (glossy_levels - 1) as f32,
                approximate_metals: u32::from(settings.metals == Metals::Approximate),
            },
        )?;
        let group = gather.bind(
            gpu,
            2,
            &[
                ("lookup_settings", lookup.as_entire_binding()),
                ("map_sampler", Sampler(&generator.sampler)),
                ("irradiance_cube", TextureView(&cube_view(&irradiance))),
                ("irradiance_harmonics", harmonics.as_entire_binding()),
                ("ggx_cube", TextureView(&cube_view(&ggx))),
                ("phong_cube", TextureView(&cube_view(&phong))),
                (
                    "albedo_table",
                    TextureView(&albedo.create_view(&Default::default())),
                ),
            ],
        )?;
        Ok(Self {
            radiance,
            irradiance,
            harmonics,
            glossy: [ggx, phong],
            albedo,
            steps,
            group,
        })
    }

    /// Fills the maps from the scene's environment.
    pub fn record(&self, frame: &mut Frame<'_>, scene: &GpuScene) {
        frame.compute("environment-map.generate", |pass| {
            for step in &self.steps {
                step.kernel.dispatch(
                    pass,
                    &[(0, &scene.bind_group), (3, &step.group)],
                    step.invocations,
                );
            }
        });
    }

    /// All maps that are textures.
    pub fn textures(&self) -> [&wgpu::Texture; 5] {
        let [ggx, phong] = &self.glossy;
        [&self.radiance, &self.irradiance, ggx, phong, &self.albedo]
    }
}

/// Roughness of the lobe that a level of the glossy maps holds: glossy_level.wesl.
pub fn level_roughness(level: u32, levels: u32) -> f32 {
    (level as f32 / (levels - 1) as f32).powf(1.5)
}

/// Exponent of the Phong lobe of about the same width: glossy_level.wesl.
pub fn phong_exponent(roughness: f32) -> f32 {
    2.0 / roughness.powi(4) - 2.0
}

/// The lobe that a level of the glossy maps holds.
fn lobe(kind: u32, level: u32, levels: u32, settings: &Settings) -> Lobe {
    let roughness = level_roughness(level, levels);
    Lobe {
        kind: if level > 0 { kind } else { Lobe::MIRROR },
        width: match kind {
            Lobe::GGX => roughness * roughness,
            // The cosine at the surface, which faces the lobe's axis, adds 1 to the exponent.
            _ => phong_exponent(roughness) + f32::from(u8::from(settings.phong_cosine)),
        },
        // Wider lobes need more samples, and a coarser level has a quarter of the texels.
        samples: settings.samples << level.saturating_sub(1),
        padding: 0,
    }
}

fn texture(
    gpu: &Gpu,
    name: &str,
    side: u32,
    layers: u32,
    levels: u32,
) -> Result<wgpu::Texture, GpuError> {
    gpu.texture(&wgpu::TextureDescriptor {
        label: Some(name),
        size: wgpu::Extent3d {
            width: side,
            height: side,
            depth_or_array_layers: layers,
        },
        mip_level_count: levels,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::STORAGE_BINDING
            | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

/// The six faces of one level, as layers.
fn faces(texture: &wgpu::Texture, level: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        base_mip_level: level,
        mip_level_count: Some(1),
        ..Default::default()
    })
}

/// All levels, as a cube.
fn cube_view(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::Cube),
        ..Default::default()
    })
}
