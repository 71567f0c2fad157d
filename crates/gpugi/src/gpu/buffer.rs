//! Read-back.

use std::sync::{Arc, Mutex};
use std::task::{Poll, Waker};

use super::{Gpu, GpuError};

/// What a mapping has come to, and who waits for it.
#[derive(Default)]
struct Mapped {
    result: Option<Result<(), wgpu::BufferAsyncError>>,
    waker: Option<Waker>,
}

/// Copies a buffer's first `size` bytes to the host, after all work submitted so far.
///
/// # Errors
/// [`GpuError::Lost`] or [`GpuError::OutOfMemory`].
pub fn read_buffer<T: bytemuck::Pod>(
    gpu: &Gpu,
    buffer: &wgpu::Buffer,
    size: u64,
) -> Result<Vec<T>, GpuError> {
    if size == 0 {
        return Ok(Vec::new());
    }
    // Copies are whole words; `Gpu::buffer` leaves room for the last one.
    let mut bytes = pollster::block_on(read(gpu, size, |encoder, staging| {
        encoder.copy_buffer_to_buffer(buffer, 0, staging, 0, Some(staging.size()));
    }))?;
    bytes.truncate(size as usize);
    Ok(bytemuck::pod_collect_to_vec(&bytes))
}

/// Copies one layer of one mip level of a texture to the host, rows tightly packed.
///
/// # Errors
/// As [`read_buffer`].
pub fn read_texture<T: bytemuck::Pod>(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    aspect: wgpu::TextureAspect,
    layer: u32,
    level: u32,
) -> Result<Vec<T>, GpuError> {
    let texel = texture.format().block_copy_size(Some(aspect)).unwrap_or(4);
    let extent = texture.size().mip_level_size(level, texture.dimension());
    let row = extent.width * texel;
    let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let size = u64::from(padded) * u64::from(extent.height);
    let bytes = pollster::block_on(read(gpu, size, |encoder, staging| {
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
                    bytes_per_row: Some(padded),
                    rows_per_image: None,
                },
            },
            wgpu::Extent3d {
                width: extent.width,
                height: extent.height,
                depth_or_array_layers: 1,
            },
        );
    }))?;
    let packed: Vec<u8> = bytes
        .chunks(padded as usize)
        .flat_map(|chunk| &chunk[..row as usize])
        .copied()
        .collect();
    Ok(bytemuck::pod_collect_to_vec(&packed))
}

/// Runs `copy` into a staging buffer and waits for its bytes. Works where blocking is impossible, too.
async fn read(
    gpu: &Gpu,
    size: u64,
    copy: impl FnOnce(&mut wgpu::CommandEncoder, &wgpu::Buffer),
) -> Result<Vec<u8>, GpuError> {
    let size = size.next_multiple_of(4);
    let staging = gpu.scoped("read-back", || {
        let staging = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read-back"),
            size,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        copy(&mut encoder, &staging);
        gpu.queue.submit([encoder.finish()]);
        Ok(staging)
    })?;
    let mapped = Arc::new(Mutex::new(Mapped::default()));
    let done = mapped.clone();
    staging
        .slice(..)
        .map_async(wgpu::MapMode::Read, move |result| {
            if let Ok(mut done) = done.lock() {
                done.result = Some(result);
                if let Some(waker) = done.waker.take() {
                    waker.wake();
                }
            }
        });
    let lost = |reason: String| GpuError::Lost { reason };
    gpu.device
        .poll(wgpu::PollType::wait_indefinitely())
        .map_err(|error| lost(error.to_string()))?;
    gpu.check_lost()?;
    // Another thread's poll may have taken the callback and be about to run it.
    std::future::poll_fn(|context| match mapped.lock() {
        Ok(mut mapped) => match mapped.result.take() {
            Some(result) => Poll::Ready(result.map_err(|error| lost(error.to_string()))),
            None => {
                mapped.waker = Some(context.waker().clone());
                Poll::Pending
            }
        },
        Err(error) => Poll::Ready(Err(lost(error.to_string()))),
    })
    .await?;
    let view = staging
        .slice(..)
        .get_mapped_range()
        .map_err(|error| lost(error.to_string()))?;
    Ok(view.to_vec())
}
