//! A GPU that is lost in the middle of work: an error that says so, and never a panic or a hang.

mod common;

use std::ops::ControlFlow;

use common::{floor, own_gpu};
use glam::Vec3;
use gpugi::bake::{Bake, LightBake, LightOptions};
use gpugi::gpu::GpuError;
use gpugi::lighting::LightingError;
use gpugi::reference::{PathTracer, Settings};
use gpugi::{Purpose, Renderer};
use gpugi_scene::builtin::builtin;
use gpugi_scene::{Atlas, AtlasOptions, Camera, Environment};

fn looking_down() -> Camera {
    Camera::look_at("", Vec3::new(0.0, 3.0, 3.0), Vec3::ZERO, 0.8)
}

#[track_caller]
fn assert_lost<T>(result: Result<T, impl Into<LightingError>>) {
    let error = result.err().expect("the GPU is lost").into();
    assert!(
        matches!(error, LightingError::Gpu(GpuError::Lost { .. })),
        "{error}"
    );
    assert!(error.to_string().contains("the GPU was lost"), "{error}");
}

#[test]
fn a_picture_whose_gpu_is_lost() {
    let Some(gpu) = own_gpu() else { return };
    let mut scene = floor(1.0);
    scene.environment = Some(Environment::default_sky());
    let mut renderer =
        Renderer::new(&gpu, &scene, [16, 16], Purpose::LiveView).expect("a renderer");
    renderer
        .render_sample(&looking_down(), 1, None, false)
        .expect("a sample");
    gpu.device.destroy();
    let samples = (2..10).try_for_each(|sample| {
        renderer.render_sample(&looking_down(), sample, None, false)?;
        Ok::<(), LightingError>(renderer.radiance().map(drop)?)
    });
    assert_lost(samples);
    assert_lost(renderer.converge(&looking_down(), false, |_, _| ControlFlow::Continue(())));
    assert_lost(renderer.radiance());
    assert_lost(Renderer::new(&gpu, &scene, [16, 16], Purpose::LiveView));
    assert_lost(gpu.check());
    assert_lost(gpu.wait());
}

#[test]
fn a_reference_whose_gpu_is_lost() {
    let Some(gpu) = own_gpu() else { return };
    let scene = builtin("cornell", 1).expect("a scene");
    let mut tracer =
        PathTracer::new(&gpu, &scene, [16, 16], &Settings::default()).expect("a path tracer");
    gpu.device.destroy();
    assert_lost(tracer.render(&looking_down(), 4, &mut |_| ControlFlow::Continue(())));
}

#[test]
fn a_bake_whose_gpu_is_lost() {
    let Some(gpu) = own_gpu() else { return };
    let scene = builtin("cornell", 1).expect("a scene");
    let options = AtlasOptions {
        size: 32,
        ..AtlasOptions::default()
    };
    let atlas = Atlas::new(&scene, &options).expect("an atlas");
    let names = ["shadow-map".to_owned()];
    let mut bake =
        LightBake::new(&gpu, &scene, &atlas, &names, &LightOptions::default()).expect("a bake");
    for _ in 0..3 {
        bake.step().expect("a step");
    }
    gpu.device.destroy();
    // Steps that are on their way may still end.
    let steps = (0..8).try_for_each(|_| {
        bake.step()?;
        Ok::<(), LightingError>(gpu.wait()?)
    });
    assert_lost(steps);
    assert_lost(bake.save());
}
