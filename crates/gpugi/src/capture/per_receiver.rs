//! What passes over points keep from frame to frame.

use super::Receiver;
use crate::gpu::GpuError;

/// What a pass keeps, such as buffers, for each receiver that it runs on.
#[derive(Debug)]
pub struct PerReceiver<T> {
    kept: Vec<Entry<T>>,
    calls: u64,
}

#[derive(Debug)]
struct Entry<T> {
    points: wgpu::Buffer,
    view: wgpu::Buffer,
    target: wgpu::Buffer,
    is_brief: bool,
    transmittance: Option<wgpu::Buffer>,
    /// Number of the call that last used the entry.
    last_used: u64,
    value: T,
}

impl<T> Default for PerReceiver<T> {
    fn default() -> Self {
        Self {
            kept: Vec::new(),
            calls: 0,
        }
    }
}

impl<T> PerReceiver<T> {
    /// An entry that was not used in this many calls is dropped, so that unused buffers are freed.
    const PATIENCE: u64 = 256;

    /// The value for a receiver; `make` creates it on first use.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn of(
        &mut self,
        receiver: &Receiver,
        make: impl FnOnce() -> Result<T, GpuError>,
    ) -> Result<&T, GpuError> {
        self.calls += 1;
        let now = self.calls;
        self.kept
            .retain(|entry| now - entry.last_used <= Self::PATIENCE);
        let Receiver {
            points,
            target,
            is_brief,
            transmittance,
        } = receiver;
        let is_this = |entry: &Entry<T>| {
            entry.points == points.points
                && entry.view == points.view
                && entry.target == target.radiance
                && entry.is_brief == *is_brief
                && entry.transmittance == *transmittance
        };
        let index = match self.kept.iter().position(is_this) {
            Some(index) => index,
            None => {
                self.kept.push(Entry {
                    points: points.points.clone(),
                    view: points.view.clone(),
                    target: target.radiance.clone(),
                    is_brief: *is_brief,
                    transmittance: transmittance.clone(),
                    last_used: now,
                    value: make()?,
                });
                self.kept.len() - 1
            }
        };
        let found = &mut self.kept[index];
        found.last_used = now;
        Ok(&found.value)
    }

    /// Drops all entries.
    pub fn clear(&mut self) {
        self.kept.clear();
    }
}
