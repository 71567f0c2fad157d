//! Pictures that nobody tuned: the default set of a still picture against the path tracer with all light paths.

mod common;

use std::ops::ControlFlow;
use std::path::PathBuf;

use common::gpu;
use gpugi::gpu::Gpu;
use gpugi::measure::{Cache, Options, Quality, measure};
use gpugi::techniques::Registry;
use gpugi::{Purpose, Renderer, default_set};
use gpugi_scene::Scene;
use gpugi_scene::builtin::builtin;
use gpugi_scene::image::metrics::Metric;

/// HDR-FLIP of the default set for `purpose`.
fn flip(gpu: &Gpu, scene: &Scene, purpose: Purpose, cache: &Cache) -> f64 {
    let registry = Registry::default();
    let set = default_set(scene, &gpu.adapter, purpose, &registry);
    let renderer = Renderer::with_set(gpu, scene, [48, 36], &set, &registry);
    let mut renderer = renderer.expect("a renderer");
    let options = Options {
        samples: 16,
        reference: Quality {
            samples: 512,
            noise: 0.0,
        },
        cache: Some(cache.clone()),
        all_light: true,
        ..Options::default()
    };
    let mut go_on = |_: &_| ControlFlow::Continue(());
    let camera = &scene.cameras[0];
    let measured = measure(gpu, scene, camera, &mut renderer, &options, &mut go_on);
    let flip = measured.expect("a measurement").value(Metric::Flip);
    flip.expect("FLIP")
}

/// The still picture of a scene differs from the truth by less than `most`, which holds part of the reference's noise,
/// and the live view, which lacks indirect light, by more.
fn still_picture_is_near_the_truth(name: &str, most: f64) {
    let Some(gpu) = gpu() else { return };
    let scene = builtin(name, 1).expect("a built-in scene");
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("default-light-{name}"));
    let cache = Cache::new(&folder);
    let [still, live] = [Purpose::StillPicture, Purpose::LiveView]
        .map(|purpose| flip(&gpu, &scene, purpose, &cache));
    println!("{name}: FLIP {still:.4}, without indirect light {live:.4}");
    assert!(still < most, "{name}: FLIP {still}");
    assert!(live > most, "{name}: FLIP {live} without indirect light");
}

#[test]
fn cornell() {
    still_picture_is_near_the_truth("cornell", 0.1);
}

#[test]
fn room() {
    still_picture_is_near_the_truth("room", 0.08);
}

#[test]
fn chamber() {
    still_picture_is_near_the_truth("chamber", 0.2);
}

#[test]
fn teapot() {
    still_picture_is_near_the_truth("teapot", 0.035);
}

#[test]
fn spheres() {
    still_picture_is_near_the_truth("spheres", 0.04);
}

#[test]
fn shapes() {
    still_picture_is_near_the_truth("shapes", 0.06);
}

#[test]
fn window_room() {
    still_picture_is_near_the_truth("window-room", 0.15);
}
