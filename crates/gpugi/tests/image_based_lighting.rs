//! image-based-lighting against environments whose light is known.

mod common;

use std::f32::consts::{FRAC_PI_2, PI};

use common::{floor, from_above, gpu, place, render};
use glam::{Vec3, vec3};
use gpugi_scene::builtin::shapes::{cuboid, sphere};
use gpugi_scene::{Environment, Image, Material, Pixels, Scene};

const WIDTH: usize = 64;
const HEIGHT: usize = 32;

fn environment(texel: impl Fn(usize, usize) -> f32) -> Environment {
    let value = |index: usize| texel(index % WIDTH, index / WIDTH);
    Environment {
        image: Image {
            name: "environment".into(),
            width: WIDTH as u32,
            height: HEIGHT as u32,
            pixels: Pixels::Rgba32Float(
                (0..WIDTH * HEIGHT)
                    .flat_map(|index| [value(index), value(index), value(index), 1.0])
                    .collect(),
            ),
        },
        rotation: 0.0,
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

/// Mean position of what a sun of one texel leaves dark around a post.
fn shadow_of_a_post(gpu: &gpugi::gpu::Gpu, rotation: f32) -> Vec3 {
    let mut scene = floor(3.0);
    place(
        &mut scene,
        cuboid(vec3(-0.1, 0.0, -0.1), vec3(0.1, 1.0, 0.1), 1),
        Material::matt("post", Vec3::splat(0.5)),
    );
    // Due +X, 45 degrees high.
    let mut sky = environment(|x, y| if (x, y) == (48, 8) { 1000.0 } else { 0.0 });
    sky.rotation = rotation;
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
        // The sun stands where rotation about +Y takes +X; the shadow lies opposite.
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
    // A single texel is as bright all around.
    let mut tiny = environment(|_, _| 0.0);
    tiny.image.width = 1;
    tiny.image.height = 1;
    tiny.image.pixels = Pixels::Rgba32Float(vec![3.0, 3.0, 3.0, 1.0]);
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
