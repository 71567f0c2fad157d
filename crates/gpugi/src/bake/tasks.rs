//! Tasks of a light bake and their results: plain values that can be stored and sent to other processes or machines.

use std::collections::BTreeMap;
use std::ops::Range;

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// A task of a light bake ([`super::LightBake::tasks`]). Tasks may run in any order and anywhere: each gives the same
/// bits on the same kind of adapter with the same build.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum LightTask {
    /// The techniques make their maps. Other bakes that merge the result need not solve them again.
    Maps,
    /// Some samples of the light at the texels of one tile.
    Texels {
        /// Index of the tile.
        tile: u32,
        /// The samples.
        samples: Range<u32>,
    },
}

/// The result of a task, to be merged by [`super::LightBake::merge`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum LightPart {
    /// Saved maps of techniques, by name.
    Maps(BTreeMap<String, Vec<u8>>),
    /// Light of texels.
    Texels(TexelPart),
}

/// Sums of some samples of the light at the texels of one tile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TexelPart {
    /// Index of the tile.
    pub(super) tile: u32,
    /// The samples in the sums.
    pub(super) samples: Range<u32>,
    /// Per captured texel: sum of the samples, and their number in a.
    pub(super) sums: Vec<[f32; 4]>,
    /// States of the captured texels, as [`LeakTest::map`](crate::capture::atlas::LeakTest::map) makes them.
    pub(super) leak_map: Vec<[u8; 4]>,
}

/// The saved state of a light bake, from which another resumes.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LightState {
    /// Saved maps of techniques, by name.
    pub(super) maps: BTreeMap<String, Vec<u8>>,
    /// The finished tiles.
    pub(super) done: Vec<Option<LitRows>>,
    /// Results of tasks in unfinished tiles.
    pub(super) parts: Vec<TexelPart>,
    /// The first samples of an unfinished task.
    pub(super) unfinished: Option<TexelPart>,
}

/// The texels of a tile's own rows.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct LitRows {
    pub texels: Vec<Vec3>,
    pub leak_map: Vec<[u8; 4]>,
}

impl TexelPart {
    /// Whether it has `texels` texels, only finite sums, and as many samples in each as there can be.
    pub(super) fn is_sound(&self, texels: usize) -> bool {
        self.sums.len() == texels
            && self.leak_map.len() == texels
            && are_sums(&self.sums, self.samples.len())
    }
}

/// Whether these are sums of up to `samples` samples each.
pub(super) fn are_sums(sums: &[[f32; 4]], samples: usize) -> bool {
    let counts = 0.0..=samples as f32;
    let mut sums = sums.iter();
    sums.all(|sum| sum.iter().all(|one| one.is_finite()) && counts.contains(&sum[3]))
}

impl LitRows {
    /// Whether it has `texels` texels, whose light is finite.
    pub(super) fn is_sound(&self, texels: usize) -> bool {
        self.texels.len() == texels
            && self.leak_map.len() == texels
            && self.texels.iter().all(|texel| texel.is_finite())
    }
}
