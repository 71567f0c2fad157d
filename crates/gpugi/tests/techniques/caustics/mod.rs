//! caustics compared with the path tracer, and in scenes where the result can only be plausible.

use std::ops::ControlFlow;

use crate::common::{floor, gpu, measured};
use glam::{Mat4, Vec3, vec3};
use gpugi::Renderer;
use gpugi::capture::VisiblePoint;
use gpugi::gpu::Gpu;
use gpugi::light_paths::{LightClass, LightPaths, overlap};
use gpugi_scene::builtin::shapes::{quad, sphere};
use gpugi_scene::{Camera, Light, LightKind, Material, Medium, Mesh, PhaseFunction, Scene, Volume};

fn glass(ior: f32) -> Material {
    Material {
        name: "glass".into(),
        transmission: 1.0,
        roughness: 0.0,
        ior,
        volume: Some(Volume {
            attenuation_distance: 1.0,
            attenuation_color: vec3(0.9, 0.8, 0.5),
        }),
        ..Material::default()
    }
}

fn mirror() -> Material {
    Material::metal("mirror", Vec3::splat(0.9), 0.0)
}

fn add(scene: &mut Scene, mesh: Mesh, material: Material, at: Vec3) {
    let mesh = scene.add_mesh(mesh);
    let material = scene.add_material(material);
    scene.add_instance("object", mesh, material, Mat4::from_translation(at));
}

/// A floor, a ball above it, and a square lamp above that.
fn ball_under_lamp(ball: Material, side: f32) -> Scene {
    let mut scene = floor(2.0);
    let corner = vec3(0.2, 2.0, 0.0) - vec3(side, 0.0, side) / 2.0;
    let lamp = quad(corner, Vec3::X * side, Vec3::Z * side, 1);
    assert!(lamp.normals[0].y < 0.0);
    let shining = Material::emitter("lamp", Vec3::splat(20.0));
    crate::common::place(&mut scene, lamp, shining);
    add(&mut scene, sphere(0.4, 64), ball, vec3(0.0, 0.6, 0.0));
    scene
}

fn camera() -> Camera {
    Camera::look_at("", vec3(0.0, 1.8, 2.6), Vec3::ZERO, 0.8)
}

fn renderer(gpu: &Gpu, scene: &Scene, techniques: &[&str], size: u32) -> Renderer {
    let names: Vec<String> = techniques.iter().map(|&name| name.to_owned()).collect();
    let mut renderer = Renderer::new(gpu, scene, [size, size], &names).expect("a renderer");
    for (technique, name, value) in [
        ("caustics", "resolution", "64"),
        ("caustics", "cube-resolution", "128"),
        ("caustics", "shape-resolution", "128"),
        ("distance-impostor", "resolution", "128"),
        ("distance-impostor", "shape-resolution", "128"),
    ] {
        if techniques.contains(&technique) {
            renderer.set(technique, name, value).expect("a setting");
        }
    }
    renderer
}

/// Means over squares of 8 x 8 pixels.
fn blurred(radiance: &[f32], size: usize) -> Vec<f64> {
    let blocks = size / 8;
    let mut sums = vec![0.0; blocks * blocks * 3];
    for (at, pixel) in radiance.chunks_exact(3).enumerate() {
        let block = at / size / 8 * blocks + at % size / 8;
        for (channel, value) in pixel.iter().enumerate() {
            sums[block * 3 + channel] += f64::from(*value) / 64.0;
        }
    }
    sums
}

/// Pixels per side of pictures of the floor.
const SIDE: usize = 64;

/// The light on the floor, which is instance 0, in squares of 8 x 8 pixels.
fn on_the_floor(renderer: &Renderer, radiance: &[f32]) -> Vec<f64> {
    let points = renderer.surface_points().expect("points");
    let is_floor =
        |point: &Option<VisiblePoint>| (point.as_ref()).is_some_and(|it| it.instance == 0);
    let pixels = radiance.chunks_exact(3).zip(&points);
    let pixels = pixels.flat_map(|(pixel, point)| match is_floor(point) {
        true => [pixel[0], pixel[1], pixel[2]],
        false => [0.0; 3],
    });
    blurred(&pixels.collect::<Vec<_>>(), SIDE)
}

/// The floor's light by each tracer, maps and rays, and the path tracer's. Scenes with ray-tracing are uploaded with rays.
/// `resolution` is the setting of caustics.
fn floors(gpu: &Gpu, scene: &Scene, samples: u32, resolution: &str) -> [Vec<f64>; 3] {
    let with = |techniques: &[&str], tracer: &str| {
        let mut techniques = techniques.to_vec();
        if !scene.media.is_empty() {
            // It dims what the camera sees through media.
            techniques.push("participating-media");
        }
        let mut renderer = renderer(gpu, scene, &techniques, SIDE as u32);
        // 4 points per frame on a lamp so near and so large are off by 3 %.
        for (name, value) in [
            ("tracer", tracer),
            ("resolution", resolution),
            ("area-samples", "16"),
        ] {
            renderer.set("caustics", name, value).expect("a setting");
        }
        renderer
    };
    let mut maps = with(&["caustics"], "maps");
    let found = measured(gpu, scene, &camera(), &mut maps, [4, samples]);
    let mut rays = with(&["caustics", "ray-tracing"], "rays");
    rays.converge(&camera(), false, |_, _| ControlFlow::Continue(()))
        .expect("caustics");
    for _ in 0..4 {
        let sample = rays.render_sample(&camera(), 4, None, false);
        sample.expect("a picture");
    }
    let radiance = rays.radiance().expect("radiance");
    [&found.radiance, &radiance, &found.truth.radiance]
        .map(|radiance| on_the_floor(&maps, radiance))
}

/// The share of the truth's flux, and the relative error of the squares.
fn compared(test: &[f64], truth: &[f64]) -> [f64; 2] {
    let [all, all_truth] = [test, truth].map(|values| values.iter().sum::<f64>());
    let mean = all_truth / truth.len() as f64;
    let squares = test.iter().zip(truth);
    let error = squares
        .map(|(a, b)| (a - b).powi(2) / (b * b + mean * mean))
        .sum::<f64>();
    [all / all_truth, error / truth.len() as f64]
}

/// The light of a lamp that reaches the floor by way of a ball: all of it, in the right place.
#[test]
fn balls_throw_their_light_where_the_path_tracer_finds_it() {
    let Some(gpu) = gpu() else { return };
    // Few of the path tracer's paths find the lamp by way of the mirror, so that lamp is large.
    for (name, material, lamp) in [("glass", glass(1.5), 0.5), ("mirror", mirror(), 2.5)] {
        let [maps, rays, truth] = floors(&gpu, &ball_under_lamp(material, lamp), 512, "128");
        for (tracer, light) in [("maps", maps), ("rays", rays)] {
            let [flux, error] = compared(&light, &truth);
            println!(
                "{name}, {tracer}: flux {flux:.4} of the truth's, rel-mse of the blurred light {error:.1e}"
            );
            // By rays, the light of the glass ball is 4 % too bright on the floor, for reasons unknown: in a closed room
            // all flux arrives, within 1 % (flux_of_points_arrives).
            let most = if tracer == "maps" { 0.03 } else { 0.05 };
            assert!((flux - 1.0).abs() < most, "{name}, {tracer}: {flux}");
            assert!(error < 0.05, "{name}, {tracer}: {error}");
        }
    }
}

/// Smoke that only absorbs, around everything, the camera too.
fn smoke() -> Medium {
    Medium {
        name: "smoke".into(),
        world_from_box: Some(Mat4::from_scale(Vec3::splat(20.0))),
        extinction: vec3(0.6, 0.3, 0.1),
        albedo: Vec3::ZERO,
        phase: PhaseFunction::HenyeyGreenstein(0.0),
        emission: Vec3::ZERO,
        density: None,
        node: None,
    }
}

/// Smoke dims the light of caustics on its whole way: to the ball, in it, and on to the floor.
#[test]
fn smoke_dims_what_balls_throw_as_in_the_path_tracer() {
    let Some(gpu) = gpu() else { return };
    for (name, material) in [("glass", glass(1.5)), ("mirror", mirror())] {
        // The few points on a large lamp err in the same way with and without smoke.
        let mut scene = ball_under_lamp(material, 2.5);
        let clear = floors(&gpu, &scene, 256, "96");
        scene.media.push(smoke());
        let dimmed = floors(&gpu, &scene, 256, "96");
        let of = |all: &[f64]| [0, 1, 2].map(|at| all.iter().skip(at).step_by(3).sum::<f64>());
        // By channel, the share of the light that smoke lets pass.
        let passed = |at: usize| {
            let (dimmed, clear) = (of(&dimmed[at]), of(&clear[at]));
            [0, 1, 2].map(|channel| dimmed[channel] / clear[channel])
        };
        let truth = passed(2);
        for (tracer, passed) in [("maps", passed(0)), ("rays", passed(1))] {
            println!("{name}, {tracer}: {passed:.4?} of the light, the path tracer {truth:.4?}");
            for (passed, truth) in passed.iter().zip(&truth) {
                let off = (passed / truth - 1.0).abs();
                assert!(off < 0.06, "{name}, {tracer}: {passed} instead of {truth}");
            }
        }
    }
}

/// Light that a mirror throws through a ball of glass onto the floor: rays follow it, the maps around the mirror do not.
#[test]
fn rays_follow_light_by_way_of_several_objects() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(2.0);
    // Shines along x, onto a mirror that turns the light down.
    let lamp = quad(vec3(-1.6, 1.2, -0.3), Vec3::Y * 0.6, Vec3::Z * 0.6, 1);
    assert!(lamp.normals[0].x > 0.9);
    crate::common::place(
        &mut scene,
        lamp,
        Material::emitter("lamp", Vec3::splat(20.0)),
    );
    let tilted = quad(
        vec3(-0.4, 1.9, -0.4),
        vec3(0.8, -0.8, 0.0),
        Vec3::Z * 0.8,
        1,
    );
    assert!(tilted.normals[0].x < 0.0 && tilted.normals[0].y < 0.0);
    add(&mut scene, tilted, mirror(), Vec3::ZERO);
    add(&mut scene, sphere(0.4, 64), glass(1.5), vec3(0.0, 0.6, 0.0));
    let [maps, rays, truth] = floors(&gpu, &scene, 256, "96");
    let [maps, rays] = [maps, rays].map(|light| compared(&light, &truth));
    println!("flux and rel-mse: maps {maps:.4?}, rays {rays:.4?}");
    assert!((rays[0] - 1.0).abs() < 0.05 && rays[1] < 0.01, "{rays:?}");
    assert!(maps[1] > 2.0 * rays[1], "{maps:?}");
}

/// Scenes are uploaded with rays only for techniques that always trace them.
#[test]
fn rays_need_a_scene_with_rays() {
    let Some(gpu) = gpu() else { return };
    let scene = ball_under_lamp(mirror(), 0.5);
    let mut renderer = renderer(&gpu, &scene, &["caustics"], 16);
    renderer
        .set("caustics", "tracer", "rays")
        .expect("a setting");
    let refused = renderer.render_sample(&camera(), 1, None, false).err();
    let refused = refused.expect("an error").to_string();
    assert!(refused.contains("tracer=rays"), "{refused}");
}

/// Caustics with shadows around them, seen through glass and in a mirror.
#[test]
fn caustics_are_seen_through_glass() {
    let Some(gpu) = gpu() else { return };
    let mut scene = ball_under_lamp(glass(1.5), 0.5);
    add(&mut scene, sphere(0.3, 48), mirror(), vec3(-0.8, 0.3, 0.3));
    let techniques = ["shadow-map", "caustics", "distance-impostor"];
    let mut with_all = renderer(&gpu, &scene, &techniques, 48);
    let found = measured(&gpu, &scene, &camera(), &mut with_all, [8, 256]);
    let mut others = renderer(&gpu, &scene, &["shadow-map", "distance-impostor"], 48);
    for _ in 0..8 {
        let sample = others.render_sample(&camera(), 8, None, false);
        sample.expect("a picture");
    }
    let others = others.radiance().expect("radiance");
    let [with, without] = [&found.radiance, &others].map(|radiance| {
        let [test, truth] = [radiance, &found.truth.radiance].map(|light| blurred(light, 48));
        let squares = test.iter().zip(&truth);
        squares
            .map(|(a, b)| (a - b).powi(2) / (b * b + 0.01))
            .sum::<f64>()
            / truth.len() as f64
    });
    println!("shadows, caustics and impostors: rel-mse {with:.1e}, without caustics {without:.1e}");
    assert!(with < 0.02, "{with}");
    assert!(without > 3.0 * with, "{without}");
}

#[test]
fn what_glass_shows_of_caustics_is_declared_and_follows_them() {
    let Some(gpu) = gpu() else { return };
    let mut scene = ball_under_lamp(glass(1.5), 0.5);
    add(&mut scene, sphere(0.3, 16), mirror(), vec3(-0.8, 0.3, 0.3));
    let techniques = ["shadow-map", "caustics", "distance-impostor"];
    let mut renderer = renderer(&gpu, &scene, &techniques, 16);
    let seen = LightPaths::new(LightClass::Area, "LSDSE");
    assert!(overlap(&renderer.light_paths(), &[seen]).is_some());
    let mut made = |pass: &str| {
        let timings = renderer
            .render_sample(&camera(), 64, None, true)
            .expect("a picture");
        timings
            .wait()
            .expect("times")
            .iter()
            .any(|timing| timing.pass == pass)
    };
    if !made("caustics.splat") {
        eprintln!("skipped: no timestamps");
        return;
    }
    let frames: Vec<u32> = (2..=20)
        .filter(|_| made("distance-impostor.store"))
        .collect();
    assert_eq!(frames, [2, 4, 8, 16]);
}

/// Caustics follow moved objects, other lights and other materials.
#[test]
fn changes_of_the_scene_are_followed() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(2.0);
    add(&mut scene, sphere(0.4, 32), glass(1.5), vec3(0.0, 0.6, 0.0));
    let light = Light::new("", LightKind::Point, Vec3::ONE);
    scene.lights = vec![light.aimed(vec3(0.2, 2.0, 0.0), Vec3::ZERO)];
    let mut kept = renderer(&gpu, &scene, &["caustics"], 24);
    let picture = |renderer: &mut Renderer| {
        renderer.restart();
        let sample = renderer.render_sample(&camera(), 1, None, false);
        sample.expect("a picture");
        renderer.radiance().expect("radiance")
    };
    let mut last = picture(&mut kept);
    type Change = fn(&mut Scene);
    let changes: [(&str, Change); 5] = [
        ("the ball moved", |scene| {
            scene.instances[1].world_from_mesh = Mat4::from_translation(vec3(0.5, 0.7, -0.2));
        }),
        ("the light moved", |scene| {
            scene.lights[0].world_from_light.w_axis.x = -1.0
        }),
        ("the light is another", |scene| {
            scene.lights[0].intensity = Vec3::X
        }),
        ("the glass is another", |scene| scene.materials[1].ior = 1.2),
        ("there is smoke", |scene| scene.media.push(smoke())),
    ];
    for (what, change) in changes {
        change(&mut scene);
        kept.update(&scene).expect("an update");
        let found = picture(&mut kept);
        let fresh = picture(&mut renderer(&gpu, &scene, &["caustics"], 24));
        let error = |a: &[f32], b: &[f32]| {
            let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2));
            squares.sum::<f32>() / b.iter().map(|b| b * b).sum::<f32>()
        };
        let (off, moved) = (error(&found, &fresh), error(&last, &fresh));
        assert!(off < 1e-3 && moved > 0.05, "{what}: {off}, {moved}");
        last = found;
    }
    // A light that goes out takes its caustics with it.
    scene.lights[0].intensity = Vec3::ZERO;
    kept.update(&scene).expect("an update");
    assert!(picture(&mut kept).iter().all(|light| *light == 0.0));
}

/// A weak light's few photons contribute as much beside a light so strong that one of its counts is worth many of
/// theirs.
#[test]
fn weak_lights_are_not_lost_beside_strong_ones() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(2.0);
    add(&mut scene, sphere(0.4, 32), mirror(), vec3(0.0, 0.6, 0.0));
    let light = |at, strength| {
        Light::new("", LightKind::Point, Vec3::splat(strength)).aimed(at, Vec3::ZERO)
    };
    scene.lights = vec![light(vec3(1.5, 0.6, 0.0), 1.0)];
    let mean = |scene: &Scene| {
        let radiance = look(&gpu, scene, 64);
        radiance.iter().sum::<f32>() / radiance.len() as f32
    };
    let alone = mean(&scene);
    // Below the floor, which keeps its light away from the ball.
    scene.lights.push(light(vec3(0.0, -1.0, 0.0), 3e4));
    let beside = mean(&scene);
    println!("alone {alone}, beside a light 3e4 times as strong {beside}");
    assert!(
        alone > 0.0 && (beside / alone - 1.0).abs() < 0.2,
        "{alone}, {beside}"
    );
}

/// Places where no caustic can be correct: everything stays finite.
#[test]
fn impossible_places_stay_finite() {
    let Some(gpu) = gpu() else { return };
    let light = |at: Vec3| Light::new("", LightKind::Point, Vec3::ONE).aimed(at, Vec3::ZERO);
    let center = vec3(0.0, 0.6, 0.0);
    // Inside the ball, on its surface, far away, and below the floor.
    for at in [center, center + Vec3::Y * 0.4, Vec3::Y * 1e6, -Vec3::Y] {
        for material in [glass(1.5), mirror()] {
            let mut scene = floor(2.0);
            add(&mut scene, sphere(0.4, 16), material, center);
            scene.lights.push(light(at));
            look(&gpu, &scene, 16);
        }
    }
    // Nothing around it; larger than everything else; touching the floor; flat; open; no triangles.
    let mut alone = Scene::new("alone");
    add(&mut alone, sphere(0.4, 16), glass(1.5), center);
    let mut large = floor(0.2);
    add(&mut large, sphere(9.0, 16), glass(1.5), Vec3::ZERO);
    let mut touching = floor(2.0);
    add(
        &mut touching,
        sphere(0.4, 16),
        mirror(),
        vec3(0.0, 0.4, 0.0),
    );
    let mut flat = floor(2.0);
    add(
        &mut flat,
        quad(center, Vec3::X, Vec3::Z, 1),
        glass(1.5),
        Vec3::ZERO,
    );
    let mut open = floor(2.0);
    let mut cap = sphere(0.4, 16);
    cap.indices.truncate(cap.indices.len() / 6 * 3);
    add(&mut open, cap, glass(1.5), center);
    let mut empty = floor(2.0);
    add(&mut empty, Mesh::default(), mirror(), center);
    for mut scene in [alone, large, touching, flat, open, empty] {
        scene.lights.push(light(vec3(0.3, 2.0, 0.4)));
        look(&gpu, &scene, 16);
    }
    let mut dark = floor(2.0);
    add(&mut dark, sphere(0.4, 16), glass(1.5), center);
    let radiance = look(&gpu, &dark, 16);
    assert!(radiance.iter().all(|value| *value == 0.0));
}

/// Renders a few frames and returns finite radiance.
fn look(gpu: &Gpu, scene: &Scene, size: u32) -> Vec<f32> {
    let mut renderer = renderer(gpu, scene, &["caustics"], size);
    for _ in 0..2 {
        renderer
            .render_sample(&camera(), 2, None, false)
            .expect("a picture");
    }
    let radiance = renderer.radiance().expect("radiance");
    assert!(
        radiance
            .iter()
            .all(|value| value.is_finite() && *value >= 0.0)
    );
    radiance
}

#[test]
fn settings_that_cannot_work_are_refused() {
    let Some(gpu) = gpu() else { return };
    let scene = ball_under_lamp(mirror(), 0.5);
    let mut renderer = renderer(&gpu, &scene, &["caustics"], 16);
    for (name, value) in [
        ("resolution", "4"),
        ("resolution", "4096"),
        ("cube-resolution", "100"),
        ("bounces", "17"),
        ("area-samples", "0"),
        ("objects", "nobody"),
        ("photons", "1"),
    ] {
        assert!(
            renderer.set("caustics", name, value).is_err(),
            "{name}={value}"
        );
    }
}
