//! What passes over points keep from frame to frame.

use super::{SurfacePoints, Target};
use crate::gpu::GpuError;

/// What a pass keeps for the points that it is run at and the targets that it writes: the picture's, and those of cubes.
#[derive(Debug)]
pub struct PerTarget<T> {
    kept: Vec<Kept<T>>,
    calls: u64,
}

#[derive(Debug)]
struct Kept<T> {
    points: wgpu::Buffer,
    view: wgpu::Buffer,
    target: wgpu::Buffer,
    /// Number of the call that asked for it last.
    asked: u64,
    made: T,
}

impl<T> Default for PerTarget<T> {
    fn default() -> Self {
        Self {
            kept: Vec::new(),
            calls: 0,
        }
    }
}

impl<T> PerTarget<T> {
    /// What nobody asked for in as many calls is forgotten, so that buffers go that are used no more.
    const PATIENCE: u64 = 256;

    /// What was made for these points and this target, or is made now.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn of(
        &mut self,
        points: &SurfacePoints,
        target: &Target,
        make: impl FnOnce() -> Result<T, GpuError>,
    ) -> Result<&T, GpuError> {
        self.calls += 1;
        let now = self.calls;
        self.kept.retain(|one| now - one.asked <= Self::PATIENCE);
        let is_this = |one: &Kept<T>| {
            one.points == points.points && one.view == points.view && one.target == target.radiance
        };
        let index = match self.kept.iter().position(is_this) {
            Some(index) => index,
            None => {
                self.kept.push(Kept {
                    points: points.points.clone(),
                    view: points.view.clone(),
                    target: target.radiance.clone(),
                    asked: now,
                    made: make()?,
                });
                self.kept.len() - 1
            }
        };
        let found = &mut self.kept[index];
        found.asked = now;
        Ok(&found.made)
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.kept.clear();
    }
}
