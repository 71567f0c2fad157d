//! Draws the tutorial's figure 79, a cloud under two suns after more and more iterations of participating-media, with its
//! error in each, and figure 80, clouds over a plain.
//!
//! `cargo run --release -p gpugi --example plot_media -- [FOLDER]` writes `participating-media-iterations.png`, `.svg` and
//! `participating-media-clouds.png` in `docs/images`, or in the folder, and prints the errors.

use std::error::Error;
use std::fmt::Write as _;
use std::ops::ControlFlow;
use std::path::PathBuf;

use glam::{Mat4, Vec3, vec3};
use gpugi::gpu::{AdapterChoice, Gpu};
use gpugi::measure::{Options, Quality, measure};
use gpugi::picture::Effects;
use gpugi::{Purpose, Renderer};
use gpugi_scene::builtin::builtin;
use gpugi_scene::image::metrics::{Metric, Picture, compare};
use gpugi_scene::image::save_png;
use gpugi_scene::{Camera, Light, LightKind, PhaseFunction, Scene};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

const TECHNIQUE: &str = "participating-media";
/// Size of each picture of figure 79 (pixels), and the gap between two.
const SIZE: [u32; 2] = [200, 140];
const GAP: u32 = 4;
/// Samples per pixel: of pictures, and of the path tracer.
const SAMPLES: u32 = 16;
const TRUTH: u32 = 256;
/// Iterations that are measured, and those that are shown.
const ITERATIONS: [u32; 9] = [0, 1, 2, 4, 8, 16, 32, 64, 128];
const SHOWN: [u32; 6] = [0, 1, 2, 4, 8, 32];

/// The built-in cloud alone under two suns, with the albedo and the g of the tutorial.
fn two_suns() -> Result<Scene> {
    let mut scene = builtin("cloud", 1).ok_or("no such scene")?;
    scene.instances.clear();
    scene.environment = None;
    let cloud = &mut scene.media[0];
    cloud.albedo = Vec3::splat(0.9);
    cloud.phase = PhaseFunction::HenyeyGreenstein(0.0);
    let sun = |name: &str, irradiance: Vec3, at: Vec3| {
        Light::new(name, LightKind::Directional, irradiance).aimed(at, Vec3::ZERO)
    };
    scene.lights = vec![
        sun("warm", vec3(4.0, 3.0, 2.0), vec3(-4.5, 6.5, 4.0)),
        sun("cold", vec3(1.5, 2.2, 3.5), vec3(5.0, 2.0, 1.0)),
    ];
    let from = vec3(0.0, 2.4, 6.5);
    scene.cameras = vec![Camera::look_at("", from, vec3(0.0, 2.8, 0.0), 0.62)];
    Ok(scene)
}

/// Five clouds over the plain of the built-in scene.
fn clouds() -> Result<Scene> {
    let mut scene = builtin("cloud", 1).ok_or("no such scene")?;
    let cloud = scene.media.remove(0);
    let places = [
        (vec3(0.0, 2.9, 0.0), 1.0, 0.0),
        (vec3(-5.5, 3.6, -4.0), 1.2, 1.9),
        (vec3(6.5, 4.2, -5.0), 1.1, 4.0),
        (vec3(-2.4, 6.4, -9.0), 1.3, 2.8),
        (vec3(1.95, 1.6, 4.5), 0.35, 5.1),
    ];
    for (index, (at, size, turn)) in places.into_iter().enumerate() {
        let mut one = cloud.clone();
        one.name = format!("cloud {index}").into();
        let sides = vec3(4.0, 2.2, 3.0) * size;
        let place = Mat4::from_translation(at) * Mat4::from_rotation_y(turn);
        one.world_from_box = Some(place * Mat4::from_scale(sides));
        scene.media.push(one);
    }
    let from = vec3(0.0, 1.2, 11.0);
    scene.cameras = vec![Camera::look_at("", from, vec3(0.0, 2.6, 0.0), 0.75)];
    Ok(scene)
}

fn effects(stops: f32) -> Effects {
    Effects::default().exposed(stops).without_dither()
}

/// The picture with all maps final, as radiance and as bytes.
fn picture(renderer: &mut Renderer, camera: &Camera, stops: f32) -> Result<(Vec<f32>, Vec<u8>)> {
    renderer.converge(camera, false, |_, _| ControlFlow::Continue(()))?;
    for sample in 1..=SAMPLES {
        let last = (sample == SAMPLES).then(|| effects(stops));
        renderer.render_sample(camera, SAMPLES, last.as_ref(), false)?;
    }
    Ok((renderer.radiance()?, renderer.pixels()?))
}

/// The errors over the number of iterations, as a plot with logarithmic axes.
fn plot(errors: &[(u32, f64)]) -> String {
    let x = |iterations: u32| 60.0 + 70.0 * f64::from(iterations).log2();
    let y = |error: f64| 20.0 - 90.0 * error.log10();
    let mut svg = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 600 390\" font-family=\"sans-serif\" \
         font-size=\"13\">\n<rect width=\"600\" height=\"390\" fill=\"white\"/>\n",
    );
    for power in 0..=7 {
        let at = x(1 << power);
        let _ = writeln!(
            svg,
            "<path d=\"M {at} 20 v 315\" stroke=\"#dddddd\"/>\n<text x=\"{at}\" y=\"352\" text-anchor=\"middle\">{}</text>",
            1 << power
        );
    }
    for power in 0..=3 {
        let at = y(10_f64.powi(-power));
        let _ = writeln!(
            svg,
            "<path d=\"M 60 {at} h 490\" stroke=\"#dddddd\"/>\n<text x=\"52\" y=\"{at}\" text-anchor=\"end\" \
             dy=\"0.35em\">1e-{power}</text>"
        );
    }
    let points = errors.iter().filter(|(iterations, _)| *iterations > 0);
    let points: Vec<String> = points
        .map(|&(iterations, error)| format!("{:.1},{:.1}", x(iterations), y(error)))
        .collect();
    let _ = writeln!(
        svg,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"#0072b2\" stroke-width=\"2\"/>\n\
         <text x=\"305\" y=\"376\" text-anchor=\"middle\">iterations; rel-mse-4</text>\n</svg>",
        points.join(" ")
    );
    svg
}

fn main() -> Result<()> {
    let folder = std::env::args_os().nth(1).map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs/images"),
        PathBuf::from,
    );
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    let scene = two_suns()?;
    let camera = &scene.cameras[0];
    let mut renderer = Renderer::new(&gpu, &scene, SIZE, &[TECHNIQUE.to_owned()])?;
    let options = Options {
        samples: SAMPLES,
        reference: Quality {
            samples: TRUTH,
            noise: 0.0,
        },
        ..Options::default()
    };
    let measured = measure(&gpu, &scene, camera, &mut renderer, &options, &mut |_| {
        ControlFlow::Continue(())
    })?;
    let [width, height] = SIZE;
    let truth = Picture::of_radiance(width, height, measured.truth.radiance)?;

    let [columns, rows] = [3, 2];
    let whole = [columns * (width + GAP) - GAP, rows * (height + GAP) - GAP];
    let mut pixels = vec![255; (whole[0] * whole[1] * 4) as usize];
    let mut errors = Vec::new();
    for iterations in ITERATIONS {
        let mut renderer = Renderer::new(&gpu, &scene, SIZE, &[TECHNIQUE.to_owned()])?;
        renderer.set(TECHNIQUE, "most-iterations", &iterations.to_string())?;
        let (radiance, bytes) = picture(&mut renderer, camera, -0.5)?;
        let test = Picture::of_radiance(width, height, radiance)?;
        let error = compare(Metric::RelMse4, &test, &truth)?.value;
        println!("| {iterations} | {error:.1e} |");
        errors.push((iterations, error));
        if let Some(place) = SHOWN.iter().position(|&shown| shown == iterations) {
            let [column, row] = [place as u32 % columns, place as u32 / columns];
            for line in 0..height {
                let at = (row * (height + GAP) + line) * whole[0] + column * (width + GAP);
                let line = (line * width * 4) as usize;
                let bytes = &bytes[line..line + (width * 4) as usize];
                pixels[(at * 4) as usize..][..bytes.len()].copy_from_slice(bytes);
            }
        }
    }
    save_png(
        &folder.join("participating-media-iterations.png"),
        whole[0],
        whole[1],
        &pixels,
    )?;
    std::fs::write(
        folder.join("participating-media-iterations.svg"),
        plot(&errors),
    )?;

    let scene = clouds()?;
    let size = [600, 360];
    let mut renderer = Renderer::new(&gpu, &scene, size, Purpose::StillPicture)?;
    // 512 each.
    renderer.set(
        TECHNIQUE,
        "particles",
        &(512 * scene.media.len()).to_string(),
    )?;
    let (_, bytes) = picture(&mut renderer, &scene.cameras[0], 0.0)?;
    save_png(
        &folder.join("participating-media-clouds.png"),
        size[0],
        size[1],
        &bytes,
    )?;
    Ok(())
}
