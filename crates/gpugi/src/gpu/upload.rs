//! Small writes from the host, collected and submitted before the next commands.
//!
//! wgpu's own `Queue::write_buffer` allocates a staging buffer per call, and each time asks the driver how much memory
//! is left. Here, small writes go to staging memory that is reused.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use wgpu::util::StagingBelt;

use super::{Gpu, GpuError};

/// Size of one chunk of staging memory (bytes).
const CHUNK: u64 = 1 << 16;
/// Writes larger than this (bytes) go through wgpu's own staging memory.
const LARGE: u64 = CHUNK / 2;
/// Alignment of writes in staging memory (bytes).
const ALIGNMENT: wgpu::BufferSize = wgpu::BufferSize::new(wgpu::COPY_BUFFER_ALIGNMENT).unwrap();

/// A buffer that only the host writes, always from its beginning. Writes that would change nothing are skipped.
#[derive(Debug, Clone)]
pub(crate) struct HostBuffer {
    buffer: wgpu::Buffer,
    /// What it holds; clones share it.
    written: Arc<Mutex<Vec<u8>>>,
}

impl HostBuffer {
    /// A zero-filled buffer, as [`Gpu::buffer`].
    ///
    /// # Errors
    /// As [`Gpu::buffer`].
    pub fn new(
        gpu: &Gpu,
        label: &str,
        size: u64,
        usage: wgpu::BufferUsages,
    ) -> Result<Self, GpuError> {
        Ok(Self {
            buffer: gpu.buffer(label, size, usage)?,
            written: Arc::default(),
        })
    }

    /// Writes `data`, before all commands that are submitted from now on.
    pub fn write<T: bytemuck::NoUninit>(&self, gpu: &Gpu, data: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        if !written.starts_with(bytes) {
            gpu.write(&self.buffer, 0, bytes);
            let rest = written.len().min(bytes.len());
            written.splice(..rest, bytes.iter().copied());
        }
    }
}

impl std::ops::Deref for HostBuffer {
    type Target = wgpu::Buffer;

    fn deref(&self) -> &wgpu::Buffer {
        &self.buffer
    }
}

/// Writes that wait for the next submission, and the number of bytes uploaded so far.
#[derive(Debug)]
pub(super) struct Uploads {
    pending: Mutex<Pending>,
    bytes: AtomicU64,
}

#[derive(Debug)]
struct Pending {
    belt: StagingBelt,
    encoder: Option<wgpu::CommandEncoder>,
    last: Option<wgpu::SubmissionIndex>,
}

impl Uploads {
    pub fn new(device: &wgpu::Device) -> Self {
        Self {
            pending: Mutex::new(Pending {
                belt: StagingBelt::new(device.clone(), CHUNK),
                encoder: None,
                last: None,
            }),
            bytes: AtomicU64::new(0),
        }
    }
}

impl Gpu {
    /// Writes `data` into a buffer at the byte `offset`, before all commands that are submitted from now on. The offset
    /// and the size are multiples of 4.
    pub fn write<T: bytemuck::NoUninit>(&self, buffer: &wgpu::Buffer, offset: u64, data: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let Some(size) = wgpu::BufferSize::new(bytes.len() as u64) else {
            return;
        };
        self.count_uploaded(bytes);
        let mut pending = self.pending();
        // In a browser, direct writes are cheap.
        if size.get() > LARGE || cfg!(target_arch = "wasm32") {
            // Keep the order of writes to the same buffer.
            self.flush(&mut pending, None);
            self.queue.write_buffer(buffer, offset, bytes);
            return;
        }
        let Pending { belt, encoder, .. } = &mut *pending;
        let encoder =
            encoder.get_or_insert_with(|| self.device.create_command_encoder(&Default::default()));
        let staging = belt.allocate(size, ALIGNMENT);
        // A lost device has no memory to map. The next check says that it is lost.
        let Ok(mut mapped) = staging.get_mapped_range_mut() else {
            return;
        };
        mapped.copy_from_slice(bytes);
        encoder.copy_buffer_to_buffer(
            staging.buffer(),
            staging.offset(),
            buffer,
            offset,
            size.get(),
        );
    }

    /// Records a compute pass that runs after the writes so far and before all commands that are submitted from now on.
    pub(crate) fn compute_before_next(
        &self,
        name: &str,
        record: impl FnOnce(&mut wgpu::ComputePass<'_>),
    ) {
        let mut pending = self.pending();
        let encoder = pending
            .encoder
            .get_or_insert_with(|| self.device.create_command_encoder(&Default::default()));
        record(
            &mut encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some(name),
                timestamp_writes: None,
            }),
        );
    }

    /// Submits commands after the writes that precede them.
    pub fn submit(&self, commands: wgpu::CommandBuffer) {
        self.flush(&mut self.pending(), Some(commands));
    }

    /// The last submission so far, for [`Gpu::wait_for`].
    pub fn last_submission(&self) -> Option<wgpu::SubmissionIndex> {
        self.pending().last.clone()
    }

    fn pending(&self) -> std::sync::MutexGuard<'_, Pending> {
        self.uploads
            .pending
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    fn flush(&self, pending: &mut Pending, commands: Option<wgpu::CommandBuffer>) {
        let Some(writes) = pending.encoder.take() else {
            pending.last = Some(self.queue.submit(commands));
            return;
        };
        pending.belt.finish();
        let writes = std::iter::once(writes.finish());
        pending.last = Some(self.queue.submit(writes.chain(commands)));
        pending.belt.recall();
    }

    pub(super) fn count_uploaded(&self, bytes: &[u8]) {
        let bytes = bytes.len() as u64;
        self.uploads.bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    /// Bytes uploaded to this device so far: writes to buffers and textures, and buffers created with contents.
    pub fn uploaded_bytes(&self) -> u64 {
        self.uploads.bytes.load(Ordering::Relaxed)
    }
}
