//! The GPU: adapters, device, shaders, passes, buffers, read-backs and timing. Only this folder holds raw wgpu
//! plumbing.

mod adapter;
mod bindings;
mod blit;
#[cfg(not(target_arch = "wasm32"))]
mod ending;
mod error;
mod frame;
mod kernel;
mod lazy;
mod pipelines;
mod quad;
mod raster;
mod read_back;
mod shader;
#[cfg(test)]
mod tests;
mod upload;

pub use adapter::{AdapterChoice, AdapterSummary, instance_descriptor, list_adapters};
pub use bindings::{Bind, Bound, Named, join};
pub(crate) use blit::Blit;
#[cfg(not(target_arch = "wasm32"))]
pub use ending::AtWork;
pub use error::GpuError;
pub use frame::{Frame, Keeps, Timing, Timings};
#[cfg(test)]
pub(crate) use kernel::WORKGROUPS;
pub(crate) use kernel::scene_layout;
pub use kernel::{Kernel, KernelOptions};
pub(crate) use quad::Quad;
pub use raster::{DepthTest, RasterKernel, RasterState};
pub(crate) use read_back::begin_read_part;
pub use read_back::{ReadBack, begin_read_buffer, begin_read_texture, read_buffer, read_texture};
pub use shader::{BindingKind, Shader, all_shaders, shader_linker};
pub(crate) use upload::HostBuffer;
use upload::Uploads;
pub use wgpu::TextureAspect;

use std::borrow::Cow;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Mesa's software adapter compiles a copy of a shader for each set of values of uniform buffers that decide branches,
/// and never frees it: 100 MB per second. It does not do this for storage buffers.
const UNIFORM_INLINER: &str = "llvmpipe";

/// Size of a buffer of nothing: an array of a shader has at least one element, which is no larger than this [bytes].
const EMPTY_BYTES: u64 = 1024;

/// One device and its queue, within WebGPU's default limits except for buffer sizes.
#[derive(Debug, Clone)]
pub struct Gpu {
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// What the adapter reports about itself.
    pub adapter: AdapterSummary,
    /// Whether passes can be timed.
    pub has_timestamps: bool,
    /// Whether shaders read uniform buffers as storage buffers.
    uniforms_are_storage: bool,
    limits: wgpu::Limits,
    faults: Arc<Mutex<Faults>>,
    /// Number of pipelines of this handle that are not compiled yet.
    compiling: Arc<AtomicUsize>,
    /// How often the host has waited with this handle.
    waits: Arc<AtomicU64>,
    /// In a browser, all pipelines that are not compiled yet, whosever they are.
    uncompiled: Option<lazy::Uncompiled>,
    /// How many more allocations may succeed.
    allocations_left: Arc<AtomicU64>,
    /// Shaders that take the place of those with their names.
    replaced: Arc<Mutex<Vec<Shader>>>,
    reflections: Arc<shader::Reflections>,
    layouts: Arc<pipelines::Layouts>,
    compute_pipelines: pipelines::Pipelines<wgpu::ComputePipeline>,
    render_pipelines: pipelines::Pipelines<wgpu::RenderPipeline>,
    uploads: Arc<Uploads>,
    bindings: Arc<bindings::BindingCache>,
}

/// Errors that the GPU API reports outside calls that could return them.
#[derive(Debug, Default)]
struct Faults {
    /// Why the device was lost, which is permanent.
    lost: Option<String>,
    /// The first error since the last [`Gpu::check`]; later ones mostly follow from it.
    error: Option<GpuError>,
}

impl Gpu {
    /// Opens the chosen adapter.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] when none fits, with what is available and what to do; [`GpuError::Device`] when the
    /// adapter refuses.
    pub fn open(choice: &AdapterChoice) -> Result<Self, GpuError> {
        pollster::block_on(Self::open_async(choice))
    }

    /// [`Gpu::open`] for programs that must not block.
    ///
    /// # Errors
    /// As [`Gpu::open`].
    pub async fn open_async(choice: &AdapterChoice) -> Result<Self, GpuError> {
        let adapter = choice.choose(adapter::adapters().await)?;
        let (device, queue) = adapter
            .request_device(&Self::device_descriptor(&adapter))
            .await
            .map_err(|error| GpuError::Device {
                adapter: adapter.get_info().name,
                reason: error.to_string(),
            })?;
        Ok(Self::from_device(&adapter, device, queue))
    }

    /// The device that gpugi asks of `adapter`, for programs that open it for their window ([`Gpu::from_device`]).
    pub fn device_descriptor(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
        wgpu::DeviceDescriptor {
            label: Some("gpugi"),
            required_features: adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
            required_limits: Self::required_limits(adapter),
            ..Default::default()
        }
    }

    /// Shares the device and queue of an engine. The device needs WebGPU's default limits and, on Mesa's software
    /// adapter, 12 more storage buffers per shader stage ([`Gpu::required_limits`]). With
    /// [`wgpu::Features::TIMESTAMP_QUERY`], passes can be timed. gpugi takes over the device's handlers of uncaptured
    /// errors and of loss; an engine that wants its own sets them afterwards and then receives gpugi's errors, too.
    pub fn from_device(adapter: &wgpu::Adapter, device: wgpu::Device, queue: wgpu::Queue) -> Self {
        #[cfg(not(target_arch = "wasm32"))]
        ending::wait_at_the_end();
        let adapter = AdapterSummary::of(adapter);
        let faults = Arc::new(Mutex::new(Faults::default()));
        let record = faults.clone();
        device.set_device_lost_callback(move |reason, message| {
            let mut faults = record.lock().unwrap_or_else(PoisonError::into_inner);
            faults.lost = Some(format!("{reason:?}: {message}"));
        });
        let record = faults.clone();
        device.on_uncaptured_error(Arc::new(move |error| {
            if let Some(error) = GpuError::uncaptured(&error) {
                let mut faults = record.lock().unwrap_or_else(PoisonError::into_inner);
                faults.error.get_or_insert(error);
            }
        }));
        Self {
            uploads: Arc::new(Uploads::new(&device)),
            limits: device.limits(),
            has_timestamps: device.features().contains(wgpu::Features::TIMESTAMP_QUERY),
            uniforms_are_storage: adapter.name.starts_with(UNIFORM_INLINER),
            device,
            queue,
            adapter,
            faults,
            compiling: Arc::default(),
            waits: Arc::default(),
            uncompiled: cfg!(target_arch = "wasm32").then(lazy::Uncompiled::default),
            allocations_left: Arc::new(AtomicU64::new(u64::MAX)),
            replaced: Arc::default(),
            reflections: Arc::default(),
            layouts: Arc::default(),
            compute_pipelines: Default::default(),
            render_pipelines: Default::default(),
            bindings: Arc::default(),
        }
    }

    /// The limits that [`Gpu::from_device`] expects of a device of `adapter`.
    pub fn required_limits(adapter: &wgpu::Adapter) -> wgpu::Limits {
        let available = adapter.limits();
        // WebGPU's defaults, but buffers may be as large as the adapter allows: scenes decide what they need.
        let defaults = wgpu::Limits::default();
        let extra = if adapter.get_info().name.starts_with(UNIFORM_INLINER) {
            defaults.max_uniform_buffers_per_shader_stage
        } else {
            0
        };
        wgpu::Limits {
            max_storage_buffers_per_shader_stage: defaults.max_storage_buffers_per_shader_stage
                + extra,
            max_buffer_size: available.max_buffer_size,
            max_storage_buffer_binding_size: available.max_storage_buffer_binding_size,
            ..defaults
        }
    }

    /// Kernels that are made from now on take these shaders in place of those with their names, and all others as they
    /// were built. For shaders under development.
    pub fn replace_shaders(&self, shaders: Vec<Shader>) {
        *self.replaced.lock().unwrap_or_else(PoisonError::into_inner) = shaders;
    }

    /// What [`Gpu::replace_shaders`] was given last.
    pub fn replaced_shaders(&self) -> Vec<Shader> {
        let replaced = self.replaced.lock();
        replaced.unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The shader, or what takes its place.
    fn current(&self, shader: &Shader) -> Shader {
        let replaced = self.replaced.lock().unwrap_or_else(PoisonError::into_inner);
        let found = replaced
            .iter()
            .find(|replacement| replacement.name == shader.name);
        found.unwrap_or(shader).clone()
    }

    /// The source of a shader as this adapter needs it.
    fn source_of<'a>(&self, shader: &'a Shader) -> Cow<'a, str> {
        if self.uniforms_are_storage {
            Cow::Owned(shader.source.replace("var<uniform>", "var<storage, read>"))
        } else {
            Cow::Borrowed(&shader.source)
        }
    }

    /// Runs `create`, which allocates GPU memory, and returns its errors here, so that running out of memory is an
    /// error of the call that allocates. In a browser, which never blocks, such an error arrives at the next
    /// [`Gpu::check`].
    ///
    /// # Errors
    /// [`GpuError::Lost`], [`GpuError::OutOfMemory`], or [`GpuError::Pass`] that names `what`.
    pub(crate) fn allocate<T>(
        &self,
        what: &str,
        create: impl FnOnce() -> T,
    ) -> Result<T, GpuError> {
        self.check_lost()?;
        let left =
            (self.allocations_left).fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| {
                left.checked_sub(1)
            });
        if left.is_err() {
            return Err(GpuError::OutOfMemory {
                pass: what.to_owned(),
            });
        }
        if cfg!(target_arch = "wasm32") {
            return Ok(create());
        }
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let created = create();
        // Natively these futures are ready: nothing waits for the GPU.
        let errors = [internal.pop(), memory.pop(), validation.pop()].map(pollster::block_on);
        match errors.into_iter().flatten().next() {
            Some(error) => {
                // What a lost device refuses is not at fault.
                self.notice_loss()?;
                Err(GpuError::in_pass(what, &error))
            }
            None => self.check_lost().map(|()| created),
        }
    }

    /// From now on only `count` allocations of GPU memory succeed; the others fail as if there were no more. For tests.
    pub fn limit_allocations(&self, count: u64) {
        self.allocations_left.store(count, Ordering::Relaxed);
    }

    /// Reports, once, the first error since the last check that no call could return: invalid pipelines, bind groups
    /// and passes, by their labels. [`Frame::submit`] checks; code that submits commands without a frame must check
    /// afterwards.
    ///
    /// # Errors
    /// [`GpuError::Lost`], [`GpuError::OutOfMemory`], [`GpuError::Pass`].
    pub fn check(&self) -> Result<(), GpuError> {
        self.check_lost()?;
        let mut faults = self.faults.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(error) = faults.error.take() else {
            return Ok(());
        };
        drop(faults);
        self.notice_loss()?;
        Err(error)
    }

    /// After an error: whether its cause is that the owner of the device has destroyed it. wgpu tells of that once the
    /// queue is empty.
    fn notice_loss(&self) -> Result<(), GpuError> {
        self.device.poll(wgpu::PollType::wait_indefinitely()).ok();
        self.check_lost()
    }

    /// Checks that the device still works.
    ///
    /// # Errors
    /// [`GpuError::Lost`] when it does not.
    pub fn check_lost(&self) -> Result<(), GpuError> {
        let faults = self.faults.lock().unwrap_or_else(PoisonError::into_inner);
        match &faults.lost {
            Some(reason) => Err(GpuError::Lost {
                reason: reason.clone(),
            }),
            None => Ok(()),
        }
    }

    /// Blocks until the GPU has run everything that was submitted. Not for browsers, which never block.
    ///
    /// # Errors
    /// As [`Gpu::check`].
    pub fn wait(&self) -> Result<(), GpuError> {
        self.wait_until(wgpu::PollType::wait_indefinitely())
    }

    /// Blocks until the GPU has run a submission and all before it, while later ones go on. Not for browsers.
    ///
    /// # Errors
    /// As [`Gpu::check`].
    pub fn wait_for(&self, submission: wgpu::SubmissionIndex) -> Result<(), GpuError> {
        self.wait_until(wgpu::PollType::Wait {
            submission_index: Some(submission),
            timeout: None,
        })
    }

    fn wait_until(&self, until: wgpu::PollType) -> Result<(), GpuError> {
        self.waits.fetch_add(1, Ordering::Relaxed);
        let waited = self.device.poll(until);
        self.check()?;
        waited.map(|_| ()).map_err(|error| GpuError::Lost {
            reason: error.to_string(),
        })
    }

    /// How often the host has waited for the GPU with this handle or a clone of it, but for handles of [`Gpu::apart`],
    /// which count anew.
    pub fn waits(&self) -> u64 {
        self.waits.load(Ordering::Relaxed)
    }

    /// Whether pipelines that were made with this handle, or a clone of it, are still being compiled. Passes that use one
    /// wait for it. In a browser, whose GPU process draws nothing meanwhile, each call compiles one.
    pub fn is_compiling(&self) -> bool {
        let is_compiling = || self.compiling.load(Ordering::Relaxed) > 0;
        if is_compiling()
            && let Some(uncompiled) = &self.uncompiled
        {
            uncompiled.compile_next();
        }
        is_compiling()
    }

    /// A handle of the same device whose pipelines are compiled as in a browser.
    #[cfg(test)]
    pub(crate) fn as_in_a_browser(&self) -> Self {
        Self {
            uncompiled: Some(lazy::Uncompiled::default()),
            compute_pipelines: Default::default(),
            render_pipelines: Default::default(),
            ..self.apart()
        }
    }

    /// Pipelines of [`Gpu::as_in_a_browser`] that were first used before they were compiled, so that a frame waited.
    #[cfg(test)]
    pub(crate) fn waited_for(&self) -> Vec<String> {
        let uncompiled = self.uncompiled.as_ref();
        uncompiled.map_or_else(Vec::new, lazy::Uncompiled::waited_for)
    }

    /// A handle of the same device that knows of its own pipelines alone ([`Gpu::is_compiling`]): whoever uses others
    /// need not wait for these. It counts its own waits ([`Gpu::waits`]).
    pub fn apart(&self) -> Self {
        Self {
            compiling: Arc::default(),
            waits: Arc::default(),
            ..self.clone()
        }
    }

    /// Limits of the device.
    pub fn limits(&self) -> &wgpu::Limits {
        &self.limits
    }

    /// A zero-filled buffer of `size` bytes; where that is 0, of enough for an element of any shader's array. COPY_DST and COPY_SRC are added to `usage`.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] with the sizes when it exceeds the device's limits, [`GpuError::OutOfMemory`].
    pub fn buffer(
        &self,
        label: &str,
        size: u64,
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, GpuError> {
        let usage = if self.uniforms_are_storage && usage.contains(wgpu::BufferUsages::UNIFORM) {
            usage | wgpu::BufferUsages::STORAGE
        } else {
            usage
        };
        let limits = &self.limits;
        let limit = if usage.contains(wgpu::BufferUsages::STORAGE) {
            limits
                .max_buffer_size
                .min(limits.max_storage_buffer_binding_size)
        } else {
            limits.max_buffer_size
        };
        let size = match size {
            0 => EMPTY_BYTES,
            _ => size.next_multiple_of(16),
        };
        if size > limit {
            return Err(GpuError::TooLarge {
                what: label.to_owned(),
                needed: size,
                limit,
                adapter: self.adapter.name.clone(),
            });
        }
        self.bindings.make_way(size);
        self.allocate(label, || {
            self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            })
        })
    }

    /// A buffer that holds `data`.
    ///
    /// # Errors
    /// As [`Gpu::buffer`].
    pub fn buffer_with<T: bytemuck::NoUninit>(
        &self,
        label: &str,
        data: &[T],
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = self.buffer(label, bytes.len() as u64, usage)?;
        // Writes are whole words; the buffer has room for the last one.
        let (whole, rest) = bytes.split_at(bytes.len() & !3);
        self.write(&buffer, 0, whole);
        if !rest.is_empty() {
            let mut word = [0; 4];
            word[..rest.len()].copy_from_slice(rest);
            self.write(&buffer, whole.len() as u64, &word);
        }
        Ok(buffer)
    }

    /// Writes the texels of a region of `size` of a texture, in rows of `bytes_per_row`, and counts the uploaded bytes.
    pub(crate) fn write_texture(
        &self,
        region: wgpu::TexelCopyTextureInfo<'_>,
        texels: &[u8],
        bytes_per_row: u32,
        size: wgpu::Extent3d,
    ) {
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(bytes_per_row),
            rows_per_image: None,
        };
        self.queue.write_texture(region, texels, layout, size);
        self.count_uploaded(texels);
    }

    /// A zero-filled storage buffer of `size` bytes.
    ///
    /// # Errors
    /// As [`Gpu::buffer`].
    pub fn room(&self, label: &str, size: u64) -> Result<wgpu::Buffer, GpuError> {
        self.buffer(label, size, wgpu::BufferUsages::STORAGE)
    }

    /// A storage buffer that holds `data`.
    ///
    /// # Errors
    /// As [`Gpu::buffer`].
    pub fn storage<T: bytemuck::NoUninit>(
        &self,
        label: &str,
        data: &[T],
    ) -> Result<wgpu::Buffer, GpuError> {
        self.buffer_with(label, data, wgpu::BufferUsages::STORAGE)
    }

    /// A uniform buffer that holds `data`.
    ///
    /// # Errors
    /// As [`Gpu::buffer`].
    pub fn uniform<T: bytemuck::NoUninit>(
        &self,
        label: &str,
        data: &T,
    ) -> Result<wgpu::Buffer, GpuError> {
        self.buffer_with(
            label,
            std::slice::from_ref(data),
            wgpu::BufferUsages::UNIFORM,
        )
    }

    /// A two-dimensional texture of `[width, height, layers]` texels and one level, as [`Gpu::texture`].
    ///
    /// # Errors
    /// As [`Gpu::texture`].
    pub fn texture_2d(
        &self,
        label: &str,
        size: [u32; 3],
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
    ) -> Result<wgpu::Texture, GpuError> {
        self.texture_with_levels(label, size, 1, format, usage)
    }

    /// As [`Gpu::texture_2d`], with `levels` of detail, of which each is half as wide as the one before.
    ///
    /// # Errors
    /// As [`Gpu::texture`].
    pub fn texture_with_levels(
        &self,
        label: &str,
        [width, height, layers]: [u32; 3],
        levels: u32,
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
    ) -> Result<wgpu::Texture, GpuError> {
        self.texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: layers,
            },
            mip_level_count: levels,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        })
    }

    /// A texture, whose size is first checked against the device's limits.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn texture(
        &self,
        descriptor: &wgpu::TextureDescriptor<'_>,
    ) -> Result<wgpu::Texture, GpuError> {
        let limits = &self.limits;
        let side = descriptor.size.width.max(descriptor.size.height);
        let layers = descriptor.size.depth_or_array_layers;
        let label = descriptor.label.unwrap_or("texture");
        for (needed, limit, what) in [
            (side, limits.max_texture_dimension_2d, "texels a side"),
            (layers, limits.max_texture_array_layers, "layers"),
        ] {
            if needed > limit {
                return Err(GpuError::TooLarge {
                    what: format!("{label}, {what}"),
                    needed: needed.into(),
                    limit: limit.into(),
                    adapter: self.adapter.name.clone(),
                });
            }
        }
        let format = descriptor.format;
        self.bindings
            .make_way(format.theoretical_memory_footprint(descriptor.size));
        self.allocate(label, || self.device.create_texture(descriptor))
    }
}
