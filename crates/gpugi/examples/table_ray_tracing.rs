//! Prints how fast the tracers of ray-tracing are: tables for docs/techniques/ray-tracing.md. Or draws the tutorial's
//! figure 26: several glass objects before an environment.
//!
//! `cargo run --release -p gpugi --example table_ray_tracing -- [size=512x512] [bounces=4] [triangles=100,1000]
//! [tracers=bvh,cones] [seconds=0.5] [bunny=FILE.ply] [picture=FILE.png]`: `seconds` is about the time of a cell, of which the
//! fastest of four batches of frames counts; `bunny` is measured as glass, at 1280x1024 and with 8 bounces; `picture` draws instead.

use std::error::Error;
use std::f32::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::{Mat4, Vec3, Vec4, vec3};
use gpugi::Renderer;
use gpugi::gpu::{AdapterChoice, Frame, Gpu};
use gpugi::picture::Effects;
use gpugi::scene::{Edit, GpuScene};
use gpugi_scene::builtin::builtin;
use gpugi_scene::builtin::shapes::{join, quad, sphere, torus, transformed};
use gpugi_scene::image::save_png;
use gpugi_scene::normals::smooth_normals;
use gpugi_scene::{
    Camera, Environment, Image, Limits, Material, Mesh, Pixels, Scene, Texture, TextureRef, Volume,
    Wrap, import_file,
};

type Result<T> = std::result::Result<T, Box<dyn Error>>;
type Setting = (&'static str, String);

const OF: &str = "ray-tracing";
const TRACERS: [&str; 3] = ["bvh", "cones", "engine"];

/// What is asked for.
struct Options {
    size: [u32; 2],
    bounces: u32,
    triangles: Vec<u32>,
    /// Time per row (s).
    seconds: f64,
    /// Tracers of the table of still objects.
    tracers: Vec<String>,
    bunny: Option<PathBuf>,
    picture: Option<PathBuf>,
}

impl Options {
    fn parse() -> Result<Self> {
        let mut options = Self {
            size: [512; 2],
            bounces: 4,
            triangles: vec![100, 1_000, 5_000, 30_000, 300_000],
            seconds: 0.5,
            tracers: TRACERS.map(str::to_owned).to_vec(),
            bunny: None,
            picture: None,
        };
        for argument in std::env::args().skip(1) {
            match argument.split_once('=') {
                Some(("size", size)) => {
                    let (width, height) = size.split_once('x').ok_or("size: WIDTHxHEIGHT")?;
                    options.size = [width.parse()?, height.parse()?];
                }
                Some(("bounces", bounces)) => options.bounces = bounces.parse()?,
                Some(("triangles", list)) => {
                    let counts = list.split(',').map(str::parse);
                    options.triangles = counts.collect::<std::result::Result<_, _>>()?;
                }
                Some(("seconds", seconds)) => options.seconds = seconds.parse()?,
                Some(("tracers", list)) => {
                    options.tracers = list.split(',').map(str::to_owned).collect();
                }
                Some(("bunny", file)) => options.bunny = Some(file.into()),
                Some(("picture", file)) => options.picture = Some(file.into()),
                _ => return Err(format!("{argument}: see the example's first lines").into()),
            }
        }
        Ok(options)
    }

    fn settings(&self, tracer: &str) -> Vec<Setting> {
        let bounces = self.bounces.to_string();
        vec![("tracer", tracer.to_owned()), ("bounces", bounces)]
    }
}

/// Segments of a sphere or torus of about so many triangles.
fn segments(triangles: u32) -> u32 {
    (f64::from(triangles) / 4.0).sqrt().round() as u32
}

/// A ball with bumps, of so many triangles.
fn bumpy_ball(radius: f32, triangles: u32) -> Mesh {
    let mut mesh = sphere(1.0, segments(triangles));
    for position in &mut mesh.positions {
        let [x, y, z] = (*position * 5.0).to_array();
        *position *= radius * (1.0 + 0.1 * ((x + 1.0).sin() * y.cos() + z.sin()));
    }
    smooth_normals(&mut mesh, PI);
    mesh
}

fn surroundings() -> Option<Environment> {
    builtin("ornaments", 1)?.environment
}

/// Five objects of clear glass, of so many triangles together.
fn glass_objects(triangles: u32) -> Scene {
    let mut scene = Scene::new("glass objects");
    let each = triangles / 5;
    let upright = Mat4::from_rotation_y(0.5) * Mat4::from_rotation_x(PI / 2.0 - 0.2);
    let objects = [
        ("bumpy ball", bumpy_ball(0.5, each), vec3(0.0, 0.0, 0.0)),
        (
            "ring",
            torus(0.4, 0.13, segments(each)),
            vec3(-0.95, 0.25, -0.3),
        ),
        ("ball", sphere(0.42, segments(each)), vec3(0.95, 0.3, -0.3)),
        ("pebble", bumpy_ball(0.28, each), vec3(-0.55, -0.65, 0.3)),
        ("marble", sphere(0.28, segments(each)), vec3(0.6, -0.6, 0.3)),
    ];
    for (name, mesh, at) in objects {
        let mesh = scene.add_mesh(mesh);
        let material = scene.add_material(clear_glass());
        scene.add_instance(name, mesh, material, Mat4::from_translation(at) * upright);
    }
    scene.environment = surroundings();
    let eye = vec3(0.0, 0.35, 4.2);
    scene
        .cameras
        .push(Camera::look_at("", eye, vec3(0.0, -0.1, 0.0), 0.62));
    scene
}

fn clear_glass() -> Material {
    Material {
        transmission: 1.0,
        roughness: 0.0,
        volume: Some(Volume {
            attenuation_distance: f32::INFINITY,
            attenuation_color: Vec3::ONE,
        }),
        ..Material::default()
    }
}

/// How coherent the rays are that a mirror reflects.
#[derive(Clone, Copy)]
enum Mirror {
    Flat,
    Curved,
    Bumpy,
}

/// A mirror that fills the picture and shows polished balls of so many triangles together, which are one mesh.
fn before_mirror(mirror: Mirror, triangles: u32) -> Scene {
    let mut scene = Scene::new("mirror");
    let mut mesh = quad(vec3(-1.0, -1.0, 0.0), 2.0 * Vec3::X, 2.0 * Vec3::Y, 4);
    let mut material = Material::metal("mirror", Vec3::splat(0.9), 0.0);
    match mirror {
        Mirror::Flat => {}
        // As if it were a part of a ball.
        Mirror::Curved => {
            let bent = mesh
                .positions
                .iter()
                .map(|at| (0.4 * *at + Vec3::Z).normalize());
            mesh.normals = bent.collect();
        }
        Mirror::Bumpy => {
            mesh.tangents = vec![Vec4::X + Vec4::W; mesh.positions.len()];
            scene.images.push(bumps().into());
            scene.textures.push(Texture {
                image: 0,
                wrap: [Wrap::Repeat; 2],
                nearest: false,
                has_levels: true,
            });
            material.normal_texture = Some(TextureRef::new(0));
        }
    }
    let mesh = scene.add_mesh(mesh);
    let material = scene.add_material(material);
    scene.add_instance("mirror", mesh, material, Mat4::IDENTITY);
    let places = [
        vec3(0.0, 0.0, 2.6),
        vec3(-0.9, 0.6, 2.3),
        vec3(0.9, 0.5, 2.2),
        vec3(-0.7, -0.8, 2.4),
        vec3(0.8, -0.7, 2.5),
    ];
    let ball = sphere(0.4, segments(triangles / 5));
    let balls = places.map(|at| transformed(ball.clone(), &Mat4::from_translation(at)));
    let balls = scene.add_mesh(join("balls", balls));
    let polished = scene.add_material(Material::metal("polished", Vec3::splat(0.9), 0.0));
    scene.add_instance("balls", balls, polished, Mat4::IDENTITY);
    scene.environment = surroundings();
    scene
        .cameras
        .push(Camera::look_at("", Vec3::Z * 1.2, Vec3::ZERO, 0.9));
    scene
}

/// A normal map: random slopes of up to 0.3, 64 along each side.
fn bumps() -> Image {
    const SIDE: u32 = 64;
    let texels = (0..SIDE * SIDE).flat_map(|index| {
        let hash = index
            .wrapping_mul(0x9e37_79b9)
            .wrapping_mul(index ^ 0x85eb_ca6b);
        let slope = |bits: u32| 0.3 * ((bits & 0xff) as f32 / 127.5 - 1.0);
        let normal = vec3(slope(hash >> 8), slope(hash >> 20), 1.0).normalize();
        let encoded = (normal * 0.5 + 0.5) * 255.0;
        [encoded.x as u8, encoded.y as u8, encoded.z as u8, 255]
    });
    Image {
        name: "bumps".into(),
        width: SIDE,
        height: SIDE,
        pixels: Pixels::Rgba8(texels.collect()),
    }
}

/// What a frame takes.
#[derive(Clone, Copy)]
struct Measured {
    /// Wall time, with frames queued (ms).
    frame: f64,
    rays: f64,
    /// Share of tests against triangles that cones spare (percent).
    culled: Option<f64>,
}

impl Measured {
    fn frames_per_second(&self) -> f64 {
        1e3 / self.frame
    }

    /// Million rays per second of the whole frame.
    fn rate(&self) -> f64 {
        self.rays / self.frame * 1e-3
    }
}

/// Renders frames, of the environment alone.
fn measure(
    gpu: &Gpu,
    scene: &Scene,
    size: [u32; 2],
    settings: &[Setting],
    seconds: f64,
) -> Result<Measured> {
    let mut renderer = Renderer::new(gpu, scene, size, &[OF.to_owned()])?;
    renderer.set(OF, "environment", "only")?;
    for (key, value) in settings {
        renderer.set(OF, key, value)?;
    }
    let camera = scene.cameras.first().ok_or("a camera")?;
    let effects = Effects::default().exposed(0.0);
    let frame = |renderer: &mut Renderer| {
        renderer.restart();
        renderer.render_sample(camera, 1, Some(&effects), false)
    };
    // Compiles.
    frame(&mut renderer)?;
    renderer.figures()?;
    frame(&mut renderer)?;
    gpu.wait()?;
    let figures = renderer.figures()?;
    let figure = |name: &str| {
        let mut all = figures.iter();
        all.find(|figure| figure.name == format!("{OF}.{name}"))
            .map(|figure| figure.value)
    };
    // A GPU at rest is slow, and so is one for which the host waits after every frame.
    let mut batch = |frames: u32| -> Result<f64> {
        let started = Instant::now();
        for _ in 0..frames {
            frame(&mut renderer)?;
        }
        gpu.wait()?;
        Ok(started.elapsed().as_secs_f64())
    };
    let mut frames = 1;
    let mut estimate = batch(frames)?;
    while estimate < 0.2 * seconds {
        frames *= 2;
        estimate = batch(frames)?;
    }
    let mut best = estimate;
    for _ in 0..3 {
        best = best.min(batch(frames)?);
    }
    Ok(Measured {
        frame: best * 1e3 / f64::from(frames),
        rays: figure("rays").ok_or("no rays were counted")?,
        culled: figure("culled by cones"),
    })
}

/// One row per kind of object and number of triangles.
fn still(gpu: &Gpu, options: &Options) -> Result<()> {
    let tracers = options.tracers.join(" | ");
    println!("| rays from | triangles | rays | {tracers} |");
    println!("|---|---|---|{}", "---|".repeat(options.tracers.len()));
    type Make = fn(u32) -> Scene;
    let kinds: [(&str, Make, u32); 5] = [
        (
            "a flat mirror",
            |count| before_mirror(Mirror::Flat, count),
            0,
        ),
        (
            "a curved mirror",
            |count| before_mirror(Mirror::Curved, count),
            0,
        ),
        (
            "a bumpy mirror",
            |count| before_mirror(Mirror::Bumpy, count),
            0,
        ),
        ("glass", glass_objects, 0),
        (
            "glass, both rays followed",
            glass_objects,
            options.bounces.min(4),
        ),
    ];
    for (name, make, split) in kinds {
        for &triangles in &options.triangles {
            let scene = make(triangles);
            let mut cells = String::new();
            let mut rays = 0.0;
            for tracer in &options.tracers {
                let mut settings = options.settings(tracer);
                settings.push(("split", split.to_string()));
                let measured = measure(gpu, &scene, options.size, &settings, options.seconds)?;
                rays = measured.rays;
                cells += &format!(" {:.3} ms, {:.1} Mrays/s", measured.frame, measured.rate());
                if let Some(culled) = measured.culled {
                    cells += &format!(", {culled:.1} % culled");
                }
                cells += " |";
            }
            let triangles = scene.statistics().triangles;
            println!("| {name} | {triangles} | {rays} |{cells}");
        }
    }
    Ok(())
}

/// Milliseconds that `edit` takes, the fastest of three.
fn fastest(gpu: &Gpu, mut edit: impl FnMut(u32) -> Result<()>) -> Result<f64> {
    let mut best = f64::INFINITY;
    for number in 0..3 {
        gpu.wait()?;
        let started = Instant::now();
        edit(number)?;
        Frame::new(gpu, false).submit()?;
        gpu.wait()?;
        best = best.min(started.elapsed().as_secs_f64() * 1e3);
    }
    Ok(best)
}

/// The balls before a flat mirror deform: what replacing their mesh takes, with the hierarchy that `bvh` needs and
/// without it.
fn deforming(gpu: &Gpu, options: &Options) -> Result<()> {
    println!("| triangles | mesh replaced, hierarchy built | mesh replaced |");
    println!("|---|---|---|");
    for &triangles in &options.triangles {
        let scene = before_mirror(Mirror::Flat, triangles);
        let deformed = |number: u32| {
            let factor = 1.0 + 0.01 * (number + 1) as f32;
            let mut mesh = Mesh::clone(&scene.meshes[1]);
            mesh.positions.iter_mut().for_each(|at| at.y *= factor);
            let mesh = Arc::new(mesh);
            Edit::Mesh { index: 1, mesh }
        };
        let mut times = [0.0; 2];
        for (time, make) in times.iter_mut().zip([GpuScene::with_rays, GpuScene::new]) {
            let mut on_gpu = make(gpu, &scene)?;
            *time = fastest(gpu, |number| Ok(on_gpu.edit(gpu, &[deformed(number)])?))?;
        }
        let triangles = scene.statistics().triangles;
        println!("| {triangles} | {:.3} ms | {:.3} ms |", times[0], times[1]);
    }
    Ok(())
}

/// What issue and page hold the tracers to.
fn goals(gpu: &Gpu, options: &Options) -> Result<()> {
    println!("| what | wanted | measured |\n|---|---|---|");
    let row =
        |what: &str, wanted: &str, measured: String| println!("| {what} | {wanted} | {measured} |");
    let scene = glass_objects(5_000);
    let mut all = Vec::new();
    for tracer in TRACERS {
        let settings = options.settings(tracer);
        all.push(measure(
            gpu,
            &scene,
            options.size,
            &settings,
            options.seconds,
        )?);
    }
    let [bvh, cones, engine] = all[..] else {
        return Err("a measurement per tracer".into());
    };
    let what = format!("5,000 triangles of glass, {} generations", options.bounces);
    let ratio = engine.frame / cones.frame;
    row(
        &what,
        "cones 10 times as fast as engine",
        format!("{ratio:.2} times"),
    );
    for (name, measured, wanted) in [("cones", cones, 300), ("bvh", bvh, 1500)] {
        let found = format!("{:.0}", measured.frames_per_second());
        row(
            &what,
            &format!("{wanted} frames a second with {name}"),
            found,
        );
    }
    if let Some(file) = &options.bunny {
        let mut scene = import_file(file, &Limits::default())?;
        scene.materials.fill(clear_glass());
        scene.environment = surroundings();
        let size = [1280, 1024];
        scene.cameras = vec![Camera::framing(&scene.bounds(), 1280.0 / 1024.0)];
        let settings = [("tracer", "bvh".to_owned()), ("bounces", "8".to_owned())];
        let measured = measure(gpu, &scene, size, &settings, options.seconds)?;
        let triangles = scene.statistics().triangles;
        let found = format!(
            "{:.0}: {:.3} ms, {} rays, {:.1} Mrays/s",
            measured.frames_per_second(),
            measured.frame,
            measured.rays,
            measured.rate()
        );
        let what = format!("a glass bunny of {triangles} triangles, 1280x1024, 8 generations");
        row(&what, "500 frames a second with bvh", found);
    }
    Ok(())
}

/// Draws the glass objects.
fn draw(gpu: &Gpu, options: &Options, file: &Path) -> Result<()> {
    const SAMPLES: u32 = 64;
    let scene = glass_objects(30_000);
    let mut renderer = Renderer::new(gpu, &scene, options.size, &[OF.to_owned()])?;
    for (key, value) in [("environment", "only"), ("bounces", "8"), ("split", "2")] {
        renderer.set(OF, key, value)?;
    }
    let effects = Effects::default().without_dither();
    for sample in 1..=SAMPLES {
        let last = (sample == SAMPLES).then_some(&effects);
        renderer.render_sample(&scene.cameras[0], SAMPLES, last, false)?;
    }
    let [width, height] = options.size;
    save_png(file, width, height, &renderer.pixels()?)?;
    Ok(())
}

fn main() -> Result<()> {
    let options = Options::parse()?;
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    if let Some(file) = &options.picture {
        return draw(&gpu, &options, file);
    }
    println!("{} ({})\n", gpu.adapter.name, gpu.adapter.driver);
    goals(&gpu, &options)?;
    println!();
    deforming(&gpu, &options)?;
    println!();
    still(&gpu, &options)
}
