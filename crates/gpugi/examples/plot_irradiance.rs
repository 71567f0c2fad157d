//! Draws the surroundings of the scene `ornaments`, and the irradiance map that environment-map generates from them
//! (figures 11 and 12 of the tutorial). `cargo run -p gpugi --example plot_irradiance` writes
//! `docs/images/environment-map-maps.png`, or the file given as argument.

use std::error::Error;
use std::f32::consts::{PI, TAU};
use std::path::PathBuf;

use glam::{Vec3, vec3};
use gpugi::Renderer;
use gpugi::gpu::{AdapterChoice, Gpu, TextureAspect, read_texture};
use gpugi_scene::builtin::builtin;
use gpugi_scene::image::save_png;
use gpugi_scene::{Camera, Pixels};
use half::f16;

/// Size of each of the two pictures (pixels).
const SIZE: [u32; 2] = [400, 200];
const GAP: u32 = 8;

fn main() -> Result<(), Box<dyn Error>> {
    let file = std::env::args_os().nth(1).map_or_else(
        || {
            let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
            root.join("../../docs/images/environment-map-maps.png")
        },
        PathBuf::from,
    );
    let scene = builtin("ornaments", 1).ok_or("no such scene")?;
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    let mut renderer = Renderer::new(&gpu, &scene, [16, 16], &["environment-map".to_owned()])?;
    let camera: &Camera = scene.cameras.first().ok_or("no camera")?;
    renderer.render_sample(camera, 1, None, false)?;
    let maps = renderer.maps();
    let is_irradiance = |map: &&gpugi::techniques::Map| map.name == "environment-map.irradiance";
    let irradiance = maps.iter().find(is_irradiance);
    let irradiance = irradiance.and_then(|map| map.texture()).ok_or("no map")?;
    let side = irradiance.width();
    let faces = (0..6)
        .map(|face| read_texture::<[f16; 4]>(&gpu, irradiance, TextureAspect::All, face, 0))
        .collect::<Result<Vec<_>, _>>()?;
    let image = &scene.environment.as_ref().ok_or("no environment")?.image;
    let Pixels::Rgba32Float(texels) = &image.pixels else {
        return Err("the environment holds floats".into());
    };

    let [width, height] = SIZE;
    let row = 2 * width + GAP;
    let mut pixels = vec![255; (row * height * 4) as usize];
    for y in 0..height {
        for x in 0..width {
            let texel = [x * image.width / width, y * image.height / height];
            let first = ((texel[1] * image.width + texel[0]) * 4) as usize;
            let radiance = Vec3::from_slice(&texels[first..]);
            let phi = TAU * ((x as f32 + 0.5) / width as f32 - 0.5);
            let theta = PI * (y as f32 + 0.5) / height as f32;
            let toward = vec3(
                phi.sin() * theta.sin(),
                theta.cos(),
                -phi.cos() * theta.sin(),
            );
            let (face, at) = on_cube(toward, side);
            let irradiance = Vec3::from_slice(&faces[face][at].map(f16::to_f32));
            for (left, value) in [(0, radiance), (width + GAP, irradiance / PI)] {
                let first = ((y * row + left + x) * 4) as usize;
                let shown = (value / (0.5 + value)).powf(1.0 / 2.2) * 255.0;
                pixels[first..first + 3]
                    .copy_from_slice(&shown.to_array().map(|channel| channel as u8));
            }
        }
    }
    save_png(&file, row, height, &pixels)?;
    println!("{}", file.display());
    Ok(())
}

/// Face and texel of a cube map in a direction. WebGPU orders the faces +X, -X, +Y, -Y, +Z, -Z.
fn on_cube(d: Vec3, side: u32) -> (usize, usize) {
    let a = d.abs();
    let (face, major, u, v) = if a.x >= a.y && a.x >= a.z {
        (usize::from(d.x < 0.0), a.x, -d.z * d.x.signum(), -d.y)
    } else if a.y >= a.z {
        (2 + usize::from(d.y < 0.0), a.y, d.x, d.z * d.y.signum())
    } else {
        (4 + usize::from(d.z < 0.0), a.z, d.x * d.z.signum(), -d.y)
    };
    let texel = |t: f32| (((t / major + 1.0) * 0.5 * side as f32) as u32).min(side - 1);
    (face, (texel(v) * side + texel(u)) as usize)
}
