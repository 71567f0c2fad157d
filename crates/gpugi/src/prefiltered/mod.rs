//! Maps of the environment: a radiance cube with levels, irradiance, spherical harmonics, and the environment's means
//! over ever wider lobes (tutorial sections 3.2.1 and 3.2.2). Techniques that want the same maps share them.

pub(crate) mod gpu;
#[cfg(test)]
mod tests;

use wgpu::BindingResource::{Sampler, TextureView};

use self::gpu::{Lobe, LookupSettings};
use crate::gpu::{Frame, Gpu, GpuError, Kernel, Named};
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

/// Which maps a technique wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PrefilteredRequest {
    /// Side of the radiance cube and of the finest level of the glossy maps (texels), a power of two.
    pub resolution: u32,
    /// Sample directions per texel of the glossy maps' first blurred level; twice as many in each coarser level.
    pub samples: u32,
    /// Whether Phong lobes keep the surface's cosine.
    pub phong_cosine: bool,
}

impl Default for PrefilteredRequest {
    fn default() -> Self {
        Self {
            resolution: 256,
            samples: 128,
            phong_cosine: true,
        }
    }
}

/// The passes that fill the maps.
#[derive(Debug)]
struct Kernels {
    radiance: Kernel,
    coarser: Kernel,
    harmonics: Kernel,
    irradiance: Kernel,
    prefilter: Kernel,
    albedo: Kernel,
    sampler: wgpu::Sampler,
}

impl Kernels {
    fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        let kernel = |shader, scene| Kernel::new(gpu, &shader, "main", scene);
        Ok(Self {
            radiance: kernel(shader!("prefiltered.radiance"), Some(&scene.layout))?,
            coarser: kernel(shader!("capture.downsample_cube"), None)?,
            harmonics: kernel(shader!("prefiltered.harmonics"), None)?,
            irradiance: kernel(shader!("prefiltered.irradiance"), None)?,
            prefilter: kernel(shader!("prefiltered.prefilter"), None)?,
            albedo: kernel(shader!("prefiltered.albedo"), None)?,
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

/// One dispatch that fills maps.
#[derive(Debug)]
struct Step {
    kernel: Kernel,
    group: wgpu::BindGroup,
    invocations: [u32; 3],
    /// Texels that one invocation reads, roughly.
    lookups: u32,
}

impl Step {
    fn new(
        gpu: &Gpu,
        kernel: &Kernel,
        resources: &[(&str, wgpu::BindingResource<'_>)],
        invocations: [u32; 3],
        lookups: u32,
    ) -> Result<Self, GpuError> {
        Ok(Self {
            group: kernel.bind(gpu, 3, resources)?,
            kernel: kernel.clone(),
            invocations,
            lookups,
        })
    }

    /// Texels that it reads.
    fn work(&self) -> u64 {
        let invocations: u64 = self
            .invocations
            .iter()
            .map(|&count| u64::from(count))
            .product();
        invocations * u64::from(self.lookups)
    }
}

/// The maps, without the environment's rotation and intensity. Cloning copies handles only.
#[derive(Debug, Clone, PartialEq)]
pub struct Prefiltered {
    /// Radiance, all levels [W/sr/m^2].
    pub radiance: wgpu::Texture,
    /// Irradiance as a function of the normal [W/m^2].
    pub irradiance: wgpu::Texture,
    /// Radiance in nine spherical harmonics, 9 x 4 floats in the order of shared/spherical_harmonics.wesl.
    pub harmonics: wgpu::Buffer,
    /// Means over GGX lobes and over Phong lobes; each level has its own roughness.
    pub glossy: [wgpu::Texture; 2],
    /// Albedos of glossy lobes.
    pub albedo: wgpu::Texture,
    /// Irradiance, both glossy maps, and albedos.
    views: [wgpu::TextureView; 4],
    sampler: wgpu::Sampler,
    wanted: PrefilteredRequest,
}

/// How a gather reads the maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Lookup {
    /// Whether irradiance comes from the spherical harmonics, not from the cube.
    pub from_harmonics: bool,
    /// Whether metals reflect by the tutorial's equation 4.
    pub approximate_metals: bool,
}

impl Prefiltered {
    /// How passes that import lookup.wesl read the maps, for [`Prefiltered::resources`].
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn settings(&self, gpu: &Gpu, lookup: Lookup) -> Result<wgpu::Buffer, GpuError> {
        let settings = LookupSettings {
            irradiance: u32::from(lookup.from_harmonics),
            phong_cosine: u32::from(self.wanted.phong_cosine),
            last_level: (self.glossy[0].mip_level_count() - 1) as f32,
            approximate_metals: u32::from(lookup.approximate_metals),
        };
        gpu.constant("environment-map lookup settings", &settings)
    }

    /// What these passes bind.
    pub fn resources<'a>(&'a self, settings: &'a wgpu::Buffer) -> [Named<'a>; 7] {
        let [irradiance, ggx, phong, albedo] = &self.views;
        [
            ("lookup_settings", settings),
            ("map_sampler", &self.sampler),
            ("irradiance_cube", irradiance),
            ("irradiance_harmonics", &self.harmonics),
            ("ggx_cube", ggx),
            ("phong_cube", phong),
            ("albedo_table", albedo),
        ]
    }

    /// All maps that are textures.
    pub fn textures(&self) -> [&wgpu::Texture; 5] {
        let [ggx, phong] = &self.glossy;
        [&self.radiance, &self.irradiance, ggx, phong, &self.albedo]
    }
}

/// The maps that techniques share.
#[derive(Debug, Default)]
pub struct Environments {
    kernels: Option<Kernels>,
    kept: Vec<FilledMaps>,
    frame: u64,
}

/// How far maps are filled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Filled {
    /// Whether all steps were done once, perhaps for an earlier environment.
    pub is_whole: bool,
    /// Whether the maps show the scene's environment.
    pub is_current: bool,
    /// Counts how often maps that had shown an earlier environment were filled.
    pub revision: u64,
}

/// Maps, and how far they are filled.
#[derive(Debug)]
struct FilledMaps {
    maps: Prefiltered,
    steps: Vec<Step>,
    /// The next step; all are done at their end.
    next: usize,
    /// Version of the scene's environment that the steps read.
    version: Option<u64>,
    /// Version in the latest frame, whose steps may have yet to begin.
    seen: Option<u64>,
    filled: Filled,
    /// The frame of the latest request.
    asked: u64,
}

impl Environments {
    /// Maps unrequested for this many frames are dropped.
    const PATIENCE: u64 = 2;

    /// Begins a frame, and drops maps that are no longer requested.
    pub fn begin_frame(&mut self) {
        self.frame += 1;
        let now = self.frame;
        self.kept
            .retain(|filled| now - filled.asked <= Self::PATIENCE);
    }

    /// Number of maps that are kept.
    #[cfg(test)]
    pub(crate) fn len(&self) -> usize {
        self.kept.len()
    }

    /// The maps `wanted`, which may not be filled yet.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn of(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        wanted: PrefilteredRequest,
    ) -> Result<&Prefiltered, GpuError> {
        Ok(&self.kept(gpu, scene, wanted)?.maps)
    }

    /// Fills the maps `wanted` from the scene's environment, unless they are, in the pass `environment-map.generate`.
    /// `takes` is told the work of each step before it is recorded, and returns false to leave it to a later frame.
    /// A begun round of steps ends before one for a changed environment begins: or else none would end while the
    /// environment changes in every frame.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn fill(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        wanted: PrefilteredRequest,
        mut takes: impl FnMut(u64) -> bool,
    ) -> Result<Filled, GpuError> {
        let kept = self.kept(frame.gpu, scene, wanted)?;
        // Rotation and intensity are applied at lookup.
        let version = Some(scene.versions.environment);
        let is_fresh = kept.seen != version;
        kept.seen = version;
        if kept.version != version && [0, kept.steps.len()].contains(&kept.next) {
            kept.version = version;
            kept.next = 0;
        }
        let left = kept.steps[kept.next..].iter();
        let taken = left.take_while(|step| takes(step.work())).count();
        let now = kept.next..kept.next + taken;
        kept.next = now.end;
        if taken > 0 {
            frame.compute("environment-map.generate", |pass| {
                for step in &kept.steps[now] {
                    let groups = [(0, &scene.bind_group), (3, &step.group)];
                    step.kernel.dispatch(pass, &groups, step.invocations);
                }
            });
        }
        let is_done = kept.next == kept.steps.len();
        let is_late = kept.filled.is_whole && !is_fresh;
        kept.filled = Filled {
            is_whole: kept.filled.is_whole || is_done,
            is_current: is_done && kept.version == version,
            revision: kept.filled.revision + u64::from(taken > 0 && is_done && is_late),
        };
        Ok(kept.filled)
    }

    fn kept(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        wanted: PrefilteredRequest,
    ) -> Result<&mut FilledMaps, GpuError> {
        let known = self
            .kept
            .iter()
            .position(|filled| filled.maps.wanted == wanted);
        let index = match known {
            Some(index) => index,
            None => {
                let kernels = match self.kernels.take() {
                    Some(kernels) => kernels,
                    None => Kernels::new(gpu, scene)?,
                };
                let kept = FilledMaps::new(gpu, self.kernels.insert(kernels), wanted)?;
                self.kept.push(kept);
                self.kept.len() - 1
            }
        };
        let kept = &mut self.kept[index];
        kept.asked = self.frame;
        Ok(kept)
    }
}

impl FilledMaps {
    fn new(gpu: &Gpu, kernels: &Kernels, wanted: PrefilteredRequest) -> Result<Self, GpuError> {
        let side = wanted.resolution;
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
            &kernels.radiance,
            &[("radiance", TextureView(&faces(&radiance, 0)))],
            texels(side),
            1,
        )?);
        for level in 1..levels {
            steps.push(Step::new(
                gpu,
                &kernels.coarser,
                &[
                    ("finer", TextureView(&faces(&radiance, level - 1))),
                    ("coarser", TextureView(&faces(&radiance, level))),
                ],
                texels(side >> level),
                4,
            )?);
        }
        let level_of_side = |wanted: u32| (side / wanted).max(1).ilog2();
        steps.push(Step::new(
            gpu,
            &kernels.harmonics,
            &[
                (
                    "radiance",
                    TextureView(&faces(&radiance, level_of_side(HARMONICS_SIDE))),
                ),
                ("harmonics", harmonics.as_entire_binding()),
            ],
            [9 * 256, 1, 1],
            6 * HARMONICS_SIDE * HARMONICS_SIDE / 256,
        )?);
        steps.push(Step::new(
            gpu,
            &kernels.irradiance,
            &[
                (
                    "radiance",
                    TextureView(&faces(&radiance, level_of_side(IRRADIANCE_SIDE))),
                ),
                ("irradiance", TextureView(&faces(&irradiance, 0))),
            ],
            texels(IRRADIANCE_SIDE),
            6 * IRRADIANCE_SIDE * IRRADIANCE_SIDE,
        )?);
        for (kind, map) in [(Lobe::GGX, &ggx), (Lobe::PHONG, &phong)] {
            for level in 0..glossy_levels {
                let lobe = lobe(kind, level, glossy_levels, wanted);
                let samples = lobe.samples;
                let lobe = gpu.uniform("glossy lobe", &lobe)?;
                steps.push(Step::new(
                    gpu,
                    &kernels.prefilter,
                    &[
                        ("radiance", TextureView(&cube_view(&radiance))),
                        ("radiance_sampler", Sampler(&kernels.sampler)),
                        ("lobe", lobe.as_entire_binding()),
                        ("filtered", TextureView(&faces(map, level))),
                    ],
                    texels(side >> level),
                    samples,
                )?);
            }
        }
        steps.push(Step::new(
            gpu,
            &kernels.albedo,
            &[(
                "albedo",
                TextureView(&albedo.create_view(&Default::default())),
            )],
            [TABLE_SIDE, TABLE_SIDE, 1],
            1,
        )?);

        Ok(Self {
            maps: Prefiltered {
                views: [
                    cube_view(&irradiance),
                    cube_view(&ggx),
                    cube_view(&phong),
                    albedo.create_view(&Default::default()),
                ],
                radiance,
                irradiance,
                harmonics,
                glossy: [ggx, phong],
                albedo,
                sampler: kernels.sampler.clone(),
                wanted,
            },
            steps,
            next: 0,
            version: None,
            seen: None,
            filled: Filled::default(),
            asked: 0,
        })
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
fn lobe(kind: u32, level: u32, levels: u32, wanted: PrefilteredRequest) -> Lobe {
    let roughness = level_roughness(level, levels);
    Lobe {
        kind: if level > 0 { kind } else { Lobe::MIRROR },
        width: match kind {
            Lobe::GGX => roughness * roughness,
            // The cosine at the surface, which faces the lobe's axis, adds 1 to the exponent.
            _ => phong_exponent(roughness) + f32::from(u8::from(wanted.phong_cosine)),
        },
        // Wider lobes need more samples, and a coarser level has a quarter of the texels.
        samples: wanted.samples << level.saturating_sub(1),
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
    let format = wgpu::TextureFormat::Rgba16Float;
    let usage = wgpu::TextureUsages::TEXTURE_BINDING
        | wgpu::TextureUsages::STORAGE_BINDING
        | wgpu::TextureUsages::COPY_SRC;
    gpu.texture_with_levels(name, [side, side, layers], levels, format, usage)
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
