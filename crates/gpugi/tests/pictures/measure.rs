//! Tests of measuring: the error is that of the two pictures, the reference holds the right light, and the cache is
//! trusted exactly where it may be.

use std::sync::Arc;

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::common::{floor, from_above, gpu, place};
use glam::Vec3;
use gpugi::Renderer;
use gpugi::gpu::Gpu;
use gpugi::light_paths::{LightClass, Part};
use gpugi::measure::{
    Cache, MeasureError, Measured, Options, Progress, Quality, Subject, Truth, measure, trace,
};
use gpugi_scene::builtin::shapes::{cuboid, quad};
use gpugi_scene::image::metrics::{Metric, Picture, compare};
use gpugi_scene::{Camera, Environment, Image, Light, LightKind, Material, Pixels, Scene};

const SIZE: u32 = 24;

/// A box on a floor under a point light, a lamp and a grey sky.
fn scene() -> Scene {
    let mut scene = floor(2.0);
    let block = cuboid(Vec3::new(-0.4, 0.0, -0.4), Vec3::new(0.4, 0.6, 0.4), 1);
    place(
        &mut scene,
        block,
        Material::matt("red", Vec3::new(0.7, 0.2, 0.1)),
    );
    let lamp = quad(Vec3::new(1.0, 1.5, 0.5), Vec3::X * 0.5, Vec3::Z * 0.5, 1);
    place(
        &mut scene,
        lamp,
        Material::emitter("lamp", Vec3::splat(6.0)),
    );
    let mut light = Light::new("bulb", LightKind::Point, Vec3::new(3.0, 4.0, 5.0));
    light.world_from_light.w_axis = Vec3::new(-1.2, 1.5, 0.3).extend(1.0);
    scene.lights.push(light);
    scene.environment = Some(Environment {
        image: Arc::new(Image {
            name: "grey".into(),
            width: 4,
            height: 2,
            pixels: Pixels::Rgba32Float([0.2, 0.3, 0.4, 1.0].repeat(8)),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    });
    scene.cameras.push(from_above(3.0, 4.0));
    scene
}

/// An empty folder for one test.
fn folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"))
        .join("measure")
        .join(name);
    std::fs::remove_dir_all(&folder).ok();
    folder
}

fn go_on(_: &Progress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

fn part(classes: &[LightClass], pattern: &str) -> Part {
    Part {
        classes: classes.to_vec(),
        pattern: pattern.to_owned(),
    }
}

/// Options for a reference of few samples, with or without a cache.
fn options(samples: u32, cache: Option<&Path>) -> Options {
    Options {
        samples: 16,
        reference: Quality {
            samples,
            noise: 0.0,
        },
        cache: cache.map(Cache::new),
        ..Options::default()
    }
}

fn measured(gpu: &Gpu, scene: &Scene, names: &[&str], options: &Options) -> Measured {
    let names: Vec<String> = names.iter().map(ToString::to_string).collect();
    let mut renderer = Renderer::new(gpu, scene, [SIZE; 2], &names).expect("a renderer");
    let camera = &scene.cameras[0];
    measure(gpu, scene, camera, &mut renderer, options, &mut go_on).expect("a measurement")
}

fn traced(gpu: &Gpu, scene: &Scene, camera: &Camera, parts: &[Part], options: &Options) -> Truth {
    let subject = Subject {
        scene,
        camera,
        size: [SIZE; 2],
    };
    trace(gpu, &subject, parts, options, &mut go_on).expect("a reference")
}

fn picture(radiance: &[f32]) -> Picture {
    Picture::of_radiance(SIZE, SIZE, radiance.to_vec()).expect("a picture")
}

fn rel_mse(test: &[f32], reference: &[f32]) -> f64 {
    let comparison = compare(Metric::RelMse, &picture(test), &picture(reference));
    comparison.expect("pictures of one size").value
}

#[test]
fn shadow_map_is_near_the_truth_and_the_error_is_that_of_the_pictures() {
    let Some(gpu) = gpu() else { return };
    let scene = scene();
    let found = measured(&gpu, &scene, &["shadow-map"], &options(256, None));
    let error = found.value(Metric::RelMse).expect("rel-mse");
    assert!(error < 8e-4, "{error}");
    assert_eq!(found.metrics.len(), Metric::ALL.len());
    for (metric, comparison) in &found.metrics {
        let again = compare(
            *metric,
            &picture(&found.radiance),
            &picture(&found.truth.radiance),
        );
        assert_eq!(again.as_ref(), Ok(comparison), "{}", metric.name());
    }
    // Without the technique's light, but with what is seen directly, the picture is far off; also if one light is
    // missing.
    let dark = measured(&gpu, &scene, &["environment-map"], &options(16, None));
    let without = rel_mse(&dark.radiance, &found.truth.radiance);
    assert!(without > 100.0 * error, "{without} without, {error} with");
    let mut unlit = scene.clone();
    unlit.lights.clear();
    let one_less = measured(&gpu, &unlit, &["shadow-map"], &options(16, None));
    let without = rel_mse(&one_less.radiance, &found.truth.radiance);
    assert!(without > 100.0 * error, "{without} without, {error} with");

    // The sky is visible and gives no light: that is the second part of the reference.
    use LightClass::{Area, Environment, Punctual};
    let parts: Vec<_> = found
        .truth
        .parts
        .iter()
        .map(|traced| &traced.part)
        .collect();
    assert_eq!(
        parts,
        [
            &part(&[Punctual, Area], "LE|L[DG]E"),
            &part(&[Environment], "LE")
        ]
    );
    let bounces: Vec<u32> = found
        .truth
        .parts
        .iter()
        .map(|traced| traced.max_bounces)
        .collect();
    assert_eq!(bounces, [1, 0]);
    assert!(found.memory.scene > 0 && found.memory.picture >= u64::from(SIZE * SIZE) * 64);
    assert!(found.memory.maps >= 1 << 20, "{:?}", found.memory);
    if gpu.has_timestamps {
        let ran = |pass: &str| {
            found
                .passes
                .iter()
                .find(|time| time.pass == pass)
                .map(|time| time.ran)
        };
        assert_eq!(ran("shadow-map.generate"), Some(1));
        assert_eq!(ran("shadow-map.gather"), Some(16));
    }
}

#[test]
fn the_parts_sum_to_the_whole() {
    let Some(gpu) = gpu() else { return };
    let scene = scene();
    let camera = &scene.cameras[0];
    let options = options(256, None);
    let whole = part(&LightClass::ALL, "LE|L[DG]E");
    let whole = traced(&gpu, &scene, camera, &[whole], &options);
    let by_class = LightClass::ALL.map(|class| part(&[class], "LE|L[DG]E"));
    let by_path = ["LE", "LDE", "LGE"].map(|pattern| part(&LightClass::ALL, pattern));
    for parts in [&by_class, &by_path] {
        let sum = traced(&gpu, &scene, camera, parts, &options);
        let error = rel_mse(&sum.radiance, &whole.radiance);
        let noise = sum.rel_mse() + whole.rel_mse();
        assert!(error < 2.0 * noise, "{error} of {noise}: {parts:?}");
    }
    // Neither check would hold with one part missing.
    let less = traced(&gpu, &scene, camera, &by_class[..2], &options);
    let missing = rel_mse(&less.radiance, &whole.radiance);
    assert!(missing > 100.0 * whole.rel_mse(), "{missing}");
}

#[test]
fn the_estimated_noise_is_that_of_another_seed() {
    let Some(gpu) = gpu() else { return };
    let scene = scene();
    let parts = [part(&LightClass::ALL, "LE|L[DG]E")];
    let first = traced(&gpu, &scene, &scene.cameras[0], &parts, &options(64, None));
    let other = Options {
        seed: 1,
        ..options(64, None)
    };
    let second = traced(&gpu, &scene, &scene.cameras[0], &parts, &other);
    // The difference between two pictures has the noise of both.
    let between = rel_mse(&first.radiance, &second.radiance) / 2.0;
    let estimate = first.rel_mse();
    assert!(
        between > 0.0 && between < 1.2 * estimate,
        "{between} of {estimate}"
    );
    assert!(between > 0.05 * estimate, "{between} of {estimate}");
}

#[test]
fn a_reference_is_rendered_once_and_again_when_something_changed() {
    let Some(gpu) = gpu() else { return };
    let scene = scene();
    let camera = scene.cameras[0].clone();
    let folder = folder("hits");
    let kept = options(64, Some(&folder));
    let parts = [part(&LightClass::ALL, "L[DG]E")];
    let started = Instant::now();
    let first = traced(&gpu, &scene, &camera, &parts, &kept);
    let cold = started.elapsed();
    assert!(!first.is_cached());
    let started = Instant::now();
    let second = traced(&gpu, &scene, &camera, &parts, &kept);
    let warm = started.elapsed();
    assert!(second.is_cached() && second.notes.is_empty());
    assert_eq!(second.radiance, first.radiance);
    assert_eq!(second.rel_mse(), first.rel_mse());
    assert!(warm * 4 < cold, "{warm:?} after {cold:?}");

    let mut renamed = scene.clone();
    Arc::make_mut(&mut renamed.meshes[0]).name = "other".into();
    assert!(traced(&gpu, &renamed, &camera, &parts, &kept).is_cached());

    let mut changed = scene.clone();
    changed.materials[0].base_color.x = 0.9;
    let miss = traced(&gpu, &changed, &camera, &parts, &kept);
    assert!(!miss.is_cached() && miss.radiance != first.radiance);
    let mut moved = camera.clone();
    moved.world_from_view.w_axis.x += 0.1;
    assert!(!traced(&gpu, &scene, &moved, &parts, &kept).is_cached());
}

/// The only file in a folder.
fn only_file(folder: &Path) -> PathBuf {
    let files: Vec<_> = std::fs::read_dir(folder)
        .expect("a folder")
        .map(|entry| entry.expect("an entry").path())
        .collect();
    assert_eq!(files.len(), 1, "{files:?}");
    files[0].clone()
}

#[test]
fn a_damaged_file_is_named_and_rendered_anew() {
    let Some(gpu) = gpu() else { return };
    let scene = scene();
    let folder = folder("damage");
    let kept = options(16, Some(&folder));
    let parts = [part(&[LightClass::Punctual], "LDE")];
    let read = || traced(&gpu, &scene, &scene.cameras[0], &parts, &kept);
    let right = read();
    let path = only_file(&folder);
    let mut bytes = std::fs::read(&path).expect("the file");
    let last = bytes.len() - 1;
    bytes[last] ^= 4;
    std::fs::write(&path, bytes).expect("the damage");
    let anew = read();
    assert!(!anew.is_cached());
    let note = anew.notes.join("; ");
    assert!(note.contains(&path.display().to_string()), "{note}");
    assert_eq!(anew.radiance, right.radiance);
    assert!(read().is_cached(), "not replaced");

    // A cache that cannot be written only adds a note.
    let nowhere = options(16, Some(&path));
    let without = traced(&gpu, &scene, &scene.cameras[0], &parts, &nowhere);
    assert_eq!(without.radiance, right.radiance);
    assert!(
        without.notes.iter().any(|note| note.contains("not kept")),
        "{:?}",
        without.notes
    );
}

#[test]
fn noise_ends_a_reference_early_and_is_named_where_it_remains() {
    let Some(gpu) = gpu() else { return };
    let scene = scene();
    let parts = [part(&LightClass::ALL, "L[DG]E")];
    let until = |samples, noise| {
        let options = Options {
            reference: Quality { samples, noise },
            ..options(16, None)
        };
        traced(&gpu, &scene, &scene.cameras[0], &parts, &options)
    };
    let early = until(100_000, 5e-3);
    assert!(early.parts[0].samples < 10_000, "{:?}", early.parts);
    assert!(early.rel_mse() <= 5e-3 && early.notes.is_empty());
    let late = until(16, 1e-9);
    assert_eq!(late.parts[0].samples, 16);
    assert!(late.notes.iter().any(|note| note.contains("estimated")));

    let noisy = measured(&gpu, &scene, &["shadow-map"], &options(16, None));
    assert!(noisy.notes.iter().any(|note| note.contains("more samples")));
}

#[test]
fn an_unlit_scene_is_black_and_exact() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(1.0);
    scene.cameras.push(from_above(3.0, 4.0));
    let found = measured(&gpu, &scene, &["shadow-map"], &options(16, None));
    assert!(found.truth.parts.is_empty());
    assert_eq!(found.value(Metric::RelMse), Some(0.0));
}

#[test]
fn broken_off_it_measures_and_keeps_nothing() {
    let Some(gpu) = gpu() else { return };
    let scene = scene();
    let folder = folder("broken");
    let names = ["shadow-map".to_owned()];
    for stage in ["shadow-map", "path tracer"] {
        let mut renderer = Renderer::new(&gpu, &scene, [SIZE; 2], &names).expect("a renderer");
        let result = measure(
            &gpu,
            &scene,
            &scene.cameras[0],
            &mut renderer,
            &options(64, Some(&folder)),
            &mut |progress| {
                assert!((0.0..=1.0).contains(&progress.fraction), "{progress:?}");
                if progress.stage.starts_with(stage) {
                    ControlFlow::Break(())
                } else {
                    ControlFlow::Continue(())
                }
            },
        );
        assert!(matches!(result, Err(MeasureError::Interrupted)), "{stage}");
    }
    assert!(!folder.exists(), "a part of a reference is kept");
}
