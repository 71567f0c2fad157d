//! Settings of ray-tracing in default sets: it shows all that surfaces reflect and refract in a still picture. Rays are
//! more exact than distance-impostor, and faster: cubes would light many more points than a picture shows.

use crate::techniques::{Occasion, Values};

/// Those for an occasion.
pub fn settings(occasion: &Occasion<'_>) -> Values {
    let mut settings = vec![("objects", "*".to_owned())];
    let mut materials = occasion.scene.materials.iter();
    if materials.any(|material| material.transmission > 0.0) {
        // Both what glass reflects and what it refracts, at its front and back: pictures of few samples have no grain.
        settings.push(("split", 2.to_string()));
    }
    settings
}
