//! Obscurances multiply the light.

use glam::{Vec3, vec3};
use gpugi::LightingError;
use gpugi_scene::{Camera, Light, LightKind, Scene};

use crate::common::{gpu, picture, renderer_of, shining_room};

fn lit_room() -> Scene {
    let mut scene = shining_room(0.0, Vec3::splat(0.6));
    let light = Light::new("", LightKind::Point, Vec3::ONE);
    scene
        .lights
        .push(light.aimed(vec3(0.3, 1.1, 0.2), Vec3::ZERO));
    scene
}

/// Where nothing is within reach the light stays; in corners it loses what obscurances take.
#[test]
fn obscurances_darken_corners() {
    let Some(gpu) = gpu() else { return };
    let scene = lit_room();
    let camera = Camera::look_at("", vec3(0.8, 0.9, 1.2), vec3(-0.6, 0.3, -0.9), 1.3);
    let of = |techniques: &[&str], settings: &[&str]| {
        let of = "final-gather";
        let mut renderer = renderer_of(&gpu, &scene, techniques, 32, of, settings);
        if techniques.contains(&"obscurances") {
            for (name, value) in [("distance", "0.3"), ("resolution", "128"), ("steps", "64")] {
                let set = renderer.set("obscurances", name, value);
                set.expect("a setting");
            }
        }
        // The first picture need not have all samples of the obscurances.
        picture(&mut renderer, &camera);
        picture(&mut renderer, &camera)
    };
    let all = ["shadow-map", "obscurances", "final-gather"];
    let direct = of(&all[..1], &[]);
    let without = of(&all, &["resolution=16"]);
    let with = of(&all, &["resolution=16", "occlusion=true"]);
    let [mut open, mut corners] = [0, 0];
    for ((direct, without), with) in direct.lit().zip(without.lit()).zip(with.lit()) {
        let share = (with.radiance - direct.radiance) / (without.radiance - direct.radiance);
        // Distances from the six walls; one of them is the point's own.
        let (low, high) = (vec3(-1.0, 0.0, -1.5), vec3(1.0, 1.5, 1.5));
        let mut walls = [with.position - low, high - with.position]
            .map(|distances| distances.to_array())
            .concat();
        walls.sort_by(f32::total_cmp);
        assert!((0.0..1.001).contains(&share.x), "{with:?}: {share}");
        if walls[1] > 0.35 {
            open += 1;
            assert!(share.x > 0.998, "{with:?}: {share}");
        } else if walls[1] < 0.05 {
            corners += 1;
            assert!((0.4..0.85).contains(&share.x), "{with:?}: {share}");
        }
    }
    assert!(open > 50 && corners > 20, "{open} {corners}");
}

#[test]
fn occlusion_needs_obscurances() {
    let Some(gpu) = gpu() else { return };
    let scene = lit_room();
    let name = "final-gather";
    let mut renderer = renderer_of(&gpu, &scene, &["shadow-map", name], 8, name, &[]);
    let refused = renderer.set(name, "occlusion", "true");
    let message = refused.expect_err("no obscurances").to_string();
    assert!(message.contains("needs obscurances"), "{message}");
    let refused = renderer.set(name, "occlusion", "true");
    assert!(matches!(refused, Err(LightingError::Needs { .. })));
    // What was refused is not kept.
    let camera = Camera::look_at("", vec3(0.8, 0.9, 1.2), vec3(-0.6, 0.3, -0.9), 1.3);
    picture(&mut renderer, &camera);
}
