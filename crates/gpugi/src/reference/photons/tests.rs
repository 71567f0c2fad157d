//! The light tracer against closed forms and against the path tracer, where both can find the light.

use std::f64::consts::PI;
use std::ops::ControlFlow;

use glam::{Mat4, Vec3, vec3};
use gpugi_scene::builtin::shapes::{cuboid, quad, sphere};
use gpugi_scene::{Camera, Lens, Light, LightKind, Material, Mesh, Projection, Scene, Volume};

use super::{LARGEST_BATCH, LEAST_PER_SAMPLE, MOST_PER_SAMPLE, PHOTONS_PER_SAMPLE, balanced};
use crate::gpu::{Gpu, read_buffer};
use crate::lighting::LightingError;
use crate::reference::{PathTracer, Settings, TILE_SIDE};
use crate::testing::test_gpu;

pub(super) fn place(scene: &mut Scene, mesh: Mesh, material: Material, at: Vec3) {
    let mesh = scene.add_mesh(mesh);
    let material = scene.add_material(material);
    scene.add_instance("", mesh, material, Mat4::from_translation(at));
}

pub(super) fn mirror(reflectance: f32) -> Material {
    Material::metal("mirror", Vec3::splat(reflectance), 0.0)
}

pub(super) fn glass(ior: f32) -> Material {
    Material {
        transmission: 1.0,
        roughness: 0.0,
        ior,
        volume: Some(Volume {
            attenuation_distance: f32::INFINITY,
            attenuation_color: Vec3::ONE,
        }),
        ..Material::default()
    }
}

pub(super) fn keeping(paths: &str) -> Settings {
    Settings {
        paths: paths.to_owned(),
        ..Settings::default()
    }
}

const BATCHES: u32 = 8;

/// Pixels along each side of the pictures whose means are taken: a dispatch in software costs as much as a thousand rays.
const SIDE: u32 = 64;

/// The mean and the standard error of the mean radiance (all channels) over pictures with several seeds.
pub(super) fn mean(
    gpu: &Gpu,
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    samples: u32,
    has_photons: bool,
) -> (f64, f64) {
    let tracer = PathTracer::with_tiles(gpu, scene, [SIDE, SIDE], settings, TILE_SIDE, has_photons);
    let mut tracer = tracer.unwrap();
    assert_eq!(tracer.photons.is_some(), has_photons);
    let means: Vec<f64> = (1..=BATCHES)
        .map(|seed| {
            let radiance = picture(&mut tracer, camera, samples, seed);
            radiance.iter().copied().map(f64::from).sum::<f64>() / radiance.len() as f64
        })
        .collect();
    let count = f64::from(BATCHES);
    let mean = means.iter().sum::<f64>() / count;
    let squares: f64 = means.iter().map(|of_seed| (of_seed - mean).powi(2)).sum();
    (mean, (squares / (count * (count - 1.0))).sqrt())
}

/// Begins anew, with as many photons in all samples: few samples have little noise, and many take no more time.
fn restart(tracer: &mut PathTracer, seed: u32) {
    tracer.restart(seed).unwrap();
    tracer.balanced = u32::MAX / 4;
    if let Some(photons) = &mut tracer.photons {
        photons.share = 0.5;
    }
}

fn picture(tracer: &mut PathTracer, camera: &Camera, samples: u32, seed: u32) -> Vec<f32> {
    restart(tracer, seed);
    let mut on = |_: &_| ControlFlow::Continue(());
    tracer.render(camera, samples, &mut on).unwrap();
    tracer.radiance().unwrap()
}

pub(super) fn from_above(side: f32, eye: f32) -> Camera {
    Camera {
        projection: Projection::Orthographic { height: side },
        ..Camera::look_at("", Vec3::Y * eye, Vec3::ZERO, 1.0)
    }
}

/// A floor of albedo 0.5 with an object.
pub(super) fn on_floor(mesh: Mesh, material: Material, at: Vec3) -> Scene {
    let mut scene = Scene::new("floor");
    let floor = quad(vec3(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0, 1);
    let grey = Material::matt("grey", Vec3::splat(0.5));
    place(&mut scene, floor, grey, Vec3::ZERO);
    place(&mut scene, mesh, material, at);
    scene
}

/// A mirror stands at x = 1; by reflection, a point at x = 0 seems to shine from x = 2.
#[test]
fn a_plane_mirror_shows_a_second_light() {
    let Some(gpu) = test_gpu() else { return };
    let stands = quad(vec3(1.0, 0.25, -0.6), Vec3::Z * 1.2, Vec3::Y * 1.35, 1);
    let scene = |kind, from: Vec3| {
        let mut scene = on_floor(stands.clone(), mirror(0.8), Vec3::ZERO);
        let light = Light::new("", kind, Vec3::splat(3.0)).aimed(from, vec3(1.0, 1.0, 0.0));
        scene.lights.push(light);
        scene
    };
    let spot = LightKind::Spot {
        inner_cone_angle: 1.4,
        outer_cone_angle: 1.5,
    };
    let point_of_floor = |i: u32, j: u32| {
        let along = |k: u32| (f64::from(k) + 0.5) / 64.0 - 0.5;
        (along(i), along(j))
    };
    // Irradiance of the square of 1 m around the origin, by the light at (2, 1, 0) or from the direction (1, 1, 0).
    let mut of_point = 0.0;
    for (x, z) in (0..64 * 64).map(|at| point_of_floor(at % 64, at / 64)) {
        let d2 = (2.0 - x).powi(2) + 1.0 + z * z;
        of_point += 3.0 / (d2 * d2.sqrt()) / 4096.0;
    }
    for (kind, from, irradiance) in [
        (LightKind::Point, vec3(0.0, 1.0, 0.0), of_point),
        (spot, vec3(0.0, 1.0, 0.0), of_point),
        (
            LightKind::Directional,
            vec3(0.0, 2.0, 0.0),
            3.0 * 0.5_f64.sqrt(),
        ),
    ] {
        let mut scene = scene(kind, from);
        if kind == LightKind::Directional {
            // It has no range, whatever a file says.
            scene.lights[0].range = Some(0.5);
        }
        for camera in [from_above(1.0, 5.0), {
            let tangent = 0.1_f32;
            Camera::look_at("", Vec3::Y * 5.0, Vec3::ZERO, 2.0 * tangent.atan())
        }] {
            let expected = 0.8 * irradiance * 0.5 / PI;
            let (value, error) = mean(&gpu, &scene, &camera, &keeping("LSDE"), 4, true);
            println!("{kind:?}: {value}, expected {expected}, error {error}");
            assert!(error < 0.005 * expected, "{kind:?}: error {error}");
            assert!(
                (value / expected - 1.0).abs() < 0.015,
                "{kind:?}: {value}, not {expected}"
            );
        }
    }
}

/// Part of a point light's power that a ball of radius 1 at `distance` from it sends on by one reflection outside, or by
/// passing without a reflection inside.
fn sent_on(distance: f64, by_passing: bool) -> f64 {
    // Under a direction with sine s from the ball's centre, a ray meets the ball at an angle of incidence with sine s
    // distance, and leaves it at the same angle.
    const STEPS: u32 = 4096;
    let least_cosine = (1.0 - 1.0 / (distance * distance)).sqrt();
    let of_direction = |step: u32| {
        let cosine =
            least_cosine + (1.0 - least_cosine) * (f64::from(step) + 0.5) / f64::from(STEPS);
        let reflected = dielectric(((1.0 - cosine * cosine).sqrt() * distance).min(1.0));
        if by_passing {
            (1.0 - reflected).powi(2)
        } else {
            reflected
        }
    };
    let sum: f64 = (0..STEPS).map(of_direction).sum();
    0.5 * (1.0 - least_cosine) * sum / f64::from(STEPS)
}

/// Fresnel reflectance of glass of index 1.5 for unpolarized light, by the sine of the angle of incidence.
fn dielectric(sine: f64) -> f64 {
    let (a, b) = (
        (1.0 - sine * sine).sqrt(),
        (1.0 - sine * sine / 2.25).sqrt(),
    );
    let rs = (a - 1.5 * b) / (a + 1.5 * b);
    let rp = (b - 1.5 * a) / (b + 1.5 * a);
    (rs * rs + rp * rp) / 2.0
}

/// Six parallel cameras look at the walls of a box around a ball. The power of what the ball mirrors, and of what passes
/// it without a reflection inside, is that of Fresnel's equations.
#[test]
fn a_ball_sends_on_the_flux_of_fresnels_equations() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = Scene::new("ball");
    let mut walls = cuboid(Vec3::splat(-4.0), Vec3::splat(4.0), 1);
    for triangle in walls.indices.chunks_exact_mut(3) {
        triangle.swap(1, 2);
    }
    for normal in &mut walls.normals {
        *normal = -*normal;
    }
    place(
        &mut scene,
        walls,
        Material::matt("walls", Vec3::splat(0.5)),
        Vec3::ZERO,
    );
    place(&mut scene, sphere(1.0, 96), glass(1.5), Vec3::ZERO);
    let power = 4.0 * PI;
    scene
        .lights
        .push(Light::new("", LightKind::Point, Vec3::ONE).aimed(vec3(0.3, 1.5, 2.0), Vec3::ZERO));
    let distance = vec3(0.3, 1.5, 2.0).length().into();
    for (paths, by_passing, samples) in [("LSDE", false, 20), ("LSSDE", true, 1)] {
        let mut flux = 0.0;
        let mut variance = 0.0;
        for direction in [Vec3::X, Vec3::Y, Vec3::Z]
            .into_iter()
            .flat_map(|axis| [axis, -axis])
        {
            let camera = Camera {
                projection: Projection::Orthographic { height: 8.0 },
                ..Camera::look_at("", direction * 2.0, direction * 3.0, 1.0)
            };
            let (value, error) = mean(&gpu, &scene, &camera, &keeping(paths), samples, true);
            // Radiance times pi over the albedo, over a wall of 64 m^2.
            flux += value * PI / 0.5 * 64.0;
            variance += (error * PI / 0.5 * 64.0).powi(2);
        }
        let expected = power * sent_on(distance, by_passing);
        println!(
            "{paths}: {flux} W, expected {expected}, error {}",
            variance.sqrt()
        );
        assert!(
            variance.sqrt() < 0.005 * expected,
            "{paths}: error {}",
            variance.sqrt()
        );
        assert!(
            (flux / expected - 1.0).abs() < 0.015,
            "{paths}: {flux} W, not {expected}"
        );
    }
}

/// Lamps, which both tracers find by way of a coarse mirror ball, a ball of glass with absorption, a thin pane, a coat
/// over a diffuse surface, and the surface of a block of glass around eye and floor: alone, the path tracer gets the same light as both together.
#[test]
fn both_tracers_find_the_same_light_of_lamps() {
    let Some(gpu) = test_gpu() else { return };
    let tinted = Material {
        volume: Some(Volume {
            attenuation_distance: 0.5,
            attenuation_color: vec3(0.9, 0.6, 0.3),
        }),
        ..glass(1.5)
    };
    let pane = Material {
        volume: None,
        base_color: vec3(0.9, 0.7, 0.5).extend(1.0),
        ..glass(1.5)
    };
    let coat = Material {
        roughness: 0.0,
        specular: 1.0,
        ..Material::matt("coat", Vec3::splat(0.6))
    };
    let ball = || sphere(0.4, 32);
    let around = cuboid(vec3(-1.5, -0.5, -1.5), vec3(1.5, 1.5, 1.4), 1);
    let hangs = quad(vec3(-0.5, 0.6, 0.5), Vec3::X, Vec3::NEG_Z, 1);
    for (name, mesh, material, at) in [
        ("mirror", sphere(0.4, 12), mirror(0.9), vec3(0.0, 0.45, 0.0)),
        ("glass", ball(), tinted, vec3(0.0, 0.45, 0.0)),
        (
            "pane",
            hangs,
            Material {
                double_sided: true,
                ..pane
            },
            Vec3::ZERO,
        ),
        ("coat", ball(), coat, vec3(0.0, 0.45, 0.0)),
        ("inside", around, glass(1.5), Vec3::ZERO),
    ] {
        let mut scene = on_floor(mesh, material, at);
        // A floor with gloss, lit by a wide lamp.
        scene.materials[0] = Material {
            roughness: 0.5,
            specular: 1.0,
            ..scene.materials[0].clone()
        };
        // The lamp must look upon the object from some distance.
        let (height, half) = if name == "inside" {
            (6.0, 4.0)
        } else {
            (2.0, 1.0)
        };
        let side = 2.0 * half;
        let lamp = quad(
            vec3(-half, height, -half),
            Vec3::X * side,
            Vec3::Z * side,
            1,
        );
        place(
            &mut scene,
            lamp,
            Material::emitter("lamp", vec3(3.0, 2.0, 1.0)),
            Vec3::ZERO,
        );
        let wall = quad(vec3(-2.0, 0.0, -1.0), Vec3::X * 4.0, Vec3::Y * 2.0, 1);
        // The eye looks through the back of a single-sided wall.
        let front = quad(vec3(2.0, 0.0, 1.5), Vec3::NEG_X * 4.0, Vec3::Y * 2.0, 1);
        for wall in [wall, front] {
            place(
                &mut scene,
                wall,
                Material::matt("wall", Vec3::splat(0.7)),
                Vec3::ZERO,
            );
        }
        let from = if name == "inside" { 0.5 } else { 1.0 };
        let eye = vec3(0.6, 1.3, 2.4) * from;
        let camera = Camera::look_at("", eye, vec3(0.0, 0.2, 0.0), 0.7);
        let patterns: &[(&str, f64)] = match name {
            "mirror" => &[("LS.*[DG]E", 0.015), ("LS+[DG][DGS]*DE", 0.04)],
            "coat" => &[("LS.*[DG]E", 0.04)],
            _ => &[("LS.*[DG]E", 0.015)],
        };
        for &(paths, most) in patterns {
            let of = |has_photons| {
                let samples = if has_photons { 8 } else { 32 };
                mean(&gpu, &scene, &camera, &keeping(paths), samples, has_photons)
            };
            let [(alone, noise), (both, error)] = [false, true].map(of);
            println!("{name}, {paths}: {alone} +- {noise} alone, {both} +- {error} with photons");
            let spread = noise.hypot(error);
            assert!(
                spread < most * alone,
                "{name}, {paths}: {spread} of {alone}"
            );
            assert!(
                (both - alone).abs() < 3.5 * spread,
                "{name}, {paths}: {both}, not {alone}"
            );
        }
    }
}

/// A caustic out of focus: photons see it through the same lens as paths from the eye.
#[test]
fn both_tracers_see_through_the_same_lens() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = on_floor(sphere(0.4, 32), glass(1.5), vec3(0.0, 0.45, 0.0));
    let lamp = quad(vec3(-0.5, 2.0, -0.5), Vec3::X, Vec3::Z, 1);
    place(
        &mut scene,
        lamp,
        Material::emitter("lamp", Vec3::ONE),
        Vec3::ZERO,
    );
    // The caustic below the ball fills the pinhole's picture, and none of its neighbourhood.
    let pinhole = Camera::look_at("", vec3(1.2, 0.8, 0.0), vec3(0.0, 0.0, 0.0), 0.1);
    let camera = Camera {
        lens: Lens::new(0.1, 0.5, 5).unwrap(),
        ..pinhole.clone()
    };
    let of = |camera, samples, has_photons| {
        mean(
            &gpu,
            &scene,
            camera,
            &keeping("LS+DE"),
            samples,
            has_photons,
        )
    };
    let (alone, noise) = of(&camera, 1, false);
    let (both, error) = of(&camera, 3, true);
    let (sharp, _) = of(&pinhole, 1, false);
    println!("{alone} +- {noise} alone, {both} +- {error} with photons, {sharp} without a lens");
    let spread = noise.hypot(error);
    assert!(spread < 0.04 * alone, "{spread} of {alone}");
    assert!((both - alone).abs() < 3.5 * spread, "{both}, not {alone}");
    assert!(
        (sharp - alone).abs() > 6.0 * spread,
        "{sharp} through a pinhole"
    );
}

/// What the filter keeps adds up to the whole, and scenes in which no light meets an ideal surface first have no
/// photons.
#[test]
fn photons_keep_to_the_settings() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = on_floor(sphere(0.4, 16), mirror(0.9), vec3(0.0, 0.45, 0.0));
    let light = Light::new("", LightKind::Point, Vec3::splat(3.0));
    scene
        .lights
        .push(light.aimed(vec3(1.0, 1.5, 0.5), Vec3::ZERO));
    let has_photons = |scene: &Scene, settings: &Settings| {
        let tracer = PathTracer::new(&gpu, scene, [16, 16], settings).unwrap();
        tracer.photons.is_some()
    };
    assert!(has_photons(&scene, &Settings::default()));
    // 2^9 states, read from the light.
    assert!(has_photons(&scene, &keeping("L.*D.{8}E")));
    assert!(!has_photons(&scene, &keeping("L[DG].*E")));
    assert!(has_photons(&scene, &keeping("LS.*SE")));
    assert!(!has_photons(&scene, &keeping("L[DG].*SE")));
    assert!(!has_photons(
        &scene,
        &Settings {
            max_bounces: 1,
            ..Settings::default()
        }
    ));
    assert!(!has_photons(
        &scene,
        &Settings {
            lights: "area,environment".to_owned(),
            ..Settings::default()
        }
    ));
    let mut matt = scene.clone();
    matt.materials[1].roughness = 0.02;
    assert!(!has_photons(&matt, &Settings::default()));
    // 2^11 states, read from the light: refused where there are no photons, too.
    let pattern = "L.*D.{10}E";
    let refused = PathTracer::new(&gpu, &matt, [16, 16], &keeping(pattern)).unwrap_err();
    assert!(
        matches!(refused, LightingError::Setting { .. }),
        "{refused}"
    );
    let error = Settings::default().set("paths", pattern).unwrap_err();
    assert!(
        error.to_string().contains("more than 1024 states"),
        "{error}"
    );

    let camera = Camera::look_at("", vec3(0.6, 1.3, 2.4), vec3(0.0, 0.2, 0.0), 0.7);
    scene.materials[0] = Material {
        roughness: 0.5,
        specular: 1.0,
        ..scene.materials[0].clone()
    };
    let of = |paths: &str| mean(&gpu, &scene, &camera, &keeping(paths), 4, true);
    let (whole, noise) = of("LS.*[DG]E");
    let parts = ["LS.*DE", "LS.*GE"].map(of);
    let sum = parts[0].0 + parts[1].0;
    println!("{whole} +- {noise}, parts {parts:?}");
    assert!(parts[1].0 > 0.02 * whole);
    assert!((sum / whole - 1.0).abs() < 0.02, "{sum}, not {whole}");
}

/// Tiles and batches do not change a bit of what photons add.
#[test]
fn photons_do_not_depend_on_tiles_and_batches() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = on_floor(sphere(0.4, 16), glass(1.5), vec3(0.0, 0.45, 0.0));
    let light = Light::new("", LightKind::Point, Vec3::splat(3.0));
    scene
        .lights
        .push(light.aimed(vec3(1.0, 1.5, 0.5), Vec3::ZERO));
    let camera = Camera::look_at("", vec3(0.6, 1.3, 2.4), vec3(0.0, 0.2, 0.0), 0.7);
    let of = |side: u32, largest_batch: u64| {
        let settings = keeping("LS.*E");
        let tracer = PathTracer::with_tiles(&gpu, &scene, [37, 22], &settings, side, true);
        let mut tracer = tracer.unwrap();
        tracer.photons.as_mut().unwrap().largest_batch = largest_batch;
        let picture = picture(&mut tracer, &camera, 18, 4);
        (picture, tracer.noise().unwrap())
    };
    let (whole, noise) = of(TILE_SIDE, LARGEST_BATCH);
    assert!(whole.iter().filter(|value| **value > 0.0).count() > 500);
    assert!(noise > 0.0);
    for (side, largest_batch) in [(8, LARGEST_BATCH), (30, 100), (TILE_SIDE, 333)] {
        let (tiled, of_tiles) = of(side, largest_batch);
        assert!(
            tiled == whole,
            "tiles of {side} pixels, batches of {largest_batch} photons give another picture"
        );
        assert!(of_tiles > 0.0);
    }
}

/// Pieces of work of a few rays, with points and photons apart, add up to the picture that is made at once, and so does the
/// number of photons, which the noise decides.
#[test]
fn pieces_send_the_same_photons() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = on_floor(sphere(0.4, 16), mirror(0.9), vec3(0.0, 0.45, 0.0));
    let light = Light::new("", LightKind::Point, Vec3::splat(3.0));
    scene
        .lights
        .push(light.aimed(vec3(1.0, 1.5, 0.5), Vec3::ZERO));
    // The ball fills the picture, so that every point counts.
    let camera = Camera::look_at("", vec3(0.6, 1.3, 2.4), vec3(0.0, 0.45, 0.0), 0.2);
    // Paths find nothing of it, so that more photons are worth their time.
    let settings = keeping("LS.*[DG].*E");
    let mut tracer = PathTracer::new(&gpu, &scene, [20, 14], &settings).unwrap();
    let share = |tracer: &PathTracer| tracer.photons.as_ref().unwrap().share;
    let mut on = |_: &_| ControlFlow::Continue(());
    tracer.render(&camera, 24, &mut on).unwrap();
    let whole = (tracer.radiance().unwrap(), share(&tracer));
    assert_ne!(whole.1, PHOTONS_PER_SAMPLE);
    tracer.restart(0).unwrap();
    assert_eq!(share(&tracer), PHOTONS_PER_SAMPLE);
    let before = tracer.pieces();
    while tracer.try_render(&camera, 24, 60).unwrap().fraction < 1.0 {
        gpu.wait().unwrap();
    }
    assert!(tracer.pieces() - before > 200);
    assert!((tracer.radiance().unwrap(), share(&tracer)) == whole);
}

/// The number of photons follows the noise of both tracers, within bounds.
#[test]
fn noise_decides_how_many_photons_there_are() {
    assert_eq!(balanced(0.125, 1.0, 1.0), 0.25);
    assert_eq!(balanced(0.25, 1.0, 0.5), 0.25);
    assert_eq!(balanced(0.25, 1.0, 1e-9), LEAST_PER_SAMPLE);
    assert_eq!(balanced(0.125, 1e-9, 1.0), MOST_PER_SAMPLE);
    // A difference of sums, rounded.
    assert_eq!(balanced(0.125, -1e-12, 1.0), MOST_PER_SAMPLE);
    assert_eq!(balanced(0.125, 0.0, 0.0), 0.125);
}

/// Sums of light carry from their low words to their high words, and a pixel whose sum overflows keeps its mean.
#[test]
fn sums_carry_and_keep_the_mean_when_they_overflow() {
    let Some(gpu) = test_gpu() else { return };
    let stands = quad(vec3(1.0, 0.25, -0.6), Vec3::Z * 1.2, Vec3::Y * 1.35, 1);
    let mut scene = on_floor(stands, mirror(0.8), Vec3::ZERO);
    let light = Light::new("", LightKind::Point, Vec3::splat(3.0));
    scene.lights.push(light.aimed(Vec3::Y, Vec3::ZERO));
    let camera = from_above(1.0, 5.0);
    let mut tracer = PathTracer::new(&gpu, &scene, [16, 16], &keeping("LSDE")).unwrap();
    let add = |tracer: &mut PathTracer, samples| {
        let mut on = |_: &_| ControlFlow::Continue(());
        tracer.render(&camera, samples, &mut on).unwrap();
        let sums = &tracer.tiles[0].photons.as_ref().unwrap().sums;
        let words: Vec<[u32; 8]> = read_buffer(&gpu, sums, sums.size()).unwrap();
        (tracer.radiance().unwrap(), words)
    };
    let sum = |words: &[u32; 8], channel: usize| {
        u64::from(words[2 * channel]) | u64::from(words[2 * channel + 1]) << 32
    };
    let mut with_sums = |change: &dyn Fn(&mut [u32; 8])| {
        restart(&mut tracer, 1);
        let (before, mut words) = add(&mut tracer, 512);
        words.iter_mut().for_each(change);
        let sums = &tracer.tiles[0].photons.as_ref().unwrap().sums;
        gpu.write(sums, 0, &words);
        let (after, words) = add(&mut tracer, 1024);
        (before, after, words)
    };
    let starting_from = |start: u64| {
        let words = [start as u32, (start >> 32) as u32];
        move |pixel: &mut [u32; 8]| {
            for channel in pixel[..6].chunks_exact_mut(2) {
                channel.copy_from_slice(&words);
            }
        }
    };
    let start = (7 << 32) + 0xffff_0000;
    let (.., from_zero) = with_sums(&starting_from(0));
    let (.., carried) = with_sums(&starting_from(start));
    let (.., overflowed) = with_sums(&starting_from(u64::MAX));
    let (before, after, _) = with_sums(&|pixel| pixel[6] = 1);
    assert!(before == after, "pixels whose sums overflowed change");
    let (before, after, _) = with_sums(&|_| ());
    assert!(before != after);
    for ((zero, carried), overflowed) in from_zero.iter().zip(&carried).zip(&overflowed) {
        for channel in 0..3 {
            let added = sum(zero, channel);
            assert!(added > 0x1_0000, "no carry by {added}");
            assert_eq!(sum(carried, channel), start + added);
            assert_eq!(sum(overflowed, channel), added - 1);
        }
        assert_eq!([zero[6], carried[6], overflowed[6]], [0, 0, 7]);
    }
}

/// A mirror of 5 cm in a scene of 10 km is as bright, after thousands of samples, as in a small scene.
#[test]
fn small_objects_in_large_scenes_stay_bright() {
    let Some(gpu) = test_gpu() else { return };
    let stands = quad(vec3(1.0, 0.25, -0.6), Vec3::Z * 1.2, Vec3::Y * 1.35, 1);
    let mut scene = on_floor(stands, mirror(0.8), Vec3::ZERO);
    for instance in &mut scene.instances {
        let small = Mat4::from_scale(Vec3::splat(0.05));
        instance.world_from_mesh = small * instance.world_from_mesh;
    }
    let light = Light::new("", LightKind::Point, Vec3::splat(3.0));
    scene.lights.push(light.aimed(Vec3::Y * 0.05, Vec3::ZERO));
    let mut large = scene.clone();
    for x in [-5e3, 5e3] {
        let far = cuboid(Vec3::ZERO, Vec3::ONE, 1);
        let grey = Material::matt("far", Vec3::splat(0.5));
        place(&mut large, far, grey, vec3(x, 0.0, 0.0));
    }
    let camera = from_above(0.05, 0.25);
    let [small, large] = [&scene, &large].map(|scene| {
        let mut tracer = PathTracer::new(&gpu, scene, [16, 16], &keeping("LSDE")).unwrap();
        let picture = picture(&mut tracer, &camera, 4096, 1);
        picture.iter().map(|value| f64::from(*value)).sum::<f64>()
    });
    // Rays start at a distance from surfaces that grows with the scene: 2 mm.
    assert!((large / small - 1.0).abs() < 0.06, "{large}, not {small}");
}

/// The estimate of the noise includes that of the photons.
#[test]
fn the_estimate_of_the_noise_is_that_of_photons() {
    let Some(gpu) = test_gpu() else { return };
    let mut scene = on_floor(sphere(0.4, 16), mirror(0.9), vec3(0.0, 0.45, 0.0));
    let light = Light::new("", LightKind::Point, Vec3::splat(3.0));
    scene
        .lights
        .push(light.aimed(vec3(1.0, 1.5, 0.5), Vec3::ZERO));
    let camera = from_above(3.0, 5.0);
    let tracer = PathTracer::new(&gpu, &scene, [16, 16], &keeping("LSDE"));
    let mut tracer = tracer.unwrap();
    let reference = picture(&mut tracer, &camera, 4096, 99);
    const SEEDS: u32 = 8;
    let (mut estimate, mut error) = (0.0, 0.0);
    for seed in 0..SEEDS {
        let found = picture(&mut tracer, &camera, 32, seed);
        estimate += tracer.noise().unwrap() / f64::from(SEEDS);
        let squares = found.iter().zip(&reference).map(|(a, b)| {
            let (a, b) = (f64::from(*a), f64::from(*b));
            (a - b).powi(2) / (b * b + 0.01)
        });
        error += squares.sum::<f64>() / f64::from(SEEDS) / reference.len() as f64;
    }
    println!("noise: estimated {estimate}, found {error}");
    // Well-distributed photons are better than independent ones, which the estimate assumes.
    assert!(
        estimate > 0.8 * error && estimate < 6.0 * error,
        "{estimate}, found {error}"
    );
}
