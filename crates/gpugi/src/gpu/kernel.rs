//! Pipelines whose bind-group layouts come from shader reflection, which keeps the host code of a pass to a few lines.

use std::sync::{Arc, Mutex, PoisonError};

use super::bindings::{BindGroups, Named, bind_all};
use super::lazy::Lazy;
use super::pipelines::Recipe;
use super::shader::{BindingKind, Declared, Reflection, Shader, is_linked_name};
use super::{Gpu, GpuError};

/// The part common to all pipelines: a module's resources as bind-group layouts.
#[derive(Debug, Clone)]
pub(super) struct Interface {
    gpu: Gpu,
    pub(super) name: String,
    declared: Vec<Declared>,
    /// Layout of each group; group 0 is the scene's if the pipeline reads the scene.
    layouts: Vec<Option<wgpu::BindGroupLayout>>,
    pub(super) pipeline_layout: wgpu::PipelineLayout,
    /// Number of the resources in the scene's group, which are declared first.
    of_scene: usize,
    /// Shared by all pipelines of the interface.
    groups: Arc<Mutex<BindGroups>>,
}

impl Interface {
    pub(super) fn new(
        gpu: &Gpu,
        shader: &Shader,
        visibility: wgpu::ShaderStages,
        scene: Option<&wgpu::BindGroupLayout>,
    ) -> Result<(Self, Arc<Reflection>), GpuError> {
        let reflection = gpu.reflections.of(shader, &gpu.source_of(shader))?;
        let declared = reflection.declared.clone();
        let groups = declared
            .iter()
            .map(|variable| variable.group + 1)
            .max()
            .unwrap_or(0);
        let layouts: Vec<Option<wgpu::BindGroupLayout>> = (0..groups)
            .map(|group| {
                if group == 0
                    && let Some(scene) = scene
                {
                    return Some(scene.clone());
                }
                let entries: Vec<_> = declared
                    .iter()
                    .filter(|variable| variable.group == group)
                    .map(|variable| wgpu::BindGroupLayoutEntry {
                        binding: variable.binding,
                        // Vertex shaders may not write to storage buffers.
                        visibility: match variable.kind {
                            BindingKind::Storage => visibility - wgpu::ShaderStages::VERTEX,
                            _ => visibility,
                        },
                        ty: variable.kind.layout_type(&variable.name),
                        count: None,
                    })
                    .collect();
                (!entries.is_empty()).then(|| gpu.layouts.get(&gpu.device, shader.name, entries))
            })
            .collect();
        let references: Vec<_> = layouts.iter().map(Option::as_ref).collect();
        let pipeline_layout = gpu
            .device
            .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(shader.name),
                bind_group_layouts: &references,
                immediate_size: 0,
            });
        let is_of_scene = |variable: &Declared| scene.is_some() && variable.group == 0;
        let interface = Self {
            name: shader.name.to_owned(),
            of_scene: declared.partition_point(is_of_scene),
            declared,
            layouts,
            pipeline_layout,
            groups: gpu.bindings.bind_groups(),
            gpu: gpu.clone(),
        };
        Ok((interface, reflection))
    }

    /// What a pipeline of this interface is compiled from.
    pub(super) fn recipe(
        &self,
        shader: &Shader,
        constants: &[(String, f64)],
        state: String,
    ) -> Recipe {
        let bits = |(name, value): &(String, f64)| (name.clone(), value.to_bits());
        Recipe {
            source: shader.source.clone(),
            constants: constants.iter().map(bits).collect(),
            layouts: self.layouts.clone(),
            state,
        }
    }

    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        group: u32,
        resources: &[(&str, wgpu::BindingResource<'_>)],
    ) -> Result<wgpu::BindGroup, GpuError> {
        let fail = |reason: String| GpuError::Pass {
            pass: self.name.clone(),
            reason,
        };
        let layout = self
            .layouts
            .get(group as usize)
            .and_then(Option::as_ref)
            .ok_or_else(|| fail(format!("the shader has no bind group {group}")))?;
        let entries = self
            .declared
            .iter()
            .filter(|variable| variable.group == group)
            .map(|variable| {
                let resource = resources
                    .iter()
                    .find(|(name, _)| is_linked_name(&variable.name, name))
                    .ok_or_else(|| fail(format!("nothing is bound to {:?}", variable.name)))?;
                Ok(wgpu::BindGroupEntry {
                    binding: variable.binding,
                    resource: resource.1.clone(),
                })
            })
            .collect::<Result<Vec<_>, GpuError>>()?;
        if entries.len() != resources.len() {
            return Err(fail(format!(
                "{} resources for the {} bindings of group {group}",
                resources.len(),
                entries.len()
            )));
        }
        Ok(gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(&self.name),
            layout,
            entries: &entries,
        }))
    }

    /// Sets the bind groups of all resources but the scene's.
    fn set(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        resources: &[Named<'_>],
    ) -> Result<(), GpuError> {
        let (gpu, declared) = (&self.gpu, &self.declared[self.of_scene..]);
        let mut groups = self.groups.lock().unwrap_or_else(PoisonError::into_inner);
        let set = groups.with(
            gpu.bindings.now(),
            declared,
            resources,
            |found| bind_all(&gpu.device, &self.name, &self.layouts, declared, found),
            |groups| {
                for (index, group) in groups {
                    pass.set_bind_group(*index, group, &[]);
                }
            },
        );
        set.map_err(|missing| GpuError::Pass {
            pass: self.name.clone(),
            reason: format!("nothing is bound to {missing:?}"),
        })
    }
}

/// Creates the module of a shader, as this adapter needs it.
pub(super) fn shader_module(gpu: &Gpu, shader: &Shader, unchecked: bool) -> wgpu::ShaderModule {
    let descriptor = wgpu::ShaderModuleDescriptor {
        label: Some(shader.name),
        source: wgpu::ShaderSource::Wgsl(gpu.source_of(shader)),
    };
    if unchecked {
        // SAFETY: see `KernelOptions::unchecked`: whoever sets it guarantees its conditions.
        #[allow(unsafe_code)]
        unsafe {
            let checks = wgpu::ShaderRuntimeChecks::unchecked();
            gpu.device.create_shader_module_trusted(descriptor, checks)
        }
    } else {
        gpu.device.create_shader_module(descriptor)
    }
}

/// How a [`Kernel`] is compiled.
#[derive(Debug, Clone, Copy, Default)]
pub struct KernelOptions<'a> {
    /// Values of pipeline-overridable constants, by their names in WESL modules.
    pub constants: &'a [(&'a str, f64)],
    /// Omits the checks that naga adds: bounds of buffers and arrays, and bounds of loops. Only for shaders in which
    /// every index is in range and every loop ends, whatever scene is bound.
    pub(crate) unchecked: bool,
}

/// A compute pipeline.
#[derive(Debug, Clone)]
pub struct Kernel {
    interface: Interface,
    entry: Arc<EntryPoint>,
    pipeline: Lazy<wgpu::ComputePipeline>,
    workgroup_size: [u32; 3],
}

/// An entry point of a module, and the constants that it is compiled with.
#[derive(Debug, Clone)]
struct EntryPoint {
    shader: Shader,
    name: String,
    unchecked: bool,
    /// Linked names of the overridable constants: all that the module declares, and those given values.
    overridable: Vec<String>,
    constants: Vec<(String, f64)>,
}

/// Constants by their linked names, which carry the module's path, from their names in WESL modules.
pub(super) fn linked_constants(
    pass: &str,
    overridable: &[String],
    constants: &[(&str, f64)],
) -> Result<Vec<(String, f64)>, GpuError> {
    let linked = |&(name, value): &(&str, f64)| {
        let mut linked = overridable.iter();
        let linked = linked.find(|linked| is_linked_name(linked, name));
        let linked = linked.ok_or_else(|| GpuError::Pass {
            pass: pass.to_owned(),
            reason: format!("there is no overridable constant {name}"),
        })?;
        Ok((linked.clone(), value))
    };
    constants.iter().map(linked).collect()
}

impl EntryPoint {
    fn label(&self) -> String {
        format!("{}.{}", self.shader.name, self.name)
    }

    /// Sets constants by their names in WESL modules.
    fn with(mut self, constants: &[(&str, f64)]) -> Result<Self, GpuError> {
        let linked = linked_constants(&self.label(), &self.overridable, constants)?;
        self.constants.extend(linked);
        Ok(self)
    }

    fn compile(self: &Arc<Self>, gpu: &Gpu, interface: &Interface) -> Lazy<wgpu::ComputePipeline> {
        let (entry, layout) = (self.clone(), interface.pipeline_layout.clone());
        let of = gpu.clone();
        let state = format!("{} unchecked: {}", self.label(), self.unchecked);
        let recipe = interface.recipe(&self.shader, &self.constants, state);
        Lazy::compile(gpu, &gpu.compute_pipelines, recipe, move || {
            let constants: Vec<_> = entry
                .constants
                .iter()
                .map(|(name, value)| (name.as_str(), *value))
                .collect();
            of.device
                .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(&entry.label()),
                    layout: Some(&layout),
                    module: &shader_module(&of, &entry.shader, entry.unchecked),
                    entry_point: Some(&entry.name),
                    compilation_options: wgpu::PipelineCompilationOptions {
                        constants: &constants,
                        ..Default::default()
                    },
                    cache: None,
                })
        })
    }
}

impl Kernel {
    /// Compiles `entry` of `shader`. `scene` is the layout of bind group 0 if the shader reads the scene.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when the shader does not compile.
    pub fn new(
        gpu: &Gpu,
        shader: &Shader,
        entry: &str,
        scene: Option<&wgpu::BindGroupLayout>,
    ) -> Result<Self, GpuError> {
        Self::with_options(gpu, shader, entry, scene, &KernelOptions::default())
    }

    /// Like [`Kernel::new`], with values of pipeline-overridable constants, by their names in WESL modules.
    ///
    /// # Errors
    /// As [`Kernel::with_options`].
    pub fn with_constants(
        gpu: &Gpu,
        shader: &Shader,
        entry: &str,
        scene: Option<&wgpu::BindGroupLayout>,
        constants: &[(&str, f64)],
    ) -> Result<Self, GpuError> {
        let options = KernelOptions {
            constants,
            ..Default::default()
        };
        Self::with_options(gpu, shader, entry, scene, &options)
    }

    /// Like [`Kernel::new`], with options.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when the shader does not compile or has no such constant.
    pub fn with_options(
        gpu: &Gpu,
        shader: &Shader,
        entry: &str,
        scene: Option<&wgpu::BindGroupLayout>,
        options: &KernelOptions<'_>,
    ) -> Result<Self, GpuError> {
        let stages = wgpu::ShaderStages::COMPUTE;
        let shader = gpu.current(shader);
        let (interface, reflection) = Interface::new(gpu, &shader, stages, scene)?;
        let entry = EntryPoint {
            shader,
            name: entry.to_owned(),
            unchecked: options.unchecked,
            overridable: reflection.overridable.clone(),
            constants: Vec::new(),
        };
        let entry = Arc::new(entry.with(options.constants)?);
        let mut points = reflection.entry_points.iter();
        let point = points.find(|(name, _)| *name == entry.name);
        let (_, workgroup_size) = point.ok_or_else(|| GpuError::Pass {
            pass: entry.label(),
            reason: "there is no such entry point".into(),
        })?;
        Ok(Self {
            pipeline: entry.compile(gpu, &interface),
            workgroup_size: *workgroup_size,
            interface,
            entry,
        })
    }

    /// The same kernel, compiled with other values of some constants. Bind groups of one work with the other.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when the shader has no such constant.
    pub fn variant(&self, gpu: &Gpu, constants: &[(&str, f64)]) -> Result<Self, GpuError> {
        let mut entry = EntryPoint::clone(&self.entry);
        let replaced = |linked: &str| {
            constants
                .iter()
                .any(|(name, _)| is_linked_name(linked, name))
        };
        entry.constants.retain(|(linked, _)| !replaced(linked));
        let entry = Arc::new(entry.with(constants)?);
        Ok(Self {
            pipeline: entry.compile(gpu, &self.interface),
            interface: self.interface.clone(),
            entry,
            ..*self
        })
    }

    /// Binds resources by their names in the shader in `group`; resources of imported modules keep their own names.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when a name is missing or a resource does not fit.
    pub fn bind(
        &self,
        gpu: &Gpu,
        group: u32,
        resources: &[(&str, wgpu::BindingResource<'_>)],
    ) -> Result<wgpu::BindGroup, GpuError> {
        self.interface.bind(gpu, group, resources)
    }

    /// Runs at least `invocations` invocations along each axis. More workgroups along x
    /// than the limit of 65,535 are folded into y if y is 1: such shaders compute their index with `num_workgroups`.
    pub fn dispatch(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        groups: &[(u32, &wgpu::BindGroup)],
        invocations: [u32; 3],
    ) {
        self.set(pass, groups);
        self.dispatch_workgroups(pass, invocations);
    }

    /// Binds `resources` by their names in the shader, and runs at least `invocations` as [`Kernel::dispatch`] does.
    /// `scene`: bind group 0 if the kernel was made with the scene's layout. Resources that the shader does not declare
    /// are ignored, so that passes which share some need only one list.
    ///
    /// # Errors
    /// [`GpuError::Pass`] when a resource is missing.
    pub fn run(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        scene: Option<&wgpu::BindGroup>,
        resources: &[Named<'_>],
        invocations: [u32; 3],
    ) -> Result<(), GpuError> {
        self.begin(pass, scene, resources)?;
        self.dispatch_workgroups(pass, invocations);
        Ok(())
    }

    /// As [`Kernel::run`], for as many workgroups as [`Kernel::dispatch_indirect`] reads.
    ///
    /// # Errors
    /// As [`Kernel::run`].
    pub fn run_indirect(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        scene: Option<&wgpu::BindGroup>,
        resources: &[Named<'_>],
        (arguments, offset): (&wgpu::Buffer, u64),
    ) -> Result<(), GpuError> {
        self.begin(pass, scene, resources)?;
        pass.dispatch_workgroups_indirect(arguments, offset);
        Ok(())
    }

    fn begin(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        scene: Option<&wgpu::BindGroup>,
        resources: &[Named<'_>],
    ) -> Result<(), GpuError> {
        pass.set_pipeline(self.pipeline.get(&self.interface.name));
        if scene.is_some() {
            pass.set_bind_group(0, scene, &[]);
        }
        self.interface.set(pass, resources)
    }

    fn dispatch_workgroups(&self, pass: &mut wgpu::ComputePass<'_>, invocations: [u32; 3]) {
        let [mut x, mut y, z] = std::array::from_fn(|axis| {
            invocations[axis].div_ceil(self.workgroup_size[axis]).max(1)
        });
        if x > 65_535 && y == 1 {
            y = x.div_ceil(65_535);
            x = x.div_ceil(y);
        }
        #[cfg(test)]
        WORKGROUPS.set(WORKGROUPS.get() + u64::from(x) * u64::from(y) * u64::from(z));
        pass.dispatch_workgroups(x, y, z);
    }

    /// Runs as many workgroups along each axis as the three words at `offset` (bytes) of `arguments` say. Each word
    /// must be at most 65,535, which is not checked.
    pub fn dispatch_indirect(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        groups: &[(u32, &wgpu::BindGroup)],
        arguments: &wgpu::Buffer,
        offset: u64,
    ) {
        self.set(pass, groups);
        pass.dispatch_workgroups_indirect(arguments, offset);
    }

    fn set(&self, pass: &mut wgpu::ComputePass<'_>, groups: &[(u32, &wgpu::BindGroup)]) {
        pass.set_pipeline(self.pipeline.get(&self.interface.name));
        for (index, group) in groups {
            pass.set_bind_group(*index, *group, &[]);
        }
    }
}

#[cfg(test)]
thread_local! {
    /// Workgroups that this thread has recorded.
    pub(crate) static WORKGROUPS: std::cell::Cell<u64> = const { std::cell::Cell::new(0) };
}

/// A bind-group layout with every resource that `shaders` declare in group 0, for all stages.
pub(crate) fn scene_layout(
    gpu: &Gpu,
    shaders: &[Shader],
) -> Result<wgpu::BindGroupLayout, GpuError> {
    let mut declared = Vec::new();
    for shader in shaders {
        let shader = gpu.current(shader);
        let reflection = gpu.reflections.of(&shader, &gpu.source_of(&shader))?;
        declared.extend_from_slice(&reflection.declared);
    }
    let entries: Vec<_> = declared
        .iter()
        .map(|variable| wgpu::BindGroupLayoutEntry {
            binding: variable.binding,
            visibility: wgpu::ShaderStages::all() & wgpu::ShaderStages::VERTEX_FRAGMENT
                | wgpu::ShaderStages::COMPUTE,
            ty: variable.kind.layout_type(&variable.name),
            count: None,
        })
        .collect();
    Ok(gpu.layouts.get(&gpu.device, "scene", entries))
}
