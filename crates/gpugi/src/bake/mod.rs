//! Light in texture space: the light that techniques add at the texels of an atlas, for files that other software shows
//! (tutorial sections 6 and 7.3).
//!
//! Every [`Bake`] works in steps of bounded length, and consists of tasks that may run anywhere. Between two steps, a
//! [`LightBake`], an [`ObscuranceBake`] or a [`PrecomputedBake`] can be saved in a [`Checkpoint`], from which another
//! bake resumes.

mod checkpoint;
mod light;
mod obscurances;
mod precomputed;
mod solver;
mod tasks;
#[cfg(test)]
mod tests;
mod volume;

use crate::capture::atlas::LeakReport;
pub use checkpoint::{Checkpoint, CheckpointError, CheckpointKey};
pub use light::{LightBake, LightOptions, LightState, LitAtlas, Quantity, TexelPart};
pub use obscurances::{ObscuranceBake, ObscurancePart, ObscuranceState};
pub use precomputed::{PaneBake, PrecomputedBake, PrecomputedState, TransferBake};
pub use tasks::{Bake, Part, Progress, Stage, Task};
pub use volume::{HarmonicVolume, IrradianceVolume, Volume, VolumeBake, VolumeLight, VoxelPart};

/// Texels of an atlas that lie inside other objects, where no light arrives.
#[derive(Debug, Clone, PartialEq)]
pub struct Leaks {
    /// Their number, and what the bake did with them.
    pub report: LeakReport,
    /// Images of the pages, as [`LeakTest::map`](crate::capture::atlas::LeakTest::map) makes them.
    pub maps: Vec<Vec<[u8; 4]>>,
}

impl Leaks {
    fn new(map: &[[u8; 4]], side: u32) -> Self {
        let pages = map.chunks((side as usize).pow(2));
        Self {
            report: LeakReport::of_map(map),
            maps: pages.map(<[_]>::to_vec).collect(),
        }
    }
}
