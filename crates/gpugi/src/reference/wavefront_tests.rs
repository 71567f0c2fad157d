//! Compares the wavefront with one kernel that follows each path to its end.

use std::ops::ControlFlow;

use glam::Vec3;
use gpugi_scene::{AlphaMode, Scene, builtin::builtin};

use crate::gpu::{Frame, Gpu, Kernel, KernelOptions, read_buffer};
use crate::paths::gpu::Parameters;
use crate::paths::has_straight;
use crate::reference::{PathTracer, Progress, Settings, TILE_SIDE};
use crate::shader;
use crate::testing::test_gpu;

/// Not a multiple of the block size.
const SIZE: [u32; 2] = [44, 36];
const SAMPLES: u32 = 5;
const SEED: u32 = 7;

/// A scene with glass, alpha and emitters.
fn glass() -> Scene {
    let mut scene = builtin("shapes", 1).unwrap();
    for (index, material) in scene.materials.iter_mut().enumerate() {
        match index % 3 {
            0 => material.transmission = 0.7,
            1 => {
                material.alpha_mode = AlphaMode::Blend;
                material.base_color.w = 0.5;
            }
            _ => material.emissive = Vec3::splat(0.1),
        }
    }
    scene
}

/// A tracer whose pool is refilled many times per batch.
fn tracer(gpu: &Gpu, scene: &Scene, settings: &Settings) -> PathTracer {
    let mut tracer = PathTracer::with_tiles(gpu, scene, SIZE, settings, TILE_SIDE, false).unwrap();
    tracer.restart(SEED).unwrap();
    // The following passes take one sample each. A pass that has begun looks no more.
    tracer.look(&scene.cameras[0]).unwrap();
    tracer.pass.samples = 2;
    assert!(tracer.wavefront.capacity > 700);
    tracer.wavefront.capacity = 700;
    tracer
}

/// The film's eight floats per pixel, among them the mean and the number of rays.
type Film = Vec<[f32; 8]>;

fn film(gpu: &Gpu, buffer: &wgpu::Buffer) -> Film {
    read_buffer(gpu, buffer, u64::from(SIZE[0] * SIZE[1]) * 32).unwrap()
}

/// The film that testing/megakernel.wesl renders of the scene that `tracer` has rendered.
fn expected(gpu: &Gpu, tracer: &PathTracer, constants: &[(&str, f64)]) -> Film {
    let kernel = Kernel::with_options(
        gpu,
        &shader!("testing.megakernel"),
        "main",
        Some(&tracer.scene.ray_layout),
        &KernelOptions {
            constants,
            ..Default::default()
        },
    )
    .unwrap();
    let parameters = Parameters {
        tile_width: SIZE[0],
        tile_height: SIZE[1],
        samples: SAMPLES,
        max_bounces: tracer.settings.max_bounces,
        roulette_after: tracer.settings.roulette_after,
        light_count: tracer.lit.table.rows.len() as u32,
        sky_probability: tracer.lit.table.sky_probability,
        emission_classes: tracer.emission_classes,
        ..bytemuck::Zeroable::zeroed()
    };
    let parameters = gpu.uniform("settings", &parameters).unwrap();
    let words = tracer.settings.filter().unwrap().automaton().words();
    let automaton = gpu.storage("automaton", &words).unwrap();
    let pixels = gpu
        .storage("pixels", &vec![[0.0_f32; 8]; (SIZE[0] * SIZE[1]) as usize])
        .unwrap();
    let own = kernel.bind(
        gpu,
        1,
        &[
            ("seen", tracer.view.as_entire_binding()),
            ("settings", parameters.as_entire_binding()),
            ("automaton", automaton.as_entire_binding()),
            ("pixels", pixels.as_entire_binding()),
        ],
    );
    let own = own.unwrap();
    let mut frame = Frame::new(gpu, false);
    frame.compute("megakernel", |pass| {
        let groups = [
            (0, &tracer.scene.ray_bind_group),
            (1, &own),
            (2, &tracer.wavefront.lights),
        ];
        kernel.dispatch(pass, &groups, [SIZE[0], SIZE[1], 1]);
    });
    frame.submit().unwrap();
    film(gpu, &pixels)
}

#[test]
fn it_renders_what_one_kernel_renders() {
    let Some(gpu) = test_gpu() else { return };
    for (scene, paths, transmission) in [
        (builtin("cornell", 1).unwrap(), "L.*E", 0.0),
        (glass(), "L[DG][DGS]*E", 1.0),
    ] {
        let settings = Settings {
            paths: paths.to_owned(),
            max_bounces: 6,
            ..Default::default()
        };
        let mut tracer = tracer(&gpu, &scene, &settings);
        let mut on = |_: &Progress| ControlFlow::Continue(());
        tracer.render(&scene.cameras[0], SAMPLES, &mut on).unwrap();
        let mut constants = vec![
            ("HAS_TRANSMISSION", transmission),
            ("HAS_STRAIGHT", f64::from(u8::from(has_straight(&scene)))),
            ("HAS_PATH_FILTER", 1.0),
            ("LIGHT_TRACER_HAS_LAMPS", 0.0),
            ("LIGHT_TRACER_MERGES", 0.0),
        ];
        constants.extend(tracer.scene.ray_constants());
        let expected = expected(&gpu, &tracer, &constants);
        assert!(expected.iter().filter(|pixel| pixel[0] > 0.0).count() > 200);
        let found = film(&gpu, &tracer.tiles[0].film);
        for (index, (a, b)) in found.iter().zip(&expected).enumerate() {
            let what = format!("{}, pixel {index}: {a:?}, not {b:?}", scene.name);
            // Sample counts and ray counts.
            assert_eq!(
                [3, 7].map(|at| a[at].to_bits()),
                [3, 7].map(|at| b[at].to_bits()),
                "{what}"
            );
            for channel in 0..3 {
                let close = 1e-5 * b[channel].abs().max(1e-3);
                assert!((a[channel] - b[channel]).abs() <= close, "{what}");
            }
        }
    }
}

#[test]
fn a_picture_that_was_broken_off_goes_on_where_it_was() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("cornell", 1).unwrap();
    let settings = Settings::default();
    let mut whole = tracer(&gpu, &scene, &settings);
    let mut on = |_: &Progress| ControlFlow::Continue(());
    whole.render(&scene.cameras[0], SAMPLES, &mut on).unwrap();
    let mut broken = tracer(&gpu, &scene, &settings);
    // The first pass has room for ten of the 30 blocks.
    broken.wavefront.items = 10 * 64 * 2;
    let mut reports = 0;
    while broken.samples() < SAMPLES {
        let mut once = |progress: &Progress| {
            reports += 1;
            assert!(progress.fraction > 0.0 && progress.fraction <= 1.0);
            ControlFlow::Break(())
        };
        broken
            .render(&scene.cameras[0], SAMPLES, &mut once)
            .unwrap();
    }
    // Three batches in the first pass, two in each of the other passes, and the final report.
    assert_eq!(reports, 3 + 2 * (SAMPLES - 2) + 1);
    assert_eq!(
        film(&gpu, &broken.tiles[0].film),
        film(&gpu, &whole.tiles[0].film)
    );
}
