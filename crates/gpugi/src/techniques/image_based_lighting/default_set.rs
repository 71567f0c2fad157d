//! Settings of image-based-lighting in default sets.

use gpugi_scene::Material;

use crate::techniques::occasion::MOST_TRACED;
use crate::techniques::{Occasion, Purpose, Speed, Values};

/// Those for an occasion: each sample of a still picture is lit from directions of its own. Where software would draw
/// their depth maps for a second or more per sample, these have half as many texels per side.
pub fn settings(occasion: &Occasion<'_>) -> Values {
    /// Most triangles whose depth maps of 512 texels per side are soon drawn in software.
    const FEW: u64 = 5_000;
    if occasion.purpose != Purpose::StillPicture {
        return Vec::new();
    }
    let mut settings = vec![("per-sample", true.to_string())];
    if occasion.speed == Speed::Software && occasion.triangles > FEW {
        settings.push(("resolution", 256.to_string()));
    }
    if traces(occasion) {
        settings.push(("visibility", "rays".to_owned()));
    }
    settings
}

/// Whether rays find the shadows of the sky: if other techniques trace rays anyway. They are exact, where depth maps blur
/// whatever is thin and leak at edges. Not among solids of glass: each ray passes many surfaces there, and takes four
/// times as long as maps with their drawing (docs/techniques/image-based-lighting.md).
fn traces(occasion: &Occasion<'_>) -> bool {
    let is_solid_glass =
        |material: &Material| material.transmission > 0.0 && material.volume.is_some();
    occasion.has_rays
        && occasion.speed == Speed::Fast
        && occasion.triangles <= MOST_TRACED
        && !occasion.scene.materials.iter().any(is_solid_glass)
}
