//! Light in texture space: what techniques add at the texels of an atlas, for files that other software shows (tutorial section 6, 7.3).
//!
//! [`LightBake`] and [`ObscuranceBake`] work in steps of bounded length. Between two of them a bake can be saved in a [`Checkpoint`], from which
//! another goes on.

mod checkpoint;
mod light;
mod obscurances;
#[cfg(test)]
mod tests;
mod volume;

use crate::capture::atlas::LeakReport;
pub use checkpoint::{Checkpoint, CheckpointError, CheckpointKey};
pub use light::{LightBake, LightOptions, LightState, LitAtlas, Progress, Quantity, Stage};
pub use obscurances::ObscuranceBake;
pub use volume::IrradianceVolume;

/// Texels of an atlas that lie inside other things, where no light can be.
#[derive(Debug, Clone, PartialEq)]
pub struct Leaks {
    /// How many there are, and what became of them.
    pub report: LeakReport,
    /// Pictures of the pages, as [`LeakTest::map`](crate::capture::atlas::LeakTest::map) makes them.
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
