//! What path-tracing is for in default sets: live views on discrete GPUs, of scenes in which it errs less for its time than
//! the others, and in software of scenes with glass (docs/equal-time.md).

use crate::light_paths::LightClass;
use crate::techniques::{MOST_TRACED, Occasion, Purpose, Speed};

/// Why it suits an occasion. In software, the maps of others take minutes where there is glass, and less than paths elsewhere. Where spots and points light a room, other light than theirs is indirect and too noisy for one
/// path per pixel, and depth maps have no noise at all. The path tracer's media were not measured.
pub fn suits(occasion: &Occasion<'_>) -> Option<String> {
    let scene = occasion.scene;
    let is_live = occasion.purpose == Purpose::LiveView && occasion.speed != Speed::Modest;
    if !is_live || !scene.media.is_empty() || occasion.triangles > MOST_TRACED {
        return None;
    }
    let mut materials = scene.instances.iter().map(|instance| instance.material);
    let has_glass = materials.any(|material| scene.materials[material].transmission > 0.0);
    if occasion.speed == Speed::Software {
        let reason = "the scene has glass, whose maps take long in software";
        return has_glass.then(|| reason.to_owned());
    }
    let reason = if occasion.classes.contains(&LightClass::Environment) {
        "the sky lights the scene"
    } else if !occasion.classes.contains(&LightClass::Punctual) {
        "lamps with extent light the scene"
    } else if has_glass {
        "the scene has glass"
    } else {
        return None;
    };
    Some(format!(
        "{reason}, and this GPU traces a path per pixel in time"
    ))
}
