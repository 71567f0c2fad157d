//! Pictures that nobody tuned: the default set of a still picture against the path tracer with all light paths.

use crate::common::{direct, gpu, measured_by, options, samples_of};
use gpugi::gpu::Gpu;
use gpugi::measure::Options;
use gpugi::{Purpose, Renderer};
use gpugi_scene::Scene;
use gpugi_scene::builtin::builtin;
use gpugi_scene::image::metrics::Metric;

const SIZE: [u32; 2] = [48, 36];

/// A renderer with the default set for a purpose.
fn default(gpu: &Gpu, scene: &Scene, purpose: Purpose) -> Renderer {
    Renderer::new(gpu, scene, SIZE, purpose).expect("a renderer")
}

/// HDR-FLIP against all light.
fn flip(gpu: &Gpu, scene: &Scene, mut renderer: Renderer) -> f64 {
    let options = Options {
        all_light: true,
        ..options([samples_of(&renderer, 16), 512])
    };
    let measured = measured_by(gpu, scene, &scene.cameras[0], &mut renderer, options);
    measured.value(Metric::Flip).expect("FLIP")
}

/// The still picture of a scene differs from the truth by less than `most`, which holds part of the reference's noise, and
/// the live view by less than `live_most`. Direct light alone differs by more. The bounds are
/// 8 percent above the greater error of an H100's picture and llvmpipe's.
fn pictures_are_near_the_truth(name: &str, most: f64, live_most: f64) {
    let Some(gpu) = gpu() else { return };
    let scene = builtin(name, 1).expect("a built-in scene");
    let [still, live] = [Purpose::StillPicture, Purpose::LiveView]
        .map(|purpose| flip(&gpu, &scene, default(&gpu, &scene, purpose)));
    let direct = Renderer::new(&gpu, &scene, SIZE, &direct(&gpu, &scene)).expect("a renderer");
    let direct = flip(&gpu, &scene, direct);
    println!("{name}: FLIP {still:.4}, live {live:.4}, without indirect light {direct:.4}");
    assert!(still < most, "{name}: FLIP {still}");
    assert!(live < live_most, "{name}: FLIP {live} of a live view");
    assert!(
        direct > live_most,
        "{name}: FLIP {direct} without indirect light"
    );
}

#[test]
fn cornell() {
    pictures_are_near_the_truth("cornell", 0.089, 0.12);
}

#[test]
fn room() {
    pictures_are_near_the_truth("room", 0.069, 0.123);
}

#[test]
fn chamber() {
    pictures_are_near_the_truth("chamber", 0.182, 0.216);
}

#[test]
fn teapot() {
    pictures_are_near_the_truth("teapot", 0.029, 0.0735);
}

#[test]
fn spheres() {
    pictures_are_near_the_truth("spheres", 0.0335, 0.0522);
}

#[test]
fn shapes() {
    pictures_are_near_the_truth("shapes", 0.0525, 0.0905);
}

#[test]
fn window_room() {
    pictures_are_near_the_truth("window-room", 0.131, 0.255);
}
