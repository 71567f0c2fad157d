//! `gpugi bench --technique bvh`: rays per second.

use std::path::Path;

use gpugi::gpu::Gpu;
use gpugi::ray_bench::{RayRate, measure};
use gpugi_scene::Scene;

use crate::output::write_json;

/// The results.
#[derive(Debug, serde::Serialize)]
struct Measured {
    adapter: String,
    driver: String,
    scene: String,
    triangles: u64,
    size: [u32; 2],
    rates: Vec<RayRate>,
}

/// Measures and prints.
pub fn run(gpu: &Gpu, scene: &Scene, size: [u32; 2], json: Option<&Path>) -> anyhow::Result<()> {
    let measured = Measured {
        adapter: gpu.adapter.name.clone(),
        driver: gpu.adapter.driver.clone(),
        scene: scene.name.clone(),
        triangles: scene.statistics().triangles,
        size,
        rates: measure(gpu, scene, size)?,
    };
    let [width, height] = size;
    println!("{} ({})", measured.adapter, measured.driver);
    println!(
        "{}: {} triangles, {width}x{height}; shadow rays: any hit toward a point light above",
        measured.scene, measured.triangles
    );
    println!(
        "  {:8} {:9} {:>9} {:>6} {:>15} {:>15} {:>6} {:>9} {:>9} {:>7}",
        "rays",
        "checks",
        "launch",
        "hit",
        "best",
        "median",
        "nodes",
        "triangles",
        "instances",
        "bytes"
    );
    for rate in &measured.rates {
        println!(
            "  {:8} {:9} {:9} {:5.1}% {:7.1} Mrays/s {:7.1} Mrays/s {:6.2} {:9.2} {:9.2} {:7.0}",
            rate.kind,
            if rate.checked { "checked" } else { "unchecked" },
            rate.rays,
            rate.hit_fraction * 100.0,
            rate.best_mrays,
            rate.median_mrays,
            rate.nodes,
            rate.triangles,
            rate.instances,
            rate.bytes,
        );
    }
    if let Some(path) = json {
        write_json(path, &measured)?;
    }
    Ok(())
}
