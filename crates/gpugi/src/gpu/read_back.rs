//! Read-backs: GPU data on its way to the host, as futures, each with a blocking twin.

use std::future::Future;
use std::ops::Range;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, Waker};

use super::{Gpu, GpuError};

/// The result of mapping a staging buffer, and the task that waits for it.
#[derive(Default)]
struct Mapping {
    result: Option<Result<(), wgpu::BufferAsyncError>>,
    waker: Option<Waker>,
}

/// A copy of GPU data that arrives once the GPU has run the commands before it. Await it, poll [`ReadBack::get`] once
/// per frame, or block in [`ReadBack::wait`]. Dropping it cancels the transfer to the host.
pub struct ReadBack<T> {
    gpu: Gpu,
    /// `None` when there is nothing to copy.
    staging: Option<wgpu::Buffer>,
    mapping: Arc<Mutex<Mapping>>,
    decode: fn(Vec<u8>) -> T,
    layout: Layout,
}

/// The layout of the data in the staging buffer (bytes).
#[derive(Debug, Clone, Copy)]
struct Layout {
    size: u64,
    /// Bytes of data per row, and from row to row; 0 for data without rows.
    row: u32,
    padded_row: u32,
}

impl Layout {
    /// The data without row padding.
    fn packed(&self, bytes: Vec<u8>) -> Vec<u8> {
        if self.row == self.padded_row {
            return bytes;
        }
        let rows = bytes.chunks(self.padded_row as usize);
        rows.flat_map(|row| &row[..self.row as usize])
            .copied()
            .collect()
    }
}

impl<T> std::fmt::Debug for ReadBack<T> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("ReadBack")
            .field("layout", &self.layout)
            .finish_non_exhaustive()
    }
}

impl<T> ReadBack<T> {
    /// Reserves staging memory and lets `copy` record the commands that fill it. Mapping begins when `encoder` is
    /// submitted.
    fn record(
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        layout: Layout,
        decode: fn(Vec<u8>) -> T,
        copy: impl FnOnce(&mut wgpu::CommandEncoder, &wgpu::Buffer),
    ) -> Result<Self, GpuError> {
        let mapping = Arc::new(Mutex::new(Mapping::default()));
        let staging = if layout.size == 0 {
            None
        } else {
            // Copies are whole words; `Gpu::buffer` leaves room for the last one.
            let staging = gpu.allocate("read-back", || {
                gpu.device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("read-back"),
                    size: layout.size.next_multiple_of(4),
                    usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                })
            })?;
            copy(encoder, &staging);
            let done = mapping.clone();
            encoder.map_buffer_on_submit(&staging, wgpu::MapMode::Read, .., move |result| {
                let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
                done.result = Some(result);
                if let Some(waker) = done.waker.take() {
                    waker.wake();
                }
            });
            Some(staging)
        };
        Ok(Self {
            gpu: gpu.clone(),
            staging,
            mapping,
            decode,
            layout,
        })
    }

    /// The device that holds the data.
    pub(super) fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The data, once it has arrived. Never blocks.
    pub fn get(&self) -> Option<Result<T, GpuError>> {
        if self.staging.is_some() {
            self.gpu.device.poll(wgpu::PollType::Poll).ok();
        }
        self.arrived(None)
    }

    /// Blocks until the data has arrived. Not for browsers, which never block.
    ///
    /// # Errors
    /// [`GpuError::Lost`], or an error of the commands that were submitted before.
    pub fn wait(&self) -> Result<T, GpuError> {
        if self.staging.is_some() {
            self.gpu.wait()?;
        }
        pollster::block_on(self.arrival())
    }

    async fn arrival(&self) -> Result<T, GpuError> {
        // Another thread's poll may have taken the callback and be about to run it.
        std::future::poll_fn(|context| match self.arrived(Some(context.waker())) {
            Some(result) => Poll::Ready(result),
            None => Poll::Pending,
        })
        .await
    }

    fn arrived(&self, waker: Option<&Waker>) -> Option<Result<T, GpuError>> {
        let lost = |reason: String| GpuError::Lost { reason };
        let Some(staging) = &self.staging else {
            return Some(Ok((self.decode)(Vec::new())));
        };
        let mut mapping = self.mapping.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(result) = mapping.result.clone() else {
            if let Err(error) = self.gpu.check_lost() {
                return Some(Err(error));
            }
            mapping.waker = waker.cloned();
            return None;
        };
        Some(
            result
                .map_err(|error| lost(error.to_string()))
                .and_then(|()| {
                    let view = staging
                        .slice(..)
                        .get_mapped_range()
                        .map_err(|error| lost(error.to_string()))?;
                    let mut bytes = view.to_vec();
                    bytes.truncate(self.layout.size as usize);
                    Ok((self.decode)(self.layout.packed(bytes)))
                }),
        )
    }
}

impl<T> Future for ReadBack<T> {
    type Output = Result<T, GpuError>;

    fn poll(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        if let Some(result) = self.get() {
            return Poll::Ready(result);
        }
        match self.arrived(Some(context.waker())) {
            Some(result) => Poll::Ready(result),
            None => {
                // Native callbacks run only during a poll, so the future polls again; browsers run callbacks on their
                // own.
                if cfg!(not(target_arch = "wasm32")) {
                    context.waker().wake_by_ref();
                }
                Poll::Pending
            }
        }
    }
}

/// Records a copy of a buffer's first `size` bytes.
pub(super) fn record_buffer<T: bytemuck::Pod>(
    gpu: &Gpu,
    encoder: &mut wgpu::CommandEncoder,
    buffer: &wgpu::Buffer,
    size: u64,
) -> Result<ReadBack<Vec<T>>, GpuError> {
    let layout = Layout {
        size,
        row: 0,
        padded_row: 0,
    };
    let decode = |bytes: Vec<u8>| bytemuck::pod_collect_to_vec(&bytes);
    ReadBack::record(gpu, encoder, layout, decode, |encoder, staging| {
        encoder.copy_buffer_to_buffer(buffer, 0, staging, 0, Some(staging.size()));
    })
}

/// Copies a range of a buffer's bytes (multiples of 4) to the host and decodes it, after all work submitted so far.
///
/// # Errors
/// As [`begin_read_buffer`].
pub(crate) fn begin_read_part<T>(
    gpu: &Gpu,
    buffer: &wgpu::Buffer,
    range: Range<u64>,
    decode: fn(Vec<u8>) -> T,
) -> Result<ReadBack<T>, GpuError> {
    let layout = Layout {
        size: range.end - range.start,
        row: 0,
        padded_row: 0,
    };
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let read_back = ReadBack::record(gpu, &mut encoder, layout, decode, |encoder, staging| {
        encoder.copy_buffer_to_buffer(buffer, range.start, staging, 0, Some(staging.size()));
    })?;
    gpu.submit(encoder.finish());
    Ok(read_back)
}

/// Copies a buffer's first `size` bytes to the host, after all work submitted so far.
///
/// # Errors
/// [`GpuError::Lost`], [`GpuError::OutOfMemory`], or an error of earlier commands.
pub fn begin_read_buffer<T: bytemuck::Pod>(
    gpu: &Gpu,
    buffer: &wgpu::Buffer,
    size: u64,
) -> Result<ReadBack<Vec<T>>, GpuError> {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let read_back = record_buffer(gpu, &mut encoder, buffer, size)?;
    gpu.submit(encoder.finish());
    Ok(read_back)
}

/// The blocking twin of [`begin_read_buffer`].
///
/// # Errors
/// As [`begin_read_buffer`].
pub fn read_buffer<T: bytemuck::Pod>(
    gpu: &Gpu,
    buffer: &wgpu::Buffer,
    size: u64,
) -> Result<Vec<T>, GpuError> {
    begin_read_buffer(gpu, buffer, size)?.wait()
}

/// Copies one layer of one mip level of a texture to the host, rows tightly packed.
///
/// # Errors
/// As [`begin_read_buffer`].
pub fn begin_read_texture<T: bytemuck::Pod>(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    aspect: wgpu::TextureAspect,
    layer: u32,
    level: u32,
) -> Result<ReadBack<Vec<T>>, GpuError> {
    let texel = texture.format().block_copy_size(Some(aspect)).unwrap_or(4);
    let extent = texture.size().mip_level_size(level, texture.dimension());
    let row = extent.width * texel;
    let padded_row = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let layout = Layout {
        size: u64::from(padded_row) * u64::from(extent.height),
        row,
        padded_row,
    };
    let decode = |bytes: Vec<u8>| bytemuck::pod_collect_to_vec(&bytes);
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let read_back = ReadBack::record(gpu, &mut encoder, layout, decode, |encoder, staging| {
        encoder.copy_texture_to_buffer(
            wgpu::TexelCopyTextureInfo {
                texture,
                mip_level: level,
                origin: wgpu::Origin3d {
                    z: layer,
                    ..Default::default()
                },
                aspect,
            },
            wgpu::TexelCopyBufferInfo {
                buffer: staging,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(padded_row),
                    rows_per_image: None,
                },
            },
            wgpu::Extent3d {
                width: extent.width,
                height: extent.height,
                depth_or_array_layers: 1,
            },
        );
    })?;
    gpu.submit(encoder.finish());
    Ok(read_back)
}

/// The blocking twin of [`begin_read_texture`].
///
/// # Errors
/// As [`begin_read_buffer`].
pub fn read_texture<T: bytemuck::Pod>(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    aspect: wgpu::TextureAspect,
    layer: u32,
    level: u32,
) -> Result<Vec<T>, GpuError> {
    begin_read_texture(gpu, texture, aspect, layer, level)?.wait()
}
