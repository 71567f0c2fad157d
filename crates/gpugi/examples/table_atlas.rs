//! Prints a table of the cost of atlases: `cargo run --release -p gpugi --example table_atlas [FILE|NAME]...`, by
//! default for all built-in scenes.

use std::path::Path;
use std::time::Instant;

use gpugi::capture::atlas::{AtlasCapture, AtlasCaptureOptions, LeakTest};
use gpugi::gpu::{AdapterChoice, Frame, Gpu, read_buffer};
use gpugi::scene::GpuScene;
use gpugi_scene::atlas::{Seams, check_second_set};
use gpugi_scene::builtin::{SCENES, builtin};
use gpugi_scene::{Atlas, AtlasOptions, Limits, Scene, import_file};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut names: Vec<String> = std::env::args().skip(1).collect();
    if names.is_empty() {
        names = SCENES.iter().map(|scene| scene.name.to_owned()).collect();
    }
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    println!(
        "| scene | triangles | second sets | layout [s] | points first [s] | again [s] | texels | area | moved | invalid | seams [s] |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    for name in names {
        let scene = match builtin(&name, 1) {
            Some(scene) => scene,
            None => import_file(Path::new(&name), &Limits::default())?,
        };
        row(&gpu, &name, &scene)?;
    }
    Ok(())
}

fn row(gpu: &Gpu, name: &str, scene: &Scene) -> Result<(), Box<dyn std::error::Error>> {
    let valid = scene
        .meshes
        .iter()
        .filter(|mesh| check_second_set(mesh).is_ok());
    let valid = valid.count();
    let start = Instant::now();
    let atlas = Atlas::new(scene, &AtlasOptions::default())?;
    let layout = start.elapsed().as_secs_f64();

    let mut on_gpu = GpuScene::new(gpu, scene)?;
    let rays = GpuScene::with_rays(gpu, scene)?;
    let start = Instant::now();
    let mut capture =
        AtlasCapture::new(gpu, scene, &on_gpu, &atlas, &AtlasCaptureOptions::default())?;
    let mut leaks = LeakTest::new(gpu, &rays, &capture)?;
    let mut passes = Vec::new();
    for _ in 0..2 {
        on_gpu.invalidate_geometry();
        let mut frame = Frame::new(gpu, false);
        capture.record(&mut frame, &on_gpu)?;
        frame.submit()?;
        gpu.wait()?;
        passes.push(Instant::now());
    }
    let first = (passes[0] - start).as_secs_f64();
    let again = (passes[1] - passes[0]).as_secs_f64();
    let (mut texels, mut area) = (0, 0.0);
    for points in capture.points() {
        let words: Vec<[u32; 12]> = read_buffer(gpu, &points.points, u64::from(points.count) * 48)?;
        for point in words.iter().filter(|point| point[10] != u32::MAX) {
            texels += 1;
            area += f64::from(f32::from_bits(point[5]));
        }
    }
    let mut frame = Frame::new(gpu, false);
    leaks.record(&mut frame, &rays, &capture);
    frame.submit()?;
    let report = leaks.report(gpu)?;

    let start = Instant::now();
    let mut image = vec![glam::Vec3::ONE; (atlas.size * atlas.size * atlas.pages) as usize];
    for (index, texel) in image.iter_mut().enumerate() {
        texel.x = (index % 97) as f32;
    }
    Seams::new(scene, &atlas).smooth(&mut image);
    let seams = start.elapsed().as_secs_f64();
    println!(
        "| {} | {} | {valid} of {} | {layout:.3} | {first:.3} | {again:.3} | {texels} | {:+.4} % | {} | {} | {seams:.3} |",
        name.rsplit('/').next().unwrap_or(name),
        scene.statistics().triangles,
        scene.meshes.len(),
        100.0 * (area / scene_area(scene) - 1.0),
        report.moved,
        report.invalid,
    );
    Ok(())
}

fn scene_area(scene: &Scene) -> f64 {
    let area = |instance: &gpugi_scene::Instance| -> f64 {
        let mesh = &scene.meshes[instance.mesh];
        let triangles = mesh.indices.as_chunks::<3>().0.iter();
        let areas = triangles.map(|triangle| {
            let [a, b, c] = triangle.map(|index| {
                let position = mesh.positions[index as usize].as_dvec3();
                instance
                    .world_from_mesh
                    .as_dmat4()
                    .transform_point3(position)
            });
            (b - a).cross(c - a).length() / 2.0
        });
        areas.sum()
    };
    scene.instances.iter().map(area).sum()
}
