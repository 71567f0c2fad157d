//! The same direct light computed in two ways that share neither visibility nor sampling: by shadow maps and by paths.

use glam::{Vec3, vec3};
use gpugi::gpu::Gpu;
use gpugi::reference::Settings;
use gpugi_scene::builtin::shapes::{cuboid, quad, sphere};
use gpugi_scene::image::metrics::rel_mse;
use gpugi_scene::{Camera, Light, LightKind, Material, Scene};

use super::{picture, tracer};
use crate::common::{floor, gpu, lit_by, place, renderer};

const SIZE: u32 = 64;

/// A floor with a matt box and a glossy ball.
fn furnished() -> Scene {
    let mut scene = floor(2.0);
    let grey = Material::matt("box", vec3(0.5, 0.4, 0.3));
    place(
        &mut scene,
        cuboid(vec3(-0.7, 0.0, -0.3), vec3(-0.2, 0.6, 0.3), 1),
        grey,
    );
    let glossy = Material {
        roughness: 0.5,
        ..Material::default()
    };
    let mut ball = sphere(0.35, 32);
    for position in &mut ball.positions {
        *position += vec3(0.5, 0.35, 0.1);
    }
    place(&mut scene, ball, glossy);
    scene
}

fn eye() -> Camera {
    Camera::look_at("", vec3(0.4, 2.2, 2.4), vec3(0.0, 0.2, 0.0), 0.75)
}

/// Direct light by shadow maps, and the light that needs no lighting technique: 16 samples per pixel.
fn rasterized(gpu: &Gpu, scene: &Scene, settings: &[&str]) -> Vec<f32> {
    let mut renderer = renderer(gpu, scene, SIZE, settings);
    for _ in 0..16 {
        renderer
            .render_sample(&eye(), 16, None, false)
            .expect("a sample");
    }
    renderer.radiance().expect("radiance")
}

fn traced(gpu: &Gpu, scene: &Scene, samples: u32) -> Vec<f32> {
    let settings = Settings {
        max_bounces: 1,
        paths: "L[DG]E|LE".to_owned(),
        ..Settings::default()
    };
    picture(
        &mut tracer(gpu, scene, [SIZE; 2], &settings),
        &eye(),
        samples,
        3,
    )
}

/// Pixels whose neighbourhoods in the reference differ by less than a factor: no edge of a shadow or of an object.
fn smooth(reference: &[f32]) -> Vec<bool> {
    let side = SIZE as i32;
    let at = |x: i32, y: i32| {
        let (x, y) = (x.clamp(0, side - 1), y.clamp(0, side - 1));
        reference[((y * side + x) * 3 + 1) as usize]
    };
    (0..side * side)
        .map(|pixel| {
            let (x, y) = (pixel % side, pixel / side);
            let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy)));
            let (low, high) = around
                .map(|(dx, dy)| at(x + dx, y + dy))
                .fold((f32::MAX, 0.0_f32), |(low, high), value| {
                    (low.min(value), high.max(value))
                });
            high <= 1.25 * low + 1e-3
        })
        .collect()
}

/// The relative error over the chosen pixels.
fn error(a: &[f32], b: &[f32], chosen: &[bool]) -> f64 {
    let pixels = a.chunks(3).zip(b.chunks(3)).zip(chosen);
    let pairs = pixels
        .filter(|(_, chosen)| **chosen)
        .flat_map(|((a, b), _)| a.iter().copied().zip(b.iter().copied()));
    rel_mse(pairs)
}

#[test]
fn punctual_lights_agree_with_shadow_maps() {
    let Some(gpu) = gpu() else { return };
    let spot = LightKind::Spot {
        inner_cone_angle: 0.6,
        outer_cone_angle: 0.8,
    };
    for (kind, intensity) in [
        (LightKind::Point, 8.0),
        (spot, 12.0),
        (LightKind::Directional, 2.0),
    ] {
        let light = Light::new("", kind, Vec3::splat(intensity));
        let light = light.aimed(vec3(1.2, 2.4, 0.9), Vec3::ZERO);
        let scene = lit_by(furnished(), light);
        let reference = traced(&gpu, &scene, 64);
        let chosen = smooth(&reference);
        let left = chosen.iter().filter(|&&chosen| chosen).count();
        let technique = rasterized(&gpu, &scene, &["shadow-map.resolution=1024"]);
        let found = error(&technique, &reference, &chosen);
        let off = error(&vec![0.0; reference.len()], &reference, &chosen);
        println!("{kind:?}: rel-mse {found} over {left} pixels, without the light {off}");
        assert!(left > chosen.len() * 3 / 5, "only {left} pixels are smooth");
        assert!(found < 0.002, "{kind:?}: rel-mse {found}");
        assert!(
            off > 50.0 * found && off > 0.3,
            "{kind:?}: {off} without the light"
        );
    }
}

#[test]
fn area_lights_agree_with_shadow_maps() {
    let Some(gpu) = gpu() else { return };
    let mut scene = furnished();
    let lamp = quad(vec3(0.2, 2.0, -0.6), Vec3::X * 0.8, Vec3::Z * 0.8, 1);
    place(
        &mut scene,
        lamp,
        Material::emitter("lamp", vec3(6.0, 5.0, 4.0)),
    );
    let reference = traced(&gpu, &scene, 256);
    let chosen = vec![true; (SIZE * SIZE) as usize];
    let technique = rasterized(&gpu, &scene, &["shadow-map.area-samples=256"]);
    let found = error(&technique, &reference, &chosen);
    let off = error(&vec![0.0; reference.len()], &reference, &chosen);
    println!("area: rel-mse {found} of all pixels, without the light {off}");
    assert!(found < 0.005, "rel-mse {found}");
    assert!(off > 50.0 * found);
}
