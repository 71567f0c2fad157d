//! A light bake cut into tasks, which could run on as many machines: tasks and results travel as bytes, arrive in any
//! order, and merge to the same bits as the plain bake.
//!
//! `cargo run --release --example bake_tasks`

use std::error::Error;

use gpugi::bake::{Bake, LightBake, LightOptions, Task};
use gpugi::gpu::{AdapterChoice, Gpu};
use gpugi_scene::{Atlas, AtlasOptions, Scene, TexelDensity};

/// The bake that all machines set up alike: scene, atlas, techniques, settings and options.
fn bake(gpu: &Gpu, scene: &Scene, atlas: &Atlas) -> Result<LightBake, gpugi::LightingError> {
    let names = ["shadow-map", "radiosity"].map(str::to_owned);
    let options = LightOptions {
        samples: 4,
        samples_per_task: 2,
        // Small tiles, so that there is something to share out.
        memory: 1 << 19,
        ..LightOptions::default()
    };
    let mut bake = LightBake::new(gpu, scene, atlas, &names, &options)?;
    bake.set("radiosity", "resolution", "64")?;
    bake.set("radiosity", "iterations", "16")?;
    Ok(bake)
}

fn main() -> Result<(), Box<dyn Error>> {
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    let scene = gpugi_scene::builtin::builtin("cornell", 1).ok_or("a built-in scene")?;
    let options = AtlasOptions {
        size: 64,
        density: TexelDensity::PerMetre(8.0),
        ..AtlasOptions::default()
    };
    let atlas = Atlas::new(&scene, &options)?;

    // One process plans, and another solves the maps, which take longest.
    let mut merged = bake(&gpu, &scene, &atlas)?;
    let tasks: Vec<Vec<u8>> = merged
        .tasks()
        .iter()
        .map(postcard::to_allocvec)
        .collect::<Result<_, _>>()?;
    let mut first = bake(&gpu, &scene, &atlas)?;
    let maps = postcard::to_allocvec(&first.run(&Task::Maps)?)?;
    println!("{} tasks; the maps take {} bytes", tasks.len(), maps.len());

    // A third one gets the solved maps. The two light texels, the last tile first.
    let mut second = bake(&gpu, &scene, &atlas)?;
    second.merge(postcard::from_bytes(&maps)?)?;
    for (number, task) in tasks.iter().enumerate().skip(1).rev() {
        let worker = if number % 2 == 0 {
            &mut first
        } else {
            &mut second
        };
        let result = worker.run(&postcard::from_bytes(task)?)?;
        let sent = postcard::to_allocvec(&result)?;
        merged.merge(postcard::from_bytes(&sent)?)?;
    }
    assert!(merged.is_complete());

    // The plain bake takes the same tasks one after another.
    let mut plain = bake(&gpu, &scene, &atlas)?;
    while plain.step()?.is_some() {}
    assert!(plain.finish() == merged.finish());
    println!("merged and plain bake have the same bits");
    Ok(())
}
