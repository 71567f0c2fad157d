//! Light in media, compared with closed forms and published tables.

use std::f64::consts::PI;
use std::ops::ControlFlow;
use std::sync::Arc;

use glam::{Mat4, Vec3, vec3};
use gpugi_scene::builtin::builtin;
use gpugi_scene::builtin::shapes::{cuboid, quad};
use gpugi_scene::{
    Camera, DensityGrid, Environment, Image, Light, LightKind, Material, Medium, PhaseFunction,
    Pixels, Projection, Scene, Volume,
};

use super::{PathTracer, Settings};
use crate::gpu::Gpu;
use crate::testing::test_gpu;

const SIDE: u32 = 16;

/// A sky with the given radiance above the horizon and below.
fn sky(above: f32, below: f32) -> Environment {
    const ROWS: u32 = 256;
    let texels = (0..ROWS).flat_map(|row| {
        let radiance = if row < ROWS / 2 { above } else { below };
        [radiance, radiance, radiance, 1.0]
    });
    Environment {
        image: Arc::new(Image {
            name: "sky".to_owned(),
            width: 1,
            height: ROWS,
            pixels: Pixels::Rgba32Float(texels.collect()),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    }
}

/// Scatters nothing, in a box of `size` at the origin.
fn absorber(extinction: Vec3, size: Vec3) -> Medium {
    Medium {
        name: "medium".into(),
        world_from_box: Some(Mat4::from_scale(size)),
        extinction,
        albedo: Vec3::ZERO,
        phase: PhaseFunction::HenyeyGreenstein(0.0),
        emission: Vec3::ZERO,
        density: None,
        node: None,
    }
}

/// Scatters like a homogeneous slab, 1 m thick, of optical thickness `depth`.
fn slab(depth: f32, albedo: f32, phase: PhaseFunction) -> Medium {
    Medium {
        albedo: Vec3::splat(albedo),
        phase,
        ..absorber(Vec3::splat(depth), vec3(1000.0, 1.0, 1000.0))
    }
}

fn scene(environment: Option<Environment>, media: Vec<Medium>) -> Scene {
    let mut scene = Scene::new("media");
    scene.environment = environment;
    scene.media = media;
    scene
}

/// Sees 0.1 m of the origin from `eye`.
fn camera(eye: Vec3) -> Camera {
    Camera {
        projection: Projection::Orthographic { height: 0.1 },
        ..Camera::look_at("", eye, Vec3::ZERO, 1.0)
    }
}

/// Mean radiance of a picture with its standard error, per channel.
fn mean(gpu: &Gpu, scene: &Scene, eye: Vec3, samples: u32, settings: &Settings) -> [[f64; 2]; 3] {
    let mut tracer = PathTracer::new(gpu, scene, [SIDE; 2], settings).unwrap();
    tracer.restart(1).unwrap();
    let mut on = |_: &_| ControlFlow::Continue(());
    tracer.render(&camera(eye), samples, &mut on).unwrap();
    let picture = tracer.radiance().unwrap();
    let count = f64::from(SIDE * SIDE);
    [0, 1, 2].map(|channel| {
        let values = picture.chunks(3).map(|color| f64::from(color[channel]));
        let mean = values.clone().sum::<f64>() / count;
        let squares = values.map(|value| (value - mean).powi(2)).sum::<f64>();
        [mean, (squares / (count * (count - 1.0))).sqrt()]
    })
}

#[track_caller]
fn assert_near(what: &str, found: [[f64; 2]; 3], expected: [f64; 3], accuracy: f64) {
    for (channel, ([mean, error], expected)) in found.into_iter().zip(expected).enumerate() {
        let difference = (mean - expected).abs();
        println!("{what}, channel {channel}: {mean} +- {error}, expected {expected}");
        assert!(
            error < 0.02 * expected.max(0.05),
            "{what}: an error of {error}"
        );
        assert!(
            difference < 5.0 * error + accuracy * expected + 1e-6,
            "{what}, channel {channel}: {mean} +- {error}, not {expected}"
        );
    }
}

#[test]
fn transmittance_is_that_of_beer_and_lambert() {
    let Some(gpu) = test_gpu() else { return };
    let settings = Settings::default();
    let extinction = vec3(0.2, 0.5, 1.5);
    let expected = |depth: f64| {
        let channels = extinction.to_array();
        channels.map(|sigma| (-f64::from(sigma) * depth).exp())
    };
    let grid = |size, values: Vec<f32>| Some(Arc::new(DensityGrid { size, values }));
    // From 0 at one side to 2 at the other, and constant up to half a cell from each.
    let rising: Vec<f32> = (0..33).map(|cell| cell as f32 / 16.0).collect();
    let box_of = |density| Medium {
        density,
        ..absorber(extinction, vec3(1.0, 1.0, 2.0))
    };
    let turned = |medium: Medium| Medium {
        world_from_box: Some(Mat4::from_rotation_y(0.5) * Mat4::from_scale(vec3(9.0, 9.0, 2.0))),
        ..medium
    };
    for (what, media, depth) in [
        ("homogeneous", vec![box_of(None)], 2.0),
        ("turned", vec![turned(box_of(None))], 2.0 / 0.5_f64.cos()),
        ("linear", vec![box_of(grid([1, 1, 33], rising))], 2.0),
        // Three quarters of the box have this mean density.
        (
            "two cells",
            vec![box_of(grid([1, 1, 2], vec![0.0, 1.0]))],
            1.0,
        ),
        ("two media", vec![box_of(None), box_of(None)], 4.0),
    ] {
        let scene = scene(Some(sky(1.0, 1.0)), media);
        let found = mean(&gpu, &scene, vec3(0.0, 0.0, 5.0), 256, &settings);
        assert_near(what, found, expected(depth), 1e-3);
    }
    let above = Medium {
        world_from_box: Some(
            Mat4::from_translation(Vec3::Y * 2.0) * Mat4::from_scale(vec3(9.0, 2.0, 9.0)),
        ),
        ..absorber(extinction, Vec3::ONE)
    };
    let mut lit = scene(None, vec![above]);
    let corner = vec3(-1.0, 0.0, 1.0);
    let floor = lit.add_mesh(quad(corner, Vec3::X * 2.0, Vec3::Z * -2.0, 1));
    let matt = lit.add_material(Material::matt("floor", Vec3::splat(0.5)));
    lit.add_instance("floor", floor, matt, Mat4::IDENTITY);
    let sun = Light::new("sun", LightKind::Directional, Vec3::splat(PI as f32));
    lit.lights = vec![sun.aimed(Vec3::Y, Vec3::ZERO)];
    // The eye is below the box, so that only shadow rays pass it.
    let found = mean(&gpu, &lit, Vec3::Y * 0.5, 256, &settings);
    assert_near("shadow", found, expected(2.0).map(|t| 0.5 * t), 1e-3);
    // A surface whose back is culled within the medium.
    let mut culled = scene(Some(sky(1.0, 1.0)), vec![box_of(None)]);
    let pane = quad(vec3(1.0, -1.0, 0.0), Vec3::X * -2.0, Vec3::Y * 2.0, 1);
    let mesh = culled.add_mesh(pane);
    let matt = culled.add_material(Material::matt("pane", Vec3::splat(0.5)));
    culled.add_instance("pane", mesh, matt, Mat4::IDENTITY);
    let found = mean(&gpu, &culled, vec3(0.0, 0.0, 5.0), 256, &settings);
    assert_near("behind a culled surface", found, expected(2.0), 1e-3);
    // A solid without refraction around the medium.
    let mut solid = scene(Some(sky(1.0, 1.0)), vec![box_of(None)]);
    let mesh = solid.add_mesh(cuboid(Vec3::splat(-1.5), Vec3::splat(1.5), 1));
    let air = solid.add_material(Material {
        transmission: 1.0,
        roughness: 0.0,
        ior: 1.0,
        volume: Some(Volume {
            attenuation_distance: f32::INFINITY,
            attenuation_color: Vec3::ONE,
        }),
        ..Material::default()
    });
    solid.add_instance("solid", mesh, air, Mat4::IDENTITY);
    let found = mean(&gpu, &solid, vec3(0.0, 0.0, 5.0), 256, &settings);
    assert_near("inside a solid", found, expected(2.0), 1e-3);
}

#[test]
fn media_that_absorb_nothing_vanish_in_a_furnace() {
    let Some(gpu) = test_gpu() else { return };
    let settings = Settings {
        max_bounces: 4096,
        ..Settings::default()
    };
    let values = (0..512).map(|cell| (cell % 7) as f32 / 3.0).collect();
    let density = DensityGrid {
        size: [8; 3],
        values,
    };
    let cloud = Medium {
        albedo: Vec3::ONE,
        phase: PhaseFunction::HenyeyGreenstein(0.7),
        density: Some(Arc::new(density)),
        ..absorber(vec3(2.0, 1.0, 0.3), Vec3::splat(2.0))
    };
    let fog = Medium {
        albedo: Vec3::ONE,
        phase: PhaseFunction::CornetteShanks(-0.4),
        ..absorber(vec3(0.2, 0.3, 0.9), Vec3::splat(3.0))
    };
    let scene = scene(Some(sky(1.0, 1.0)), vec![cloud, fog]);
    let found = mean(&gpu, &scene, vec3(0.0, 0.0, 5.0), 64, &settings);
    assert_near("furnace", found, [1.0; 3], 1e-3);
}

#[test]
fn emission_adds_up_along_rays() {
    let Some(gpu) = test_gpu() else { return };
    let (sigma, emission) = (vec3(0.0, 0.5, 2.0), vec3(1.0, 2.0, 3.0));
    let fire = Medium {
        emission,
        ..absorber(sigma, Vec3::splat(2.0))
    };
    let expected = [0, 1, 2].map(|channel| {
        let (s, e) = (f64::from(sigma[channel]), f64::from(emission[channel]));
        if s == 0.0 {
            2.0 * e
        } else {
            e / s * (1.0 - (-2.0 * s).exp())
        }
    });
    let clear = Medium {
        extinction: Vec3::ZERO,
        ..fire.clone()
    };
    let settings = Settings::default();
    let eye = vec3(0.0, 0.0, 5.0);
    for (medium, expected) in [
        (fire, expected),
        (clear, emission.to_array().map(|e| 2.0 * f64::from(e))),
    ] {
        let scene = scene(None, vec![medium]);
        assert_near(
            "fire",
            mean(&gpu, &scene, eye, 256, &settings),
            expected,
            1e-3,
        );
        let no_lamps = Settings {
            lights: "punctual".to_owned(),
            ..Settings::default()
        };
        let dark = mean(&gpu, &scene, eye, 1, &no_lamps);
        assert_eq!(dark.map(|channel| channel[0]), [0.0; 3]);
    }
}

/// L = albedo E p(cos) mu0 / (mu + mu0) (1 - exp(-depth (1 / mu + 1 / mu0))) for a slab seen from above, with mu = 1 and
/// irradiance E on a surface that faces the sun.
#[test]
fn light_scattered_once_is_its_closed_form() {
    let Some(gpu) = test_gpu() else { return };
    let (depth, albedo, mu0) = (1.5_f32, 0.8, 0.6_f64);
    let henyey_greenstein = |g: f64, cosine: f64| {
        (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cosine).powf(1.5))
    };
    for (phase, value) in [
        (
            PhaseFunction::HenyeyGreenstein(-0.4),
            henyey_greenstein(-0.4, -mu0),
        ),
        (
            PhaseFunction::CornetteShanks(0.3),
            henyey_greenstein(0.3, -mu0) * 1.5 * (1.0 + mu0 * mu0) / (2.0 + 0.09),
        ),
    ] {
        let mut scene = scene(None, vec![slab(depth, albedo, phase)]);
        let sun = Light::new("sun", LightKind::Directional, Vec3::splat(10.0));
        scene.lights = vec![sun.aimed(vec3(0.8, mu0 as f32, 0.0), Vec3::ZERO)];
        let path = mu0 / (1.0 + mu0);
        let expected = f64::from(albedo)
            * 10.0
            * value
            * path
            * (1.0 - (-f64::from(depth) * (1.0 + 1.0 / mu0)).exp());
        let once = Settings {
            paths: "LVE".to_owned(),
            ..Settings::default()
        };
        let eye = vec3(0.0, 5.0, 0.0);
        let found = mean(&gpu, &scene, eye, 256, &once);
        assert_near("LVE", found, [expected; 3], 2e-3);
        // Other filters hold the rest.
        let of = |paths: &str| {
            let paths = paths.to_owned();
            let settings = Settings {
                paths,
                ..Settings::default()
            };
            mean(&gpu, &scene, eye, 64, &settings)[1][0]
        };
        let [all, more, none] = ["L.*E", "LV{2,}E", "L[^V]*E"].map(of);
        assert!(
            (all - more - expected).abs() < 0.03 * all,
            "{all} {more} {expected}"
        );
        assert!(more > 0.1 * all);
        assert_eq!(none, 0.0);
    }
}

/// Light of a point or a spot in fog, scattered once: the integral along a ray of albedo sigma p I / d^2 e^(-sigma (t + d)).
/// With a mean free path of 1 m, half of it comes from points near the light.
#[test]
fn light_of_a_point_scattered_once_is_its_integral() {
    let Some(gpu) = test_gpu() else { return };
    let (sigma, albedo, g) = (1.0_f64, 0.8_f64, 0.4_f64);
    let at = vec3(0.3, 0.2, -0.5);
    let inner_outer = [0.5_f32, 0.7];
    let spot = LightKind::Spot {
        inner_cone_angle: inner_outer[0],
        outer_cone_angle: inner_outer[1],
    };
    for kind in [LightKind::Point, spot] {
        let is_spot = kind != LightKind::Point;
        let fog = Medium {
            albedo: Vec3::splat(albedo as f32),
            phase: PhaseFunction::HenyeyGreenstein(g as f32),
            ..absorber(Vec3::splat(sigma as f32), vec3(9.0, 9.0, 8.0))
        };
        let mut scene = scene(None, vec![fog]);
        let light = Light::new("light", kind, Vec3::splat(2.0));
        scene.lights = vec![light.aimed(at, vec3(0.0, 0.0, 0.5))];
        let axis = (vec3(0.0, 0.0, 0.5) - at).normalize().as_dvec3();
        let [inner, outer] = inner_outer.map(|angle| f64::from(angle).cos());
        // The camera looks along -z, from 5 m; the fog begins at z = 4.
        let steps = 20_000;
        let expected: f64 = (0..steps)
            .map(|step| {
                let t = 8.0 * (f64::from(step) + 0.5) / f64::from(steps);
                let away = glam::dvec3(0.0, 0.0, 4.0 - t) - at.as_dvec3();
                let d = away.length();
                // The path goes on along -z; the light comes from `away`.
                let cosine = away.z / d;
                let phase = (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cosine).powf(1.5));
                let cone = ((away.dot(axis) / d - outer) / (inner - outer)).clamp(0.0, 1.0);
                let intensity = 2.0 * if is_spot { cone * cone } else { 1.0 };
                albedo * sigma * phase * intensity / (d * d) * (-sigma * (t + d)).exp() * 8.0
                    / f64::from(steps)
            })
            .sum();
        let once = Settings {
            paths: "LVE".to_owned(),
            ..Settings::default()
        };
        let found = mean(&gpu, &scene, vec3(0.0, 0.0, 5.0), 256, &once);
        assert_near("LVE", found, [expected; 3], 3e-3);
    }
}

/// The light around a point source in a medium without bounds that scatters isotropically. Case and Zweifel 1967: in mean
/// free paths, with G(k) = atan(k) / k, light scattered more than once has the fluence
///   1 / (2 pi^2 r) integral of albedo^2 G^3 / (1 - albedo G) k sin(k r) dk,
/// and that scattered once, in spheroidal coordinates around both points, albedo / (4 pi r) integral from 1 of
///   e^(-r x) / x ln((x + 1) / (x - 1)) dx.
#[test]
fn the_light_around_a_point_is_that_of_transport_theory() {
    let Some(gpu) = test_gpu() else { return };
    let (albedo, r) = (0.7_f64, 1.5_f64);
    let steps = 400_000;
    let more: f64 = (0..steps)
        .map(|step| {
            let k = (f64::from(step) + 0.5) * 0.005;
            let g = k.atan() / k;
            albedo * albedo * g.powi(3) / (1.0 - albedo * g) * k * (k * r).sin() * 0.005
        })
        .sum();
    let once: f64 = (0..100_000)
        .map(|step| {
            // x = 1 + u^2, because of the pole of the logarithm.
            let u = (f64::from(step) + 0.5) * 1e-4;
            let x = 1.0 + u * u;
            (-r * x).exp() / x * ((x + 1.0) / (x - 1.0)).ln() * 2.0 * u * 1e-4
        })
        .sum();
    // Of a source of 1 W/sr, which sends 4 pi W.
    let expected = 4.0 * PI * (more / (2.0 * PI * PI * r) + albedo * once / (4.0 * PI * r));
    let fog = Medium {
        world_from_box: None,
        albedo: Vec3::splat(albedo as f32),
        ..absorber(Vec3::ONE, Vec3::ONE)
    };
    let mut scene = scene(None, vec![fog]);
    scene.lights = vec![Light::new("source", LightKind::Point, Vec3::ONE)];
    let settings = Settings::default();
    let mut tracer = PathTracer::new(&gpu, &scene, [SIDE; 2], &settings).unwrap();
    let eye = vec3(0.0, 0.0, r as f32);
    // The faces of a cube around the eye: toward the source, to a side, and away.
    let faces = [(Vec3::NEG_Z, 1.0), (Vec3::X, 4.0), (Vec3::Z, 1.0)];
    let (mut fluence, mut variance) = (0.0, 0.0);
    for (toward, count) in faces {
        let camera = Camera::look_at("", eye, eye + toward, PI as f32 / 2.0);
        let of_seeds = [1, 2, 3, 4].map(|seed| {
            tracer.restart(seed).unwrap();
            let mut on = |_: &_| ControlFlow::Continue(());
            tracer.render(&camera, 64, &mut on).unwrap();
            let picture = tracer.radiance().unwrap();
            let side = f64::from(SIDE);
            let of_pixel = (0..SIDE * SIDE).map(|at| {
                let [x, y] =
                    [at % SIDE, at / SIDE].map(|k| (f64::from(k) + 0.5) / side * 2.0 - 1.0);
                let solid_angle = 4.0 / (side * side) / (1.0 + x * x + y * y).powf(1.5);
                f64::from(picture[3 * at as usize]) * solid_angle
            });
            count * of_pixel.sum::<f64>()
        });
        let mean = of_seeds.iter().sum::<f64>() / 4.0;
        let squares: f64 = of_seeds.iter().map(|value| (value - mean).powi(2)).sum();
        fluence += mean;
        variance += squares / 12.0;
    }
    let error = variance.sqrt();
    println!("fluence {fluence} +- {error}, expected {expected}");
    assert!(error < 0.02 * expected, "error {error}");
    assert!(
        (fluence - expected).abs() < 3.5 * error + 2e-3 * expected,
        "{fluence} +- {error}, not {expected}"
    );
}

/// Chandrasekhar 1950, section 32: a half space that scatters isotropically reflects
/// albedo E / (4 pi) mu0 / (mu + mu0) H(mu) H(mu0), where 1 / H(mu) = sqrt(1 - albedo) + albedo / 2 integral over mu' of
/// mu' H(mu') / (mu + mu').
#[test]
fn a_half_space_reflects_what_chandrasekhar_found() {
    let Some(gpu) = test_gpu() else { return };
    const STEPS: usize = 1000;
    let (albedo, mu0) = (0.8_f64, 0.5_f64);
    let at = |step: usize| (step as f64 + 0.5) / STEPS as f64;
    let next = |h: &[f64], mu: f64| {
        let sum: f64 = (0..STEPS)
            .map(|step| at(step) * h[step] / (mu + at(step)))
            .sum();
        1.0 / ((1.0 - albedo).sqrt() + albedo / 2.0 * sum / STEPS as f64)
    };
    let mut h = vec![1.0; STEPS];
    for _ in 0..50 {
        h = (0..STEPS).map(|step| next(&h, at(step))).collect();
    }
    let expected = albedo * 10.0 / (4.0 * PI) * mu0 / (1.0 + mu0) * next(&h, 1.0) * next(&h, mu0);
    let isotropic = PhaseFunction::HenyeyGreenstein(0.0);
    let mut scene = scene(None, vec![slab(40.0, albedo as f32, isotropic)]);
    let sun = Light::new("sun", LightKind::Directional, Vec3::splat(10.0));
    let toward = vec3((1.0 - mu0 * mu0).sqrt() as f32, mu0 as f32, 0.0);
    scene.lights = vec![sun.aimed(toward, Vec3::ZERO)];
    let found = mean(&gpu, &scene, vec3(0.0, 5.0, 0.0), 512, &Settings::default());
    assert_near("half space", found, [expected; 3], 2e-3);
}

/// Van de Hulst, "Multiple Light Scattering", 1980: a slab of optical thickness 2 with albedo 0.9 and g = 0.75 reflects
/// 0.09739 of light that arrives perpendicularly, and transmits 0.66096. By reciprocity, these are its radiances under a
/// white sky above it, seen from above and from below.
#[test]
fn a_slab_reflects_and_transmits_what_van_de_hulst_found() {
    let Some(gpu) = test_gpu() else { return };
    let phase = PhaseFunction::HenyeyGreenstein(0.75);
    let scene = scene(Some(sky(1.0, 0.0)), vec![slab(2.0, 0.9, phase)]);
    for (y, expected) in [(5.0, 0.09739), (-5.0, 0.66096)] {
        let found = mean(&gpu, &scene, vec3(0.0, y, 0.0), 512, &Settings::default());
        assert_near("slab", found, [expected; 3], 5e-3);
    }
}

/// In one of 2^24 segments, the random number of the first free path is 0. Such a path must not collide in the empty
/// space before a medium, where it would get infinite weight.
#[test]
fn free_paths_of_length_zero_do_not_end_in_empty_space() {
    let Some(gpu) = test_gpu() else { return };
    let fog = Medium {
        albedo: Vec3::splat(0.9),
        ..absorber(Vec3::ONE, Vec3::splat(2.0))
    };
    let scene = scene(Some(sky(1.0, 1.0)), vec![fog]);
    let mut tracer = PathTracer::new(&gpu, &scene, [SIDE; 2], &Settings::default()).unwrap();
    // The third sample of pixel (3, 5) has that number.
    tracer.restart(45416).unwrap();
    let mut on = |_: &_| ControlFlow::Continue(());
    let eye = vec3(0.0, 0.0, 5.0);
    tracer.render(&camera(eye), 4, &mut on).unwrap();
    let picture = tracer.radiance().unwrap();
    assert!(picture.iter().all(|&value| value < 10.0), "{picture:?}");
}

#[test]
fn a_medium_without_extinction_changes_no_pixel() {
    let Some(gpu) = test_gpu() else { return };
    let scene = builtin("cornell", 1).unwrap();
    let mut clear = scene.clone();
    clear.media = vec![
        absorber(Vec3::ZERO, Vec3::splat(5.0)),
        Medium {
            world_from_box: None,
            ..absorber(Vec3::ZERO, Vec3::ONE)
        },
    ];
    let picture = |scene: &Scene| {
        let mut tracer = PathTracer::new(&gpu, scene, [20, 15], &Settings::default()).unwrap();
        tracer.restart(3).unwrap();
        let mut on = |_: &_| ControlFlow::Continue(());
        tracer.render(&scene.cameras[0], 3, &mut on).unwrap();
        tracer.radiance().unwrap()
    };
    assert!(picture(&scene) == picture(&clear));
}

#[test]
fn media_without_meaning_are_refused() {
    let Some(gpu) = test_gpu() else { return };
    let fog = absorber(Vec3::ONE, Vec3::ONE);
    let refused = |media: Vec<Medium>| {
        let scene = scene(Some(sky(1.0, 1.0)), media);
        let error = PathTracer::new(&gpu, &scene, [8; 2], &Settings::default());
        error.expect_err("the medium is wrong").to_string()
    };
    let negative = Medium {
        extinction: Vec3::NEG_ONE,
        ..fog.clone()
    };
    assert!(refused(vec![negative]).contains("extinction"));
    assert!(refused(vec![fog; 65]).contains("65 media"));
}
