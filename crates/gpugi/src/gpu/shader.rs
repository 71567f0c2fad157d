//! Linked shaders and their resources by naga's reflection.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use super::GpuError;

/// A linked WGSL module, created by [`shader!`](crate::shader).
#[derive(Debug, Clone)]
pub struct Shader {
    /// Dotted module path below `src`, such as `techniques.shadow_map.gather`.
    pub name: &'static str,
    /// Linked WGSL.
    pub source: Cow<'static, str>,
}

/// The linked shader of a module: `shader!("techniques.shadow_map.gather")`.
#[macro_export]
macro_rules! shader {
    ($name:literal) => {
        $crate::gpu::Shader {
            name: $name,
            source: std::borrow::Cow::Borrowed(include_str!(concat!(
                env!("OUT_DIR"),
                "/",
                $name,
                ".wgsl"
            ))),
        }
    };
}

/// Every linked shader: name and WGSL.
pub fn all_shaders() -> &'static [(&'static str, &'static str)] {
    include!(concat!(env!("OUT_DIR"), "/shaders.rs"))
}

/// In debug builds, the program that writes all shaders, linked anew from their sources, into the folder `OUT_DIR`; and
/// the folder in which it runs, with the sources in `src`. It is build.rs.
pub fn shader_linker() -> Option<(&'static Path, &'static Path)> {
    let program = option_env!("GPUGI_LINKER").map(Path::new);
    program.zip(option_env!("GPUGI_LINKER_FOLDER").map(Path::new))
}

/// Whether `linked` is the linker's form of `name`. In the root module, that is the name itself. In an imported module,
/// it is the module's path and then the name, where a part with n > 0 underscores becomes `_npart`.
pub(super) fn is_linked_name(linked: &str, name: &str) -> bool {
    let part = match name.matches('_').count() {
        0 => name.to_owned(),
        count => format!("_{count}{name}"),
    };
    linked == name
        || linked
            .strip_suffix(&part)
            .is_some_and(|path| path.ends_with('_'))
}

/// One resource that a shader declares.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Declared {
    pub name: String,
    pub group: u32,
    pub binding: u32,
    pub kind: BindingKind,
}

/// What the host needs to know of a shader's module.
#[derive(Debug, Clone)]
pub(super) struct Reflection {
    /// Its resources, ordered by group and binding.
    pub declared: Vec<Declared>,
    /// Linked names of the constants that pipelines may override.
    pub overridable: Vec<String>,
    /// Names and workgroup sizes of its entry points.
    pub entry_points: Vec<(String, [u32; 3])>,
}

/// Reflections by source: techniques make the same kernels again and again, and parsing takes milliseconds.
#[derive(Debug, Default)]
pub(super) struct Reflections(Mutex<HashMap<Cow<'static, str>, Arc<Reflection>>>);

impl Reflections {
    /// The reflection of a shader; `source` as an adapter needs it.
    pub fn of(&self, shader: &Shader, source: &str) -> Result<Arc<Reflection>, GpuError> {
        let known = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = known().get(&shader.source) {
            return Ok(found.clone());
        }
        let module = shader.parse_as(source)?;
        let overrides = module.overrides.iter();
        let points = module.entry_points.iter();
        let reflection = Arc::new(Reflection {
            declared: shader.declared(&module)?,
            overridable: overrides
                .filter_map(|(_, constant)| constant.name.clone())
                .collect(),
            entry_points: points
                .map(|point| (point.name.clone(), point.workgroup_size))
                .collect(),
        });
        known().insert(shader.source.clone(), reflection.clone());
        Ok(reflection)
    }
}

/// The type of a declared resource.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BindingKind {
    /// Uniform buffer.
    Uniform,
    /// Storage buffer that shaders only read.
    ReadOnlyStorage,
    /// Storage buffer that shaders write.
    Storage,
    /// Sampled texture: dimension, sample type.
    Texture(wgpu::TextureViewDimension, wgpu::TextureSampleType),
    /// Storage texture that shaders only write: dimension, format.
    StorageTexture(wgpu::TextureViewDimension, wgpu::TextureFormat),
    /// Sampler that does not compare.
    Sampler,
    /// Comparison sampler.
    ComparisonSampler,
}

impl Shader {
    /// The shader of a gather from another crate: `body`, which has the entry point `main`, after gpugi's library
    /// (techniques/library.wesl).
    pub fn gather(name: &'static str, body: &str) -> Self {
        let library = include_str!(concat!(env!("OUT_DIR"), "/techniques.library.wgsl"));
        Self {
            name,
            source: Cow::Owned(format!("{library}\n{body}")),
        }
    }

    /// Parses and validates.
    ///
    /// # Errors
    /// [`GpuError::Pass`] with the compiler's message.
    pub fn parse(&self) -> Result<naga::Module, GpuError> {
        self.parse_as(&self.source)
    }

    /// Checks that GPUs will take it, as far as that can be said without one.
    ///
    /// # Errors
    /// As [`Shader::parse`].
    pub fn validate(&self) -> Result<(), GpuError> {
        // `pack2x16float` is part of WebGPU, but naga makes it a separate capability.
        let capabilities = naga::valid::Capabilities::default()
            | naga::valid::Capabilities::SHADER_FLOAT16_IN_FLOAT32;
        let flags = naga::valid::ValidationFlags::all();
        let mut validator = naga::valid::Validator::new(flags, capabilities);
        let validated = validator.validate(&self.parse()?);
        validated.map(drop).map_err(|error| GpuError::Pass {
            pass: self.name.to_owned(),
            reason: error.emit_to_string(&self.source),
        })
    }

    /// Like [`Shader::parse`], for the source as an adapter needs it.
    pub(super) fn parse_as(&self, source: &str) -> Result<naga::Module, GpuError> {
        naga::front::wgsl::parse_str(source).map_err(|error| GpuError::Pass {
            pass: self.name.to_owned(),
            reason: error.emit_to_string(source),
        })
    }

    /// Every global resource of the module, ordered by group and binding.
    pub(super) fn declared(&self, module: &naga::Module) -> Result<Vec<Declared>, GpuError> {
        let mut declared = Vec::new();
        for (_, variable) in module.global_variables.iter() {
            let Some(at) = variable.binding else { continue };
            let kind = binding_kind(module, variable).ok_or_else(|| GpuError::Pass {
                pass: self.name.to_owned(),
                reason: format!(
                    "binding {:?} has a type that gpugi does not bind",
                    variable.name
                ),
            })?;
            declared.push(Declared {
                name: variable.name.clone().unwrap_or_default(),
                group: at.group,
                binding: at.binding,
                kind,
            });
        }
        declared.sort_by_key(|variable| (variable.group, variable.binding));
        Ok(declared)
    }
}

fn binding_kind(module: &naga::Module, variable: &naga::GlobalVariable) -> Option<BindingKind> {
    Some(match variable.space {
        naga::AddressSpace::Uniform => BindingKind::Uniform,
        naga::AddressSpace::Storage { access } => {
            if access.contains(naga::StorageAccess::STORE) {
                BindingKind::Storage
            } else {
                BindingKind::ReadOnlyStorage
            }
        }
        naga::AddressSpace::Handle => match module.types[variable.ty].inner {
            naga::TypeInner::Sampler { comparison: false } => BindingKind::Sampler,
            naga::TypeInner::Sampler { comparison: true } => BindingKind::ComparisonSampler,
            naga::TypeInner::Image {
                dim,
                arrayed,
                class,
            } => {
                let dimension = match (dim, arrayed) {
                    (naga::ImageDimension::D2, false) => wgpu::TextureViewDimension::D2,
                    (naga::ImageDimension::D2, true) => wgpu::TextureViewDimension::D2Array,
                    (naga::ImageDimension::Cube, false) => wgpu::TextureViewDimension::Cube,
                    (naga::ImageDimension::Cube, true) => wgpu::TextureViewDimension::CubeArray,
                    (naga::ImageDimension::D3, _) => wgpu::TextureViewDimension::D3,
                    _ => return None,
                };
                if let naga::ImageClass::Storage { format, access } = class {
                    let format = match format {
                        naga::StorageFormat::Rgba16Float => wgpu::TextureFormat::Rgba16Float,
                        naga::StorageFormat::Rgba32Float => wgpu::TextureFormat::Rgba32Float,
                        naga::StorageFormat::Rgba32Uint => wgpu::TextureFormat::Rgba32Uint,
                        naga::StorageFormat::Rg32Float => wgpu::TextureFormat::Rg32Float,
                        naga::StorageFormat::R32Float => wgpu::TextureFormat::R32Float,
                        naga::StorageFormat::R32Uint => wgpu::TextureFormat::R32Uint,
                        _ => return None,
                    };
                    return (access == naga::StorageAccess::STORE)
                        .then_some(BindingKind::StorageTexture(dimension, format));
                }
                let sample_type = match class {
                    naga::ImageClass::Depth { multi: false } => wgpu::TextureSampleType::Depth,
                    naga::ImageClass::Sampled {
                        kind: naga::ScalarKind::Float,
                        multi: false,
                    } => wgpu::TextureSampleType::Float { filterable: true },
                    naga::ImageClass::Sampled {
                        kind: naga::ScalarKind::Uint,
                        multi: false,
                    } => wgpu::TextureSampleType::Uint,
                    _ => return None,
                };
                BindingKind::Texture(dimension, sample_type)
            }
            _ => return None,
        },
        _ => return None,
    })
}

impl BindingKind {
    /// The layout entry of this kind. Textures and samplers whose names end in `_unfilterable` never filter.
    pub(super) fn layout_type(self, name: &str) -> wgpu::BindingType {
        let is_unfilterable = name.ends_with("_unfilterable");
        let buffer = |ty| wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset: false,
            min_binding_size: None,
        };
        match self {
            Self::Uniform => buffer(wgpu::BufferBindingType::Uniform),
            Self::ReadOnlyStorage => buffer(wgpu::BufferBindingType::Storage { read_only: true }),
            Self::Storage => buffer(wgpu::BufferBindingType::Storage { read_only: false }),
            Self::Texture(view_dimension, sample_type) => wgpu::BindingType::Texture {
                sample_type: if is_unfilterable {
                    wgpu::TextureSampleType::Float { filterable: false }
                } else {
                    sample_type
                },
                view_dimension,
                multisampled: false,
            },
            Self::StorageTexture(view_dimension, format) => wgpu::BindingType::StorageTexture {
                access: wgpu::StorageTextureAccess::WriteOnly,
                format,
                view_dimension,
            },
            Self::Sampler => wgpu::BindingType::Sampler(if is_unfilterable {
                wgpu::SamplerBindingType::NonFiltering
            } else {
                wgpu::SamplerBindingType::Filtering
            }),
            Self::ComparisonSampler => {
                wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Comparison)
            }
        }
    }
}
