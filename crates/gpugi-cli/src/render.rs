//! `gpugi render`.

use std::path::{Path, PathBuf};

use anyhow::Context;
use gpugi::display::{DisplaySettings, Exposure, ToneMap};
use gpugi::gpu::{Gpu, Timing, read_buffer, read_texture};
use gpugi::{RenderError, Renderer, capture};
use gpugi_scene::image::{save_exr, save_hdr, save_png};
use indicatif::{ProgressBar, ProgressStyle};

use crate::scene_argument::{self, SceneArguments};
use crate::{Common, Usage};

/// Options of `gpugi render`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// Picture to write: .png tone-mapped, .exr or .hdr linear radiance
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "1024x768", value_parser = parse_size)]
    size: [u32; 2],
    /// Camera of the scene by name or index, or "eye=x,y,z;target=x,y,z;fov=DEG"
    #[arg(long)]
    camera: Option<String>,
    /// Exposure in EV (0 shows radiance 1 as 1), or auto
    #[arg(
        long,
        value_name = "EV|auto",
        default_value = "auto",
        allow_hyphen_values = true
    )]
    exposure: String,
    /// Tone mapping: none, reinhard, aces, agx, neutral
    #[arg(long, value_name = "NAME")]
    tone_map: Option<String>,
    /// Techniques, separated by commas; the best real-time set when not given
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    technique: Vec<String>,
    /// A technique's setting (repeatable)
    #[arg(long, value_name = "technique.key=value")]
    set: Vec<String>,
    /// Jittered frames to accumulate, for smooth edges
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    samples: u32,
    /// Seed of all that is stochastic
    #[arg(long, default_value_t = 0)]
    seed: u32,
    /// Write what was rendered, on what and how fast
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Write every technique's maps into this folder
    #[arg(long, value_name = "DIR")]
    dump_maps: Option<PathBuf>,
    /// Also write these beside the picture: albedo, normal, depth, position
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    aov: Vec<Aov>,
}

/// A quantity of surface points that can be written as a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Aov {
    Albedo,
    Normal,
    Depth,
    Position,
}

fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let side = |text: &str| text.parse::<u32>().ok().filter(|&side| side > 0);
    text.split_once('x')
        .and_then(|(width, height)| Some([side(width)?, side(height)?]))
        .ok_or_else(|| "expected WIDTHxHEIGHT, such as 1280x1024".to_owned())
}

/// What `--report` writes.
#[derive(serde::Serialize)]
struct Report {
    scene: gpugi_scene::Statistics,
    scene_bytes_on_gpu: u64,
    adapter: String,
    driver: String,
    size: [u32; 2],
    samples: u32,
    techniques: serde_json::Map<String, serde_json::Value>,
    left_out: Vec<String>,
    notes: Vec<String>,
    passes_of_last_sample: Vec<Timing>,
    seconds: f64,
}

/// Makes a renderer's argument errors count as such.
pub fn usage(error: RenderError) -> anyhow::Error {
    match error {
        RenderError::Gpu(error) => error.into(),
        other => Usage(other.to_string()).into(),
    }
}

/// Applies `--set` options.
pub fn apply_settings(renderer: &mut Renderer, settings: &[String]) -> anyhow::Result<()> {
    for setting in settings {
        let parts = setting
            .split_once('=')
            .and_then(|(path, value)| Some((path.split_once('.')?, value)));
        let Some(((technique, key), value)) = parts else {
            return Err(Usage(format!("--set {setting}: expected technique.key=value")).into());
        };
        renderer.set(technique, key, value).map_err(usage)?;
    }
    Ok(())
}

/// Renders.
pub fn run(common: &Common, arguments: &Arguments) -> anyhow::Result<()> {
    let started = std::time::Instant::now();
    let format = output_format(&arguments.output)?;
    let display = display_settings(arguments)?;
    let (scene, mut notes) = scene_argument::load(&arguments.scene)?;
    let size = arguments.size;
    let camera = scene_argument::camera(
        &scene,
        arguments.camera.as_deref(),
        size[0] as f32 / size[1] as f32,
    )?;
    let gpu = Gpu::open(&common.adapter)?;
    let mut renderer = Renderer::new(&gpu, &scene, size, &arguments.technique).map_err(usage)?;
    apply_settings(&mut renderer, &arguments.set)?;
    renderer.set_seed(arguments.seed);
    let left_out = renderer.left_out();
    if !left_out.is_empty() {
        notes.push(format!("not in this picture: {}", left_out.join("; ")));
    }
    if !common.quiet {
        for note in &notes {
            eprintln!("note: {note}");
        }
    }

    let progress = progress_bar(common.quiet, arguments.samples);
    let mut timings = Vec::new();
    for sample in 1..=arguments.samples {
        let last = sample == arguments.samples;
        timings = renderer.render_sample(
            &camera,
            arguments.samples,
            last.then_some(&display),
            last && arguments.report.is_some(),
        )?;
        if !last && sample % 8 == 0 {
            // Wait now and then, so that the bar tells the truth and the queue stays short.
            gpu.device.poll(gpu_wait()).ok();
        }
        progress.inc(1);
    }
    progress.finish_and_clear();

    let write_failed = || format!("{}: cannot be written", arguments.output.display());
    match format {
        Format::Png => save_png(&arguments.output, size[0], size[1], &renderer.pixels()?),
        Format::Exr => save_exr(&arguments.output, size[0], size[1], &renderer.radiance()?),
        Format::Hdr => save_hdr(&arguments.output, size[0], size[1], &renderer.radiance()?),
    }
    .with_context(write_failed)?;
    write_aovs(&gpu, &renderer, arguments, &camera)?;
    if let Some(folder) = &arguments.dump_maps {
        dump_maps(&gpu, &renderer, folder)?;
    }
    let seconds = started.elapsed().as_secs_f64();
    if let Some(path) = &arguments.report {
        let report = Report {
            scene: scene.statistics(),
            scene_bytes_on_gpu: renderer.scene().bytes,
            adapter: gpu.adapter.name.clone(),
            driver: gpu.adapter.driver.clone(),
            size,
            samples: renderer.samples(),
            techniques: renderer
                .techniques()
                .iter()
                .map(|technique| (technique.info().name.to_owned(), technique.settings()))
                .collect(),
            left_out,
            notes,
            passes_of_last_sample: timings,
            seconds,
        };
        write_json(path, &report)?;
    }
    if !common.quiet {
        println!(
            "{}: {}x{}, {} samples, {seconds:.2} s on {}",
            arguments.output.display(),
            size[0],
            size[1],
            renderer.samples(),
            gpu.adapter.name
        );
    }
    Ok(())
}

fn gpu_wait() -> gpugi::gpu::PollType {
    gpugi::gpu::PollType::wait_indefinitely()
}

enum Format {
    Png,
    Exr,
    Hdr,
}

fn output_format(path: &Path) -> anyhow::Result<Format> {
    let extension = path
        .extension()
        .map(|extension| extension.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        Some("png") => Ok(Format::Png),
        Some("exr") => Ok(Format::Exr),
        Some("hdr") => Ok(Format::Hdr),
        _ => Err(Usage(format!(
            "-o {}: the name must end in .png, .exr or .hdr",
            path.display()
        ))
        .into()),
    }
}

fn display_settings(arguments: &Arguments) -> anyhow::Result<DisplaySettings> {
    let exposure = match arguments.exposure.as_str() {
        "auto" => Exposure::Auto,
        text => Exposure::Manual(
            text.parse()
                .ok()
                .filter(|ev: &f32| ev.is_finite())
                .ok_or_else(|| Usage(format!("--exposure {text}: a number of EV or auto")))?,
        ),
    };
    let mut settings = DisplaySettings {
        exposure,
        ..Default::default()
    };
    if let Some(name) = &arguments.tone_map {
        settings.tone_map = name
            .parse::<ToneMap>()
            .map_err(|error| Usage(format!("--tone-map: {error}")))?;
    }
    Ok(settings)
}

fn progress_bar(quiet: bool, samples: u32) -> ProgressBar {
    if quiet || samples < 2 {
        return ProgressBar::hidden();
    }
    // Draws on a terminal only.
    ProgressBar::new(samples.into()).with_style(
        ProgressStyle::with_template("{bar:40} {pos}/{len} samples, {eta} left")
            .unwrap_or_else(|_| ProgressStyle::default_bar()),
    )
}

/// Writes JSON to a temporary file, then renames it.
pub fn write_json<T: serde::Serialize>(path: &Path, value: &T) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(value)?;
    gpugi_scene::image::replace_file(path, |file| {
        std::io::Write::write_all(file, text.as_bytes())
    })
    .with_context(|| format!("{}: cannot be written", path.display()))
}

/// Writes surface points as linear EXR pictures named `OUTPUT-aov.exr`. Background is zero.
fn write_aovs(
    gpu: &Gpu,
    renderer: &Renderer,
    arguments: &Arguments,
    camera: &gpugi_scene::Camera,
) -> anyhow::Result<()> {
    if arguments.aov.is_empty() {
        return Ok(());
    }
    let [width, height] = arguments.size;
    let bytes = u64::from(width) * u64::from(height) * capture::SURFACE_POINT_BYTES;
    let words: Vec<u32> = read_buffer(gpu, renderer.surface_points(), bytes)?;
    let points: Vec<Option<capture::VisiblePoint>> = words
        .chunks_exact(12)
        .map(capture::VisiblePoint::unpack)
        .collect();
    let eye = camera.world_from_view.w_axis.truncate();
    let forward = -camera.world_from_view.z_axis.truncate();
    for aov in &arguments.aov {
        let value = |point: &capture::VisiblePoint| match aov {
            Aov::Albedo => point.albedo,
            Aov::Normal => point.normal,
            Aov::Depth => glam::Vec3::splat((point.position - eye).dot(forward)),
            Aov::Position => point.position,
        };
        let texels: Vec<f32> = points
            .iter()
            .flat_map(|point| point.as_ref().map_or(glam::Vec3::ZERO, value).to_array())
            .collect();
        let name = format!("{aov:?}").to_lowercase();
        let stem = arguments
            .output
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy();
        let path = arguments
            .output
            .with_file_name(format!("{stem}-{name}.exr"));
        save_exr(&path, width, height, &texels)
            .with_context(|| format!("{}: cannot be written", path.display()))?;
    }
    Ok(())
}

/// Writes each technique's depth maps as EXR: reversed depth, as stored.
fn dump_maps(gpu: &Gpu, renderer: &Renderer, folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("{}: cannot be made", folder.display()))?;
    for map in renderer.maps() {
        let depth: Vec<f32> =
            read_texture(gpu, &map.texture, gpugi::gpu::TextureAspect::DepthOnly, 0)?;
        let texels: Vec<f32> = depth.iter().flat_map(|&depth| [depth; 3]).collect();
        let path = folder.join(format!("{}.exr", map.name));
        save_exr(&path, map.texture.width(), map.texture.height(), &texels)
            .with_context(|| format!("{}: cannot be written", path.display()))?;
    }
    Ok(())
}
