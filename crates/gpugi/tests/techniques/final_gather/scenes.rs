//! Scenes against the path tracer, on the technique's own light paths; changes of scenes.

use std::time::{Duration, Instant};

use glam::vec3;
use gpugi::light_paths::{LightClass, LightPaths, overlap};
use gpugi::{LightingError, Readiness, Renderer};
use gpugi_scene::builtin::builtin;
use gpugi_scene::{Camera, Scene};

use crate::common::{gpu, measured, rel_mse, renderer_of};

/// A grid of reference points; alone, it also adds the direct light of the lamp.
#[test]
fn the_cornell_box_is_the_path_tracers() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin("cornell", 1).expect("a scene");
    // Everything but the lamp, whose edges would be most of the error.
    let camera = &Camera::look_at("", vec3(0.0, 2.73, 8.0), vec3(0.0, 2.4, 0.0), 0.5);
    for (techniques, settings, bound) in [
        (&["shadow-map", "final-gather"][..], &[][..], 0.002),
        (&["shadow-map", "final-gather"], &["blend=drawn"], 0.002),
        (&["shadow-map", "final-gather"], &["visibility=none"], 0.002),
        (&["final-gather"], &[], 0.02),
    ] {
        let settings = [&["resolution=32"], settings].concat();
        let mut renderer = renderer_of(&gpu, &scene, techniques, 32, "final-gather", &settings);
        let found = measured(&gpu, &scene, camera, &mut renderer, [4, 256]);
        let error = rel_mse(&found);
        println!("{techniques:?} {settings:?}: rel-mse {error:.1e}");
        assert!(error < bound, "{techniques:?} {settings:?}: {error}");
    }
}

/// A hall with columns, textures and stairs, whole.
#[test]
fn the_chamber_is_the_path_tracers() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin("chamber", 1).expect("a scene");
    let camera = &scene.cameras[0];
    let of = "final-gather";
    let mut renderer = renderer_of(&gpu, &scene, &["shadow-map", of], 32, of, &[]);
    let found = measured(&gpu, &scene, camera, &mut renderer, [4, 512]);
    let error = rel_mse(&found);
    println!("rel-mse {error:.1e}");
    assert!(error < 0.02, "{error}");
}

#[test]
fn paths_are_what_others_leave_over() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin("cornell", 1).expect("a scene");
    let adds = |renderer: &Renderer, path| {
        let path = LightPaths::new(LightClass::Area, path);
        overlap(renderer.light_paths_of("final-gather"), &[path]).is_some()
    };
    let of = |techniques: &[&str], settings: &[&str]| {
        let renderer = renderer_of(&gpu, &scene, techniques, 8, "final-gather", settings);
        ["LDE", "LDDE", "LDDDE", "LDGE", "LGDE"].map(|path| adds(&renderer, path))
    };
    assert_eq!(of(&["final-gather"], &[]), [true, true, true, false, false]);
    let both = ["shadow-map", "final-gather"];
    assert_eq!(of(&both, &[]), [false, true, true, false, false]);
    assert_eq!(
        of(&both, &["bounces=0"]),
        [false, true, false, false, false]
    );
    assert_eq!(of(&both, &["glossy=true"]), [false, true, true, true, true]);
}

/// Radiosity lights the still world and final-gather one object in it: together they have all indirect light.
#[test]
fn radiosity_leaves_claimed_objects_alone() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin("cornell", 1).expect("a scene");
    let camera = &scene.cameras[0];
    let techniques = ["shadow-map", "radiosity", "final-gather"];
    let names = techniques.map(str::to_owned);
    let mut renderer = Renderer::new(&gpu, &scene, [40, 40], &names).expect("a renderer");
    // Both would light everything.
    let set = renderer.set("final-gather", "reference-points", "grid");
    assert!(matches!(set, Err(LightingError::Overlap { .. })), "{set:?}");
    let set = renderer.set("final-gather", "objects", "short block");
    set.expect("a setting");
    for (name, value) in [("resolution", "64"), ("iterations", "16"), ("steps", "16")] {
        let set = renderer.set("radiosity", name, value);
        set.expect("a setting");
    }
    let found = measured(&gpu, &scene, camera, &mut renderer, [4, 256]);
    let error = rel_mse(&found);
    println!("rel-mse {error:.1e}");
    assert!(error < 0.005, "{error}");
}

/// What is lit differently is followed, by a few faces per frame, until nothing changes any more.
#[test]
fn changes_of_the_scene_are_followed() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin("cornell", 1).expect("a scene");
    let camera = scene.cameras[0].clone();
    let techniques = ["shadow-map", "final-gather"];
    let picture = |renderer: &mut Renderer, frames: u32| -> Vec<f32> {
        for _ in 0..frames {
            renderer.restart();
            let sample = renderer.render_sample(&camera, 1, None, false);
            sample.expect("a picture");
        }
        renderer.radiance().expect("radiance")
    };
    for more in [
        // Some reference points per frame, then some faces of one of them, then objects.
        &["density=0.5", "faces-per-frame=24"],
        &["density=0.3", "faces-per-frame=4"],
        &["reference-points=objects", "objects=* block"],
    ] {
        let settings = [&["resolution=16", "bounces=8"], &more[..]].concat();
        let mut scene = scene.clone();
        let mut kept = renderer_of(&gpu, &scene, &techniques, 24, "final-gather", &settings);
        let before = picture(&mut kept, 1);
        let light = scene.instances[5].material;
        scene.materials[light].emissive = vec3(2.0, 9.0, 2.0);
        scene.instances[7].world_from_mesh.w_axis.x += 1.0;
        kept.update(&scene).expect("an update");
        // At most 30, if what the GPU tells, such as where points are to be moved, arrives before the next one. Frames that
        // wait for shaders do not count: a fast GPU makes hundreds of them.
        let mut frames = 0..60;
        let began = Instant::now();
        let is_final = |renderer: &mut Renderer| {
            loop {
                renderer.restart();
                let sample = renderer.try_render_sample(&camera, 1, None, false);
                gpu.wait().expect("a GPU");
                match sample.expect("a frame").0 {
                    Readiness::Pending {
                        what: "shaders", ..
                    } if began.elapsed() < Duration::from_secs(60) => {
                        std::thread::sleep(Duration::from_millis(1));
                    }
                    readiness => return readiness == Readiness::Ready,
                }
            }
        };
        assert!(frames.any(|_| is_final(&mut kept)), "{more:?}: not in time");
        println!("{} frames", frames.start);
        let found = picture(&mut kept, 1);
        let mut fresh = renderer_of(&gpu, &scene, &techniques, 24, "final-gather", &settings);
        let fresh = picture(&mut fresh, 1);
        let error = |a: &[f32], b: &[f32]| {
            let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2));
            squares.sum::<f32>() / b.iter().map(|b| b.powi(2)).sum::<f32>()
        };
        let (off, moved) = (error(&found, &fresh), error(&before, &fresh));
        println!("{more:?}: off {off:.1e}, from before {moved:.1e}");
        assert!(off < 1e-5 && moved > 0.01, "{more:?}: {off}, {moved}");
    }
}

/// Lights that change or move light what was captured before; surfaces that move are captured again.
#[test]
fn changed_lights_capture_nothing_again() {
    let Some(gpu) = gpu() else { return };
    if !gpu.has_timestamps {
        eprintln!("skipped: this adapter cannot time passes");
        return;
    }
    let mut scene = builtin("room", 1).expect("a scene");
    let camera = scene.cameras[0].clone();
    let settings = ["resolution=16", "density=0.5", "faces-per-frame=24"];
    let mut renderer = renderer_of(
        &gpu,
        &scene,
        &["shadow-map", "final-gather"],
        8,
        "final-gather",
        &settings,
    );
    // Captures of the reference points in eight frames, beside the camera's own.
    let mut captures = |scene: &Scene| {
        renderer.update(scene).expect("an update");
        let mut count = 0;
        for _ in 0..8 {
            renderer.restart();
            let timings = renderer.render_sample(&camera, 1, None, true);
            let timings = timings.expect("a picture").wait().expect("times");
            let is_capture = |pass: &&str| *pass == "capture.hits";
            let passes = timings.iter().map(|timing| timing.pass.as_str());
            count += passes.filter(is_capture).count() - 1;
        }
        (count, renderer.radiance().expect("radiance"))
    };
    let (first, before) = captures(&scene);
    assert!(first >= 8, "{first}");
    scene.lights[0].intensity *= vec3(0.2, 1.0, 3.0);
    scene.lights[1].world_from_light.w_axis.x += 1.0;
    let (relit, after) = captures(&scene);
    assert_eq!(relit, 0);
    assert_ne!(before, after);
    scene.instances[6].world_from_mesh.w_axis.x -= 0.3;
    let (moved, _) = captures(&scene);
    assert!(moved >= 8, "{moved}");
}
