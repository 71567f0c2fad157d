//! Draws the directional domains of the default sky over it (figure 15 of the tutorial): borders of domains, the
//! directions that represent them, and the Delaunay mesh between these. `cargo run -p gpugi --example plot_domains`
//! writes `docs/images/environment-domains.png`, or the file given as argument.

use std::error::Error;
use std::f32::consts::{PI, TAU};
use std::path::PathBuf;

use glam::Vec3;
use gpugi::gpu::{AdapterChoice, Frame, Gpu, TextureAspect, read_texture};
use gpugi::scene::GpuScene;
use gpugi::techniques::image_based_lighting::{Decomposition, Settings};
use gpugi_scene::image::save_png;
use gpugi_scene::{Environment, Pixels, Scene};

/// Pixels per cell along each axis.
const SCALE: u32 = 3;

fn main() -> Result<(), Box<dyn Error>> {
    let file = std::env::args_os().nth(1).map_or_else(
        || {
            let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
            root.join("../../docs/images/environment-domains.png")
        },
        PathBuf::from,
    );
    let mut scene = Scene::new("sky");
    let sky = Environment::default_sky();
    scene.environment = Some(sky.clone());
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    let scene = GpuScene::new(&gpu, &scene)?;
    let mut decomposition = Decomposition::new(&gpu, &scene)?;
    let mut frame = Frame::new(&gpu, false);
    let domains = decomposition.decompose(&mut frame, &scene, &Settings::default())?;
    frame.submit()?;
    let domains = domains.ok_or("no environment")?.wait()?;
    let owners = decomposition.owners().ok_or("no domains")?;
    let (cells, rows) = (owners.width(), owners.height());
    let owners: Vec<u32> = read_texture(&gpu, owners, TextureAspect::All, 0, 0)?;
    let Pixels::Rgba32Float(texels) = &sky.image.pixels else {
        return Err("the default sky holds floats".into());
    };

    let (width, height) = (cells * SCALE, rows * SCALE);
    let owner = |x: u32, y: u32| owners[(y / SCALE * cells + x / SCALE) as usize];
    let mut pixels = vec![255; (width * height * 4) as usize];
    for y in 0..height {
        for x in 0..width {
            let here = owner(x, y);
            let edge =
                here != owner((x + 1) % width, y) || here != owner(x, (y + 1).min(height - 1));
            let [column, row] = [x * sky.image.width / width, y * sky.image.height / height];
            let texel = (row * sky.image.width + column) as usize * 4;
            let pixel = (y * width + x) as usize * 4;
            for channel in 0..3 {
                let radiance = texels[texel + channel];
                let shown = (radiance / (0.5 + radiance)).powf(1.0 / 2.2);
                let shown = if edge { shown * 0.6 } else { shown };
                pixels[pixel + channel] = (shown * 255.0) as u8;
            }
        }
    }
    // A square of pixels around a direction, which extends `reach` pixels to each side.
    let mut dot = |d: Vec3, reach: i32, color: [u8; 3]| {
        let u = d.x.atan2(-d.z) / TAU + 0.5;
        let v = d.y.clamp(-1.0, 1.0).acos() / PI;
        let at = [(u * width as f32) as i32, (v * height as f32) as i32];
        for (x, y) in (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (x, y))) {
            let x = (at[0] + x).rem_euclid(width as i32);
            let y = (at[1] + y).clamp(0, height as i32 - 1);
            let pixel = (y * width as i32 + x) as usize * 4;
            pixels[pixel..pixel + 3].copy_from_slice(&color);
        }
    };
    for ends in decomposition.delaunay_edges(&gpu)? {
        let [from, to] = ends.map(|end| domains[end as usize].toward);
        // Points of the chord, projected from the centre, give the great circle. Near a pole many columns lie close
        // together.
        let steps = (from.distance(to) * 16.0 * height as f32) as u32 + 1;
        for step in 0..=steps {
            dot(
                from.lerp(to, step as f32 / steps as f32).normalize(),
                0,
                [20, 60, 160],
            );
        }
    }
    for domain in domains.iter().filter(|domain| domain.solid_angle > 0.0) {
        dot(domain.toward, 1, [200, 30, 20]);
    }
    save_png(&file, width, height, &pixels)?;
    println!("{}", file.display());
    Ok(())
}
