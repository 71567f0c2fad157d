//! What an atlas should be like.

use serde::{Deserialize, Serialize};

/// Texel density.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum TexelDensity {
    /// The highest density at which everything fits one page. What is far larger than the scene's core
    /// ([`Scene::core`](crate::Scene::core)) gets fewer texels per metre than the rest. If gutters alone overfill a page,
    /// several pages at the lowest density.
    OnePage,
    /// Texels per metre (1/m), in as many pages as needed.
    PerMetre(f32),
}

/// Layout options of an atlas.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AtlasOptions {
    /// Side of a page (texels), 16 to [`LARGEST_PAGE`](super::LARGEST_PAGE).
    pub size: u32,
    /// Texel density.
    pub density: TexelDensity,
    /// Minimum number of empty texels between charts; usually there are about twice as many. With 1, bilinear filters
    /// never read texels of another chart.
    pub gutter: u32,
    /// Maximum number of pages; an atlas that needs more is an error.
    pub most_pages: u32,
    /// Whether valid second texture coordinates define the charts.
    pub use_second_set: bool,
    /// Whether open double-sided meshes, such as leaves and curtains, and all that transmit light diffusely also have
    /// texels for the backs of their surfaces.
    pub backs: bool,
}

impl Default for AtlasOptions {
    fn default() -> Self {
        Self {
            size: 1024,
            density: TexelDensity::OnePage,
            gutter: 2,
            most_pages: 64,
            use_second_set: true,
            backs: false,
        }
    }
}
