//! Renderers: strips, threads, and frames that never wait.

use std::time::Instant;

use glam::{Mat4, Vec3};
use gpugi_scene::builtin::builtin;
use gpugi_scene::{Environment, Light, Material};

use super::*;
use crate::techniques::{image_based_lighting, shadow_map};
use crate::testing::test_gpu;

#[test]
fn renderers_may_move_between_threads() {
    fn is_send_and_sync<T: Send + Sync>() {}
    is_send_and_sync::<Renderer>();
    is_send_and_sync::<crate::bake::LightBake>();
    is_send_and_sync::<crate::reference::PathTracer>();
}

/// Shadows, mirrors, glass, light in texels and see-through surfaces alike.
#[test]
fn a_picture_lit_in_strips_has_no_seams() {
    let Some(gpu) = test_gpu() else { return };
    let size = [48, 37];
    let settings = [
        ("shadow-map", "area-samples", "4"),
        ("radiosity", "resolution", "64"),
        ("radiosity", "iterations", "4"),
        ("distance-impostor", "resolution", "32"),
    ];
    let names = ["shadow-map", "radiosity", "distance-impostor"].map(str::to_owned);
    let scene = builtin("glass-room", 1).unwrap();
    let picture = |most_points: u32| {
        let mut renderer = Renderer::new(&gpu, &scene, size, &names).unwrap();
        for (technique, name, value) in settings {
            renderer.set(technique, name, value).unwrap();
        }
        renderer.cut(size, most_points).unwrap();
        let effects = Effects::default();
        for _ in 0..2 {
            renderer
                .render_sample(&scene.cameras[0], 2, Some(&effects), false)
                .unwrap();
        }
        let points = renderer.surface_points().unwrap();
        let picked = renderer.pick([20, 30]).unwrap().wait().unwrap();
        assert_eq!(picked, points[30 * 48 + 20]);
        assert!(picked.is_some());
        (
            renderer.strips.len(),
            renderer.radiance().unwrap(),
            renderer.pixels().unwrap(),
        )
    };
    let (one, whole, shown) = picture(u32::MAX);
    let (several, stripwise, shown_stripwise) = picture(48 * 8);
    assert_eq!((one, several), (1, 5));
    assert_eq!(whole.len(), stripwise.len());
    let far = whole
        .iter()
        .zip(&stripwise)
        .filter(|(a, b)| (*a - *b).abs() > 1e-3 * a.abs().max(0.05));
    // A rasterizer may decide otherwise at a triangle's edge.
    assert!(far.count() <= 3 * 4);
    let differs = shown
        .iter()
        .zip(&shown_stripwise)
        .filter(|(a, b)| a.abs_diff(**b) > 1);
    assert!(differs.count() <= 3 * 4);
    assert!(Renderer::pick(&Renderer::new(&gpu, &scene, size, &names).unwrap(), [48, 0]).is_err());
}

/// A renderer by shadow maps of few lookups.
fn quick(gpu: &Gpu, scene: &Scene, size: [u32; 2]) -> Renderer {
    let names = [shadow_map::INFO.name.to_owned()];
    let mut renderer = Renderer::new(gpu, scene, size, &names).unwrap();
    renderer.set("shadow-map", "area-samples", "4").unwrap();
    renderer.set("shadow-map", "resolution", "64").unwrap();
    renderer
}

/// Frames light a strip each. In between, sums of two and of three samples are means alike.
#[test]
fn strips_that_are_lit_one_per_frame_make_the_same_picture() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("cornell", 1).unwrap();
    let camera = &scene.cameras[0];
    let size = [24, 20];
    let mut whole = quick(&gpu, &scene, size);
    whole.cut(size, 24 * 5).unwrap();
    let mut by_strips = quick(&gpu, &scene, size);
    by_strips.resize_in_strips(size, 24 * 5).unwrap();
    for sample in 1..4 {
        whole.render_sample(camera, 3, None, false).unwrap();
        let mut progress = Vec::new();
        while by_strips.samples() < sample {
            by_strips.try_render_sample(camera, 3, None, false).unwrap();
            gpu.wait().unwrap();
            progress.push(by_strips.progress());
            if sample == 3 && by_strips.progress() == 0.5 {
                let sum = |values: Vec<f32>| values.iter().sum::<f32>();
                let (half, all) = (by_strips.radiance().unwrap(), whole.radiance().unwrap());
                let ratio = sum(half) / sum(all);
                assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
            }
        }
        progress.drain(..progress.len() - 4);
        assert_eq!(progress, [0.25, 0.5, 0.75, 0.0], "{sample}");
        assert!(by_strips.radiance().unwrap() == whole.radiance().unwrap());
    }
    // A picture that waits need not be complete to begin again.
    by_strips.try_render_sample(camera, 4, None, false).unwrap();
    by_strips.restart();
    assert_eq!(by_strips.progress(), 0.0);
    by_strips.render_sample(camera, 1, None, false).unwrap();
    assert_eq!((by_strips.samples(), by_strips.progress()), (1, 0.0));
}

/// Of a larger picture, what is not lit yet shows the small one: the same light, without details.
#[test]
fn a_picture_shows_the_last_one_until_its_strips_are_lit() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("cornell", 1).unwrap();
    let camera = &scene.cameras[0];
    let [small, large] = [[16, 16], [64, 64]];
    let effects = Effects::of_live_view();
    let mut renderer = quick(&gpu, &scene, small);
    renderer
        .render_sample(camera, 8, Some(&effects), false)
        .unwrap();
    let before = renderer.live_radiance().unwrap();
    renderer.resize_in_strips(large, 64 * 16).unwrap();
    let rows = |picture: &[f32], [width, _]: [u32; 2], rows: [u32; 2]| -> f64 {
        let [first, end] = rows.map(|row| (row * width * 3) as usize);
        // But for the lamp.
        let values = picture[first..end].iter();
        let sum: f64 = values.map(|&value| f64::from(value.min(0.5))).sum();
        sum / (end - first) as f64
    };
    let mut shown = Vec::new();
    loop {
        renderer
            .try_render_sample(camera, 8, Some(&effects), false)
            .unwrap();
        shown.push(renderer.live_radiance().unwrap());
        if renderer.samples() == 1 {
            break;
        }
    }
    let mut alone = quick(&gpu, &scene, large);
    alone
        .render_sample(camera, 8, Some(&effects), false)
        .unwrap();
    let fine = alone.live_radiance().unwrap();
    assert_eq!(shown.len(), 4);
    for (lit, shown) in shown.iter().enumerate() {
        for strip in 0..4 {
            let found = rows(shown, large, [16 * strip, 16 * strip + 16]);
            // The last picture counts a little among what is lit: at edges, it differs by its pixels.
            let (expected, most) = match strip as usize > lit {
                true => (rows(&before, small, [4 * strip, 4 * strip + 4]), 0.05),
                false => (rows(&fine, large, [16 * strip, 16 * strip + 16]), 0.15),
            };
            let ratio = found / expected;
            assert!((ratio - 1.0).abs() < most, "{lit} {strip}: {ratio}");
        }
    }
    // At last, it is what it would have been from the start.
    while renderer.samples() < 8 {
        renderer
            .try_render_sample(camera, 8, Some(&effects), false)
            .unwrap();
    }
    for _ in 1..8 {
        alone
            .render_sample(camera, 8, Some(&effects), false)
            .unwrap();
    }
    let (found, expected) = (renderer.pixels().unwrap(), alone.pixels().unwrap());
    let far = found
        .iter()
        .zip(&expected)
        .filter(|(a, b)| a.abs_diff(**b) > 2);
    assert!(far.count() < 3 * 8);
}

/// Through a lens, too, and however often the size changes before a sample is complete.
#[test]
fn what_is_not_lit_yet_is_never_black() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("cornell", 1).unwrap();
    let mut through_lens = scene.cameras[0].clone();
    through_lens.lens.aperture = 0.05;
    let effects = Effects::of_live_view();
    for camera in [&scene.cameras[0], &through_lens] {
        let mut renderer = quick(&gpu, &scene, [16, 16]);
        renderer
            .render_sample(camera, 1, Some(&effects), false)
            .unwrap();
        let bottom = |renderer: &Renderer| {
            let pixels = renderer.pixels().unwrap();
            let rows = &pixels[pixels.len() / 4 * 3..];
            rows.iter().map(|&value| f64::from(value)).sum::<f64>() / rows.len() as f64
        };
        let before = bottom(&renderer);
        for (side, frames) in [(64, 1), (48, 2), (64, 3), (32, 1)] {
            // Two rows each.
            renderer.resize_in_strips([side; 2], 2 * side).unwrap();
            let mut lit = 0;
            // Shaders may be compiling.
            while lit < frames {
                renderer
                    .try_render_sample(camera, 8, Some(&effects), false)
                    .unwrap();
                lit += u32::from(renderer.lit_points() > 0);
            }
            assert_eq!(renderer.samples(), 0);
            let ratio = bottom(&renderer) / before;
            // The border is enlarged several times.
            assert!((ratio - 1.0).abs() < 0.25, "{side}: {ratio}");
            renderer.restart();
        }
    }
}

#[test]
fn frames_that_never_wait_come_to_the_same_picture() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("spheres", 1).unwrap();
    let camera = &scene.cameras[0];
    let names = [shadow_map::INFO.name, image_based_lighting::INFO.name].map(str::to_owned);
    let mut blocking = Renderer::new(&gpu, &scene, [16, 16], &names).unwrap();
    blocking.render_sample(camera, 1, None, false).unwrap();
    let mut live = Renderer::new(&gpu, &scene, [16, 16], &names).unwrap();
    let mut waited = 0;
    while live.samples() == 0 {
        let (readiness, _) = live.try_render_sample(camera, 1, None, false).unwrap();
        waited += u32::from(!readiness.is_usable());
    }
    assert!(waited > 0, "an environment's domains take a frame at least");
    assert_eq!(live.radiance().unwrap(), blocking.radiance().unwrap());
    live.resize([24, 8]).unwrap();
    assert!(!live.is_compiling(), "another size needs no other shaders");
    live.render_sample(camera, 1, None, false).unwrap();
    assert_eq!(live.radiance().unwrap().len(), 24 * 8 * 3);
}

/// Techniques make shaders when they need them: other ones for other scenes and settings. The picture before stays until
/// they are compiled.
#[test]
fn frames_that_never_wait_wait_for_no_shaders() {
    let Some(gpu) = test_gpu() else { return };
    // A frame that may wait tells for what.
    let waiting = gpu.as_in_a_browser();
    let scene = builtin("cornell", 1).unwrap();
    let names = [shadow_map::INFO.name.to_owned()];
    let mut blocking = Renderer::new(&waiting, &scene, [8, 8], &names).unwrap();
    blocking
        .render_sample(&scene.cameras[0], 1, None, false)
        .unwrap();
    assert_ne!(waiting.waited_for(), [""; 0]);
    let sets = [
        (
            "glass-room",
            "shadow-map caustics final-gather distance-impostor",
            "final-gather.solid-angle=quad",
        ),
        ("cornell", "shadow-map radiosity", "radiosity.mode=shooting"),
        (
            "cornell",
            "shadow-map obscurances",
            "obscurances.mode=peeling",
        ),
        ("cornell", "shadow-map light-path-map", ""),
        ("spheres", "shadow-map radiance-transfer", ""),
        (
            "spheres",
            "image-based-lighting environment-map",
            "image-based-lighting.reflectivity=ratio",
        ),
        (
            "ornaments",
            "environment-map ray-tracing",
            "ray-tracing.tracer=cones",
        ),
        (
            "cloud",
            "shadow-map participating-media",
            "participating-media.visibility=peel",
        ),
    ];
    for (scene, names, setting) in sets {
        let gpu = gpu.as_in_a_browser();
        let scene = builtin(scene, 1).unwrap();
        let names: Vec<String> = names.split(' ').map(str::to_owned).collect();
        let mut renderer = Renderer::new(&gpu, &scene, [8, 8], &names).unwrap();
        for name in &names {
            for resolution in ["32", "64", "256"] {
                if renderer.set(name, "resolution", resolution).is_ok() {
                    break;
                }
            }
            // Small cubes, where a technique has some: they decide how long its maps take.
            renderer.set(name, "cube-resolution", "16").ok();
        }
        renderer.set_budget(Budget::units(200_000));
        let mut settings = vec![setting];
        loop {
            let began = Instant::now();
            while renderer.samples() < 4 {
                // A busy machine must not fail.
                assert!(began.elapsed().as_secs() < 600, "{names:?}");
                let camera = &scene.cameras[0];
                renderer.try_render_sample(camera, 4, None, false).unwrap();
                gpu.wait().unwrap();
            }
            assert_eq!(gpu.waited_for(), [""; 0], "{names:?}");
            let Some((path, value)) = settings.pop().and_then(|setting| setting.split_once('='))
            else {
                break;
            };
            let (technique, name) = path.split_once('.').unwrap();
            renderer.set(technique, name, value).unwrap();
            renderer.restart();
        }
    }
}

/// Edits that are refused change nothing: neither the picture, nor the maps, nor what later edits start from.
#[test]
fn refused_edits_change_nothing() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = builtin("glass-room", 1).unwrap();
    scene.lights.truncate(1);
    scene.lights[0].kind = LightKind::Point;
    let camera = scene.cameras[0].clone();
    let names = ["shadow-map", "radiance-transfer"].map(str::to_owned);
    let settings = [
        ("shadow-map", "resolution", "64"),
        ("shadow-map", "area-samples", "4"),
        ("shadow-map", "area-resolution", "32"),
        ("radiance-transfer", "resolution", "64"),
        ("radiance-transfer", "rays", "4"),
        ("radiance-transfer", "directional-lights", "true"),
    ];
    let new = |scene: &Scene| {
        let mut renderer = Renderer::new(&gpu, scene, [16, 12], &names).unwrap();
        for (technique, name, value) in settings {
            renderer.set(technique, name, value).unwrap();
        }
        renderer
    };
    let picture = |renderer: &mut Renderer| {
        renderer.forget();
        let go_on = |_, _| ControlFlow::Continue(());
        renderer.converge(&camera, false, go_on).unwrap();
        renderer.render_sample(&camera, 1, None, false).unwrap();
        renderer.radiance().unwrap()
    };
    let material = |change: fn(&mut Material)| {
        let mut material = Box::new(scene.materials[0].clone());
        change(&mut material);
        Edit::Material { index: 0, material }
    };
    let mut mesh = scene.meshes[0].as_ref().clone();
    mesh.positions.iter_mut().for_each(|at| *at *= 0.9);
    let mesh = mesh.into();
    let place = |index: usize| Edit::Instance {
        index,
        world_from_mesh: Mat4::from_translation(Vec3::Y) * scene.instances[index].world_from_mesh,
    };
    let light = |kind: LightKind| Light {
        kind,
        intensity: scene.lights[0].intensity * 0.5,
        ..scene.lights[0].clone()
    };
    // Both techniques would add the light of a sun.
    let sun = Edit::Light {
        index: 0,
        light: light(LightKind::Directional),
    };
    let refused = [
        vec![sun.clone()],
        vec![Edit::Lights(vec![light(LightKind::Directional); 2])],
        // All that is edited in place, one instance twice.
        vec![
            place(0),
            material(|material| (material.roughness, material.emissive) = (0.2, Vec3::ONE)),
            Edit::Mesh { index: 0, mesh },
            place(1),
            place(0),
            sun.clone(),
        ],
        // What takes an upload.
        vec![
            place(1),
            material(|material| material.transmission = 1.0),
            sun,
        ],
    ];
    let mut renderer = new(&scene);
    let before = picture(&mut renderer);
    let versions = renderer.scene().versions;
    let is_as_before = |renderer: &mut Renderer, refused: &LightingError| {
        assert_eq!(renderer.scene().versions, versions, "{refused}");
        assert_eq!(renderer.samples(), 1, "{refused}");
        assert!(picture(renderer) == before, "{refused}");
    };
    for edits in refused {
        let refused = renderer.edit(&edits).unwrap_err();
        assert!(matches!(refused, LightingError::Overlap { .. }));
        is_as_before(&mut renderer, &refused);
    }
    let point = |index: usize| Edit::Light {
        index,
        light: light(LightKind::Point),
    };
    // What there is not, or no longer.
    let input = [
        vec![place(0), Edit::Environment(Environment::default_sky())],
        vec![place(0), point(1)],
        vec![Edit::Lights(Vec::new()), point(0)],
    ];
    for edits in input {
        let refused = renderer.edit(&edits).unwrap_err();
        assert!(matches!(
            refused,
            LightingError::Gpu(GpuError::Input { .. })
        ));
        is_as_before(&mut renderer, &refused);
    }
    let edits = [
        place(1),
        material(|material| material.roughness = 0.3),
        point(0),
    ];
    renderer.edit(&edits).unwrap();
    let mut edited = scene.clone();
    edits.iter().for_each(|edit| edit.apply_to(&mut edited));
    let after = picture(&mut renderer);
    assert!(after != before);
    assert!(after == picture(&mut new(&edited)));
}

/// Mirrors, and nothing else, say how far away is what they show; it lies in the room. What is no mirror any more says no
/// more.
#[test]
fn mirrors_say_how_far_away_their_images_are() {
    let Some(gpu) = test_gpu() else { return };
    let size = [48, 36];
    let mut scene = builtin("room", 1).unwrap();
    let names = ["shadow-map", "distance-impostor"];
    let mut renderer = Renderer::new(&gpu, &scene, size, &names).unwrap();
    renderer
        .set("distance-impostor", "resolution", "32")
        .unwrap();
    let camera = scene.cameras[0].clone();
    let is_ball = |instance: &gpugi_scene::Instance| instance.name.as_str() == "sphere";
    let ball = scene.instances.iter().position(is_ball).unwrap();
    let (low, high) = (scene.bounds().min - 0.1, scene.bounds().max + 0.1);
    let eye = camera.world_from_view.w_axis.truncate();
    let told = |renderer: &mut Renderer| {
        renderer.restart();
        renderer.render_sample(&camera, 1, None, false).unwrap();
        let receiver = &renderer.strips[0].receiver;
        let count = u64::from(size[0] * size[1]);
        let distances: Vec<f32> = read_buffer(&gpu, &receiver.target.mirrored, count * 4).unwrap();
        let points = &receiver.points.points;
        let points: Vec<u32> = read_buffer(&gpu, points, count * SURFACE_POINT_BYTES).unwrap();
        let points = points.chunks_exact(12).map(VisiblePoint::unpack);
        let mut told = [0; 2];
        for (distance, point) in distances.into_iter().zip(points) {
            let point = point.filter(|point| point.instance as usize == ball);
            let Some(point) = point.filter(|_| distance > 0.0) else {
                assert_eq!(distance, 0.0, "no mirror");
                continue;
            };
            told[0] += 1;
            // The room is open toward the camera.
            if distance > 100.0 {
                continue;
            }
            let ray = (point.position - eye).normalize();
            let normal = point.normal;
            let image = point.position + distance * (ray - 2.0 * ray.dot(normal) * normal);
            assert!(image.cmpgt(low).all() && image.cmplt(high).all(), "{image}");
            told[1] += 1;
        }
        told
    };
    let [all, in_room] = told(&mut renderer);
    assert!(in_room > 20 && in_room * 2 > all, "{in_room} of {all}");
    let material = scene.instances[ball].material;
    scene.materials[material].roughness = 0.5;
    renderer.update(&scene).unwrap();
    assert_eq!(told(&mut renderer), [0; 2]);
}
