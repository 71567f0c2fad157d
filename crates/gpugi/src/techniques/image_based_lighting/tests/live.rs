//! Live frames under a sky that changes.

use std::sync::Arc;

use glam::Vec3;
use gpugi_scene::{Camera, Pixels, Scene};

use super::still;
use crate::Renderer;
use crate::lighting::Readiness;
use crate::testing::test_gpu;

/// The scene with twice the light of the sky.
fn brighter(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    if let Some(sky) = &mut scene.environment
        && let Pixels::Rgba32Float(texels) = &mut Arc::make_mut(&mut sky.image).pixels
    {
        texels.iter_mut().for_each(|value| *value *= 2.0);
    }
    scene
}

/// A frame is lit by the directions of the sky one frame before; ratios are of light that is never late.
#[test]
fn a_sky_that_changes_in_every_frame_is_followed() {
    let Some(gpu) = test_gpu() else { return };
    // Sees surfaces alone.
    let camera = Camera::look_at("", Vec3::new(0.0, 3.0, 0.01), Vec3::ZERO, 0.3);
    for (reflectivity, late) in [("lobe", 1), ("ratio", 0)] {
        let mut scene = still([64, 32]);
        let [mut live, mut blocking] = [(), ()].map(|()| {
            let names = &["image-based-lighting"];
            let mut renderer = Renderer::new(&gpu, &scene, [8, 8], names).unwrap();
            for (name, value) in [
                ("samples", "16"),
                ("resolution", "32"),
                ("reflectivity", reflectivity),
            ] {
                renderer.set("image-based-lighting", name, value).unwrap();
            }
            renderer.render_sample(&camera, 1, None, false).unwrap();
            renderer
        });
        while live.is_compiling() {
            std::thread::yield_now();
        }
        let light = |renderer: &Renderer| renderer.radiance().unwrap().iter().sum::<f32>();
        let first = light(&live);
        for frame in 1..4 {
            scene = brighter(&scene);
            live.update(&scene).unwrap();
            let (readiness, _) = live.try_render_sample(&camera, 1, None, false).unwrap();
            assert!(
                matches!(readiness, Readiness::Refining { .. }),
                "{readiness:?}"
            );
            let ratio = light(&live) / first;
            let expected = f32::powi(2.0, frame - late);
            println!("{reflectivity}: {ratio} times the light, not {expected}");
            assert!((ratio / expected - 1.0).abs() < 0.1);
            blocking.update(&scene).unwrap();
            blocking.render_sample(&camera, 1, None, false).unwrap();
        }
        // At rest it is the light of the last sky, to the bit.
        live.restart();
        let (readiness, _) = live.try_render_sample(&camera, 1, None, false).unwrap();
        assert_eq!(readiness, Readiness::Ready);
        assert_eq!(live.radiance().unwrap(), blocking.radiance().unwrap());
    }
}
