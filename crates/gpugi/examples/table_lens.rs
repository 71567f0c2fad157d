//! Live depth of field and motion blur against still pictures of the same techniques, whose samples see through points of
//! the lens at moments of the shutter: a table of rel-mse without and with the effect, for built-in scenes.
//! `--size WxH`, `--samples N` of the still picture, `--save FOLDER`, `--set EFFECT.SETTING=VALUE`, names of scenes.

use std::error::Error;
use std::ops::ControlFlow;

use gpugi::gpu::{AdapterChoice, Gpu};
use gpugi::picture::{Effects, ToneMap};
use gpugi::{Purpose, Renderer};
use gpugi_scene::builtin::builtin;
use gpugi_scene::image::metrics::{Metric, Picture, compare};
use gpugi_scene::image::save_png;
use gpugi_scene::{Camera, Lens, Projection, Scene};

/// Frames before the one that is measured.
const FRAMES: u32 = 16;
/// Radius of the image of what is infinitely far, as a part of the picture's height.
const BLUR: f32 = 0.03;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

fn main() -> Result<()> {
    let mut size = [1280, 1024];
    let mut names = Vec::new();
    let mut samples = 256;
    let mut save = None;
    let mut effects = Effects::of_live_view().without_dither();
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        match word.as_str() {
            "--size" => {
                let text = words.next().ok_or("--size WxH")?;
                size = parsed_size(&text).ok_or("--size WxH")?;
            }
            "--samples" => samples = words.next().ok_or("--samples N")?.parse()?,
            "--save" => save = words.next(),
            "--set" => {
                let text = words.next().ok_or("--set EFFECT.SETTING=VALUE")?;
                let (place, value) = text.split_once('=').ok_or("--set EFFECT.SETTING=VALUE")?;
                let (effect, name) = place.split_once('.').ok_or("--set EFFECT.SETTING=VALUE")?;
                effects.set(effect, name, value).ok_or("no such effect")??;
            }
            _ => names.push(word),
        }
    }
    if names.is_empty() {
        names.extend(["cornell", "room", "ornaments", "spheres", "glass-room"].map(str::to_owned));
    }
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    println!("{}, {}x{}", gpu.adapter.name, size[0], size[1]);
    println!("| scene | pinhole | depth of field | ratio | pass (ms) |");
    println!("|---|---|---|---|---|");
    // A value of 1 must not be reached, and errors count in what is linear.
    effects.tone_map.operator = ToneMap::None;
    for name in names {
        let scene = builtin(&name, 1).ok_or_else(|| format!("{name}: no such scene"))?;
        let mut renderer = Renderer::new(&gpu, &scene, size, Purpose::LiveView)?;
        let camera = with_lens(&scene);
        renderer.converge(&camera, false, |_, _| ControlFlow::Continue(()))?;
        let mut still = Effects::default().without_dither();
        renderer.render_sample(&camera, 1, Some(&still), false)?;
        let exposure = renderer.exposure_value()? - 1.5;
        still.tone_map.operator = ToneMap::None;
        let (effects, still) = (effects.clone().exposed(exposure), still.exposed(exposure));
        renderer.forget();
        for sample in 1..=samples {
            let last = (sample == samples).then_some(&still);
            renderer.render_sample(&camera, samples, last, false)?;
        }
        let truth = renderer.pixels()?;
        let mut sharp = effects.clone();
        sharp.depth_of_field.samples = 0;
        let mut errors = Vec::new();
        let mut times = Vec::new();
        for (kind, effects) in [("pinhole", &sharp), ("lens", &effects)] {
            renderer.forget();
            for _ in 0..FRAMES {
                renderer.restart();
                let frame = renderer.render_sample(&camera, 1, Some(effects), true)?;
                let passes = frame.wait()?;
                let passes = passes
                    .iter()
                    .filter(|timing| timing.pass == "picture.depth-of-field");
                times.extend(passes.map(|timing| timing.milliseconds));
            }
            let pixels = renderer.pixels()?;
            if let Some(folder) = &save {
                for (kind, pixels) in [(kind, &pixels), ("truth", &truth)] {
                    let file = format!("{folder}/{name}-{kind}.png");
                    save_png(file.as_ref(), size[0], size[1], pixels)?;
                }
            }
            let [test, reference] = [&pixels, &truth].map(|pixels| {
                let radiance: Vec<f32> = linear(pixels);
                Picture::of_radiance(size[0], size[1], radiance)
            });
            errors.push(compare(Metric::RelMse, &test?, &reference?)?.value);
        }
        times.sort_by(f64::total_cmp);
        let time = times.get(times.len() / 2).copied().unwrap_or_default();
        let ratio = errors[1] / errors[0];
        println!(
            "| {name} | {:.5} | {:.5} | {ratio:.3} | {time:.3} |",
            errors[0], errors[1]
        );
    }
    Ok(())
}

fn parsed_size(text: &str) -> Option<[u32; 2]> {
    let (width, height) = text.split_once('x')?;
    Some([width.parse().ok()?, height.parse().ok()?])
}

/// The scene's camera with a lens that sees its middle sharply.
fn with_lens(scene: &Scene) -> Camera {
    let mut camera = scene.cameras[0].clone();
    let [back, eye] = [2, 3].map(|column| camera.world_from_view.col(column).truncate());
    let focus = (eye - scene.bounds().center()).dot(back).max(0.1);
    let Projection::Perspective { vertical_fov } = camera.projection else {
        return camera;
    };
    let aperture = BLUR * 2.0 * focus * (vertical_fov / 2.0).tan();
    camera.lens = Lens {
        aperture,
        focus,
        blades: 6,
    };
    camera
}

fn linear(pixels: &[u8]) -> Vec<f32> {
    let decoded = |value: u8| {
        let value = f32::from(value) / 255.0;
        match value <= 0.04045 {
            true => value / 12.92,
            false => ((value + 0.055) / 1.055).powf(2.4),
        }
    };
    let rgb = pixels.chunks_exact(4).flat_map(|rgba| &rgba[..3]);
    rgb.map(|&value| decoded(value)).collect()
}
