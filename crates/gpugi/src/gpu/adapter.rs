//! Listing and choosing GPU adapters.

use super::GpuError;

/// Which adapter to open.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum AdapterChoice {
    /// The fastest: discrete, then integrated, then anything, software last.
    #[default]
    Best,
    /// A software rasterizer: slow, but the same everywhere.
    Software,
    /// A discrete GPU only.
    Discrete,
    /// That at this place of [`list_adapters`], counted from 0.
    Numbered(usize),
    /// The first whose name contains this text; case is ignored.
    Named(String),
}

impl std::str::FromStr for AdapterChoice {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text {
            "best" => Self::Best,
            "software" => Self::Software,
            "discrete" => Self::Discrete,
            text => match text.strip_prefix('#').and_then(|text| text.parse().ok()) {
                Some(number) => Self::Numbered(number),
                None => Self::Named(text.to_owned()),
            },
        })
    }
}

/// What an adapter reports about itself.
#[derive(Debug, Clone, PartialEq)]
pub struct AdapterSummary {
    /// Device name.
    pub name: String,
    /// Discrete, integrated, virtual, software.
    pub device_type: wgpu::DeviceType,
    /// Vulkan, Metal, DX12, browser.
    pub backend: wgpu::Backend,
    /// Driver name and version.
    pub driver: String,
    /// Its limits.
    pub limits: wgpu::Limits,
    /// Its optional features.
    pub features: wgpu::Features,
}

impl AdapterSummary {
    /// What `adapter` reports.
    pub fn of(adapter: &wgpu::Adapter) -> Self {
        let info = adapter.get_info();
        Self {
            name: info.name,
            device_type: info.device_type,
            backend: info.backend,
            driver: format!("{} {}", info.driver, info.driver_info)
                .trim()
                .to_owned(),
            limits: adapter.limits(),
            features: adapter.features(),
        }
    }

    /// Whether the processor does its work.
    pub fn is_software(&self) -> bool {
        self.device_type == wgpu::DeviceType::Cpu
    }

    /// Whether passes can be timed.
    pub fn has_timestamps(&self) -> bool {
        self.features.contains(wgpu::Features::TIMESTAMP_QUERY)
    }

    /// What gpugi needs and this adapter lacks, one line each; empty when the adapter is usable.
    pub fn missing(&self) -> Vec<String> {
        let mut missing = Vec::new();
        wgpu::Limits::default().check_limits_with_fail_fn(
            &self.limits,
            false,
            |name, needed, has| {
                missing.push(format!(
                    "{name}: gpugi needs {needed}, the adapter has {has}"
                ));
            },
        );
        missing
    }
}

/// How gpugi creates its instance of wgpu, for programs that create one for their window.
pub fn instance_descriptor() -> wgpu::InstanceDescriptor {
    let defaults = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
    wgpu::InstanceDescriptor {
        backends: wgpu::Backends::PRIMARY,
        // This validation adds a pass before each indirect dispatch, which costs the path tracer up to 8 percent.
        // gpugi's shaders write arguments within the limits.
        flags: defaults.flags - wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL,
        // The rest of the memory budget is left to other programs: allocations beyond this percentage fail before the
        // device is lost.
        memory_budget_thresholds: wgpu::MemoryBudgetThresholds {
            for_resource_creation: Some(90),
            for_device_loss: None,
        },
        ..defaults
    }
}

/// Every adapter of this machine, best first.
pub fn list_adapters() -> Vec<AdapterSummary> {
    let mut adapters = pollster::block_on(adapters());
    sort(&mut adapters);
    adapters.iter().map(AdapterSummary::of).collect()
}

/// The best first.
fn sort(adapters: &mut [wgpu::Adapter]) {
    adapters.sort_by_key(|adapter| match adapter.get_info().device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    });
}

impl AdapterChoice {
    /// The best of `adapters` that fits, such as those that can draw on a window.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] when none fits.
    pub fn choose(&self, mut adapters: Vec<wgpu::Adapter>) -> Result<wgpu::Adapter, GpuError> {
        sort(&mut adapters);
        let names: Vec<String> = adapters
            .iter()
            .map(|adapter| adapter.get_info().name)
            .collect();
        let fits = |place: usize, info: &wgpu::AdapterInfo| match self {
            Self::Best => true,
            Self::Software => info.device_type == wgpu::DeviceType::Cpu,
            Self::Discrete => info.device_type == wgpu::DeviceType::DiscreteGpu,
            Self::Numbered(number) => place == *number,
            Self::Named(name) => info.name.to_lowercase().contains(&name.to_lowercase()),
        };
        let mut places = adapters.into_iter().enumerate();
        places
            .find(|(place, adapter)| fits(*place, &adapter.get_info()))
            .map(|(_, adapter)| adapter)
            .ok_or_else(|| GpuError::NoAdapter {
                wanted: match self {
                    Self::Best => "is installed".to_owned(),
                    Self::Software => "renders in software".to_owned(),
                    Self::Discrete => "is a discrete GPU".to_owned(),
                    Self::Numbered(number) => format!("has the number {number}"),
                    Self::Named(name) => format!("is named {name:?}"),
                },
                found: if names.is_empty() {
                    "There is none at all.".to_owned()
                } else {
                    format!("There is: {}.", names.join(", "))
                },
                advice: "`gpugi doctor` says what is missing and how to get it.".to_owned(),
            })
    }
}

pub(super) async fn adapters() -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(instance_descriptor());
    instance.enumerate_adapters(wgpu::Backends::PRIMARY).await
}
