//! Draws final gathering beside classical environment mapping and the path tracer, as the tutorial's figures 51 to 53
//! do, and prints a table of errors. `cargo run -p gpugi --example draw_gathers` writes
//! `docs/images/final-gather-places.png`, or to the folder given as argument; with a mesh file as a second argument, it
//! only prints the table for that mesh.

use std::error::Error;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use glam::{Mat4, Vec3, vec3};
use gpugi::Renderer;
use gpugi::gpu::{AdapterChoice, Gpu};
use gpugi::measure::{Options, Quality, measure};
use gpugi::picture::{Effects, developed};
use gpugi_scene::builtin::builtin;
use gpugi_scene::builtin::shapes::sphere;
use gpugi_scene::image::save_png;
use gpugi_scene::{Bounds, Camera, Limits, Material, MaterialModel, Mesh, Scene, import_file};

/// Side of a picture, and the white space between two (pixels).
const SIZE: usize = 96;
const GAP: usize = 4;

const OPTIONS: Options = Options {
    motion: None,
    shutter_steps: 8,
    samples: 8,
    reference: Quality {
        samples: 2048,
        noise: 0.0,
    },
    seed: 0,
    cache: None,
    all_light: false,
};

/// Settings of final-gather.
type Settings = &'static [(&'static str, &'static str)];

const OWN: Settings = &[("reference-points", "objects"), ("objects", "object")];
/// One reference point in the middle of the room.
const MIDDLE: Settings = &[("reference-points", "grid"), ("density", "0.1")];

/// Name of a column, and whether lights are at their distances.
const WAYS: [(&str, &str, bool); 4] = [
    ("classical", "8", false),
    ("M = 2", "2", true),
    ("M = 4", "4", true),
    ("M = 8", "8", true),
];

/// Matt, and two that are glossy.
fn materials() -> [(&'static str, Material); 3] {
    let phong = MaterialModel::Phong {
        kd: Vec3::ZERO,
        ks: Vec3::splat(0.7),
        shininess: 5.0,
    };
    [
        ("matt", Material::matt("matt", Vec3::splat(0.7))),
        (
            "Phong 5",
            Material {
                name: "Phong".into(),
                model: phong,
                ..Material::default()
            },
        ),
        ("GGX 0.4", Material::metal("rough", Vec3::splat(0.8), 0.4)),
    ]
}

/// A sphere of radius 1 with bumps: r = 1 + h(p), whose normals follow from the gradient of h on the sphere.
fn bumpy_ball() -> Mesh {
    const HEIGHT: f32 = 0.04;
    const WAVES: f32 = 7.0;
    let mut mesh = sphere(1.0, 96);
    for (position, normal) in mesh.positions.iter_mut().zip(&mut mesh.normals) {
        let p = position.normalize();
        let (x, y, z) = (WAVES * p.x, WAVES * p.y, WAVES * p.z);
        let h = HEIGHT * x.sin() * y.sin() * z.sin();
        let gradient = vec3(
            x.cos() * y.sin() * z.sin(),
            x.sin() * y.cos() * z.sin(),
            x.sin() * y.sin() * z.cos(),
        ) * (HEIGHT * WAVES);
        *position = p * (1.0 + h);
        *normal = (p * (1.0 + h) - gradient + p * p.dot(gradient)).normalize();
    }
    mesh.tangents.clear();
    mesh
}

/// The empty room with a mesh at a place.
fn with_object(
    mesh: &Mesh,
    bounds: &Bounds,
    material: &Material,
    at: Vec3,
) -> Result<Scene, Box<dyn Error>> {
    let mut room = builtin("room", 2).ok_or("no such scene")?;
    room.remove("box,sphere")?;
    for light in &mut room.lights {
        light.radius = 0.0;
    }
    let extent = bounds.max - bounds.min;
    let scale = Mat4::from_scale(Vec3::splat(0.9 / extent.max_element()));
    let world_from_mesh =
        Mat4::from_translation(at) * scale * Mat4::from_translation(-bounds.center());
    let mesh = room.add_mesh(mesh.clone());
    let material = room.add_material(Material {
        double_sided: true,
        ..material.clone()
    });
    room.add_instance("object", mesh, material, world_from_mesh);
    Ok(room)
}

/// A camera that looks at an object, with the room behind it.
fn toward(at: Vec3) -> Camera {
    let back = (vec3(0.3, 1.7, 1.7) - at).normalize();
    Camera::look_at("", at + 1.5 * back, at, 0.6)
}

/// Relative mean squared error on the last instance, without its silhouette.
fn error(
    renderer: &Renderer,
    object: u32,
    found: &[f32],
    truth: &[f32],
) -> Result<f64, Box<dyn Error>> {
    let points = renderer.surface_points()?;
    let is_object = |index: usize| {
        points[index]
            .as_ref()
            .is_some_and(|point| point.instance == object)
    };
    let (mut sum, mut count) = (0.0, 0.0);
    for index in SIZE + 1..SIZE * (SIZE - 1) - 1 {
        let around = [index - SIZE - 1, index - 1, index + SIZE - 1];
        if around
            .into_iter()
            .all(|left| (left..left + 3).all(is_object))
        {
            for (found, truth) in found[3 * index..][..3].iter().zip(&truth[3 * index..][..3]) {
                let (found, truth) = (f64::from(*found), f64::from(*truth));
                sum += (found - truth).powi(2) / (truth * truth + 0.01);
                count += 1.0;
            }
        }
    }
    Ok(sum / f64::max(count, 1.0))
}

/// Draws an object in each way and with the path tracer, side by side at one exposure; prints the errors.
fn draw(
    gpu: &Gpu,
    name: &str,
    scene: &Scene,
    at: Vec3,
    is_glossy: bool,
) -> Result<Vec<u8>, Box<dyn Error>> {
    let techniques = ["shadow-map", "final-gather"].map(str::to_owned);
    let size = [SIZE as u32; 2];
    let camera = toward(at);
    let mut renderer = Renderer::new(gpu, scene, size, &techniques)?;
    // So that the error is final-gather's, and not that of coarse shadows.
    renderer.set("shadow-map", "resolution", "4096")?;
    let glossy = is_glossy.to_string();
    for (key, value) in [("glossy", glossy.as_str()), ("resolution", "64")]
        .iter()
        .chain(OWN)
    {
        renderer.set("final-gather", key, value)?;
    }
    let go_on = &mut |_: &_| ControlFlow::Continue(());
    let truth = measure(gpu, scene, &camera, &mut renderer, &OPTIONS, go_on)?
        .truth
        .radiance;
    let object = scene.instances.len() as u32 - 1;
    let mut shown = Vec::new();
    let mut errors = Vec::new();
    for (_, side, localize) in WAYS {
        // One map in the middle of the room serves all places but the middle itself, where the object hides the room.
        let places = if localize || at == PLACES[0].1 {
            OWN
        } else {
            MIDDLE
        };
        let visibility = if localize { "distance" } else { "none" };
        let localize = localize.to_string();
        let more = [
            ("size", side),
            ("localize", &localize),
            ("visibility", visibility),
        ];
        for (key, value) in places.iter().chain(&more) {
            renderer.set("final-gather", key, value)?;
        }
        renderer.restart();
        for _ in 0..OPTIONS.samples {
            renderer.render_sample(&camera, OPTIONS.samples, None, false)?;
        }
        let radiance = renderer.radiance()?;
        errors.push(format!(
            "{:.1e}",
            error(&renderer, object, &radiance, &truth)?
        ));
        shown.extend(radiance);
    }
    println!("| {name} | {} |", errors.join(" | "));
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

const PLACES: [(&str, Vec3); 3] = [
    ("middle", vec3(0.0, 1.5, 0.0)),
    ("left corner", vec3(-1.3, 0.7, -1.3)),
    ("right wall", vec3(1.35, 1.0, -0.5)),
];

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let folder = arguments.next();
    let file = arguments.next();
    let mesh = match &file {
        Some(file) => {
            let scene = import_file(file, &Limits::default())?;
            let mesh = scene.meshes.first().ok_or("no mesh")?;
            Mesh::clone(mesh)
        }
        None => bumpy_ball(),
    };
    let bounds = mesh.bounds();
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    let columns: Vec<&str> = WAYS.iter().map(|(column, ..)| *column).collect();
    println!(
        "| object | {} |\n|---|{}",
        columns.join(" | "),
        "---|".repeat(columns.len())
    );
    let mut rows = Vec::new();
    for (kind, material) in materials() {
        for (place, at) in PLACES {
            let scene = with_object(&mesh, &bounds, &material, at)?;
            let name = format!("{kind}, {place}");
            rows.push(draw(&gpu, &name, &scene, at, kind != "matt")?);
        }
    }
    if file.is_none() {
        let images = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/images");
        let folder = folder.unwrap_or(images);
        let width = (WAYS.len() + 1) * (SIZE + GAP) - GAP;
        let height = rows.len() * (SIZE + GAP) - GAP;
        let pixels = rows.join(&vec![255; width * GAP * 4][..]);
        let path = folder.join("final-gather-places.png");
        save_png(&path, width as u32, height as u32, &pixels)?;
    }
    Ok(())
}
