//! image-based-lighting against environments whose light is known.

use std::sync::Arc;

use std::f32::consts::{FRAC_PI_2, PI};

use crate::common::{floor, from_above, gpu, measured, place, render};
use glam::{Vec3, vec3};
use gpugi::Renderer;
use gpugi::gpu::Gpu;
use gpugi_scene::builtin::shapes::{self, cuboid, sphere};
use gpugi_scene::image::metrics::Metric;
use gpugi_scene::{
    Camera, Environment, Image, Light, LightKind, Material, MaterialModel, Pixels, Scene,
};

const WIDTH: usize = 64;
const HEIGHT: usize = 32;

fn environment(texel: impl Fn(usize, usize) -> f32) -> Environment {
    let value = |index: usize| texel(index % WIDTH, index / WIDTH);
    Environment {
        image: Arc::new(Image {
            name: "environment".into(),
            width: WIDTH as u32,
            height: HEIGHT as u32,
            pixels: Pixels::Rgba32Float(
                (0..WIDTH * HEIGHT)
                    .flat_map(|index| [value(index), value(index), value(index), 1.0])
                    .collect(),
            ),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    }
}

/// Solid angle of a texel [sr].
fn solid_angle(row: usize) -> f32 {
    let edge = |row: usize| (PI * row as f32 / HEIGHT as f32).cos();
    2.0 * PI / WIDTH as f32 * (edge(row) - edge(row + 1))
}

fn under(mut scene: Scene, environment: Environment) -> Scene {
    scene.environment = Some(environment);
    scene
}

#[test]
fn a_white_sky_gives_white_its_albedo() {
    let Some(gpu) = gpu() else { return };
    let plane = under(floor(2.0), environment(|_, _| 3.0));
    let picture = render(&gpu, &plane, &from_above(3.0, 1.0), 32, &[]);
    let worst = picture
        .lit()
        .map(|lit| (lit.radiance.x / 1.5 - 1.0).abs())
        .fold(0.0, f32::max);
    println!("plane: largest relative error {worst}");
    assert!(worst < 0.02, "{worst}");

    let mut ball = Scene::new("ball");
    place(
        &mut ball,
        sphere(1.0, 48),
        Material::matt("white", Vec3::ONE),
    );
    let picture = render(
        &gpu,
        &under(ball, environment(|_, _| 3.0)),
        &from_above(1.6, 3.0),
        48,
        &[],
    );
    let mean = picture.lit().map(|lit| lit.radiance.x).sum::<f32>() / picture.lit().count() as f32;
    let worst = picture
        .lit()
        .map(|lit| (lit.radiance.x / 3.0 - 1.0).abs())
        .fold(0.0, f32::max);
    println!("sphere: mean {mean} of 3, largest relative error {worst}");
    assert!((mean / 3.0 - 1.0).abs() < 0.02, "{mean}");
    assert!(worst < 0.1, "{worst}");
}

/// Mean position of what a one-texel sun leaves dark around a post.
fn shadow_of_a_post(gpu: &gpugi::gpu::Gpu, rotation: f32) -> Vec3 {
    let mut scene = floor(3.0);
    place(
        &mut scene,
        cuboid(vec3(-0.1, 0.0, -0.1), vec3(0.1, 1.0, 0.1), 1),
        Material::matt("post", Vec3::splat(0.5)),
    );
    // Due +X, 45 degrees high.
    let mut sky = environment(|x, y| if (x, y) == (48, 8) { 1000.0 } else { 0.0 });
    sky.rotation = glam::Quat::from_rotation_y(rotation);
    let settings = [
        "image-based-lighting.samples=16",
        "image-based-lighting.resolution=1024",
    ];
    let picture = render(
        gpu,
        &under(scene, sky),
        &from_above(4.0, 3.0),
        64,
        &settings,
    );
    let floor = || picture.lit().filter(|lit| lit.instance == 0);
    let brightest = floor().map(|lit| lit.radiance.x).fold(0.0, f32::max);
    let expected = 0.5 / PI * 1000.0 * solid_angle(8) * (PI * 8.5 / HEIGHT as f32).cos();
    assert!(
        (brightest / expected - 1.0).abs() < 0.05,
        "{brightest}, not {expected}"
    );
    let dark: Vec<Vec3> = floor()
        .filter(|lit| lit.radiance.x < 0.5 * brightest)
        .map(|lit| lit.position)
        .collect();
    assert!(dark.len() > 20, "{} dark pixels", dark.len());
    dark.iter().sum::<Vec3>() / dark.len() as f32
}

#[test]
fn turning_the_environment_turns_the_shadow() {
    let Some(gpu) = gpu() else { return };
    for rotation in [0.0, FRAC_PI_2, 2.0] {
        let shadow = shadow_of_a_post(&gpu, rotation);
        // The sun is where rotation about +Y takes +X; the shadow lies opposite.
        let away = -(glam::Mat3::from_rotation_y(rotation - PI / WIDTH as f32) * Vec3::X);
        let angle = shadow.normalize().dot(away).clamp(-1.0, 1.0).acos();
        assert!(
            angle < 0.1,
            "rotation {rotation}: shadow toward {shadow}, not {away}"
        );
        assert!((0.3..0.8).contains(&shadow.length()), "{shadow}");
    }
}

#[test]
fn black_and_dim_skies_are_no_trouble() {
    let Some(gpu) = gpu() else { return };
    let black = render(
        &gpu,
        &under(floor(1.0), environment(|_, _| 0.0)),
        &from_above(3.0, 1.0),
        16,
        &[],
    );
    assert!(black.radiance.iter().all(|&value| value == 0.0));
    // Light from below does not reach the floor's upper side.
    let below = render(
        &gpu,
        &under(
            floor(1.0),
            environment(|_, y| if y > 20 { 1.0 } else { 0.0 }),
        ),
        &from_above(1.0, 1.0),
        16,
        &[],
    );
    assert!(below.lit().all(|lit| lit.radiance == Vec3::ZERO));
    // A single texel is equally bright in all directions.
    let mut tiny = environment(|_, _| 0.0);
    let texel = Arc::make_mut(&mut tiny.image);
    texel.width = 1;
    texel.height = 1;
    texel.pixels = Pixels::Rgba32Float(vec![3.0, 3.0, 3.0, 1.0]);
    let grey = render(
        &gpu,
        &under(floor(1.0), tiny),
        &from_above(1.0, 1.0),
        16,
        &[],
    );
    for lit in grey.lit() {
        assert!((lit.radiance.x / 1.5 - 1.0).abs() < 0.03, "{lit:?}");
    }
}

/// A bright sky with a wide sun.
fn sunny() -> Environment {
    environment(|x, y| {
        let sun = x.abs_diff(20) < 3 && y.abs_diff(8) < 3;
        let height = 1.0 - y as f32 / HEIGHT as f32;
        0.2 + height + if sun { 20.0 } else { 0.0 }
    })
}

fn phong(shininess: f32) -> Material {
    Material {
        name: "phong".into(),
        model: MaterialModel::Phong {
            kd: Vec3::splat(0.2),
            ks: Vec3::splat(0.6),
            shininess,
        },
        ..Material::default()
    }
}

/// A single ball of shininess 100.
fn ball() -> Scene {
    let mut scene = Scene::new("ball");
    place(&mut scene, sphere(1.0, 48), phong(100.0));
    under(scene, sunny())
}

/// A floor with balls of every material model.
fn balls() -> Scene {
    let mut scene = floor(2.0);
    scene.name = "balls".into();
    let copper = Material {
        model: MaterialModel::Conductor {
            n: vec3(0.2, 0.92, 1.1),
            k: vec3(3.9, 2.45, 2.14),
        },
        roughness: 0.4,
        ..Material::default()
    };
    let plastic = Material {
        roughness: 0.3,
        ..Material::matt("plastic", Vec3::splat(0.5))
    };
    let materials = [phong(60.0), copper, plastic];
    for (x, material) in [-1.1, 0.0, 1.1].into_iter().zip(materials) {
        let mut mesh = sphere(0.5, 24);
        for vertex in &mut mesh.positions {
            *vertex += vec3(x, 0.5, 0.0);
        }
        place(&mut scene, mesh, material);
    }
    under(scene, sunny())
}

/// rel-mse against the path tracer on the same light paths.
fn error(gpu: &Gpu, scene: &Scene, technique: &str, settings: &[(&str, &str)]) -> f64 {
    let camera = Camera::look_at("", vec3(0.4, 1.6, 3.2), vec3(0.0, 0.2, 0.0), 0.8);
    let mut renderer =
        Renderer::new(gpu, scene, [32, 32], &[technique.to_owned()]).expect("a renderer");
    for (name, value) in settings {
        renderer.set(technique, name, value).expect("a setting");
    }
    let found = measured(gpu, scene, &camera, &mut renderer, [4, 64]);
    found.value(Metric::RelMse).expect("rel-mse")
}

#[test]
fn reflectivities_are_near_the_truth() {
    let Some(gpu) = gpu() else { return };
    let (ball, balls) = (ball(), balls());
    let of = |scene, samples, reflectivity| {
        let settings = [
            ("samples", samples),
            ("resolution", "256"),
            ("reflectivity", reflectivity),
        ];
        let error = error(&gpu, scene, "image-based-lighting", &settings);
        println!(
            "{}, {samples} samples, {reflectivity}: rel-mse {error:.1e}",
            scene.name
        );
        error
    };
    // A ball does not shadow itself, so all of its error comes from reflectivity. One direction per domain shows as
    // dots.
    assert!(of(&ball, "48", "sample") > 0.1);
    assert!(of(&ball, "48", "lobe") < 0.006);
    assert!(of(&ball, "48", "ratio") < 0.005);
    let found = ["sample", "lobe", "ratio"].map(|reflectivity| of(&balls, "128", reflectivity));
    let [sample, lobe, ratio] = found;
    assert!(sample < 0.015 && lobe < 0.014 && ratio < 0.017, "{found:?}");
    // Without shadows.
    let without = error(&gpu, &balls, "environment-map", &[]);
    println!("balls without shadows: rel-mse {without:.1e}");
    assert!(without > 4.0 * lobe.max(ratio), "{without}");
}

/// A closed room of quads without thickness that face inward: 400 units wide, 260 high, 500 long.
fn closed_room() -> Scene {
    let mut scene = Scene::new("closed room");
    let (low, high) = (vec3(-200.0, 0.0, -250.0), vec3(200.0, 260.0, 250.0));
    let size = high - low;
    let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
    for (corner, right, up) in [
        (low.with_z(high.z), x, -z),
        (low.with_y(high.y), x, z),
        (low, x, y),
        (high.with_y(low.y), -x, y),
        (low.with_z(high.z), -z, y),
        (low.with_x(high.x), z, y),
    ] {
        let mesh = shapes::quad(corner, right, up, 1);
        place(&mut scene, mesh, Material::matt("white", Vec3::ONE));
    }
    scene
}

#[test]
fn walls_without_thickness_keep_light_out() {
    let Some(gpu) = gpu() else { return };
    // Radiance 1 from everywhere: a white surface outside has radiance 1.
    let scene = under(closed_room(), environment(|_, _| 1.0));
    let middle = vec3(0.0, 130.0, 0.0);
    let mut leaks = Vec::new();
    for toward in [vec3(-1.0, -0.6, -1.0), vec3(1.0, 0.6, 0.9)] {
        let camera = Camera::look_at("", middle - toward * 100.0, middle + toward, 1.9);
        let picture = render(&gpu, &scene, &camera, 128, &[]);
        leaks.extend(picture.lit().map(|lit| lit.radiance.x));
    }
    let mean = leaks.iter().sum::<f32>() / leaks.len() as f32;
    let most = leaks.iter().copied().fold(0.0, f32::max);
    println!("of the light outside, {mean} on average, at most {most}");
    assert!(mean < 1e-4 && most < 0.1, "{mean}, at most {most}");
}

/// A box that sees the sky through one side, which a pane of thin glass closes.
fn glazed(pane: Material) -> Scene {
    let mut scene = Scene::new("glazed");
    let sides = [
        (vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0),
        (vec3(-1.0, 2.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0),
        (vec3(-1.0, 0.0, -1.0), Vec3::X * 2.0, Vec3::Y * 2.0),
        (vec3(-1.0, 0.0, 1.0), Vec3::NEG_Z * 2.0, Vec3::Y * 2.0),
        (vec3(1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::Y * 2.0),
    ];
    for (corner, right, up) in sides {
        let mesh = shapes::quad(corner, right, up, 1);
        place(&mut scene, mesh, Material::matt("white", Vec3::splat(0.8)));
    }
    let mesh = shapes::quad(vec3(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::Y * 2.0, 1);
    place(&mut scene, mesh, pane);
    under(scene, sunny())
}

#[test]
fn light_passes_windows() {
    let Some(gpu) = gpu() else { return };
    let glass = Material {
        transmission: 1.0,
        roughness: 0.0,
        base_color: vec3(0.7, 0.7, 0.7).extend(1.0),
        ..Material::default()
    };
    let mut scene = glazed(glass);
    // caustics claims the pane, and brings the lamp's light back, but not the sky's.
    let lamp = Light::new("lamp", LightKind::Point, Vec3::splat(1e-6));
    scene.lights.push(lamp.aimed(Vec3::Y, Vec3::ZERO));
    let camera = Camera::look_at("", vec3(0.0, 1.0, 0.9), vec3(0.0, 0.8, -1.0), 1.2);
    let with_caustics = ["image-based-lighting", "caustics"];
    let ratio = share_of_energy(&gpu, &scene, &camera, &with_caustics, "maps");
    println!("behind a window, {ratio} of the path tracer's energy");
    assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
}

/// Energy of a picture as a fraction of the path tracer's.
fn share_of_energy(
    gpu: &Gpu,
    scene: &Scene,
    camera: &Camera,
    techniques: &[&str],
    visibility: &str,
) -> f32 {
    let names: Vec<String> = techniques.iter().map(|&name| name.to_owned()).collect();
    let mut renderer = Renderer::new(gpu, scene, [32, 32], &names).expect("a renderer");
    for (name, value) in [
        ("per-sample", "true"),
        ("resolution", "256"),
        ("visibility", visibility),
    ] {
        renderer.set(&names[0], name, value).expect("a setting");
    }
    let found = measured(gpu, scene, camera, &mut renderer, [32, 256]);
    let energy = |radiance: &[f32]| radiance.iter().sum::<f32>();
    energy(&found.radiance) / energy(&found.truth.radiance)
}

/// Rays leave no light behind walls without thickness, and pass glass as depth maps do.
#[test]
fn rays_find_the_shadows_of_the_sky() {
    let Some(gpu) = gpu() else { return };
    let settings = [("visibility", "rays")];
    // Scenes are uploaded with rays for ray-tracing, which has no object here.
    let names = ["image-based-lighting", "ray-tracing"].map(str::to_owned);
    let room = under(closed_room(), environment(|_, _| 1.0));
    let mut renderer = Renderer::new(&gpu, &room, [128, 128], &names).expect("a renderer");
    for (name, value) in settings {
        renderer.set(&names[0], name, value).expect("a setting");
    }
    let middle = vec3(0.0, 130.0, 0.0);
    let camera = Camera::look_at("", vec3(100.0, 190.0, 100.0), middle, 1.9);
    let inside = crate::common::picture(&mut renderer, &camera);
    assert!(inside.lit().count() > 16_000);
    let most = inside.lit().map(|lit| lit.radiance.max_element());
    assert_eq!(most.fold(0.0, f32::max), 0.0);

    let pane = Material {
        transmission: 1.0,
        roughness: 0.0,
        base_color: vec3(0.9, 0.6, 0.3).extend(1.0),
        ..Material::default()
    };
    let camera = Camera::look_at("", vec3(0.0, 1.0, 0.9), vec3(0.0, 0.8, -1.0), 1.2);
    let names = ["image-based-lighting", "ray-tracing"];
    let ratio = share_of_energy(&gpu, &glazed(pane), &camera, &names, "rays");
    println!("behind a window, {ratio} of the path tracer's energy");
    assert!((ratio - 1.0).abs() < 0.03, "{ratio}");

    // Without a technique that brings rays, the error says which.
    let names = ["image-based-lighting".to_owned()];
    let mut renderer = Renderer::new(&gpu, &room, [8, 8], &names).expect("a renderer");
    renderer
        .set(&names[0], "visibility", "rays")
        .expect("a setting");
    let error = renderer
        .render_sample(&camera, 1, None, false)
        .expect_err("no rays");
    assert!(
        error.to_string().contains("radiosity or ray-tracing"),
        "{error}"
    );
}
