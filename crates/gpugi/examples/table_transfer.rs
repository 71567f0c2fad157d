//! Prints the error of radiance-transfer under blurred environments: a table for docs/techniques/radiance-transfer.md.
//!
//! `cargo run --release --example table_transfer -- [technique.key=value ...] SCENE ... ENVIRONMENT.exr ...`: scenes are
//! files, or `skylight`, a room under a hole in its ceiling. Each environment is blurred by a von Mises-Fisher lobe,
//! and the last one is shown once more, turned by 100 degrees.

use std::error::Error;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use glam::{Mat4, Vec3, vec3};
use gpugi::Renderer;
use gpugi::gpu::{AdapterChoice, Gpu};
use gpugi::measure::{Options, Quality, measure};
use gpugi_scene::builtin::builtin;
use gpugi_scene::builtin::shapes::quad;
use gpugi_scene::image::metrics::Metric;
use gpugi_scene::{
    Camera, Environment, Image, Limits, Material, Pixels, Scene, import_environment, import_file,
};

const OF: &str = "radiance-transfer";
const SIZE: [u32; 2] = [64, 48];
/// Samples per pixel of the technique, and of the path tracer.
const SAMPLES: u32 = 16;
const REFERENCE_SAMPLES: u32 = 4096;
/// Standard deviation of the blur (degrees).
const BLUR: f32 = 20.0;
/// Width of the blurred maps, and of what is summed for them (texels).
const WIDTH: u32 = 64;
const SOURCE_WIDTH: u32 = 128;

/// The room without its ceiling, its mirror and its lamps, under a ceiling with a hole of 2 x 2 m.
fn skylight() -> Result<Scene, Box<dyn Error>> {
    let mut scene = builtin("room", 1).ok_or("there is a room")?;
    scene.remove("ceiling,sphere,spot,fill")?;
    let material = scene.add_material(Material::matt("ceiling", Vec3::splat(0.75)));
    let strips = [
        (
            vec3(-2.0, 3.0, -2.0),
            vec3(4.0, 0.0, 0.0),
            vec3(0.0, 0.0, 1.0),
        ),
        (
            vec3(-2.0, 3.0, 1.0),
            vec3(4.0, 0.0, 0.0),
            vec3(0.0, 0.0, 1.0),
        ),
        (
            vec3(-2.0, 3.0, -1.0),
            vec3(1.0, 0.0, 0.0),
            vec3(0.0, 0.0, 2.0),
        ),
        (
            vec3(1.0, 3.0, -1.0),
            vec3(1.0, 0.0, 0.0),
            vec3(0.0, 0.0, 2.0),
        ),
    ];
    for (corner, right, up) in strips {
        let mesh = scene.add_mesh(quad(corner, right, up, 2));
        scene.add_instance("ceiling", mesh, material, Mat4::IDENTITY);
    }
    Ok(scene)
}

/// Directions and solid angles of the texels of an image that is twice as wide as high.
fn texels(width: u32) -> impl Iterator<Item = (Vec3, f32)> {
    let height = width / 2;
    let step = std::f32::consts::PI / height as f32;
    (0..width * height).map(move |index| {
        let phi = step * ((index % width) as f32 + 0.5) - std::f32::consts::PI;
        let row = index / width;
        let theta = step * (row as f32 + 0.5);
        let (sine, cosine) = theta.sin_cos();
        let direction = vec3(phi.sin() * sine, cosine, -phi.cos() * sine);
        let solid_angle = step * ((step * row as f32).cos() - (step * (row + 1) as f32).cos());
        (direction, solid_angle)
    })
}

/// The mean of an image over the texels of a smaller one, both twice as wide as high.
fn shrunk(image: &Image) -> Result<Vec<Vec3>, Box<dyn Error>> {
    let Pixels::Rgba32Float(pixels) = &image.pixels else {
        return Err("environments are read as floats".into());
    };
    let factor = image.width / SOURCE_WIDTH;
    if factor == 0 || image.width != factor * SOURCE_WIDTH || image.height * 2 != image.width {
        return Err(format!(
            "{} x {} texels: a multiple of {SOURCE_WIDTH} x {}",
            image.width,
            image.height,
            SOURCE_WIDTH / 2
        )
        .into());
    }
    let mut sums = vec![Vec3::ZERO; (SOURCE_WIDTH * SOURCE_WIDTH / 2) as usize];
    for (index, pixel) in pixels.as_chunks::<4>().0.iter().enumerate() {
        let (x, y) = (
            index as u32 % image.width / factor,
            index as u32 / image.width / factor,
        );
        sums[(y * SOURCE_WIDTH + x) as usize] += Vec3::from_slice(pixel) / (factor * factor) as f32;
    }
    Ok(sums)
}

/// Convolves with exp((cos - 1) / s^2).
fn blurred(environment: &Environment) -> Result<Environment, Box<dyn Error>> {
    let variance = BLUR.to_radians().powi(2);
    let source: Vec<_> = texels(SOURCE_WIDTH)
        .zip(shrunk(&environment.image)?)
        .collect();
    let pixels = texels(WIDTH).flat_map(|(direction, _)| {
        let mut sum = Vec3::ZERO.extend(0.0);
        for &((from, solid_angle), radiance) in &source {
            let weight = solid_angle * ((direction.dot(from) - 1.0) / variance).exp();
            sum += weight * radiance.extend(1.0);
        }
        (sum / sum.w).to_array()
    });
    Ok(Environment {
        image: Arc::new(Image {
            name: environment.image.name.clone(),
            width: WIDTH,
            height: WIDTH / 2,
            pixels: Pixels::Rgba32Float(pixels.collect()),
        }),
        ..environment.clone()
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let limits = Limits::default();
    let (mut scenes, mut environments, mut settings) = (Vec::new(), Vec::new(), Vec::new());
    for argument in std::env::args().skip(1) {
        let path = Path::new(&argument);
        let name = path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        if let Some((key, value)) = argument.split_once('=') {
            settings.push((key.to_owned(), value.to_owned()));
        } else if argument == "skylight" {
            scenes.push((name, skylight()?));
        } else if argument.ends_with(".exr") {
            environments.push((name, blurred(&import_environment(path, &limits)?)?));
        } else {
            scenes.push((name, import_file(path, &limits)?));
        }
    }
    if let Some((name, last)) = environments.last() {
        let rotation = glam::Quat::from_rotation_y(100_f32.to_radians());
        let turned = Environment {
            rotation,
            ..last.clone()
        };
        environments.push((format!("{name}, turned"), turned));
    }
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    let options = Options {
        samples: SAMPLES,
        reference: Quality {
            samples: REFERENCE_SAMPLES,
            noise: 2e-4,
        },
        ..Options::default()
    };
    println!(
        "| scene | environment, blurred | rel-mse | rel-mse-4 | flip | reference |\n|---|---|---|---|---|---|"
    );
    for (scene_name, mut scene) in scenes {
        let framing = || Camera::framing(&scene.bounds(), SIZE[0] as f32 / SIZE[1] as f32);
        let camera = scene.cameras.first().cloned().unwrap_or_else(framing);
        scene.environment = environments.first().map(|(_, first)| first.clone());
        let mut renderer = Renderer::new(&gpu, &scene, SIZE, &[OF.to_owned()])?;
        for (key, value) in &settings {
            renderer.set(OF, key, value)?;
        }
        for (name, environment) in &environments {
            scene.environment = Some(environment.clone());
            renderer.update(&scene)?;
            let mut go_on = |_: &_| ControlFlow::Continue(());
            let measured = measure(&gpu, &scene, &camera, &mut renderer, &options, &mut go_on)?;
            let value = |metric| measured.value(metric).unwrap_or(f64::NAN);
            println!(
                "| {scene_name} | {name} | {:.1e} | {:.1e} | {:.3} | {:.0e} |",
                value(Metric::RelMse),
                value(Metric::RelMse4),
                value(Metric::Flip),
                measured.truth.rel_mse(),
            );
        }
    }
    Ok(())
}
