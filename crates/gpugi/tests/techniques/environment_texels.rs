//! Hostile environments with image-based-lighting and environment-map.

use std::sync::Arc;

use std::f32::consts::PI;

use crate::common::{Picture, floor, from_above, gpu, picture, place};
use glam::{Vec3, vec3};
use gpugi::gpu::{Gpu, GpuError};
use gpugi::{LightingError, Renderer};
use gpugi_scene::builtin::shapes::sphere;
use gpugi_scene::{Environment, Image, Material, Pixels, Scene};

/// Image-based-lighting with environment-map for mirrors, and environment-map alone.
const SETS: [&[&str]; 2] = [
    &["image-based-lighting", "environment-map"],
    &["environment-map"],
];

fn environment([width, height]: [u32; 2], texels: Vec<Vec3>) -> Environment {
    let values = texels.iter().flat_map(|texel| texel.extend(1.0).to_array());
    Environment {
        image: Arc::new(Image {
            name: "environment".into(),
            width,
            height,
            pixels: Pixels::Rgba32Float(values.collect()),
        }),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    }
}

/// A matt floor with two balls on it: a mirror and a glossy one.
fn balls(environment: Environment) -> Scene {
    let mut scene = floor(1.0);
    for (x, roughness) in [(-0.5, 0.0), (0.5, 0.3)] {
        let mut ball = sphere(0.4, 16);
        for position in &mut ball.positions {
            *position += vec3(x, 0.5, 0.0);
        }
        place(
            &mut scene,
            ball,
            Material::metal("ball", Vec3::ONE, roughness),
        );
    }
    scene.environment = Some(environment);
    scene
}

fn renderer(gpu: &Gpu, scene: &Scene, names: &[&str]) -> Result<Renderer, LightingError> {
    let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
    let mut renderer = Renderer::new(gpu, scene, [16, 16], &names)?;
    renderer.set("environment-map", "resolution", "16")?;
    renderer.set("environment-map", "samples", "4")?;
    if names.len() > 1 {
        renderer.set("image-based-lighting", "samples", "16")?;
        renderer.set("image-based-lighting", "resolution", "64")?;
    }
    Ok(renderer)
}

/// Pictures of a scene by every set of techniques; [`picture`] checks that radiance is finite.
fn pictures(gpu: &Gpu, scene: &Scene) -> Vec<Picture> {
    let camera = from_above(2.0, 3.0);
    SETS.iter()
        .map(|names| {
            picture(
                &mut renderer(gpu, scene, names).expect("a renderer"),
                &camera,
            )
        })
        .collect()
}

#[test]
fn broken_texels_are_what_the_nearest_light_would_be() {
    let Some(gpu) = gpu() else { return };
    let sky = |repaired: bool| {
        let texel = |index: usize| match (index, repaired) {
            (3, false) => Vec3::NAN,
            (10, false) => Vec3::NEG_INFINITY,
            (17, false) => Vec3::splat(-3.0),
            (3 | 10 | 17, true) => Vec3::ZERO,
            (12, false) => Vec3::INFINITY,
            (13, false) => Vec3::splat(1e30),
            (12, true) => Vec3::splat(65504.0),
            // The largest half float, times the largest scale of texels.
            (13, true) => Vec3::splat(65504.0 * 16384.0),
            _ => Vec3::splat(0.5 + 0.1 * index as f32),
        };
        environment([8, 4], (0..32).map(texel).collect())
    };
    let broken = pictures(&gpu, &balls(sky(false)));
    let repaired = pictures(&gpu, &balls(sky(true)));
    for ((broken, repaired), names) in broken.iter().zip(&repaired).zip(SETS) {
        assert!(repaired.lit().any(|lit| lit.radiance.x > 100.0));
        assert_eq!(broken.radiance, repaired.radiance, "{names:?}");
    }
}

#[test]
fn black_is_black_and_one_texel_is_light_from_everywhere() {
    let Some(gpu) = gpu() else { return };
    for size in [[1, 1], [8, 4]] {
        let texels = vec![Vec3::ZERO; (size[0] * size[1]) as usize];
        for picture in pictures(&gpu, &balls(environment(size, texels))) {
            assert!(picture.radiance.iter().all(|&value| value == 0.0));
        }
    }
    let mut scene = floor(1.0);
    scene.environment = Some(environment([1, 1], vec![vec3(2.0, 1.0, 0.5)]));
    for (picture, names) in pictures(&gpu, &scene).iter().zip(SETS) {
        for lit in picture.lit() {
            let off = lit.radiance / vec3(1.0, 0.5, 0.25) - 1.0;
            assert!(
                off.abs().max_element() < 0.03,
                "{names:?}: {}",
                lit.radiance
            );
        }
    }
}

#[test]
fn a_single_bright_texel_lights_by_its_solid_angle() {
    let Some(gpu) = gpu() else { return };
    const HEIGHT: u32 = 32;
    let (column, row) = (40, 7);
    let texel = |index: u32| {
        let is_bright = (index % 64, index / 64) == (column, row);
        Vec3::splat(if is_bright { 1000.0 } else { 0.0 })
    };
    let mut scene = floor(1.0);
    scene.environment = Some(environment(
        [64, HEIGHT],
        (0..64 * HEIGHT).map(texel).collect(),
    ));
    let edge = |row: u32| (PI * row as f32 / HEIGHT as f32).cos();
    let solid_angle = 2.0 * PI / 64.0 * (edge(row) - edge(row + 1));
    let height = (PI * (row as f32 + 0.5) / HEIGHT as f32).cos();
    let expected = 0.5 / PI * 1000.0 * solid_angle * height;
    for (picture, names) in pictures(&gpu, &scene).iter().zip(SETS) {
        for lit in picture.lit() {
            let off = (lit.radiance / expected - 1.0).abs().max_element();
            assert!(off < 0.02, "{names:?}: {}, not {expected}", lit.radiance);
        }
    }
}

#[test]
fn numbers_that_are_no_intensity_or_angle_are_refused() {
    let Some(gpu) = gpu() else { return };
    let white = || environment([1, 1], vec![Vec3::ONE]);
    let before = balls(white());
    for (intensity, real, part) in [
        (f32::NAN, 1.0, "intensity NaN"),
        (f32::INFINITY, 1.0, "intensity inf"),
        (-1.0, 1.0, "intensity -1"),
        (1.0, f32::NAN, "rotation [0, 0, 0, NaN]"),
        (1.0, 1.5, "rotation [0, 0, 0, 1.5]"),
    ] {
        let scene = balls(Environment {
            intensity,
            rotation: glam::Quat::from_xyzw(0.0, 0.0, 0.0, real),
            ..white()
        });
        for names in SETS {
            let refused = renderer(&gpu, &scene, names).map(|_| ());
            let Err(LightingError::Gpu(GpuError::Input { what })) = refused else {
                panic!("{part}: {refused:?}")
            };
            assert!(what.contains(part), "{what}");
        }
        let mut renderer = renderer(&gpu, &before, SETS[1]).expect("a renderer");
        let refused = renderer.update(&scene);
        assert!(
            matches!(refused, Err(LightingError::Gpu(GpuError::Input { .. }))),
            "{part}"
        );
    }
    let dark = Environment {
        intensity: 0.0,
        ..white()
    };
    for picture in pictures(&gpu, &balls(dark)) {
        assert!(picture.radiance.iter().all(|&value| value == 0.0));
    }
}
