//! Whatever the scene and the settings, the result is a picture of finite values, or an error that says why there is
//! none.

use std::sync::Arc;

use std::time::Instant;

use glam::{Mat4, Vec3, vec3};
use gpugi::LightingError;
use gpugi::gpu::{Gpu, GpuError};
use gpugi::reference::{PathTracer, Settings};
use gpugi_scene::builtin::shapes::{cuboid, quad, sphere};
use gpugi_scene::{Camera, Light, LightKind, Material, Mesh, Scene, Volume};

use super::{bounces, picture, tracer, white};
use crate::common::{floor, from_above, gpu, lit_by, place};

fn looking_down() -> Camera {
    Camera::look_at("", vec3(0.0, 3.0, 3.0), Vec3::ZERO, 0.8)
}

fn point(position: Vec3, intensity: f32) -> Light {
    Light::new("lamp", LightKind::Point, Vec3::splat(intensity)).aimed(position, Vec3::ZERO)
}

/// A small picture, whose values [`picture`] checks to be finite.
fn render(gpu: &Gpu, scene: &Scene, camera: &Camera) -> Vec<f32> {
    picture(
        &mut tracer(gpu, scene, [8, 8], &Settings::default()),
        camera,
        4,
        1,
    )
}

fn refused(gpu: &Gpu, scene: &Scene, size: [u32; 2], settings: &Settings) -> LightingError {
    match PathTracer::new(gpu, scene, size, settings) {
        Ok(_) => panic!("{size:?} {settings:?} was not refused"),
        Err(error) => error,
    }
}

fn ball(material: Material) -> Scene {
    let mut scene = Scene::new("ball");
    place(&mut scene, sphere(1.0, 8), material);
    scene
}

#[test]
fn nothing_to_see_is_black() {
    let Some(gpu) = gpu() else { return };
    let is_black = |scene: &Scene| {
        render(&gpu, scene, &looking_down())
            .iter()
            .all(|&v| v == 0.0)
    };
    assert!(is_black(&Scene::new("nothing at all")));
    assert!(is_black(&floor(1.0)), "no light");
    let mut lit = lit_by(Scene::new("a light alone"), point(Vec3::Y, 1.0));
    assert!(is_black(&lit));
    let empty = lit.add_mesh(Mesh::default());
    let material = lit.add_material(Material::emitter("", Vec3::ONE));
    lit.add_instance("no triangle", empty, material, Mat4::IDENTITY);
    assert!(is_black(&lit));
}

#[test]
fn what_is_not_finite_is_refused() {
    let Some(gpu) = gpu() else { return };
    let settings = Settings::default();
    type Sabotage = fn(&mut Scene, f32);
    let cases: [(&str, Sabotage); 9] = [
        ("vertex 2", |scene, value| {
            Arc::make_mut(&mut scene.meshes[0]).positions[2].y = value
        }),
        ("light", |scene, value| scene.lights[0].intensity.x = value),
        ("light", |scene, value| {
            scene.lights[0].world_from_light.w_axis.x = value
        }),
        ("light", |scene, value| scene.lights[0].radius = value),
        ("emission", |scene, value| {
            scene.materials[0].emissive.z = value
        }),
        ("transform", |scene, value| {
            scene.instances[0].world_from_mesh.x_axis.y = value
        }),
        ("environment", |scene, value| {
            if let Some(sky) = &mut scene.environment {
                sky.intensity = value;
            }
        }),
        ("environment", |scene, value| {
            if let Some(sky) = &mut scene.environment {
                sky.rotation.x = value;
            }
        }),
        ("reflects", |scene, value| {
            scene.materials[0].base_color.y = value
        }),
    ];
    for (part, sabotage) in cases {
        for value in [f32::NAN, f32::INFINITY] {
            let mut scene = lit_by(floor(1.0), point(Vec3::Y, 1.0));
            scene.environment = Some(white());
            sabotage(&mut scene, value);
            let error = refused(&gpu, &scene, [8, 8], &settings);
            assert!(
                matches!(error, LightingError::Gpu(GpuError::Input { .. })),
                "{error:?}"
            );
            let message = error.to_string();
            assert!(message.contains(part), "{part}: {message}");
        }
    }
    let mut scene = floor(1.0);
    scene.environment = Some(gpugi_scene::Environment {
        intensity: -1.0,
        ..white()
    });
    let error = refused(&gpu, &scene, [8, 8], &settings).to_string();
    assert!(error.contains("intensity -1"), "{error}");
    // One bad texel among good ones.
    for value in [f32::NAN, f32::INFINITY] {
        let mut scene = floor(1.0);
        scene.environment = Some(super::environment(2, &[Vec3::ONE, vec3(1.0, value, 1.0)]));
        let error = refused(&gpu, &scene, [8, 8], &settings).to_string();
        assert!(error.contains("texel 1"), "{error}");
    }
}

/// Large but finite numbers, whose squares and sums are infinite.
#[test]
fn huge_light_stays_finite() {
    let Some(gpu) = gpu() else { return };
    for radiance in [1e25, 3e38] {
        let mut scene = lit_by(floor(1.0), point(Vec3::Y * 1e-3, radiance));
        place(
            &mut scene,
            quad(vec3(0.1, 1.0, 0.1), Vec3::X, Vec3::Z, 1),
            Material::emitter("", Vec3::splat(radiance)),
        );
        let mut tracer = tracer(&gpu, &scene, [8, 8], &Settings::default());
        let picture = picture(&mut tracer, &from_above(1.0, 3.0), 32, 1);
        assert!(picture.iter().any(|&value| value > 1e10));
        let noise = tracer.noise().expect("noise");
        assert!(noise.is_finite(), "{radiance}: {noise}");
    }
}

#[test]
fn degenerate_geometry_stays_finite() {
    let Some(gpu) = gpu() else { return };
    let mut scene = lit_by(floor(2.0), point(vec3(0.5, 2.0, 0.5), 3.0));
    scene.environment = Some(white());
    let mut line = quad(vec3(0.0, 1.0, 0.0), Vec3::X, Vec3::X * 0.5, 2);
    line.normals.fill(Vec3::Y);
    place(
        &mut scene,
        line.clone(),
        Material::emitter("line", Vec3::ONE),
    );
    place(&mut scene, line, Material::matt("line", Vec3::ONE));
    let ball = scene.add_mesh(sphere(0.3, 6));
    let grey = scene.add_material(Material::matt("grey", Vec3::splat(0.5)));
    let lamp = scene.add_material(Material::emitter("lamp", Vec3::ONE));
    for material in [grey, lamp] {
        for scale in [
            vec3(1.0, 0.0, 1.0),
            vec3(1.0, 0.0, 0.0),
            Vec3::ZERO,
            Vec3::splat(1e-20),
        ] {
            let place = Mat4::from_translation(Vec3::Y) * Mat4::from_scale(scale);
            scene.add_instance("singular", ball, material, place);
        }
    }
    // Lights on a surface, at a corner, in the eye; without range, and large.
    for position in [Vec3::ZERO, vec3(2.0, 0.0, 2.0), vec3(0.0, 3.0, 3.0)] {
        scene.lights.push(point(position, 1.0));
        scene.lights.push(Light {
            radius: 0.5,
            range: Some(0.0),
            ..point(position, 1.0)
        });
    }
    scene.lights.push(Light {
        radius: 10.0,
        ..Light::new("", LightKind::Directional, Vec3::ONE)
    });
    let radiance = render(&gpu, &scene, &looking_down());
    assert!(radiance.iter().any(|&value| value > 0.0));

    // Extreme scales of the whole scene.
    for scale in [1e-9, 1e9] {
        let mut scene = floor(scale);
        scene.environment = Some(white());
        let seen = render(&gpu, &scene, &from_above(scale, scale * 3.0));
        // Albedo 0.5 under a white sky.
        let mean = seen.iter().sum::<f32>() / seen.len() as f32;
        assert!((mean - 0.5).abs() < 0.05, "scale {scale}: {mean}");
    }
}

#[test]
fn the_eye_may_be_anywhere() {
    let Some(gpu) = gpu() else { return };
    let inside = Camera::look_at("", vec3(0.1, 0.2, 0.1), vec3(0.3, 0.2, -1.0), 1.0);
    let glass = Material {
        transmission: 1.0,
        roughness: 0.0,
        volume: Some(Volume {
            attenuation_distance: 1.0,
            attenuation_color: Vec3::splat(0.5),
        }),
        ..Material::default()
    };
    let mean = |scene: &mut Scene| {
        scene.environment = Some(white());
        let picture = render(&gpu, scene, &inside);
        picture.iter().sum::<f32>() / picture.len() as f32
    };
    // From inside a single-sided ball, one sees as if it were not there; from inside a double-sided one, its inner
    // side.
    assert_eq!(mean(&mut ball(Material::matt("", Vec3::splat(0.5)))), 1.0);
    let closed = Material {
        double_sided: true,
        ..Material::matt("", Vec3::splat(0.5))
    };
    assert_eq!(mean(&mut ball(closed)), 0.0);
    // From inside glass, one sees the sky, brighter by the square of the index, minus what a metre absorbs and what is
    // reflected back.
    let seen = mean(&mut ball(glass));
    assert!((0.9..1.4).contains(&seen), "{seen}");
    // On a surface, on a corner, on a light.
    let mut scene = lit_by(floor(1.0), point(Vec3::Y, 1.0));
    place(
        &mut scene,
        cuboid(Vec3::ZERO, Vec3::ONE, 1),
        Material::default(),
    );
    for eye in [Vec3::ZERO, Vec3::ONE, Vec3::Y] {
        render(
            &gpu,
            &scene,
            &Camera::look_at("", eye, eye + vec3(0.3, -1.0, 0.2), 2.0),
        );
    }
}

#[test]
fn sizes_are_checked() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(1.0);
    scene.environment = Some(white());
    let settings = Settings::default();
    let one = picture(
        &mut tracer(&gpu, &scene, [1, 1], &settings),
        &from_above(1.0, 2.0),
        256,
        1,
    );
    assert!((one[0] - 0.5).abs() < 0.03, "{one:?}");
    for size in [[0, 0], [0, 5], [5, 0]] {
        let error = refused(&gpu, &scene, size, &settings).to_string();
        assert!(
            error.contains(&format!("{} x {}", size[0], size[1])),
            "{error}"
        );
    }
    for size in [[4_000_000, 4_000_000], [u32::MAX, u32::MAX], [u32::MAX, 64]] {
        let started = Instant::now();
        let error = refused(&gpu, &scene, size, &settings);
        assert!(
            matches!(
                error,
                LightingError::Gpu(GpuError::TooLarge { .. } | GpuError::OutOfMemory { .. })
            ),
            "{error:?}"
        );
        // A driver that finds no memory says nothing of sizes.
        let message = error.to_string();
        let what = match error {
            LightingError::Gpu(GpuError::OutOfMemory { .. }) => "a smaller --size".to_owned(),
            _ => size[0].to_string(),
        };
        assert!(message.contains(&what), "{message}");
        // A GPU with 139 GiB, on which other tests run, has taken 21 s to find that it has too little.
        assert!(started.elapsed().as_secs() < 60);
    }
}

#[test]
fn hostile_settings_are_refused() {
    let Some(gpu) = gpu() else { return };
    let scene = floor(1.0);
    let many = "(L|D)?".repeat(10_000);
    let deep = "(".repeat(100_000);
    let counts = "(((L{32}){32}){32}){32}";
    let blown_up = format!("L.*D{}E", ".".repeat(500));
    for paths in [
        "", "(", "X", "L**E{", "[", "L\u{0}E", "[z-a]", &many, &deep, counts, &blown_up,
    ] {
        let started = Instant::now();
        let settings = Settings {
            paths: paths.to_owned(),
            ..Settings::default()
        };
        // An error, or no such paths; both quickly.
        match PathTracer::new(&gpu, &scene, [4, 4], &settings) {
            Ok(mut tracer) => drop(picture(&mut tracer, &looking_down(), 1, 1)),
            Err(error) => {
                assert!(matches!(error, LightingError::Setting { .. }), "{error:?}");
                assert!(error.to_string().len() < 100_200 + paths.len(), "{error}");
            }
        }
        assert!(
            started.elapsed().as_secs() < 5,
            "{} characters",
            paths.len()
        );
        let mut settings = Settings::default();
        let before = settings.clone();
        if settings.set("paths", paths).is_err() {
            assert_eq!(settings, before, "a refused value changed something");
        }
    }
    for lights in ["", ",", "sun", "area,,punctual", "Area"] {
        let settings = Settings {
            lights: lights.to_owned(),
            ..Settings::default()
        };
        let error = refused(&gpu, &scene, [4, 4], &settings).to_string();
        assert!(
            error.contains("punctual, area, environment"),
            "{lights:?}: {error}"
        );
        assert!(Settings::default().set("lights", lights).is_err());
    }
    for (name, value) in [
        ("max-bounces", "-1"),
        ("max-bounces", "4097"),
        ("max-bounces", "nan"),
        ("roulette-after", "0"),
        ("noise", "-1"),
        ("noise", "inf"),
        ("noise", "NaN"),
        ("what", "1"),
    ] {
        assert!(
            Settings::default().set(name, value).is_err(),
            "{name}={value}"
        );
    }
    // No bounce, all bounces, a class named twice.
    for (name, value) in [
        ("max-bounces", "0"),
        ("max-bounces", "4096"),
        ("lights", " area , area "),
    ] {
        let mut settings = Settings::default();
        settings.set(name, value).expect("a good value");
        picture(
            &mut tracer(&gpu, &scene, [4, 4], &settings),
            &looking_down(),
            1,
            1,
        );
    }
}

#[test]
fn a_million_lights() {
    let Some(gpu) = gpu() else { return };
    let mut scene = floor(2.0);
    // On a plane, evenly bright: E = sum of I cos / d^2, nearly pi I / A, that of a closed sky, below the middle of a
    // wide plane.
    const SIDE: u32 = 1000;
    let light = point(Vec3::Y, 1e-6);
    scene.lights = vec![light; (SIDE * SIDE) as usize];
    for (at, light) in scene.lights.iter_mut().enumerate() {
        let (x, z) = (at as u32 % SIDE, at as u32 / SIDE);
        let along = |k: u32| (k as f32 + 0.5) / SIDE as f32 * 2.0 - 1.0;
        light.world_from_light.w_axis = vec3(along(x), 1.0, along(z)).extend(1.0);
    }
    let started = Instant::now();
    let made = tracer(&gpu, &scene, [16, 16], &bounces(1));
    println!(
        "a million lights: ready after {:.2} s",
        started.elapsed().as_secs_f64()
    );
    drop(made);
    let batches = super::trace(
        &gpu,
        &scene,
        &from_above(0.02, 3.0),
        [16, 16],
        16,
        &bounces(1),
    );
    println!(
        "a million lights: {:.2} s in all",
        started.elapsed().as_secs_f64()
    );
    // Under the middle of the square of 2 m: int cos / d^2 = int y / d^3 over it, the solid angle of the square.
    let solid_angle = 4.0 * (1.0_f64 / (2.0 * 2.0_f64).sqrt()).asin();
    let expected = 0.5 / std::f64::consts::PI * solid_angle / 4.0;
    batches.mean().check(
        "a million lights",
        glam::DVec3::splat(expected),
        0.01 * expected,
    );
}

#[test]
fn more_than_a_million_emissive_triangles() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::new("lamps");
    let lamps = quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0, 40);
    let mesh = scene.add_mesh(lamps);
    let material = scene.add_material(Material::emitter("", Vec3::ONE));
    for row in 0..469 {
        let place = Mat4::from_translation(Vec3::NEG_Y * row as f32);
        scene.add_instance("lamps", mesh, material, place);
    }
    assert!(scene.statistics().emissive_triangles > 1_500_000);
    let started = Instant::now();
    match PathTracer::new(&gpu, &scene, [8, 8], &bounces(1)) {
        Ok(mut tracer) => {
            let camera = from_above(1.0, 3.0);
            let picture = picture(&mut tracer, &camera, 2, 1);
            assert!(
                picture.iter().all(|&value| value == 1.0 || value == 0.0),
                "{picture:?}"
            );
        }
        Err(error) => {
            let is_clear = matches!(error, LightingError::Gpu(GpuError::TooLarge { .. }));
            assert!(is_clear, "{error:?}");
            println!("{error}");
        }
    }
    println!(
        "1.5 million lamps: {:.2} s",
        started.elapsed().as_secs_f64()
    );
}
