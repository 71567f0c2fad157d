//! `gpugi bench --technique edits`: what it costs to change a scene of ten thousand instances, beside the frame.

use std::path::Path;
use std::time::Instant;

use glam::{Mat4, Vec3, vec3};
use gpugi::gpu::{Frame, Gpu, GpuError};
use gpugi::scene::{Edit, GpuScene};
use gpugi_scene::builtin::shapes::cuboid;
use gpugi_scene::{Environment, Light, LightKind, Material, Scene};

use crate::output::{median, write_json};

/// Instances along each side of the square that they stand in.
const SIDE: usize = 100;

/// What was measured.
#[derive(Debug, serde::Serialize)]
struct Measured {
    adapter: String,
    driver: String,
    instances: usize,
    edits: Vec<Row>,
}

/// One kind of edit.
#[derive(Debug, serde::Serialize)]
struct Row {
    /// Whether rays are traced in the scene; otherwise captures see it.
    rays: bool,
    edit: &'static str,
    /// Median CPU time of an edit (ms).
    cpu_ms: f64,
    /// Most bytes that one uploaded.
    bytes: u64,
}

/// Measures `count` edits of each kind.
pub fn run(gpu: &Gpu, count: u32, json: Option<&Path>) -> anyhow::Result<()> {
    let scene = cubes();
    let mut measured = Measured {
        adapter: gpu.adapter.name.clone(),
        driver: gpu.adapter.driver.clone(),
        instances: scene.instances.len(),
        edits: Vec::new(),
    };
    println!("{} ({})", measured.adapter, measured.driver);
    println!(
        "{} instances, median of {count} edits of each kind",
        measured.instances
    );
    type Make = fn(&Gpu, &Scene) -> Result<GpuScene, GpuError>;
    for (rays, make) in [(false, GpuScene::new as Make), (true, GpuScene::with_rays)] {
        let mut on_gpu = make(gpu, &scene)?;
        for (edit, edits) in KINDS {
            let mut times = Vec::new();
            let mut most = 0;
            for number in 0..count {
                let edits = edits(&scene, number);
                let before = gpu.uploaded_bytes();
                let started = Instant::now();
                on_gpu.edit(gpu, &edits)?;
                times.push(started.elapsed().as_secs_f64() * 1e3);
                most = most.max(gpu.uploaded_bytes() - before);
                // As a frame does.
                Frame::new(gpu, false).submit()?;
                gpu.wait()?;
            }
            let row = Row {
                rays,
                edit,
                cpu_ms: median(times),
                bytes: most,
            };
            let kind = if rays { "rays" } else { "captures" };
            println!(
                "  {kind:8} {edit:20} {:9.4} ms CPU {:9} bytes",
                row.cpu_ms, row.bytes
            );
            measured.edits.push(row);
        }
    }
    if let Some(path) = json {
        write_json(path, &measured)?;
    }
    Ok(())
}

/// The edits of each kind, by the number of the repetition.
type Kind = (&'static str, fn(&Scene, u32) -> Vec<Edit>);
const KINDS: [Kind; 5] = [
    ("move an instance", |scene, number| {
        // A few of them lie at the border, where the scene's box follows.
        let index = number as usize * 7919 % scene.instances.len();
        vec![moved(scene, index, number)]
    }),
    ("move all instances", |scene, number| {
        let all = 0..scene.instances.len();
        all.map(|index| moved(scene, index, number)).collect()
    }),
    ("change a material", |scene, number| {
        let mut material = scene.materials[0].clone();
        material.roughness = 0.2 + 0.1 * (number % 7) as f32;
        vec![Edit::Material {
            index: 0,
            material: Box::new(material),
        }]
    }),
    ("turn the sky", |scene, number| {
        let sky = scene.environment.clone().map(|sky| Environment {
            rotation: glam::Quat::from_rotation_y(0.1 * (number + 1) as f32),
            ..sky
        });
        sky.map(Edit::Environment).into_iter().collect()
    }),
    ("move a light", |scene, number| {
        let mut light = scene.lights[0].clone();
        light.world_from_light.w_axis.x += (number + 1) as f32;
        vec![Edit::Light { index: 0, light }]
    }),
];

fn moved(scene: &Scene, index: usize, number: u32) -> Edit {
    let by = vec3(0.0, 0.1 + 0.1 * (number % 7) as f32, 0.0);
    Edit::Instance {
        index,
        world_from_mesh: Mat4::from_translation(by) * scene.instances[index].world_from_mesh,
    }
}

/// Cubes in a square, a light and a sky.
fn cubes() -> Scene {
    let mut scene = Scene::new("cubes");
    let mesh = scene.add_mesh(cuboid(Vec3::ZERO, Vec3::splat(0.5), 1));
    let material = scene.add_material(Material::default());
    for index in 0..SIDE * SIDE {
        let [x, z] = [index % SIDE, index / SIDE].map(|at| at as f32);
        let place = Mat4::from_translation(vec3(x, 0.0, z));
        scene.add_instance("", mesh, material, place);
    }
    let light = Light::new("", LightKind::Point, Vec3::splat(100.0));
    let at = vec3(0.0, 10.0, 0.0);
    scene.lights.push(light.aimed(at, Vec3::ZERO));
    scene.environment = Some(Environment::default_sky());
    scene
}
