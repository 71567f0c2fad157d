//! Results of a light bake's tasks, and its saved state.

use std::ops::Range;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::super::tasks::SavedMaps;

/// Sums of some samples of the light at the texels of one tile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TexelPart {
    /// Index of the tile.
    pub(in crate::bake) tile: u32,
    /// The samples in the sums.
    pub(in crate::bake) samples: Range<u32>,
    /// Per captured texel: sum of the samples, and their number in a.
    pub(in crate::bake) sums: Vec<[f32; 4]>,
    /// Sums of their squares, if the bake is denoised.
    pub(in crate::bake) squares: Vec<[f32; 3]>,
    /// States of the captured texels, as [`LeakTest::map`](crate::capture::atlas::LeakTest::map) makes them.
    pub(in crate::bake) leak_map: Vec<[u8; 4]>,
}

/// The saved state of a light bake, from which another resumes.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LightState {
    /// Saved maps of techniques, by name.
    pub(in crate::bake) maps: SavedMaps,
    /// The finished tiles.
    pub(in crate::bake) done: Vec<Option<LitRows>>,
    /// Results of tasks in unfinished tiles.
    pub(in crate::bake) parts: Vec<TexelPart>,
    /// The first samples of an unfinished task.
    pub(in crate::bake) unfinished: Option<TexelPart>,
}

/// The texels of a tile's own rows.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(in crate::bake) struct LitRows {
    pub texels: Vec<Vec3>,
    pub leak_map: Vec<[u8; 4]>,
}

impl TexelPart {
    /// Whether it has `texels` texels, only finite sums, as many samples in each as there can be, and squares if asked for.
    pub(in crate::bake) fn is_sound(&self, texels: usize, has_squares: bool) -> bool {
        self.sums.len() == texels
            && self.squares.len() == if has_squares { texels } else { 0 }
            && self.leak_map.len() == texels
            && are_sums(&self.sums, self.samples.len())
            && are_squares(&self.squares)
    }
}

/// Whether these are sums of up to `samples` samples each.
pub(in crate::bake) fn are_sums(sums: &[[f32; 4]], samples: usize) -> bool {
    let counts = 0.0..=samples as f32;
    let mut sums = sums.iter();
    sums.all(|sum| sum.iter().all(|value| value.is_finite()) && counts.contains(&sum[3]))
}

/// Whether these may be sums of squares.
pub(in crate::bake) fn are_squares(sums: &[[f32; 3]]) -> bool {
    let mut values = sums.iter().flatten();
    values.all(|value| value.is_finite() && *value >= 0.0)
}

impl LitRows {
    /// Whether it has `texels` texels, whose light is finite.
    pub(in crate::bake) fn is_sound(&self, texels: usize) -> bool {
        self.texels.len() == texels
            && self.leak_map.len() == texels
            && self.texels.iter().all(|texel| texel.is_finite())
    }
}
