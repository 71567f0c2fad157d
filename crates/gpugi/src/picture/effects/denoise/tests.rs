//! Frames with noise against pictures of many samples.

use std::ops::ControlFlow;

use glam::{Mat4, Vec3, vec3};
use gpugi_scene::builtin::builtin;
use gpugi_scene::image::metrics::{Metric, Picture, compare};
use gpugi_scene::{Camera, Medium, PhaseFunction, Scene};

use super::Filter;
use crate::Renderer;
use crate::gpu::Gpu;
use crate::picture::Effects;
use crate::scene::Edit;
use crate::testing::test_gpu;

/// Larger than a test needs, because coarse pixels are mostly edges: some tests take 2 to 3 s.
const SIZE: [u32; 2] = [64, 48];

fn renderer(gpu: &Gpu, scene: &Scene, techniques: &[&str]) -> Renderer {
    Renderer::new(gpu, scene, SIZE, techniques).unwrap()
}

fn live(filter: Filter) -> Effects {
    let mut effects = Effects::of_live_view().exposed(1.0).without_dither();
    effects.denoise.filter = filter;
    effects
}

/// One frame of a picture of its own, as it is shown.
fn frame(renderer: &mut Renderer, camera: &Camera, effects: &Effects) -> Vec<f32> {
    renderer.restart();
    renderer
        .render_sample(camera, 1, Some(effects), false)
        .unwrap();
    renderer.live_radiance().unwrap()
}

/// The last of some frames of a camera that moves aside, and ends where the scene's stands.
fn moved(renderer: &mut Renderer, scene: &Scene, effects: &Effects) -> Vec<f32> {
    renderer.forget();
    let aside = |step: u16| {
        let mut camera = scene.cameras[0].clone();
        camera.world_from_view.w_axis.x += 0.004 * f32::from(step);
        camera
    };
    let frames = (0..16).rev();
    let frames = frames.map(|step| frame(renderer, &aside(step), effects));
    frames.last().unwrap()
}

/// A picture of so many samples, of what is seen at once.
fn truth(renderer: &mut Renderer, camera: &Camera, samples: u32) -> Vec<f32> {
    renderer.restart();
    for _ in 0..samples {
        renderer
            .render_sample(camera, samples, None, false)
            .unwrap();
    }
    renderer.radiance().unwrap()
}

fn flip(shown: &[f32], truth: &[f32]) -> f64 {
    let [shown, truth] = [shown, truth]
        .map(|radiance| Picture::of_radiance(SIZE[0], SIZE[1], radiance.to_vec()).unwrap());
    compare(Metric::Flip, &shown, &truth).unwrap().value
}

/// Mean of what is no lamp.
fn mean(radiance: &[f32]) -> f64 {
    let values = radiance.iter().map(|&value| f64::from(value.min(3.0)));
    values.sum::<f64>() / radiance.len() as f64
}

/// A frame in motion errs by 0.7 of what it does without a filter, which makes it neither darker nor brighter.
#[test]
fn filtered_frames_err_less() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("cornell", 1).unwrap();
    let mut renderer = renderer(&gpu, &scene, &["path-tracing"]);
    let truth = truth(&mut renderer, &scene.cameras[0], 64);
    let [unfiltered, spatial, temporal] = [Filter::None, Filter::Spatial, Filter::Temporal]
        .map(|filter| moved(&mut renderer, &scene, &live(filter)));
    let brightness = |shown: &[f32]| mean(shown) / mean(&unfiltered);
    for (filter, shown) in [("spatial", &spatial), ("temporal", &temporal)] {
        let brightness = brightness(shown);
        println!("{filter}: brightness {brightness:.3}");
        assert!((brightness - 1.0).abs() < 0.06, "{filter}: {brightness}");
    }
    let [unfiltered, temporal] = [&unfiltered, &temporal].map(|shown| flip(shown, &truth));
    println!("unfiltered {unfiltered:.3}, temporal {temporal:.3}");
    assert!(temporal < 0.8 * unfiltered, "{temporal} of {unfiltered}");
}

/// Behind fog, noise is dimmed as the light is of which it is a part. It takes 4 s: two sets of frames, and a truth with less
/// noise than these leave.
#[test]
fn noise_behind_fog_is_filtered() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = builtin("cornell", 1).unwrap();
    let place = Mat4::from_translation(vec3(0.0, 2.75, 0.0));
    scene.media.push(Medium {
        name: "fog".into(),
        world_from_box: Some(place * Mat4::from_scale(Vec3::splat(5.6))),
        extinction: Vec3::splat(0.1),
        albedo: Vec3::splat(0.5),
        phase: PhaseFunction::HenyeyGreenstein(0.0),
        emission: Vec3::ZERO,
        density: None,
        node: None,
    });
    let mut renderer = renderer(&gpu, &scene, &["participating-media", "path-tracing"]);
    renderer
        .set("participating-media", "particles", "64")
        .unwrap();
    renderer
        .converge(&scene.cameras[0], false, |_, _| ControlFlow::Continue(()))
        .unwrap();
    let truth = truth(&mut renderer, &scene.cameras[0], 128);
    let [unfiltered, filtered] =
        [Filter::None, Filter::Temporal].map(|filter| moved(&mut renderer, &scene, &live(filter)));
    let brightness = mean(&filtered) / mean(&unfiltered);
    let [unfiltered, filtered] = [&unfiltered, &filtered].map(|shown| flip(shown, &truth));
    println!("unfiltered {unfiltered:.3}, filtered {filtered:.3}, brightness {brightness:.3}");
    assert!((brightness - 1.0).abs() < 0.06, "{brightness}");
    // What the fog itself sends has no noise. If its dimming is left out, the error is above 0.4.
    assert!(filtered < 0.92 * unfiltered, "{filtered} of {unfiltered}");
    assert!(filtered < 0.25, "{filtered}");
}

/// Light that no technique draws by chance passes as it is, and without a filter all light does.
#[test]
fn what_is_not_filtered_stays() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("cornell", 1).unwrap();
    let camera = &scene.cameras[0];
    let [without, with] = [Filter::None, Filter::Temporal].map(|filter| {
        let mut smooth = renderer(&gpu, &scene, &["shadow-map"]);
        moved(&mut smooth, &scene, &live(filter))
    });
    assert!(without == with, "light without noise is not filtered");
    // A first frame: what the film holds, but for edges, which are made smooth.
    let mut noisy = renderer(&gpu, &scene, &["path-tracing"]);
    let shown = frame(&mut noisy, camera, &live(Filter::None));
    let exact = noisy.radiance().unwrap();
    let near = |(a, b): (&f32, &f32)| (a - b).abs() <= 2e-3 * b.abs().max(1e-3);
    let kept = shown.iter().zip(&exact).filter(|pair| near(*pair)).count();
    assert!(kept * 4 > shown.len() * 3, "{kept} of {}", shown.len());
}

/// After a light is switched off, its light is gone within a quarter of a second.
#[test]
fn light_that_is_switched_off_does_not_linger() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("room", 1).unwrap();
    let camera = &scene.cameras[0];
    let mut renderer = renderer(&gpu, &scene, &["path-tracing"]);
    let effects = live(Filter::Temporal);
    for _ in 0..16 {
        frame(&mut renderer, camera, &effects);
    }
    let before = mean(&renderer.live_radiance().unwrap());
    let mut light = scene.lights[0].clone();
    light.intensity *= 0.05;
    renderer.edit(&[Edit::Light { index: 0, light }]).unwrap();
    let frames: Vec<f64> = (0..18)
        .map(|_| mean(&frame(&mut renderer, camera, &effects)))
        .collect();
    // One frame alone is noisy.
    let lingering = frames[14..].iter().sum::<f64>() / 4.0;
    let gone = mean(&truth(&mut renderer, camera, 32));
    println!("{before:.4} before, {lingering:.4} after, {gone:.4} in truth");
    assert!(gone < 0.8 * before, "{gone} of {before}");
    assert!(lingering < 1.05 * gone, "{lingering} of {gone}");
    assert!(lingering > 0.9 * gone, "{lingering} of {gone}");
}

/// What mirrors show is filtered as the surfaces behind them, and the sky in them is sharp at once.
#[test]
fn images_in_mirrors_are_filtered_too() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = builtin("ornaments", 1).unwrap();
    for material in &mut scene.materials {
        (material.roughness, material.metallic) = (0.0, 1.0);
    }
    let camera = &scene.cameras[0];
    let mut renderer = renderer(&gpu, &scene, &["path-tracing"]);
    let truth = truth(&mut renderer, camera, 64);
    let [unfiltered, filtered] = [Filter::None, Filter::Temporal]
        .map(|filter| flip(&moved(&mut renderer, &scene, &live(filter)), &truth));
    println!("unfiltered {unfiltered:.4}, filtered {filtered:.4}");
    assert!(filtered < 1.1 * unfiltered, "{filtered}, {unfiltered}");
}

/// One edit, one frame, and then a picture at rest, as a viewer has it: the history is that of before the edit all the while.
#[test]
fn light_that_is_switched_off_does_not_come_back_at_rest() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("room", 1).unwrap();
    let camera = &scene.cameras[0];
    let mut renderer = renderer(&gpu, &scene, &["path-tracing"]);
    let effects = live(Filter::Temporal);
    for _ in 0..16 {
        frame(&mut renderer, camera, &effects);
    }
    let mut light = scene.lights[0].clone();
    light.intensity *= 0.05;
    renderer.edit(&[Edit::Light { index: 0, light }]).unwrap();
    frame(&mut renderer, camera, &effects);
    for _ in 0..20 {
        renderer
            .render_sample(camera, 64, Some(&effects), false)
            .unwrap();
    }
    let shown = mean(&renderer.live_radiance().unwrap());
    let gone = mean(&truth(&mut renderer, camera, 32));
    println!("{shown:.4} at rest, {gone:.4} in truth");
    assert!((shown / gone - 1.0).abs() < 0.1, "{shown} of {gone}");
}
