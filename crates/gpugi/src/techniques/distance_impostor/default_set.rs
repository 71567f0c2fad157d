//! What distance-impostor is for in default sets: all that surfaces reflect and refract in a still picture, mirrors and
//! glass in others.

use super::INFO;
use crate::scene::has_smooth_objects;
use crate::techniques::{Occasion, Values};

/// Why it suits an occasion.
pub fn suits(occasion: &Occasion<'_>) -> Option<String> {
    let of_mirrors = || {
        let lights = occasion.has_lights(INFO.paths);
        has_smooth_objects(occasion.scene).then(|| format!("{lights}, and mirrors or glass"))
    };
    occasion.has_wide_lobes().or_else(of_mirrors)
}

/// Settings for an occasion.
pub fn settings(occasion: &Occasion<'_>) -> Values {
    match occasion.has_wide_lobes() {
        Some(_) => vec![("objects", "*".to_owned()), ("lobes", "drawn".to_owned())],
        None => Vec::new(),
    }
}
