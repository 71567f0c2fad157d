//! participating-media compared with the path tracer on the same light paths.

mod common;

use common::{gpu, measured, renderer_of};
use glam::Vec3;
use gpugi_scene::PhaseFunction;
use gpugi_scene::builtin::builtin;
use gpugi_scene::image::metrics::Metric;

/// The built-in cloud under sun and sky.
#[test]
fn the_cloud_is_lit_as_by_the_path_tracer() {
    let Some(gpu) = gpu() else { return };
    let mut scene = builtin("cloud", 1).expect("a scene");
    scene.media[0].albedo = Vec3::splat(0.9);
    let camera = scene.cameras[0].clone();
    // Found on a software adapter: 0.0043 and 0.0041.
    for g in [0.0, 0.6] {
        scene.media[0].phase = PhaseFunction::HenyeyGreenstein(g);
        let techniques = ["participating-media"];
        let mut renderer = renderer_of(&gpu, &scene, &techniques, 32, techniques[0], &[]);
        let found = measured(&gpu, &scene, &camera, &mut renderer, [4, 64]);
        let error = found.value(Metric::RelMse4).expect("a value");
        assert!(error < 0.006, "g {g}: {error}");
    }
}
