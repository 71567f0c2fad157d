//! Panes and their clusters of points, as files store them.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::Atlas;

/// Most clusters of entry points.
pub const MOST_CLUSTERS: usize = 1024;

/// Most entry points, and most light samples per entry point.
pub const MOST_ENTRIES: usize = 16_384;
const MOST_SAMPLES: usize = 16;

/// The `depth` of panes that hold light of any number of reflections.
pub const ANY_DEPTH: u32 = 32;

/// A place on a surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SurfacePlace {
    /// Index into the scene's instances.
    pub instance: u32,
    /// Triangle of the instance's mesh.
    pub triangle: u32,
    /// Weights of the triangle's second and third corner; the first one has the rest.
    pub barycentrics: [f32; 2],
}

/// Panes: pane c is the indirect irradiance of an atlas's texels for irradiance 1 of the points of cluster c. Under any
/// light, texels receive the sum of w_c P_c [W/m^2], where w_c is the mean irradiance of the cluster's points, each
/// counted by its albedo.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LightPathPanes {
    /// Where the texels are. Its charts are not stored in files: every triangle with an area belongs to chart 0.
    pub atlas: Arc<Atlas>,
    /// Most surfaces that light visited between an entry point and a texel; [`ANY_DEPTH`] if there is no such limit.
    pub depth: u32,
    /// Entry points, cluster by cluster.
    pub entries: Vec<SurfacePlace>,
    /// Further points at which the light is sampled, cluster by cluster.
    pub samples: Vec<SurfacePlace>,
    /// First entry point of each cluster, and behind the last one their number.
    pub firsts: Vec<u32>,
    /// First light sample of each cluster, and behind the last one their number.
    pub first_samples: Vec<u32>,
    /// Irradiance, rgb9e5: pane by pane, page by page, row by row from the top.
    #[serde(with = "crate::plain")]
    pub panes: Vec<u32>,
    /// [`geometry`](crate::transfer::geometry) of the scene that they were made for.
    pub geometry: [u8; 32],
    /// [`Scene::material_digest`](crate::Scene::material_digest) of that scene.
    pub materials: [u8; 32],
}

impl LightPathPanes {
    /// Clusters of entry points, and panes.
    pub fn clusters(&self) -> usize {
        self.firsts.len().saturating_sub(1)
    }

    /// Texels of a page.
    pub fn texels_per_page(&self) -> usize {
        (self.atlas.size as usize).pow(2)
    }

    /// Checks that there are a pane and points for each cluster.
    pub(crate) fn check_size(&self) -> Result<(), String> {
        let Atlas { size, pages, .. } = *self.atlas;
        let clusters = self.clusters();
        if !(1..=MOST_CLUSTERS).contains(&clusters) {
            return Err(format!(
                "{clusters} clusters are not in 1 to {MOST_CLUSTERS}"
            ));
        }
        if self.depth > ANY_DEPTH {
            return Err(format!("depth {} is not in 0 to {ANY_DEPTH}", self.depth));
        }
        let (entries, samples) = (self.entries.len(), self.samples.len());
        if !(1..=MOST_ENTRIES).contains(&entries)
            || !samples.is_multiple_of(entries)
            || samples / entries >= MOST_SAMPLES
        {
            return Err(format!(
                "{entries} entry points and {samples} light samples: 1 to {MOST_ENTRIES}, and up to {} for each",
                MOST_SAMPLES - 1
            ));
        }
        let divides = |firsts: &[u32], count: usize| {
            firsts.len() == clusters + 1
                && firsts[0] == 0
                && firsts[clusters] as usize == count
                && firsts.is_sorted()
        };
        if !divides(&self.firsts, entries) || !divides(&self.first_samples, samples) {
            return Err("clusters that do not divide the points".to_owned());
        }
        let texels = u64::from(size).pow(2).saturating_mul(pages.into());
        let found = self.panes.len() as u64;
        if found == 0 || found != texels.saturating_mul(clusters as u64) {
            return Err(format!(
                "{found} values for {texels} texels of {clusters} panes"
            ));
        }
        Ok(())
    }
}
