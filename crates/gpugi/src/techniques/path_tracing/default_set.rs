//! What path-tracing is for in default sets: live views on discrete GPUs, where it errs less for its time than the others,
//! and in software those of scenes with glass (docs/equal-time.md).

use crate::scene::stand_apart;
use crate::techniques::{MOST_TRACED, Occasion, Purpose, Speed};

/// Most lights without extent that one path per pixel chooses from. More were not measured.
const MOST_PUNCTUAL: usize = 64;

/// The same where fog is around things: for each light, participating-media traces shadow rays of its own.
const MOST_IN_FOG: usize = 2;

/// Why it suits an occasion. In software, the maps of others take minutes where there is glass, and less than paths
/// elsewhere; media were not measured there, nor clouds that stand apart.
pub fn suits(occasion: &Occasion<'_>) -> Option<String> {
    let scene = occasion.scene;
    let is_live = occasion.purpose == Purpose::LiveView;
    let is_clear = scene.media.is_empty();
    if !is_live || occasion.triangles > MOST_TRACED {
        return None;
    }
    match occasion.speed {
        Speed::Software => {
            let mut materials = scene.instances.iter().map(|instance| instance.material);
            let has_glass = materials.any(|material| scene.materials[material].transmission > 0.0);
            let reason = "the scene has glass, whose maps take long in software";
            (is_clear && has_glass).then(|| reason.to_owned())
        }
        Speed::Modest => None,
        Speed::Fast => {
            let reason = "this GPU traces a path per pixel in time";
            let most = if is_clear { MOST_PUNCTUAL } else { MOST_IN_FOG };
            let has_few = scene.lights.len() <= most;
            (has_few && (is_clear || !stand_apart(scene))).then(|| reason.to_owned())
        }
    }
}
