//! GPU memory that runs out, after few allocations or many: an error that says so, and never a panic or a hang.

mod common;

use std::ops::ControlFlow;

use common::{direct, floor, own_gpu};
use glam::Vec3;
use gpugi::Renderer;
use gpugi::bake::{Bake, LightBake, LightOptions};
use gpugi::gpu::{Gpu, GpuError};
use gpugi::lighting::LightingError;
use gpugi::reference::{PathTracer, Settings};
use gpugi_scene::builtin::builtin;
use gpugi_scene::{Atlas, AtlasOptions, Camera, Environment};

/// Runs `work` with one, two, three and more allocations, in growing steps, until they are enough.
#[track_caller]
fn assert_runs_out(gpu: &Gpu, work: impl Fn() -> Result<(), LightingError>) {
    let mut allocations = 0;
    loop {
        gpu.limit_allocations(allocations);
        match work() {
            Ok(()) => break,
            Err(error) => {
                let is_memory = matches!(error, LightingError::Gpu(GpuError::OutOfMemory { .. }));
                assert!(is_memory, "{allocations} allocations: {error}");
                assert!(
                    error.to_string().contains("out of GPU memory in"),
                    "{error}"
                );
            }
        }
        allocations += 1 + allocations / 5;
    }
    assert!(
        allocations > 20,
        "all is there after {allocations} allocations"
    );
    // Once there is memory again, all is well.
    gpu.limit_allocations(u64::MAX);
    work().expect("enough memory");
}

fn looking_down() -> Camera {
    Camera::look_at("", Vec3::new(0.0, 3.0, 3.0), Vec3::ZERO, 0.8)
}

#[test]
fn a_picture_without_memory() {
    let Some(gpu) = own_gpu() else { return };
    let mut scene = floor(1.0);
    scene.environment = Some(Environment::default_sky());
    let names = direct(&gpu, &scene);
    assert_runs_out(&gpu, || {
        let mut renderer = Renderer::new(&gpu, &scene, [16, 16], &names)?;
        renderer.render_sample(&looking_down(), 1, None, false)?;
        renderer.radiance()?;
        Ok(())
    });
}

#[test]
fn a_reference_without_memory() {
    let Some(gpu) = own_gpu() else { return };
    let scene = builtin("cornell", 1).expect("a scene");
    assert_runs_out(&gpu, || {
        let mut tracer = PathTracer::new(&gpu, &scene, [16, 16], &Settings::default())?;
        tracer.render(&looking_down(), 1, &mut |_| ControlFlow::Continue(()))?;
        Ok(())
    });
}

#[test]
fn a_bake_without_memory() {
    let Some(gpu) = own_gpu() else { return };
    let scene = builtin("cornell", 1).expect("a scene");
    let options = AtlasOptions {
        size: 32,
        ..AtlasOptions::default()
    };
    let atlas = Atlas::new(&scene, &options).expect("an atlas");
    let names = ["shadow-map".to_owned()];
    assert_runs_out(&gpu, || {
        let mut bake = LightBake::new(&gpu, &scene, &atlas, &names, &LightOptions::default())?;
        for _ in 0..3 {
            bake.step()?;
        }
        bake.save()?;
        Ok(())
    });
}
