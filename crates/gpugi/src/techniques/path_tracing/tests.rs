//! The technique finds the light that the path tracer finds, leaves to others what they add, and does not depend on how many
//! paths are in flight.

use std::ops::ControlFlow;

use glam::Vec3;
use gpugi_scene::builtin::builtin;
use gpugi_scene::{AlphaMode, Scene};

use super::{INFO, PathTracing};
use crate::gpu::Gpu;
use crate::reference::{PathTracer, Settings};
use crate::testing::test_gpu;
use crate::{LightingError, Renderer};

const SIZE: [u32; 2] = [32, 28];

/// A picture of so many samples.
fn picture(renderer: &mut Renderer, scene: &Scene, samples: u32) -> Vec<f32> {
    let camera = &scene.cameras[0];
    renderer
        .converge(camera, false, |_, _| ControlFlow::Continue(()))
        .unwrap();
    for _ in 0..samples {
        renderer
            .render_sample(camera, samples, None, false)
            .unwrap();
    }
    renderer.radiance().unwrap()
}

fn alone(gpu: &Gpu, scene: &Scene) -> Renderer {
    Renderer::new(gpu, scene, SIZE, &[INFO.name]).unwrap()
}

/// Mean of what is not far brighter than the rest, such as lamps.
fn mean(radiance: &[f32]) -> f64 {
    let sum: f64 = radiance.iter().map(|value| f64::from(value.min(2.0))).sum();
    sum / radiance.len() as f64
}

/// Lamps in a box, and rough and smooth metal and glass under a sky: the same light within the noise of 48 samples.
#[test]
fn the_light_is_that_of_the_path_tracer() {
    let Some(gpu) = test_gpu() else { return };
    for (name, bound) in [("cornell", 0.02), ("ornaments", 0.01)] {
        let scene = builtin(name, 1).unwrap();
        let found = picture(&mut alone(&gpu, &scene), &scene, 48);
        let mut tracer = PathTracer::new(&gpu, &scene, SIZE, &Settings::default()).unwrap();
        let camera = &scene.cameras[0];
        tracer
            .render(camera, 48, &mut |_| ControlFlow::Continue(()))
            .unwrap();
        let truth = tracer.radiance().unwrap();
        let [found, truth] = [&found, &truth].map(|radiance| mean(radiance));
        println!("{name}: {found:.5} of {truth:.5}");
        assert!((found / truth - 1.0).abs() < bound, "{found} of {truth}");
    }
}

/// Several paths per point in flight, few at a time or all at once: the same bits.
/// A room full of fog with a spot: beside participating-media, which shows fog the light that paths find on surfaces, all light
/// is there. Most of its seconds compile the path tracer for media.
#[test]
fn fog_and_paths_have_the_light_of_the_path_tracer() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = builtin("fog-room", 1).unwrap();
    // Caustics in fog are neither's.
    scene.instances.retain(|instance| {
        let material = &scene.materials[instance.material];
        material.metallic == 0.0
    });
    let names = ["participating-media", INFO.name];
    let mut renderer = Renderer::new(&gpu, &scene, SIZE, &names).unwrap();
    for (name, value) in [("particles", "256"), ("directions", "64")] {
        renderer.set("participating-media", name, value).unwrap();
    }
    let found = mean(&picture(&mut renderer, &scene, 32));
    let mut tracer = PathTracer::new(&gpu, &scene, SIZE, &Settings::default()).unwrap();
    let camera = &scene.cameras[0];
    tracer
        .render(camera, 128, &mut |_| ControlFlow::Continue(()))
        .unwrap();
    let truth = mean(&tracer.radiance().unwrap());
    println!("{found:.5} of {truth:.5}");
    assert!((found / truth - 1.0).abs() < 0.05, "{found} of {truth}");
}

#[test]
fn the_picture_does_not_depend_on_the_memory_of_paths() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("cornell", 1).unwrap();
    let of = |most: Option<u32>| {
        let mut renderer = alone(&gpu, &scene);
        renderer.set(INFO.name, "samples", "3").unwrap();
        let changed = renderer.change(|technique: &mut PathTracing| technique.most_paths = most);
        changed.unwrap();
        picture(&mut renderer, &scene, 2)
    };
    // Blocks of 8 x 8 points, three paths each: 16 of them.
    assert_eq!(of(Some(7 * 192)), of(None));
}

/// Direct light by depth maps leaves the rest; what adds indirect light, too, leaves nothing.
#[test]
fn it_leaves_to_others_what_they_add() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("cornell", 1).unwrap();
    let whole = mean(&picture(&mut alone(&gpu, &scene), &scene, 48));
    let names = ["shadow-map", INFO.name];
    let mut renderer = Renderer::new(&gpu, &scene, SIZE, &names).unwrap();
    renderer.set("shadow-map", "area-samples", "64").unwrap();
    let shared = mean(&picture(&mut renderer, &scene, 48));
    assert!((shared / whole - 1.0).abs() < 0.03, "{shared} of {whole}");
    let names = ["shadow-map", "final-gather", INFO.name];
    let refused = Renderer::new(&gpu, &scene, SIZE, &names);
    assert!(
        matches!(refused, Err(LightingError::Overlap { .. })),
        "both add indirect light"
    );
}

/// A pane of alpha 0.5 is seen with the probability that the eye sees it, not with its square.
#[test]
fn what_the_eye_sees_through_alpha_is_lit_once() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = builtin("cornell", 1).unwrap();
    for material in &mut scene.materials {
        if material.emissive == Vec3::ZERO {
            material.alpha_mode = AlphaMode::Blend;
            material.base_color.w = 0.5;
        }
    }
    let found = mean(&picture(&mut alone(&gpu, &scene), &scene, 64));
    let mut tracer = PathTracer::new(&gpu, &scene, SIZE, &Settings::default()).unwrap();
    tracer
        .render(&scene.cameras[0], 64, &mut |_| ControlFlow::Continue(()))
        .unwrap();
    let truth = mean(&tracer.radiance().unwrap());
    println!("{found:.5} of {truth:.5}");
    assert!((found / truth - 1.0).abs() < 0.04, "{found} of {truth}");
}

/// A picture in strips has the rays and random numbers of the whole one.
#[test]
fn strips_do_not_show() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("cornell", 1).unwrap();
    let mut renderer = alone(&gpu, &scene);
    let whole = picture(&mut renderer, &scene, 2);
    renderer.cut(SIZE, 10 * SIZE[0]).unwrap();
    let strips = picture(&mut renderer, &scene, 2);
    assert!(whole == strips, "strips have other random numbers");
}
