//! Live depth of field and motion blur against still pictures of the same techniques, whose samples see through points of
//! the lens at moments of the shutter: a table of rel-mse without and with the effect, for built-in scenes.
//! `--size WxH`, `--samples N` of the still picture, `--save FOLDER`, `--set EFFECT.SETTING=VALUE`, names of scenes.

use std::error::Error;
use std::ops::ControlFlow;

use glam::{DMat4, DQuat, DVec3, Quat, Vec3};
use gpugi::gpu::{AdapterChoice, Gpu};
use gpugi::picture::{Effects, ToneMap};
use gpugi::{Motion, Purpose, Renderer};
use gpugi_scene::animation::{Animation, Channel, Interpolation, Node, Property, Rig, Transform};
use gpugi_scene::builtin::builtin;
use gpugi_scene::image::metrics::{Metric, Picture, compare};
use gpugi_scene::image::save_png;
use gpugi_scene::{Camera, Lens, Projection, Scene};

/// Frames before the one that is measured.
const FRAMES: u32 = 16;
/// Time of the picture (s), and between frames.
const TIME: f32 = 1.0;
const SECONDS: f32 = 1.0 / 60.0;
const DEGREES_PER_SECOND: f32 = 60.0;
/// Steps of maps while the shutter is open.
const STEPS: u32 = 8;
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
    println!("| scene | effect | without | with | ratio | pass (ms) |");
    println!("|---|---|---|---|---|---|");
    // Errors count in what is linear.
    effects.tone_map.operator = ToneMap::None;
    for name in names {
        let scene = builtin(&name, 1).ok_or_else(|| format!("{name}: no such scene"))?;
        for effect in ["depth-of-field", "motion-blur"] {
            let (scene, camera) = match effect {
                "motion-blur" => in_motion(&scene),
                _ => (scene.clone(), with_lens(&scene)),
            };
            let mut renderer = Renderer::new(&gpu, &scene, size, Purpose::LiveView)?;
            renderer.converge(&camera, false, |_, _| ControlFlow::Continue(()))?;
            let mut still = Effects::default().without_dither();
            renderer.render_sample(&camera, 1, Some(&still), false)?;
            // A value of 1 should not be reached.
            let exposure = renderer.exposure_value()? - 1.5;
            still.tone_map.operator = ToneMap::None;
            let (effects, still) = (effects.clone().exposed(exposure), still.exposed(exposure));
            renderer.forget();
            renderer.set_motion(Motion::seen_by(&camera, &scene, TIME), STEPS)?;
            for sample in 1..=samples {
                let last = (sample == samples).then_some(&still);
                renderer.render_sample(&camera, samples, last, false)?;
            }
            let truth = renderer.pixels()?;
            renderer.set_motion(None, STEPS)?;
            let mut without = effects.clone();
            without.depth_of_field.samples = 0;
            without.motion_blur.samples = 0;
            let mut errors = Vec::new();
            let mut times = Vec::new();
            for (kind, effects) in [("without", &without), ("with", &effects)] {
                renderer.forget();
                for frame in (0..FRAMES).rev() {
                    let time = TIME - SECONDS * frame as f32;
                    let mut posed = scene.clone();
                    posed.pose(time);
                    renderer.update(&posed)?;
                    renderer.pass_time(SECONDS);
                    let camera = scene.camera_at(&camera, time);
                    let frame = renderer.render_sample(&camera, 1, Some(effects), true)?;
                    let passes = frame.wait()?;
                    let pass = format!("picture.{effect}");
                    let passes = passes.iter().filter(|timing| timing.pass == pass);
                    times.extend(passes.map(|timing| timing.milliseconds));
                }
                let pixels = renderer.pixels()?;
                if let Some(folder) = &save {
                    for (kind, pixels) in [(kind, &pixels), ("truth", &truth)] {
                        let file = format!("{folder}/{name}-{effect}-{kind}.png");
                        save_png(file.as_ref(), size[0], size[1], pixels)?;
                    }
                }
                let [test, reference] = [&pixels, &truth]
                    .map(|pixels| Picture::of_radiance(size[0], size[1], linear(pixels)));
                errors.push(compare(Metric::RelMse, &test?, &reference?)?.value);
            }
            times.sort_by(f64::total_cmp);
            let time = times.get(times.len() / 2).copied().unwrap_or_default();
            let [without, with] = [errors[0], errors[1]];
            let ratio = with / without;
            println!("| {name} | {effect} | {without:.5} | {with:.5} | {ratio:.3} | {time:.3} |");
        }
    }
    Ok(())
}

/// The scene at [`TIME`] of an animation in which its first camera turns about its middle, and its last instance flies; and
/// this camera, with a shutter that is open for all the time between frames.
fn in_motion(scene: &Scene) -> (Scene, Camera) {
    let mut scene = scene.clone();
    let center = scene.bounds().center().as_dvec3();
    let speed = scene.bounds().diagonal() * 0.2;
    let node = |parent, matrix| Node {
        parent,
        rest: Transform::Matrix(matrix),
        weights: Vec::new(),
    };
    let channel = |node, property, times: &[f32], values: &[Vec<f32>]| Channel {
        node,
        property,
        interpolation: Interpolation::Linear,
        times: times.to_vec(),
        values: values.concat(),
    };
    let middle = DMat4::from_translation(center);
    let camera = middle.inverse() * scene.cameras[0].world_from_view.as_dmat4();
    let turned = |second: f32| {
        let angle = (second - TIME) * DEGREES_PER_SECOND.to_radians();
        Quat::from_rotation_y(angle).to_array().to_vec()
    };
    let seconds = [0.0, 1.0, 2.0, 3.0];
    let last = scene.instances.len() - 1;
    let place = scene.instances[last].world_from_mesh;
    let flown = |second: f32| {
        let way = (second - TIME) * speed;
        (place.w_axis.truncate() + Vec3::X * way)
            .to_array()
            .to_vec()
    };
    let (scale, rotation, translation) = place.as_dmat4().to_scale_rotation_translation();
    let rest = Transform::Parts {
        translation,
        rotation,
        scale,
    };
    scene.rig = Some(Rig {
        nodes: vec![
            Node {
                rest: Transform::Parts {
                    translation: center,
                    rotation: DQuat::IDENTITY,
                    scale: DVec3::ONE,
                },
                ..node(None, middle)
            },
            node(Some(0), camera),
            Node {
                rest,
                ..node(None, DMat4::IDENTITY)
            },
        ],
        order: vec![0, 1, 2],
        animations: vec![Animation {
            name: "motion".to_owned(),
            duration: 3.0,
            channels: vec![
                channel(0, Property::Rotation, &seconds, &seconds.map(turned)),
                channel(2, Property::Translation, &seconds, &seconds.map(flown)),
            ],
        }],
        ..Rig::default()
    });
    for light in &mut scene.lights {
        light.node = None;
    }
    scene.cameras[0].node = Some(1);
    scene.instances[last].node = Some(2);
    scene.pose(TIME);
    let camera = Camera {
        shutter: SECONDS,
        ..scene.cameras[0].clone()
    };
    (scene, camera)
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
