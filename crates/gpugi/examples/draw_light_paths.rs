//! Draws light path maps as the tutorial's figures 66 and 67 do: the entry points; and pictures of which one half has
//! local illumination only. `cargo run -p gpugi --example draw_light_paths` writes
//! `docs/images/light-path-map-chamber.png`, or into the folder given as argument. With `table` and a scene (`room`,
//! `cornell` or `chamber`) as the arguments it prints errors against the path tracer instead, with a light at twelve
//! places, or `places=6`; the settings may follow, one case per argument: `table cornell places=6 "panes=32"
//! "entries=1024 clusters=128"`.

use std::error::Error;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::{Vec3, vec3};
use gpugi::Renderer;
use gpugi::gpu::{AdapterChoice, Gpu, read_buffer};
use gpugi::light_paths::{LightClass, Part};
use gpugi::measure::{Options, Quality, Subject, Truth, trace};
use gpugi::picture::{Effects, developed};
use gpugi::scene::Edit;
use gpugi::techniques::Texels;
use gpugi_scene::builtin::builtin;
use gpugi_scene::image::save_png;
use gpugi_scene::{Camera, Light, LightKind, Projection, Scene};

/// Width and height of the pictures, and white space between two (pixels).
const SIZE: [u32; 2] = [192, 144];
const GAP: usize = 4;
/// Width and height of the pictures that are compared.
const COMPARED: [u32; 2] = [64, 48];
const SAMPLES: u32 = 8;
/// Places of the light along its way.
const PLACES: u32 = 12;

const TECHNIQUES: [&str; 2] = ["shadow-map", "light-path-map"];

type Settings<'a> = &'a [(&'a str, &'a str)];

fn renderer(
    gpu: &Gpu,
    scene: &Scene,
    size: [u32; 2],
    techniques: &[&str],
    settings: Settings<'_>,
) -> Result<Renderer, Box<dyn Error>> {
    let names: Vec<String> = techniques.iter().map(|&name| name.to_owned()).collect();
    let mut renderer = Renderer::new(gpu, scene, size, &names)?;
    for (name, value) in settings {
        renderer.set("light-path-map", name, value)?;
    }
    Ok(renderer)
}

/// Radiance of all pixels, after the first light has changed.
fn picture(
    renderer: &mut Renderer,
    camera: &Camera,
    light: &Light,
) -> Result<Vec<f32>, Box<dyn Error>> {
    let (index, light) = (0, light.clone());
    renderer.edit(&[Edit::Light { index, light }])?;
    renderer.converge(camera, false, |_, _| ControlFlow::Continue(()))?;
    renderer.restart();
    for _ in 0..SAMPLES {
        renderer.render_sample(camera, SAMPLES, None, false)?;
    }
    Ok(renderer.radiance()?)
}

/// The scene's first light at places between two.
fn places(scene: &Scene, [from, to]: [Vec3; 2], target: Vec3, count: u32) -> Vec<Light> {
    let light = &scene.lights[0];
    let place = |number: u32| from.lerp(to, number as f32 / (count - 1).max(1) as f32);
    (0..count)
        .map(|number| light.clone().aimed(place(number), target))
        .collect()
}

/// The way of the chamber's spot from the left gallery into the nave, and what it shines on.
const WAY: [Vec3; 2] = [vec3(-4.4, 8.6, 3.0), vec3(2.4, 7.0, 2.0)];
const TARGET: Vec3 = vec3(1.8, 0.0, -2.0);

/// The pixels in which the entry points of the renderer's light path map are seen.
fn seen_entries(
    gpu: &Gpu,
    renderer: &Renderer,
    camera: &Camera,
) -> Result<Vec<usize>, Box<dyn Error>> {
    let maps = renderer.maps();
    let entries = maps.iter().find(|map| map.name == "light-path-map.entries");
    let Some(Texels::Buffer {
        buffer,
        size: map_size,
        stride,
        ..
    }) = entries.map(|map| &map.texels)
    else {
        return Err("no entry points".into());
    };
    let Projection::Perspective { vertical_fov } = camera.projection else {
        return Err("no perspective".into());
    };
    let count = u64::from(map_size[0] * map_size[1]);
    let words: Vec<f32> = read_buffer(gpu, buffer, count * stride)?;
    let points = renderer.surface_points()?;
    let view_from_world = camera.world_from_view.inverse();
    let [width, height] = SIZE.map(|side| side as f32);
    let seen = words.chunks(*stride as usize / 4).filter_map(|words| {
        let position = Vec3::from_slice(words);
        let at = view_from_world.transform_point3(position);
        let scale = height / 2.0 / (vertical_fov / 2.0).tan() / -at.z;
        let (x, y) = (width / 2.0 + at.x * scale, height / 2.0 - at.y * scale);
        let is_inside = at.z < 0.0 && x >= 0.0 && y >= 0.0 && x < width && y < height;
        let pixel = is_inside.then_some(y as usize * SIZE[0] as usize + x as usize)?;
        let shown = points[pixel].as_ref()?.position;
        (shown.distance(position) < 3.0 / scale).then_some(pixel)
    });
    Ok(seen.collect())
}

/// Side by side: the entry points, and two places of the light, the lower halves with local illumination only.
fn draw(
    gpu: &Gpu,
    scene: &Scene,
    folder: &Path,
    settings: Settings<'_>,
) -> Result<(), Box<dyn Error>> {
    let camera = &scene.cameras[0];
    let mut local = renderer(gpu, scene, SIZE, &TECHNIQUES[..1], &[])?;
    let mut global = renderer(gpu, scene, SIZE, &TECHNIQUES, settings)?;
    let mut shown = Vec::new();
    for light in places(scene, WAY, TARGET, 2) {
        let mut halves = picture(&mut global, camera, &light)?;
        let below = picture(&mut local, camera, &light)?;
        let middle = halves.len() / 2;
        halves[middle..].copy_from_slice(&below[middle..]);
        shown.extend(halves);
    }
    let effects = Effects::default().without_dither();
    let pixels = developed(
        gpu,
        [SIZE[0], shown.len() as u32 / 3 / SIZE[0]],
        &shown,
        &effects,
    )?;
    let [width, height] = SIZE.map(|side| side as usize);
    let mut pictures: Vec<Vec<u8>> = pixels
        .chunks(width * height * 4)
        .map(<[u8]>::to_vec)
        .collect();
    let grey = |pixel: &[u8]| [pixel[0] / 4, pixel[1] / 4, pixel[2] / 4, 255];
    let mut dots: Vec<u8> = pictures[0].chunks(4).flat_map(grey).collect();
    for pixel in seen_entries(gpu, &global, camera)? {
        dots[4 * pixel..][..4].fill(255);
    }
    pictures.insert(0, dots);
    let row = |y: usize| {
        let rows = pictures
            .iter()
            .map(move |picture| &picture[y * width * 4..][..width * 4]);
        rows.collect::<Vec<_>>().join(&[255; GAP * 4][..])
    };
    let pixels: Vec<u8> = (0..height).flat_map(row).collect();
    let width = (width + GAP) * pictures.len() - GAP;
    let path = folder.join("light-path-map-chamber.png");
    Ok(save_png(&path, width as u32, height as u32, &pixels)?)
}

/// The path tracer's indirect light.
fn truth(gpu: &Gpu, scene: &Scene, light: &Light) -> Result<Truth, Box<dyn Error>> {
    let mut scene = scene.clone();
    scene.lights[0] = light.clone();
    let part = Part {
        classes: vec![LightClass::Punctual],
        pattern: "LDD+E".into(),
    };
    let subject = Subject {
        scene: &scene,
        camera: &scene.cameras[0],
        size: COMPARED,
    };
    let options = Options {
        reference: Quality {
            samples: 256,
            noise: 0.0,
        },
        ..Options::default()
    };
    let go_on = &mut |_: &_| ControlFlow::Continue(());
    Ok(trace(gpu, &subject, &[part], &options, go_on)?)
}

/// A built-in scene without lamps: those of the chamber stay where they are, and the box gets a point instead.
fn lit_by_points(name: &str) -> Result<Scene, Box<dyn Error>> {
    let mut scene = builtin(name, 1).ok_or("no such scene")?;
    for material in &mut scene.materials {
        material.emissive = Vec3::ZERO;
    }
    if scene.lights.is_empty() {
        let point = Light::new("", LightKind::Point, Vec3::splat(40.0));
        scene.lights.push(point);
    }
    Ok(scene)
}

/// Prints the mean and the worst error with the light at some places, for some settings.
fn table(
    gpu: &Gpu,
    name: &str,
    way: [Vec3; 2],
    target: Vec3,
    count: u32,
    cases: &[String],
) -> Result<(), Box<dyn Error>> {
    let scene = lit_by_points(name)?;
    let lights = places(&scene, way, target, count);
    let truths = lights.iter().map(|light| truth(gpu, &scene, light));
    let truths = truths.collect::<Result<Vec<_>, _>>()?;
    let camera = &scene.cameras[0];
    let mut local = renderer(gpu, &scene, COMPARED, &TECHNIQUES[..1], &[])?;
    let directs = lights
        .iter()
        .map(|light| picture(&mut local, camera, light));
    let directs = directs.collect::<Result<Vec<_>, _>>()?;
    let usual = [("steps", "4096"), ("resolution", "64")];
    println!("| scene | | mean rel-mse | worst | panes [s] |\n|---|---|---|---|---|");
    for case in cases {
        let pairs = case.split_whitespace();
        let settings: Option<Vec<_>> = pairs.map(|pair| pair.split_once('=')).collect();
        let settings = settings.ok_or("settings are name=value")?;
        let mut global = renderer(
            gpu,
            &scene,
            COMPARED,
            &TECHNIQUES,
            &[&usual[..], &settings].concat(),
        )?;
        let begun = Instant::now();
        global.converge(camera, false, |_, _| ControlFlow::Continue(()))?;
        let seconds = begun.elapsed().as_secs_f32();
        let mut errors = Vec::new();
        for ((light, truth), direct) in lights.iter().zip(&truths).zip(&directs) {
            let found = picture(&mut global, camera, light)?;
            let pairs = found.iter().zip(direct).zip(&truth.radiance);
            let squares = pairs.map(|((both, direct), truth)| {
                let (found, truth) = (f64::from(both - direct), f64::from(*truth));
                (found - truth).powi(2) / (truth * truth + 0.01)
            });
            errors.push(squares.sum::<f64>() / found.len() as f64 - truth.rel_mse());
        }
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let worst = errors.iter().copied().fold(0.0, f64::max);
        println!("| {name} | {case} | {mean:.1e} | {worst:.1e} | {seconds:.0} |");
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let argument = std::env::args_os().nth(1);
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    if argument
        .as_ref()
        .is_some_and(|argument| argument == "table")
    {
        let name = std::env::args().nth(2).unwrap_or_default();
        let (way, target) = match name.as_str() {
            "room" => (
                [vec3(1.3, 2.8, 1.3), vec3(-1.0, 1.5, 1.2)],
                vec3(-0.1, 0.2, -0.5),
            ),
            "cornell" => ([vec3(-1.5, 2.0, -1.2), vec3(2.0, 4.2, -2.8)], Vec3::ZERO),
            "chamber" => (WAY, TARGET),
            _ => return Err("table needs room, cornell or chamber".into()),
        };
        let mut cases: Vec<String> = std::env::args().skip(3).collect();
        let mut count = PLACES;
        if let Some(places) = cases.first().and_then(|case| case.strip_prefix("places=")) {
            count = places.parse()?;
            cases.remove(0);
        }
        if cases.is_empty() {
            cases = vec![String::new()];
        }
        return table(&gpu, &name, way, target, count, &cases);
    }
    let images = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/images");
    let folder = argument.map_or(images, PathBuf::from);
    let scene = builtin("chamber", 1).ok_or("no such scene")?;
    draw(
        &gpu,
        &scene,
        &folder,
        &[("resolution", "128"), ("entries", "2048"), ("steps", "64")],
    )
}
