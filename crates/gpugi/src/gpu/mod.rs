//! The GPU: adapters, device, shaders, passes, buffers, read-back and timing. The only folder with raw wgpu plumbing.

mod adapter;
mod blit;
mod buffer;
mod error;
mod frame;
mod kernel;
mod shader;
#[cfg(test)]
mod tests;

pub use adapter::{AdapterChoice, AdapterSummary, list_adapters};
pub(crate) use blit::Blit;
pub use buffer::{read_buffer, read_texture};
pub use error::GpuError;
pub use frame::{Frame, Keeps, Timing};
pub(crate) use kernel::scene_layout;
pub use kernel::{Kernel, KernelOptions, RasterKernel, RasterState};
pub use shader::{BindingKind, Shader, all_shaders};
pub use wgpu::{PollType, TextureAspect};

use std::borrow::Cow;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// Mesa's software adapter compiles a copy of a shader for the values in its uniform buffers that decide branches, whenever these change, and forgets
/// to free it: 100 MB a second. Storage buffers are left alone.
const UNIFORM_INLINER: &str = "llvmpipe";

/// One device and its queue, within WebGPU's default limits except for buffer sizes.
#[derive(Debug, Clone)]
pub struct Gpu {
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// What the adapter says of itself.
    pub adapter: AdapterSummary,
    /// Whether passes can be timed.
    pub has_timestamps: bool,
    /// Whether shaders read uniform buffers as storage.
    uniforms_are_storage: bool,
    uploaded: Arc<AtomicU64>,
    lost: Arc<Mutex<Option<String>>>,
}

impl Gpu {
    /// Opens the chosen adapter.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] when none fits, with what there is and what to do; [`GpuError::Device`] when it refuses.
    pub fn open(choice: &AdapterChoice) -> Result<Self, GpuError> {
        pollster::block_on(Self::open_async(choice))
    }

    /// [`Gpu::open`] where blocking is not possible.
    ///
    /// # Errors
    /// As [`Gpu::open`].
    pub async fn open_async(choice: &AdapterChoice) -> Result<Self, GpuError> {
        let adapter = adapter::choose(choice).await?;
        let summary = AdapterSummary::of(&adapter);
        let available = adapter.limits();
        // WebGPU's defaults, but let buffers be as large as the adapter allows: scenes decide what they need.
        let defaults = wgpu::Limits::default();
        let uniforms_are_storage = summary.name.starts_with(UNIFORM_INLINER);
        let required_limits = wgpu::Limits {
            max_storage_buffers_per_shader_stage: if uniforms_are_storage {
                defaults.max_storage_buffers_per_shader_stage
                    + defaults.max_uniform_buffers_per_shader_stage
            } else {
                defaults.max_storage_buffers_per_shader_stage
            },
            max_buffer_size: available.max_buffer_size,
            max_storage_buffer_binding_size: available.max_storage_buffer_binding_size,
            ..defaults
        };
        let has_timestamps = adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let (device, queue) = adapter
            .request_device(&wgpu::DeviceDescriptor {
                label: Some("gpugi"),
                required_features: if has_timestamps {
                    wgpu::Features::TIMESTAMP_QUERY
                } else {
                    wgpu::Features::empty()
                },
                required_limits,
                ..Default::default()
            })
            .await
            .map_err(|error| GpuError::Device {
                adapter: summary.name.clone(),
                reason: error.to_string(),
            })?;
        let lost = Arc::new(Mutex::new(None));
        let record = lost.clone();
        device.set_device_lost_callback(move |reason, message| {
            if reason != wgpu::DeviceLostReason::Destroyed
                && let Ok(mut lost) = record.lock()
            {
                *lost = Some(format!("{reason:?}: {message}"));
            }
        });
        Ok(Self {
            device,
            queue,
            adapter: summary,
            has_timestamps,
            uniforms_are_storage,
            uploaded: Arc::default(),
            lost,
        })
    }

    /// A shader as this adapter gets it.
    fn source_of(&self, shader: &Shader) -> Cow<'static, str> {
        if self.uniforms_are_storage {
            Cow::Owned(shader.source.replace("var<uniform>", "var<storage, read>"))
        } else {
            Cow::Borrowed(shader.source)
        }
    }

    /// Runs `work` inside error scopes; an error that the GPU API reports for it becomes one that names `pass`.
    ///
    /// # Errors
    /// [`GpuError::Lost`], [`GpuError::OutOfMemory`], [`GpuError::Pass`], or what `work` returns.
    pub fn scoped<T>(
        &self,
        pass: &str,
        work: impl FnOnce() -> Result<T, GpuError>,
    ) -> Result<T, GpuError> {
        self.check_lost()?;
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let result = work();
        let errors = [internal.pop(), memory.pop(), validation.pop()].map(pollster::block_on);
        self.check_lost()?;
        match errors.into_iter().flatten().next() {
            Some(error) => Err(GpuError::in_pass(pass, &error)),
            None => result,
        }
    }

    /// Whether the device still works.
    ///
    /// # Errors
    /// [`GpuError::Lost`] when it does not.
    pub fn check_lost(&self) -> Result<(), GpuError> {
        match self.lost.lock().ok().and_then(|lost| lost.clone()) {
            Some(reason) => Err(GpuError::Lost { reason }),
            None => Ok(()),
        }
    }

    /// A buffer of `size` bytes (at least 16), zero-filled. `usage` is completed with COPY_DST and COPY_SRC.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] with the numbers when it exceeds the device's limits, [`GpuError::OutOfMemory`].
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
        let limits = self.device.limits();
        let limit = if usage.contains(wgpu::BufferUsages::STORAGE) {
            limits
                .max_buffer_size
                .min(limits.max_storage_buffer_binding_size)
        } else {
            limits.max_buffer_size
        };
        let size = size.max(16).next_multiple_of(16);
        if size > limit {
            return Err(GpuError::TooLarge {
                what: label.to_owned(),
                needed: size,
                limit,
                adapter: self.adapter.name.clone(),
            });
        }
        self.scoped(label, || {
            Ok(self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }))
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

    /// Writes `data` into a buffer from the byte `offset` on, and counts it.
    pub fn write<T: bytemuck::NoUninit>(&self, buffer: &wgpu::Buffer, offset: u64, data: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        self.queue.write_buffer(buffer, offset, bytes);
        self.count_uploaded(bytes);
    }

    /// Writes the texels of a region of `size` of a texture, in rows of `bytes_per_row`, and counts them.
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

    fn count_uploaded(&self, bytes: &[u8]) {
        self.uploaded
            .fetch_add(bytes.len() as u64, Ordering::Relaxed);
    }

    /// Bytes that were uploaded to this device so far: of scenes and of buffers made with their contents.
    pub fn uploaded_bytes(&self) -> u64 {
        self.uploaded.load(Ordering::Relaxed)
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

    /// A texture, its size checked against the device's limits first.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn texture(
        &self,
        descriptor: &wgpu::TextureDescriptor<'_>,
    ) -> Result<wgpu::Texture, GpuError> {
        let limits = self.device.limits();
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
        self.scoped(label, || Ok(self.device.create_texture(descriptor)))
    }
}
