//! Error of frames in motion, without and with temporal anti-aliasing: a table of FLIP against 64 samples of the same
//! techniques, for built-in scenes in orbit. `--size WxH`, `--speed` in degrees per frame, `--interval` between the pixels
//! that a frame lights, `--save` for a folder, names of scenes.

use std::error::Error;
use std::ops::ControlFlow;

use glam::{Mat4, Quat};
use gpugi::gpu::{AdapterChoice, Gpu};
use gpugi::picture::Effects;
use gpugi::{Purpose, Renderer};
use gpugi_scene::builtin::builtin;
use gpugi_scene::image::metrics::{Metric, Picture, compare};
use gpugi_scene::{Camera, Scene};

/// Frames before the one that is measured.
const FRAMES: u32 = 24;
const SAMPLES: u32 = 64;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

fn main() -> Result<()> {
    let mut size = [1280, 1024];
    let mut speed = 0.3;
    let mut names = Vec::new();
    let mut interval = 1;
    let mut save = None;
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        match word.as_str() {
            "--size" => {
                let text = words.next().ok_or("--size WxH")?;
                size = parsed_size(&text).ok_or("--size WxH")?;
            }
            "--speed" => speed = words.next().ok_or("--speed DEGREES")?.parse()?,
            "--interval" => interval = words.next().ok_or("--interval PIXELS")?.parse()?,
            "--save" => save = words.next(),
            _ => names.push(word),
        }
    }
    if names.is_empty() {
        names.extend(["cornell", "room", "spheres", "chamber"].map(str::to_owned));
    }
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    println!("{}, {}x{}", gpu.adapter.name, size[0], size[1]);
    println!("| scene | one sample | averaged | ratio |");
    println!("|---|---|---|---|");
    for name in names {
        let scene = builtin(&name, 1).ok_or_else(|| format!("{name}: no such scene"))?;
        let mut renderer = Renderer::new(&gpu, &scene, size, Purpose::LiveView)?;
        let truth = truth(&mut renderer, &scene)?;
        let exposure = renderer.exposure_value()?;
        let mut errors = Vec::new();
        let mut live = Effects::of_live_view();
        live.temporal_antialiasing.interval = interval;
        for effects in [Effects::default(), live] {
            let effects = effects.exposed(exposure).without_dither();
            let pixels = moved(&mut renderer, &scene, &effects, speed)?;
            if let Some(folder) = &save {
                let kind = if errors.is_empty() { "one" } else { "averaged" };
                let file = format!("{folder}/{name}-{kind}.png");
                gpugi_scene::image::save_png(file.as_ref(), size[0], size[1], &pixels)?;
                let file = format!("{folder}/{name}-truth.png");
                gpugi_scene::image::save_png(file.as_ref(), size[0], size[1], &truth)?;
            }
            let [width, height] = size;
            let [test, reference] =
                [&pixels, &truth].map(|pixels| Picture::of_pixels(width, height, pixels));
            errors.push(compare(Metric::Flip, &test, &reference)?.value);
        }
        let ratio = errors[1] / errors[0];
        println!(
            "| {name} | {:.4} | {:.4} | {ratio:.3} |",
            errors[0], errors[1]
        );
    }
    Ok(())
}

fn parsed_size(text: &str) -> Option<[u32; 2]> {
    let (width, height) = text.split_once('x')?;
    Some([width.parse().ok()?, height.parse().ok()?])
}

/// The scene's camera, turned about what it looks at, `degrees` behind.
fn camera(scene: &Scene, degrees: f32) -> Camera {
    let mut camera = scene.cameras[0].clone();
    let center = scene.bounds().center();
    let turn = Quat::from_rotation_y(degrees.to_radians());
    let about =
        Mat4::from_translation(center) * Mat4::from_quat(turn) * Mat4::from_translation(-center);
    camera.world_from_view = about * camera.world_from_view;
    camera
}

fn truth(renderer: &mut Renderer, scene: &Scene) -> Result<Vec<u8>> {
    let camera = camera(scene, 0.0);
    renderer.converge(&camera, false, |_, _| ControlFlow::Continue(()))?;
    let effects = Effects::default().without_dither();
    for sample in 1..=SAMPLES {
        let last = (sample == SAMPLES).then_some(&effects);
        renderer.render_sample(&camera, SAMPLES, last, false)?;
    }
    Ok(renderer.pixels()?)
}

/// The last frame of an orbit that ends where the camera stands.
fn moved(renderer: &mut Renderer, scene: &Scene, effects: &Effects, speed: f32) -> Result<Vec<u8>> {
    renderer.forget();
    for frame in (0..=FRAMES).rev() {
        renderer.restart();
        renderer.render_sample(
            &camera(scene, speed * frame as f32),
            1,
            Some(effects),
            false,
        )?;
    }
    Ok(renderer.pixels()?)
}
