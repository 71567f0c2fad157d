//! Draws distance impostors beside classical environment mapping and the path tracer, as the tutorial's figures 29, 33
//! and 36 do, and prints a table of their errors. `cargo run -p gpugi --example draw_impostors` writes
//! `docs/images/distance-impostor-*.png`, or to the folder given as argument.

use std::error::Error;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use glam::{Mat4, Vec3, vec3};
use gpugi::Renderer;
use gpugi::gpu::{AdapterChoice, Gpu};
use gpugi::measure::{Options, Quality, measure};
use gpugi::picture::{Effects, developed};
use gpugi_scene::builtin::builtin;
use gpugi_scene::image::metrics::{Metric, Picture, compare};
use gpugi_scene::image::save_png;
use gpugi_scene::{Camera, Light, LightKind, Material, Scene, Volume};

/// Side of a picture, and the white space between two (pixels).
const SIZE: usize = 200;
const GAP: usize = 4;

const OPTIONS: Options = Options {
    motion: None,
    shutter_steps: 8,
    samples: 16,
    reference: Quality {
        samples: 128,
        noise: 0.0,
    },
    seed: 0,
    cache: None,
    all_light: false,
};

/// A name in the table and the settings of distance-impostor that it stands for.
type Way = (&'static str, &'static [(&'static str, &'static str)]);

const CLASSICAL: Way = ("classical", &[("search", "none"), ("bounces", "0")]);
const IMPOSTOR: Way = ("impostor", &[("search", "walk")]);
const ONCE: Way = (
    "impostor, refracted once",
    &[("search", "walk"), ("bounces", "0")],
);
const TWICE: Way = (
    "impostor, refracted twice",
    &[("search", "walk"), ("bounces", "4")],
);

/// Draws an object with each of `ways` and with the path tracer, side by side at one exposure; prints the errors.
fn draw(
    gpu: &Gpu,
    name: &str,
    scene: &Scene,
    camera: &Camera,
    ways: &[Way],
) -> Result<Vec<u8>, Box<dyn Error>> {
    let techniques = ["shadow-map", "distance-impostor"].map(str::to_owned);
    let size = [SIZE as u32; 2];
    let mut renderer = Renderer::new(gpu, scene, size, &techniques)?;
    // The middle of the room.
    renderer.set("distance-impostor", "reference", "0,1.5,0")?;
    let go_on = &mut |_: &_| ControlFlow::Continue(());
    let truth = measure(gpu, scene, camera, &mut renderer, &OPTIONS, go_on)?
        .truth
        .radiance;
    let picture = |radiance: &[f32]| Picture::of_radiance(size[0], size[1], radiance.to_vec());
    let reference = picture(&truth)?;
    let mut shown = Vec::new();
    for (way, settings) in ways {
        for (key, value) in *settings {
            renderer.set("distance-impostor", key, value)?;
        }
        renderer.restart();
        for _ in 0..OPTIONS.samples {
            renderer.render_sample(camera, OPTIONS.samples, None, false)?;
        }
        let radiance = renderer.radiance()?;
        let error = compare(Metric::RelMse, &picture(&radiance)?, &reference)?;
        let error = format!("{:.1e}", error.value);
        println!("| {name} | {way} | {error} |");
        shown.extend(radiance);
    }
    shown.extend(truth);
    let effects = Effects::default().without_dither();
    let pixels = developed(
        gpu,
        [SIZE, shown.len() / 3 / SIZE].map(|side| side as u32),
        &shown,
        &effects,
    )?;
    let pictures: Vec<&[u8]> = pixels.chunks(SIZE * SIZE * 4).collect();
    let row = |y: usize| {
        let rows = pictures
            .iter()
            .map(move |picture| &picture[y * SIZE * 4..][..SIZE * 4]);
        rows.collect::<Vec<_>>().join(&[255; GAP * 4][..])
    };
    Ok((0..SIZE).flat_map(row).collect())
}

/// Saves rows of pictures, one below the other.
fn save(folder: &Path, file: &str, columns: usize, rows: &[Vec<u8>]) -> Result<(), Box<dyn Error>> {
    let width = columns * (SIZE + GAP) - GAP;
    let height = rows.len() * (SIZE + GAP) - GAP;
    let pixels = rows.join(&vec![255; width * GAP * 4][..]);
    save_png(&folder.join(file), width as u32, height as u32, &pixels)?;
    Ok(())
}

/// A camera that looks at a ball, with the room behind it.
fn toward(at: Vec3) -> Camera {
    let back = (vec3(0.3, 1.7, 1.7) - at).normalize();
    Camera::look_at("", at + 1.7 * back, at, 0.8)
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs/images"),
        PathBuf::from,
    );
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    let mut room = builtin("room", 2).ok_or("no such scene")?;
    room.remove("box")?;
    let ball = room
        .instances
        .iter()
        .position(|instance| instance.name == "sphere");
    let ball = ball.ok_or("no such object")?;
    println!("| ball | shown by | rel-mse |\n|---|---|---|");
    let with_ball = |scene: &Scene, at: Vec3| {
        let mut scene = scene.clone();
        scene.instances[ball].world_from_mesh = Mat4::from_translation(at);
        scene
    };
    let mut rows = Vec::new();
    for (name, at) in [
        ("mirror, middle", vec3(0.0, 1.5, 0.0)),
        ("mirror, left corner", vec3(-1.3, 0.7, -1.3)),
        ("mirror, right wall", vec3(1.35, 1.0, -0.5)),
    ] {
        rows.push(draw(
            &gpu,
            name,
            &with_ball(&room, at),
            &toward(at),
            &[CLASSICAL, IMPOSTOR],
        )?);
    }
    save(&folder, "distance-impostor-places.png", 3, &rows)?;

    // Behind the ball, so that its shadow falls out of sight: light that passes through glass into its shadow is a
    // caustic.
    let light = Light::new("light", LightKind::Point, Vec3::splat(9.0));
    room.lights = vec![light.aimed(vec3(0.0, 2.7, -1.2), Vec3::ZERO)];
    let material = room.instances[ball].material;
    room.materials[material] = Material {
        name: "glass".into(),
        transmission: 1.0,
        roughness: 0.0,
        ior: 1.1,
        volume: Some(Volume {
            attenuation_distance: f32::INFINITY,
            attenuation_color: Vec3::ONE,
        }),
        ..Material::default()
    };
    let at = vec3(0.0, 1.2, 0.0);
    let scene = with_ball(&room, at);
    let row = draw(
        &gpu,
        "glass, index 1.1",
        &scene,
        &toward(at),
        &[CLASSICAL, ONCE, TWICE],
    )?;
    save(&folder, "distance-impostor-refractions.png", 4, &[row])
}
