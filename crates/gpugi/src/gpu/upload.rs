//! Small writes from the host, gathered before the commands that are submitted next.
//!
//! wgpu's own `Queue::write_buffer` allocates a staging buffer per call, and asks the driver how much memory is left
//! each time. Here small writes go to staging memory that is reused.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use wgpu::util::StagingBelt;

use super::Gpu;

/// Bytes of a piece of staging memory.
const CHUNK: u64 = 1 << 16;
/// Larger writes leave staging memory to wgpu.
const LARGE: u64 = CHUNK / 2;

/// Writes that wait for the next submission, and the bytes of all so far.
#[derive(Debug)]
pub(super) struct Uploads {
    pending: Mutex<Pending>,
    bytes: AtomicU64,
}

#[derive(Debug)]
struct Pending {
    belt: StagingBelt,
    encoder: Option<wgpu::CommandEncoder>,
}

impl Uploads {
    pub fn new(device: &wgpu::Device) -> Self {
        Self {
            pending: Mutex::new(Pending {
                belt: StagingBelt::new(device.clone(), CHUNK),
                encoder: None,
            }),
            bytes: AtomicU64::new(0),
        }
    }
}

impl Gpu {
    /// Writes `data` into a buffer from the byte `offset` on (a multiple of 4, and so is the size), before all commands that are submitted from now on.
    pub fn write<T: bytemuck::NoUninit>(&self, buffer: &wgpu::Buffer, offset: u64, data: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let Some(size) = wgpu::BufferSize::new(bytes.len() as u64) else {
            return;
        };
        self.count_uploaded(bytes);
        let mut pending = self.pending();
        // A browser's writes are cheap as they are.
        if size.get() > LARGE || cfg!(target_arch = "wasm32") {
            // Earlier writes to the same buffer stay earlier.
            self.flush(&mut pending, None);
            self.queue.write_buffer(buffer, offset, bytes);
            return;
        }
        let Pending { belt, encoder } = &mut *pending;
        let encoder =
            encoder.get_or_insert_with(|| self.device.create_command_encoder(&Default::default()));
        belt.write_buffer(encoder, buffer, offset, size)
            .copy_from_slice(bytes);
    }

    /// Submits commands, after the writes that precede them.
    pub fn submit(&self, commands: wgpu::CommandBuffer) {
        self.flush(&mut self.pending(), Some(commands));
    }

    fn pending(&self) -> std::sync::MutexGuard<'_, Pending> {
        self.uploads
            .pending
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    fn flush(&self, pending: &mut Pending, commands: Option<wgpu::CommandBuffer>) {
        let Some(writes) = pending.encoder.take() else {
            self.queue.submit(commands);
            return;
        };
        pending.belt.finish();
        let writes = std::iter::once(writes.finish());
        self.queue.submit(writes.chain(commands));
        pending.belt.recall();
    }

    pub(super) fn count_uploaded(&self, bytes: &[u8]) {
        let bytes = bytes.len() as u64;
        self.uploads.bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    /// Bytes that were uploaded to this device so far: of scenes and of buffers made with their contents.
    pub fn uploaded_bytes(&self) -> u64 {
        self.uploads.bytes.load(Ordering::Relaxed)
    }
}
