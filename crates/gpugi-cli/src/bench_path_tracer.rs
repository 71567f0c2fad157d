//! `gpugi bench --technique path-tracer`: samples and path segments per second, and the time to a given error.

use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

use gpugi::gpu::Gpu;
use gpugi::reference::{PathTracer, Settings};
use gpugi_scene::{Camera, Scene};

use crate::output::write_json;
use crate::render::usage;

/// The error for which equal-error times are reported.
const TARGET: f64 = 1e-3;
/// Maximum time to reach that error (s).
const PATIENCE: f64 = 60.0;

/// The results.
#[derive(Debug, serde::Serialize)]
struct Measured {
    adapter: String,
    driver: String,
    scene: String,
    triangles: u64,
    size: [u32; 2],
    max_bounces: u32,
    samples: u32,
    seconds: f64,
    million_samples_per_second: f64,
    million_segments_per_second: f64,
    segments_per_sample: f64,
    /// Estimated relative mean squared error after `samples`.
    estimated_rel_mse: f64,
    /// Time until the estimate falls to 0.001; `None` if it did not within a minute.
    seconds_to_rel_mse_0_001: Option<f64>,
    samples_to_rel_mse_0_001: u32,
    scene_bytes: u64,
}

/// Measures.
#[allow(clippy::too_many_arguments)]
pub fn run(
    gpu: &Gpu,
    name: &str,
    scene: &Scene,
    camera: &Camera,
    size: [u32; 2],
    samples: u32,
    settings: &Settings,
    json: Option<&Path>,
) -> anyhow::Result<()> {
    let mut tracer = PathTracer::new(gpu, scene, size, settings).map_err(usage)?;
    let mut on = |_: &gpugi::reference::Progress| ControlFlow::Continue(());
    // Warm up until dispatches reach their full size.
    let started = Instant::now();
    let mut warm = 0;
    while started.elapsed().as_secs_f64() < 1.0 && warm < samples {
        warm = (warm * 2).clamp(1, samples);
        tracer.render(camera, warm, &mut on)?;
    }
    tracer.restart(0)?;
    let before = Instant::now();
    tracer.render(camera, samples, &mut on)?;
    let seconds = before.elapsed().as_secs_f64();
    let segments = tracer.segments()? as f64;
    let pixel_samples = f64::from(size[0]) * f64::from(size[1]) * f64::from(samples);
    let estimated_rel_mse = tracer.noise()?;

    tracer.restart(1)?;
    let mut spent = 0.0;
    let mut reached = None;
    while reached.is_none() && spent < PATIENCE {
        let before = Instant::now();
        let more = (tracer.samples() / 8).max(1);
        tracer.render(camera, tracer.samples() + more, &mut on)?;
        spent += before.elapsed().as_secs_f64();
        if tracer.samples() >= 16 && tracer.noise()? <= TARGET {
            reached = Some(spent);
        }
    }
    let measured = Measured {
        adapter: gpu.adapter.name.clone(),
        driver: gpu.adapter.driver.clone(),
        scene: name.to_owned(),
        triangles: scene.statistics().triangles,
        size,
        max_bounces: settings.max_bounces,
        samples,
        seconds,
        million_samples_per_second: pixel_samples / seconds * 1e-6,
        million_segments_per_second: segments / seconds * 1e-6,
        segments_per_sample: segments / pixel_samples,
        estimated_rel_mse,
        seconds_to_rel_mse_0_001: reached,
        samples_to_rel_mse_0_001: tracer.samples(),
        scene_bytes: tracer.scene().bytes,
    };
    print_table(&measured);
    match json {
        Some(path) => write_json(path, &measured),
        None => Ok(()),
    }
}

fn print_table(measured: &Measured) {
    let [width, height] = measured.size;
    println!("{} ({})", measured.adapter, measured.driver);
    println!(
        "{}: {} triangles, {width}x{height}, {} bounces, {} samples in {:.3} s",
        measured.scene,
        measured.triangles,
        measured.max_bounces,
        measured.samples,
        measured.seconds
    );
    println!(
        "  {:8.2} million samples a second, {:8.2} million path segments a second ({:.2} a sample)",
        measured.million_samples_per_second,
        measured.million_segments_per_second,
        measured.segments_per_sample
    );
    println!("  estimated rel-mse {:.2e}", measured.estimated_rel_mse);
    match measured.seconds_to_rel_mse_0_001 {
        Some(seconds) => println!(
            "  {seconds:.3} s and {} samples to an estimated rel-mse of 0.001",
            measured.samples_to_rel_mse_0_001
        ),
        None => println!(
            "  an estimated rel-mse of 0.001 was not reached in {PATIENCE} s and {} samples",
            measured.samples_to_rel_mse_0_001
        ),
    }
}
