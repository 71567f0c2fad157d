//! `gpugi bench`: GPU time of each technique's passes, and frames per second.

use std::collections::{BTreeMap, VecDeque};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use gpugi::gpu::{Gpu, Timing, Timings};
use gpugi::lighting::Readiness;
use gpugi::picture::Effects;
use gpugi::scene::Edit;
use gpugi::techniques::Figure;
use gpugi::{Purpose, Renderer, Techniques};
use gpugi_arguments::{technique_names, with_settings};
use gpugi_scene::Camera;

use crate::output::{median, write_json};
use crate::render::{apply_settings, is_path_tracer, path_tracer_settings, print_notes, usage};
use crate::scene_argument::{self, SceneArguments};
use crate::{Common, Usage, bench_edits, bench_path_tracer, bench_rays};

/// Most frames that the GPU is given before the first of them is done: enough that it never waits for the host.
const MOST_IN_FLIGHT: usize = 16;

/// Time between frames, as effects are told (s).
const FRAME_SECONDS: f32 = 1.0 / 60.0;

/// Options of `gpugi bench`.
#[derive(Debug, clap::Args)]
#[command(mut_arg("scene", |scene| {
    let scene = scene.long("scene").display_order(0);
    scene.required(false).default_value("room")
}))]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// Width and height in pixels (default: 1280x1024, or 1920x1080 for bvh)
    #[arg(long, value_name = "WxH")]
    size: Option<String>,
    /// Techniques, or path-tracer, or bvh for rays per second, or edits for changes of ten thousand instances (default:
    /// the best real-time set)
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    technique: Vec<String>,
    /// Scene camera by name or index, or "eye=x,y,z;target=x,y,z;fov=DEG;aperture=M;focus=M;shutter=S"
    #[arg(long)]
    camera: Option<String>,
    /// A setting of a technique or an effect (repeatable)
    #[arg(long, value_name = "name.key=value")]
    set: Vec<String>,
    /// In frames that rebuild maps, move only the casters; maps that depend only on environment or lights are kept
    #[arg(long)]
    moving: bool,
    /// In frames that rebuild maps, move only the first light, by a centimetre
    #[arg(long, conflicts_with = "moving")]
    moving_light: bool,
    /// Keep only the first N punctual lights, and no other light
    #[arg(long, value_name = "N")]
    lights: Option<usize>,
    /// Frames to measure; for path-tracer, samples per pixel; for edits, edits of each kind
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: u32,
    /// Write the table as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The results.
#[derive(Debug, serde::Serialize)]
struct Measured {
    adapter: String,
    driver: String,
    scene: String,
    triangles: u64,
    size: [u32; 2],
    frames: u32,
    /// Whether only casters changed in frames that rebuild maps.
    moving: bool,
    /// Whether only the first light moved in these frames.
    moving_light: bool,
    /// All maps, before the frames; each of these makes no more than a slice of long work.
    completing: Completing,
    /// Median GPU milliseconds of each pass, summed over all its parts in a frame, in frames that rebuild maps.
    passes: BTreeMap<String, f64>,
    /// What the techniques counted in a frame.
    figures: Vec<OfFrame>,
    /// Median of the total GPU milliseconds of a frame's passes.
    passes_total_ms: f64,
    /// Wall time per frame (ms) with many frames queued and maps rebuilt.
    frame_dynamic_ms: f64,
    /// The same with maps kept.
    frame_static_ms: f64,
    /// Median CPU time to record and submit a frame (ms), with maps rebuilt, without `cpu_wait_ms`.
    cpu_record_ms: f64,
    /// Median time that such a frame waits for the GPU (ms), because it cannot be recorded before something is read back.
    cpu_wait_ms: f64,
}

/// What a frame took on the CPU, and the future times of its passes.
struct Recorded {
    recording: Duration,
    waiting: Duration,
    timings: Timings,
}

impl Recorded {
    /// Records frames as a live view does, until one has its light; waits for the GPU after each that has not. Recording
    /// includes what was done since `began`.
    fn since(
        began: Instant,
        gpu: &Gpu,
        mut record: impl FnMut() -> anyhow::Result<(Readiness, Timings)>,
    ) -> anyhow::Result<Self> {
        let mut timings = Timings::default();
        let mut waiting = Duration::ZERO;
        loop {
            let (readiness, more) = record()?;
            timings = timings.then(more);
            if readiness.is_usable() {
                return Ok(Self {
                    recording: began.elapsed() - waiting,
                    waiting,
                    timings,
                });
            }
            let waits = Instant::now();
            gpu.wait()?;
            waiting += waits.elapsed();
        }
    }
}

/// A number about a technique's work in a frame.
#[derive(Debug, serde::Serialize)]
struct OfFrame {
    name: String,
    value: f64,
    unit: &'static str,
    /// The number over the time of the pass that does this work.
    per_second: Option<f64>,
}

/// Figures and their rates, given the milliseconds of the passes.
fn of_frame(figures: Vec<Figure>, passes: &BTreeMap<String, f64>) -> Vec<OfFrame> {
    let figures = figures.into_iter().map(|figure| {
        let milliseconds = figure.pass.and_then(|pass| passes.get(pass));
        OfFrame {
            per_second: milliseconds.map(|milliseconds| figure.value / milliseconds * 1e3),
            name: figure.name,
            value: figure.value,
            unit: figure.unit,
        }
    });
    figures.collect()
}

/// Time that all maps take from nothing, once pipelines are compiled and texels laid out.
#[derive(Debug, serde::Serialize)]
struct Completing {
    /// GPU milliseconds of each pass, of all frames.
    passes: BTreeMap<String, f64>,
    wall_ms: f64,
}

impl Completing {
    fn measure(renderer: &mut Renderer, camera: &Camera) -> anyhow::Result<Self> {
        renderer.converge(camera, true, |_, _| ControlFlow::Continue(()))?;
        renderer.invalidate();
        let mut passes = BTreeMap::new();
        let started = Instant::now();
        renderer.converge(camera, true, |_, timings| {
            add_timings(&mut passes, timings);
            ControlFlow::Continue(())
        })?;
        let wall_ms = started.elapsed().as_secs_f64() * 1e3;
        Ok(Self { passes, wall_ms })
    }
}

/// Adds the times of passes, which may run several times.
fn add_timings(sums: &mut BTreeMap<String, f64>, timings: Vec<Timing>) {
    for timing in timings {
        *sums.entry(timing.pass).or_default() += timing.milliseconds;
    }
}

/// Measures.
pub fn run(common: &Common, arguments: &Arguments) -> anyhow::Result<()> {
    if arguments.technique == ["edits"] {
        let gpu = Gpu::open(&common.adapter)?;
        return bench_edits::run(&gpu, arguments.frames, arguments.json.as_deref());
    }
    let rays = arguments.technique == ["bvh"];
    let size = match (&arguments.size, rays) {
        (Some(size), _) => size,
        (None, false) => "1280x1024",
        (None, true) => "1920x1080",
    };
    let size = size
        .split_once('x')
        .and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]))
        .filter(|size| size.iter().all(|&side: &u32| side > 0))
        .ok_or_else(|| Usage(format!("--size {size}: expected WIDTHxHEIGHT")))?;
    let name = &arguments.scene.scene;
    let (mut scene, notes) = scene_argument::load(&arguments.scene)?;
    print_notes(common, &notes);
    if let Some(count) = arguments.lights {
        scene.lights.truncate(count);
        scene.environment = None;
        for material in &mut scene.materials {
            material.emissive = glam::Vec3::ZERO;
        }
    }
    if rays {
        let gpu = Gpu::open(&common.adapter)?;
        return bench_rays::run(&gpu, &scene, size, arguments.json.as_deref());
    }
    let aspect = size[0] as f32 / size[1] as f32;
    let camera = scene_argument::camera(&scene, arguments.camera.as_deref(), aspect)?;
    let live = Effects::of_live_view().exposed(0.0);
    let (effects, set) = with_settings(live, &arguments.set)?;
    let gpu = Gpu::open(&common.adapter)?;
    if is_path_tracer(&arguments.technique)? {
        return bench_path_tracer::run(
            &gpu,
            name,
            &scene,
            &camera,
            size,
            arguments.frames,
            &path_tracer_settings(&set)?,
            arguments.json.as_deref(),
        );
    }
    let techniques = match technique_names(&arguments.technique) {
        Some(names) => Techniques::Named(names),
        None => Techniques::Default(Purpose::LiveView),
    };
    let mut renderer = Renderer::new(&gpu, &scene, size, techniques).map_err(usage)?;
    apply_settings(&mut renderer, &set)?;
    if arguments.moving_light && scene.lights.is_empty() {
        let message = format!("--moving-light: {name} has no punctual light");
        return Err(Usage(message).into());
    }
    let completing = Completing::measure(&mut renderer, &camera)?;
    let mut moves = 0;
    let mut frame = |renderer: &mut Renderer, dynamic: bool, timed: bool| {
        let began = Instant::now();
        renderer.restart();
        renderer.pass_time(FRAME_SECONDS);
        if dynamic && arguments.moving_light {
            moves += 1;
            let mut light = scene.lights[0].clone();
            light.world_from_light.w_axis.x += 0.01 * (moves % 32) as f32;
            renderer.edit(&[Edit::Light { index: 0, light }])?;
        } else if dynamic && arguments.moving {
            renderer.invalidate_geometry();
        } else if dynamic {
            renderer.invalidate();
        }
        Recorded::since(began, &gpu, || {
            Ok(renderer.try_render_sample(&camera, 1, Some(&effects), timed)?)
        })
    };
    for _ in 0..3 {
        frame(&mut renderer, true, true)?.timings.wait()?;
    }
    let mut passes: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    let mut totals = Vec::new();
    for _ in 0..arguments.frames {
        let timings = frame(&mut renderer, true, true)?.timings.wait()?;
        totals.push(timings.iter().map(|timing| timing.milliseconds).sum());
        // A pass may run several times per frame, for example in batches.
        let mut sums = BTreeMap::new();
        add_timings(&mut sums, timings);
        for (pass, sum) in sums {
            passes.entry(pass).or_default().push(sum);
        }
    }
    let wait = || gpu.wait();
    let (mut recording, mut waiting) = (Vec::new(), Vec::new());
    let mut wall = |dynamic: bool| -> anyhow::Result<f64> {
        // Takes what the frames before have read back.
        frame(&mut renderer, dynamic, false)?;
        wait()?;
        let mut in_flight = VecDeque::new();
        let started = Instant::now();
        for _ in 0..arguments.frames {
            let recorded = frame(&mut renderer, dynamic, false)?;
            if dynamic {
                recording.push(recorded.recording.as_secs_f64() * 1e3);
                waiting.push(recorded.waiting.as_secs_f64() * 1e3);
            }
            in_flight.extend(gpu.last_submission());
            if in_flight.len() > MOST_IN_FLIGHT
                && let Some(first) = in_flight.pop_front()
            {
                gpu.wait_for(first)?;
            }
        }
        wait()?;
        Ok(started.elapsed().as_secs_f64() * 1e3 / f64::from(arguments.frames))
    };
    let frame_dynamic_ms = wall(true)?;
    let frame_static_ms = wall(false)?;
    // What the techniques count in one of the frames whose passes were timed.
    renderer.figures()?;
    frame(&mut renderer, true, false)?;
    let figures = renderer.figures()?;
    let passes = passes.into_iter();
    let passes: BTreeMap<_, _> = passes.map(|(pass, times)| (pass, median(times))).collect();
    let measured = Measured {
        adapter: gpu.adapter.name.clone(),
        driver: gpu.adapter.driver.clone(),
        scene: name.clone(),
        triangles: scene.statistics().triangles,
        size,
        frames: arguments.frames,
        moving: arguments.moving,
        moving_light: arguments.moving_light,
        completing,
        figures: of_frame(figures, &passes),
        passes,
        passes_total_ms: median(totals),
        frame_dynamic_ms,
        frame_static_ms,
        cpu_record_ms: median(recording),
        cpu_wait_ms: median(waiting),
    };
    print_table(&measured);
    if let Some(path) = &arguments.json {
        write_json(path, &measured)?;
    }
    Ok(())
}

fn print_table(measured: &Measured) {
    let [width, height] = measured.size;
    println!("{} ({})", measured.adapter, measured.driver);
    println!(
        "{}: {} triangles, {width}x{height}, median of {} frames",
        measured.scene, measured.triangles, measured.frames
    );
    let Completing { passes, wall_ms } = &measured.completing;
    for (pass, milliseconds) in passes {
        println!("  {pass:34} {milliseconds:9.4} ms GPU, all maps");
    }
    println!("  {:34} {wall_ms:9.4} ms wall", "all maps");
    for (pass, milliseconds) in &measured.passes {
        println!("  {pass:34} {milliseconds:9.4} ms GPU");
    }
    println!(
        "  {:34} {:9.4} ms GPU",
        "all passes", measured.passes_total_ms
    );
    for figure in &measured.figures {
        let OfFrame {
            name, value, unit, ..
        } = figure;
        // Counts have no fraction.
        let digits = if value.fract() == 0.0 { 0 } else { 2 };
        let rate = figure
            .per_second
            .map(|rate| format!(", {:.3} million per second", rate * 1e-6));
        let rate = rate.unwrap_or_default();
        println!("  {name:34} {value:9.digits$} {unit}{rate}");
    }
    for (name, milliseconds) in [
        (
            match (measured.moving, measured.moving_light) {
                (true, _) => "frame, casters moving",
                (_, true) => "frame, a light moving",
                _ => "frame, maps made every frame",
            },
            measured.frame_dynamic_ms,
        ),
        ("frame, maps kept", measured.frame_static_ms),
    ] {
        println!(
            "  {name:34} {milliseconds:9.4} ms wall, {:.0} frames per second",
            1e3 / milliseconds
        );
    }
    for (name, milliseconds) in [
        ("recording and submitting a frame", measured.cpu_record_ms),
        ("waiting for the GPU meanwhile", measured.cpu_wait_ms),
    ] {
        println!("  {name:34} {milliseconds:9.4} ms CPU");
    }
}
