//! Settings of shadow-map in default sets.

use gpugi_scene::{Light, LightKind, Scene};

use crate::scene::has_emitters;
use crate::techniques::{Occasion, Purpose, Speed, Values};

/// Those for an occasion.
pub fn settings(occasion: &Occasion<'_>) -> Values {
    match occasion.purpose {
        Purpose::StillPicture => soft_shadows(occasion.scene, occasion.speed),
        // Where a picture soon has more samples, a quarter of each one's work is enough.
        Purpose::LiveView if has_emitters(occasion.scene) => {
            vec![("interleaved", true.to_string())]
        }
        Purpose::LiveView | Purpose::Bake => Vec::new(),
    }
}

/// Settings for a still picture, whose samples share the work of soft shadows. A discrete GPU draws larger depth maps; in
/// software, where each point of an area light takes long, half as many serve each sample.
fn soft_shadows(scene: &Scene, speed: Speed) -> Values {
    let has_emitters = has_emitters(scene);
    let is_soft = has_emitters || scene.lights.iter().any(|light| light.radius > 0.0);
    let mut settings = Vec::new();
    let mut set = |name, value: u32| settings.push((name, value.to_string()));
    match speed {
        Speed::Software if has_emitters => set("area-samples", 32),
        Speed::Fast => {
            if let Some([resolution, area_resolution]) = depth_maps(scene, has_emitters) {
                set("resolution", resolution);
                set("area-resolution", area_resolution);
            }
        }
        Speed::Software | Speed::Modest => {}
    }
    if is_soft {
        settings.push(("per-sample", true.to_string()));
    }
    settings
}

/// Sides of depth maps, of lights and of area samples, that all fit in the largest atlas.
fn depth_maps(scene: &Scene, has_emitters: bool) -> Option<[u32; 2]> {
    /// Texels of the atlas (8192 x 8192), less what gaps between maps may take.
    const ROOM: u64 = 60 << 20;
    /// Samples of area lights, each with the half of a cube, which has the area of three faces.
    const SAMPLES: u64 = 64;
    let faces_of = |light: &Light| match light.kind {
        LightKind::Point => 6,
        LightKind::Spot { .. } => 1,
        // Cascades, and one map of the whole scene.
        LightKind::Directional => 5,
    };
    let faces: u64 = scene.lights.iter().map(faces_of).sum();
    let area_faces = if has_emitters { 3 * SAMPLES } else { 0 };
    let texels = |faces: u64, side: u32| faces * u64::from(side).pow(2);
    [[2048, 512], [2048, 384], [1024, 384]]
        .into_iter()
        .find(|&[side, area_side]| texels(faces, side) + texels(area_faces, area_side) <= ROOM)
}

#[cfg(test)]
mod tests {
    use gpugi_scene::builtin::builtin;

    use super::*;

    #[test]
    fn depth_maps_fit_the_atlas() {
        let of = |name| depth_maps(&builtin(name, 1).unwrap(), true);
        assert_eq!(of("cornell"), Some([2048, 512]));
        assert_eq!(of("glass-room"), Some([2048, 384]));
        let mut many = builtin("glass-room", 1).unwrap();
        let lights = many.lights.clone();
        many.lights.extend(lights.iter().cloned());
        assert_eq!(depth_maps(&many, true), Some([1024, 384]));
        for _ in 0..4 {
            many.lights.extend(lights.iter().cloned());
        }
        assert_eq!(depth_maps(&many, true), None);
    }
}
