//! `gpugi measure`.

mod equal_time;

use std::ops::ControlFlow;
use std::path::PathBuf;

use gpugi::gpu::Gpu;
use gpugi::measure::{
    Cache, Live, MeasureError, Measured, Memory, Moves, Options, PassTime, Quality, Subject,
    TracedPart, measure, measure_live, trace_live,
};
use gpugi::picture::{self, Effects};
use gpugi::{Motion, Purpose, Renderer};
use gpugi_arguments::{parse_size, with_settings};
use gpugi_scene::image::metrics::{Metric, Picture, compare, heat_map};
use serde_json::{Map, Value};

use crate::compare::{in_json, print_line};
use crate::output::{write_json, write_png};
use crate::progress::Progress;
use crate::render::{Chosen, SHUTTER_STEPS, is_path_tracer, print_notes};
use crate::scene_argument::{self, SceneArguments};
use crate::{Common, Usage, interrupt};

/// Options of `gpugi measure`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// Techniques, separated by commas (default: the set that `render` chooses)
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    technique: Vec<String>,
    /// Compare with all light of the scene, not only the techniques' light paths: light that they lack counts as error
    #[arg(long)]
    all_light: bool,
    /// Measure live frames instead, in motion and at rest after it, against all light
    #[arg(long, conflicts_with_all = ["all_light", "diff"])]
    live: bool,
    /// What moves in live frames: camera (an orbit), animation (the scene's), swing=NAMES (lights or objects, sideways), or
    /// off=NAMES (nothing, but lights or emitters are off in the last 16 frames)
    #[arg(long, value_name = "WHAT", default_value_t = Moves::Camera, requires = "live")]
    moves: Moves,
    /// Measure instead what each of several sets shows when so many milliseconds have passed, against all light: still
    /// pictures, and frames in motion (docs/equal-time.md)
    #[arg(
        long, value_name = "MS,...", value_delimiter = ',',
        conflicts_with_all = ["live", "all_light", "diff", "side_by_side", "technique", "samples"]
    )]
    equal_time: Vec<f64>,
    /// Sets for --equal-time, separated by semicolons: "default", "path-tracer", or techniques and their settings,
    /// separated by commas [default: default;path-tracing;path-tracer]
    #[arg(
        long,
        value_name = "SET;...",
        value_delimiter = ';',
        requires = "equal_time"
    )]
    techniques: Vec<String>,
    /// Which of the two to measure (default: both)
    #[arg(long, value_name = "KIND", requires = "equal_time")]
    pictures: Option<equal_time::Pictures>,
    /// Write the chart of --equal-time
    #[arg(long, value_name = "FILE.svg", requires = "equal_time")]
    svg: Option<PathBuf>,
    /// A technique's setting (repeatable)
    #[arg(long, value_name = "technique.key=value")]
    set: Vec<String>,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "320x240", value_parser = parse_size)]
    size: [u32; 2],
    /// Scene camera by name or index, or "eye=x,y,z;target=x,y,z;up=x,y,z;fov=DEG"
    #[arg(long)]
    camera: Option<String>,
    /// Samples per pixel for the techniques
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    samples: u32,
    /// Steps in which maps and lights follow what moves while the shutter is open; what is seen moves with every sample
    #[arg(long, value_name = "N", default_value_t = SHUTTER_STEPS, value_parser = clap::value_parser!(u32).range(1..=1024))]
    shutter_steps: u32,
    /// Samples per pixel for the path tracer (default: 1024, or 16777216 with --noise)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(16..=16_777_216))]
    reference_samples: Option<u32>,
    /// Stop the path tracer when its estimated rel-mse falls to this value
    #[arg(long, value_name = "REL-MSE")]
    noise: Option<f64>,
    /// Seed of all random numbers
    #[arg(long, default_value_t = 0)]
    seed: u32,
    /// Folder for cached references of the path tracer (default: gpugi in the user's cache folder)
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
    /// Neither read nor write cached references
    #[arg(long, conflicts_with = "cache")]
    no_cache: bool,
    /// Write the result as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write a heat map of each pixel's relative error
    #[arg(long, value_name = "FILE.png")]
    diff: Option<PathBuf>,
    /// Write the techniques' image, the path tracer's at the same exposure, and the heat map side by side
    #[arg(long, value_name = "FILE.png")]
    side_by_side: Option<PathBuf>,
}

/// The content of `--json`.
#[derive(serde::Serialize)]
struct Report<'a> {
    scene: &'a str,
    techniques: Map<String, Value>,
    size: [u32; 2],
    samples: u32,
    seed: u32,
    adapter: &'a str,
    driver: &'a str,
    metrics: Map<String, Value>,
    passes: &'a [PassTime],
    memory_bytes: Memory,
    map_frames: u32,
    reference: Reference<'a>,
    notes: &'a [String],
}

#[derive(serde::Serialize)]
struct Reference<'a> {
    estimated_rel_mse: f64,
    seconds: f64,
    cached: bool,
    parts: &'a [TracedPart],
}

/// Measures, prints and writes the requested files.
pub fn run(common: &Common, arguments: &Arguments) -> anyhow::Result<()> {
    crate::output::check_folders(
        [
            &arguments.json,
            &arguments.diff,
            &arguments.side_by_side,
            &arguments.svg,
        ]
        .into_iter()
        .flatten()
        .map(PathBuf::as_path),
    )?;
    for (option, path) in [
        ("--diff", &arguments.diff),
        ("--side-by-side", &arguments.side_by_side),
    ] {
        let is_png = |path: &PathBuf| {
            path.extension()
                .is_some_and(|extension| extension.eq_ignore_ascii_case("png"))
        };
        if let Some(path) = path.as_ref().filter(|path| !is_png(path)) {
            let message = format!("{option} {}: the name must end in .png", path.display());
            return Err(Usage(message).into());
        }
    }
    let mut options = options(arguments)?;
    if is_path_tracer(&arguments.technique)? {
        let message =
            "--technique path-tracer: it is the reference; name what to compare with it".into();
        return Err(Usage(message).into());
    }
    let (scene, mut notes) = scene_argument::load(&arguments.scene)?;
    let size = arguments.size;
    let aspect = size[0] as f32 / size[1] as f32;
    let camera = scene_argument::camera(&scene, arguments.camera.as_deref(), aspect)?;
    options.motion = Motion::seen_by(&camera, &scene, arguments.scene.time);
    let gpu = Gpu::open(&common.adapter)?;
    let of_reference = format!("{}.", gpugi::reference::INFO.name);
    if let Some(set) = arguments
        .set
        .iter()
        .find(|set| set.starts_with(&of_reference))
    {
        return Err(Usage(format!(
            "--set {set}: the reference takes its settings from the techniques' light paths"
        ))
        .into());
    }
    let compares_times = !arguments.equal_time.is_empty();
    // Effects of live frames, and the techniques' settings.
    let (effects, settings) = match arguments.live || compares_times {
        true => with_settings(Effects::of_live_view(), &arguments.set)?,
        false => (Effects::default(), arguments.set.clone()),
    };
    let subject = Subject {
        scene: &scene,
        camera: &camera,
        size,
    };
    (arguments.moves.check(&scene))
        .map_err(|reason| Usage(format!("--moves {}: {reason}", arguments.moves)))?;
    interrupt::catch();
    let mut shown = (String::new(), Progress::new(common.quiet));
    let mut report = |progress: &gpugi::measure::Progress| {
        if shown.0 != progress.stage {
            shown.1.finish();
            shown = (progress.stage.clone(), Progress::new(common.quiet));
        }
        let message = format!("{}: {}", progress.stage, progress.state);
        shown.1.show(progress.fraction, &message);
        if interrupt::asked() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    };
    if compares_times {
        if let Some(setting) = settings.first() {
            let message =
                format!("--set {setting}: settings of techniques belong in --techniques here");
            return Err(Usage(message).into());
        }
        let comparison = equal_time::Comparison::new(
            &gpu,
            (&arguments.scene.scene, subject),
            (&effects, &options),
            (&arguments.equal_time, &arguments.techniques),
            arguments.pictures,
        )?;
        let files = [arguments.json.as_deref(), arguments.svg.as_deref()];
        let compared = comparison.run(&mut report)?;
        shown.1.finish();
        notes.extend(compared.notes.iter().cloned());
        print_notes(common, &notes);
        if !common.quiet {
            comparison.print(&compared);
        }
        return comparison.write(&compared, files);
    }
    let mut chosen = Chosen::new(
        &gpu,
        &scene,
        size,
        match arguments.live {
            true => Purpose::LiveView,
            false => Purpose::StillPicture,
        },
        &arguments.technique,
        &settings,
    )?;
    if arguments.live {
        let renderer = &mut chosen.renderer;
        let classes = renderer.light_classes();
        let moves = (&arguments.moves, arguments.scene.time);
        let truth = trace_live(&gpu, &subject, moves, &classes, &options, &mut report)?;
        let seen = (&scene, &camera);
        let live = measure_live(seen, renderer, &effects, &truth, &options, &mut report)?;
        shown.1.finish();
        print_notes(common, &notes);
        if !common.quiet {
            print_live(&gpu, arguments, &chosen.renderer, &live);
        }
        if let Some(path) = &arguments.side_by_side {
            let [shown, truth] = &live.last;
            let errors = heat(size, shown, truth)?;
            let (size, pixels) = side_by_side(&gpu, size, [shown, truth], &errors)?;
            write_png(path, size, &pixels)?;
        }
        return match &arguments.json {
            Some(path) => write_json(path, &live),
            None => Ok(()),
        };
    }
    let measured = loop {
        let renderer = &mut chosen.renderer;
        match measure(&gpu, &scene, &camera, renderer, &options, &mut report) {
            Ok(measured) => break measured,
            Err(MeasureError::Render(error)) => chosen.without_atlas(error)?,
            Err(other) => return Err(other.into()),
        }
    };
    shown.1.finish();
    let Chosen { renderer, set, .. } = chosen;
    notes.extend(set.into_iter().flat_map(|set| set.notes));

    notes.extend(measured.notes.iter().cloned());
    print_notes(common, &notes);
    if !common.quiet {
        print(&gpu, arguments, &renderer, &measured);
    }
    let errors = error_colors(&measured);
    if let Some(path) = &arguments.diff {
        write_png(path, size, &errors)?;
    }
    if let Some(path) = &arguments.side_by_side {
        let (size, pixels) = side_by_side(
            &gpu,
            size,
            [&measured.radiance, &measured.truth.radiance],
            &errors,
        )?;
        write_png(path, size, &pixels)?;
    }
    if let Some(path) = &arguments.json {
        let metrics = measured.metrics.iter();
        let report = Report {
            scene: &arguments.scene.scene,
            techniques: renderer
                .techniques()
                .iter()
                .map(|technique| {
                    (
                        technique.info().name.to_owned(),
                        technique.settings().to_json(),
                    )
                })
                .collect(),
            size,
            samples: arguments.samples,
            seed: arguments.seed,
            adapter: &gpu.adapter.name,
            driver: &gpu.adapter.driver,
            metrics: metrics
                .map(|(metric, result)| (metric.name().to_owned(), in_json(result)))
                .collect(),
            passes: &measured.passes,
            memory_bytes: measured.memory,
            map_frames: measured.map_frames,
            reference: Reference {
                estimated_rel_mse: measured.truth.rel_mse(),
                seconds: measured.truth.seconds(),
                cached: measured.truth.is_cached(),
                parts: &measured.truth.parts,
            },
            notes: &notes,
        };
        write_json(path, &report)?;
    }
    Ok(())
}

fn options(arguments: &Arguments) -> anyhow::Result<Options> {
    let noise = arguments.noise.unwrap_or(0.0);
    if !(noise.is_finite() && noise >= 0.0) || arguments.noise == Some(0.0) {
        return Err(Usage(format!("--noise {noise}: a number above 0 is needed")).into());
    }
    let default = Quality::default().samples;
    let samples = match (arguments.reference_samples, arguments.noise) {
        (Some(samples), _) => samples,
        (None, Some(_)) => 16_777_216,
        (None, None) => default,
    };
    let cache = match (&arguments.cache, arguments.no_cache) {
        (_, true) => None,
        (Some(folder), false) => Some(Cache::new(folder)),
        // Without a home folder, nothing is cached.
        (None, false) => etcetera::base_strategy::choose_native_strategy()
            .ok()
            .map(|folders| etcetera::BaseStrategy::cache_dir(&folders).join("gpugi"))
            .map(Cache::new),
    };
    Ok(Options {
        samples: arguments.samples,
        reference: Quality { samples, noise },
        seed: arguments.seed,
        cache,
        all_light: arguments.all_light,
        shutter_steps: arguments.shutter_steps,
        motion: None,
    })
}

/// Names of the techniques in use.
fn names(renderer: &Renderer) -> String {
    let techniques = renderer.techniques().iter();
    let names: Vec<&str> = techniques.map(|technique| technique.info().name).collect();
    names.join(", ")
}

fn print_live(gpu: &Gpu, arguments: &Arguments, renderer: &Renderer, live: &Live) {
    let [width, height] = arguments.size;
    println!(
        "{}: {} live against all light, {width}x{height}, on {} ({})",
        arguments.scene.scene,
        names(renderer),
        gpu.adapter.name,
        gpu.adapter.driver
    );
    if let Some(milliseconds) = live.milliseconds {
        println!("  frame     {milliseconds:9.3} ms GPU");
    }
    println!("  moving    {:9.4} flip", live.moving);
    println!("  still     {:9.4} flip", live.still);
    println!("  flicker   {:9.3} % of white", live.flicker * 100.0);
    println!("  mean      {:9.4} of the reference's", live.brightness);
    println!(
        "reference: estimated rel-mse {:.2e}",
        live.reference_rel_mse
    );
    for pass in &live.passes {
        println!("  {:34} {:9.4} ms GPU", pass.pass, pass.milliseconds);
    }
}

fn print(gpu: &Gpu, arguments: &Arguments, renderer: &Renderer, measured: &Measured) {
    let [width, height] = measured.size;
    println!(
        "{}: {} against the path tracer, {width}x{height}, {} samples, on {} ({})",
        arguments.scene.scene,
        names(renderer),
        arguments.samples,
        gpu.adapter.name,
        gpu.adapter.driver
    );
    for (metric, comparison) in &measured.metrics {
        print_line(*metric, comparison);
    }
    println!(
        "reference: estimated rel-mse {:.2e}, {:.2} s",
        measured.truth.rel_mse(),
        measured.truth.seconds()
    );
    for part in &measured.truth.parts {
        let classes: Vec<String> = part.part.classes.iter().map(ToString::to_string).collect();
        let origin = if part.cached { ", from the cache" } else { "" };
        println!(
            "  {} ({}): {} samples on {}{origin}",
            part.part.pattern,
            classes.join(", "),
            part.samples,
            part.adapter
        );
    }
    if !measured.passes.is_empty() {
        println!(
            "time, median of the frames that a pass ran in ({} for maps, {} samples):",
            measured.map_frames, arguments.samples
        );
    }
    let frames = measured.map_frames + arguments.samples;
    for pass in &measured.passes {
        println!(
            "  {:34} {:9.4} ms GPU, {} of {frames}",
            pass.pass, pass.milliseconds, pass.ran
        );
    }
    let memory = measured.memory;
    let mebibytes = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    println!(
        "memory: scene {:.1} MiB, maps {:.1} MiB, work {:.1} MiB, picture {:.1} MiB",
        mebibytes(memory.scene),
        mebibytes(memory.maps),
        mebibytes(memory.work),
        mebibytes(memory.picture)
    );
}

/// Heat map of the relative error of a picture.
fn heat(size: [u32; 2], shown: &[f32], truth: &[f32]) -> anyhow::Result<Vec<u8>> {
    let picture = |radiance: &[f32]| {
        Picture::of_radiance(size[0], size[1], radiance.to_vec()).map_err(anyhow::Error::msg)
    };
    let result = compare(Metric::RelMse, &picture(shown)?, &picture(truth)?)?;
    Ok(heat_map(Metric::RelMse, &result.map))
}

/// Heat map of the relative error.
fn error_colors(measured: &Measured) -> Vec<u8> {
    let mut metrics = measured.metrics.iter();
    let map = metrics
        .find(|(metric, _)| *metric == Metric::RelMse)
        .map_or(&[][..], |(_, comparison)| &comparison.map);
    heat_map(Metric::RelMse, map)
}

/// The techniques' image, the path tracer's, and the heat map, separated by white strips.
fn side_by_side(
    gpu: &Gpu,
    [width, height]: [u32; 2],
    [shown, truth]: [&[f32]; 2],
    errors: &[u8],
) -> anyhow::Result<([u32; 2], Vec<u8>)> {
    const GAP: usize = 4;
    // Display both as one image, so that they share one exposure.
    let both: Vec<f32> = [shown, truth].concat();
    // Dither noise would distract from the error and would take up most of the file's bytes.
    let effects = Effects::default().without_dither();
    let shown = picture::developed(gpu, [width, 2 * height], &both, &effects)?;
    let (test, truth) = shown.split_at(shown.len() / 2);
    let row = width as usize * 4;
    let gap = [255; GAP * 4];
    let pixels = (0..height as usize)
        .flat_map(|y| {
            let [test, truth, errors] =
                [test, truth, errors].map(|picture| &picture[y * row..][..row]);
            [test, &gap, truth, &gap, errors].concat()
        })
        .collect();
    Ok(([width * 3 + 2 * GAP as u32, height], pixels))
}
