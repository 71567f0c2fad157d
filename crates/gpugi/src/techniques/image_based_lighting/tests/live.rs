//! Live frames under a sky that changes.

use std::sync::Arc;

use glam::Vec3;
use gpugi_scene::{Camera, Pixels, Scene};

use super::still;
use crate::Renderer;
use crate::lighting::{Budget, Readiness};
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

/// Maps are drawn again a few per frame; once all are, the picture is that of maps that were all drawn at once, to the bit.
#[test]
fn what_moves_is_followed_map_by_map() {
    let Some(gpu) = test_gpu() else { return };
    let camera = Camera::look_at("", Vec3::new(0.0, 3.0, 0.01), Vec3::ZERO, 0.3);
    let mut scene = still([64, 32]);
    let [mut live, mut at_once] = [(), ()].map(|()| {
        let names = &["image-based-lighting"];
        let mut renderer = Renderer::new(&gpu, &scene, [16, 16], names).unwrap();
        // What compute draws is drawn at once.
        for (name, value) in [
            ("samples", "16"),
            ("resolution", "32"),
            ("rasterizer", "hardware"),
        ] {
            renderer.set("image-based-lighting", name, value).unwrap();
        }
        renderer.render_sample(&camera, 1, None, false).unwrap();
        renderer
    });
    let last = scene.instances.last_mut().unwrap();
    last.world_from_mesh.w_axis.x += 0.3;
    at_once.update(&scene).unwrap();
    at_once.render_sample(&camera, 1, None, false).unwrap();
    let expected = at_once.radiance().unwrap();
    let apart = |renderer: &Renderer| {
        let radiance = renderer.radiance().unwrap();
        let pairs = radiance.iter().zip(&expected);
        pairs.map(|(a, b)| f64::from((a - b).abs())).sum::<f64>()
    };
    live.update(&scene).unwrap();
    // Four of the 16 maps: texels and triangles.
    let map = 32 * 32 + 64 * scene.statistics().triangles;
    live.set_budget(Budget::units(4 * map));
    let (mut frames, mut before) = (0, f64::INFINITY);
    loop {
        live.restart();
        let (readiness, _) = live.try_render_sample(&camera, 1, None, false).unwrap();
        frames += 1;
        let now = apart(&live);
        println!("{readiness:?}: {now}");
        if readiness == Readiness::Ready {
            assert_eq!(now, 0.0);
            break;
        }
        assert!(now > 0.0 && now < before * 1.5, "{now}");
        before = now;
        assert!(frames < 16, "not one map per frame");
    }
    assert_eq!(frames, 4);
}
