//! `gpugi render`.

mod chosen;
mod rival;
mod tracing;

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Instant;

use gpugi::default_set::StillPicture;
use gpugi::gpu::{Gpu, Timing};
use gpugi::picture::{self, Effects, Shown};
use gpugi::reference::{self, PathTracer};
use gpugi::{LightingError, Motion, Purpose, Readiness, Renderer};
use gpugi_arguments::{DisplayArguments, parse_size, split_settings};
use gpugi_scene::{Camera, Scene};

use crate::explain::{Costs, explain, explain_path_tracer};
use crate::output::{self, Aov, Format, write_json};
use crate::progress::Progress;
use crate::scene_argument::{self, SceneArguments};
use crate::{Common, Usage, interrupt};
pub use chosen::Chosen;
use rival::Rival;
use tracing::{Tracing, path_tracing};

/// Options of pictures and films: what is seen, by whom, and lit by what.
#[derive(Debug, Clone, clap::Args)]
pub struct PictureArguments {
    /// The scene.
    #[command(flatten)]
    pub scene: SceneArguments,
    /// Scene camera by name or index, or "eye=x,y,z;target=x,y,z;up=x,y,z;fov=DEG", or "from=NAME" and what differs;
    /// also aperture=M;focus=M;blades=N (lens) and shutter=S
    #[arg(long)]
    pub camera: Option<String>,
    /// How pictures are displayed.
    #[command(flatten)]
    pub display: DisplayArguments,
    /// Techniques, separated by commas, or path-tracer, or none, or default: those that suit the scene, and a still picture
    /// or frames in motion. Without it, default, but for a PNG by gpugi render on a discrete GPU, or of fog in software:
    /// path-tracer, denoised
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub technique: Vec<String>,
    /// A technique's setting, or an effect's (repeatable)
    #[arg(long, value_name = "technique.key=value")]
    pub set: Vec<String>,
    /// Steps in which maps and lights follow what moves while the shutter is open; what is seen moves with every sample
    #[arg(long, value_name = "N", default_value_t = SHUTTER_STEPS, value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub shutter_steps: u32,
    /// Seed of all random numbers
    #[arg(long, default_value_t = 0)]
    pub seed: u32,
}

/// Options of `gpugi render`.
#[derive(Debug, Clone, clap::Args)]
pub struct Arguments {
    /// Image to write: .png (tone-mapped), .exr or .hdr (linear radiance)
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "1024x768", value_parser = parse_size)]
    size: [u32; 2],
    #[command(flatten)]
    picture: PictureArguments,
    /// Print which techniques were chosen and why, what each adds and what it costs, the light that is missing, and what the
    /// other way, techniques or the path tracer, would give. Takes about twice as long
    #[arg(long)]
    explain: bool,
    /// Samples per pixel, once the techniques' maps are final (default: 4, for smooth edges; 64 if lens or shutter blur the
    /// picture; 256 for --technique path-tracer; as many as it needs, but no more than 512, where that is the default)
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=16_777_216))]
    samples: Option<u32>,
    /// Write a report of what was rendered, on what and how fast
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Write every technique's maps into this folder
    #[arg(long, value_name = "DIR")]
    dump_maps: Option<PathBuf>,
    /// Also write these as layers of an EXR file, means over samples: OUTPUT if that is one, or else OUTPUT with .exr
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    aov: Vec<Aov>,
    /// Filter the noise out of the path tracer's picture; on where it is the default
    #[arg(long)]
    denoise: bool,
}

/// Default samples per pixel for techniques, unless a lens or an open shutter blurs the picture.
pub const TECHNIQUE_SAMPLES: u32 = 4;
/// Of pictures that they blur.
pub const BLURRED_SAMPLES: u32 = 64;
/// Default samples per pixel for the path tracer.
pub const PATH_TRACER_SAMPLES: u32 = 256;
/// Default steps of maps while the shutter is open.
pub const SHUTTER_STEPS: u32 = 8;

/// The content of `--report`.
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
    /// For techniques only: time until their maps are final, and GPU time of passes.
    maps_seconds: Option<f64>,
    passes_of_last_sample: Vec<Timing>,
    /// For the path tracer only: estimated relative mean squared error, and number of closest-hit rays.
    estimated_rel_mse: Option<f64>,
    path_segments: Option<u64>,
    seconds: f64,
}

/// What is written.
enum Image {
    /// 8-bit sRGB, RGBA.
    Pixels(Vec<u8>),
    /// Mean linear radiance, three floats per pixel.
    Radiance(Vec<f32>),
}

/// Layers to write.
struct Layers {
    /// Mean linear radiance, three floats per pixel.
    radiance: Vec<f32>,
    seen: output::Seen,
}

/// An image, and its data for the report.
struct Rendered {
    image: Image,
    layers: Option<Layers>,
    samples: u32,
    scene_bytes_on_gpu: u64,
    techniques: serde_json::Map<String, serde_json::Value>,
    left_out: Vec<String>,
    maps_seconds: Option<f64>,
    passes_of_last_sample: Vec<Timing>,
    estimated_rel_mse: Option<f64>,
    path_segments: Option<u64>,
    /// The other way to make it, if that is to be explained.
    rival: Option<Rival>,
}

/// Converts a renderer's argument errors to usage errors.
pub fn usage(error: LightingError) -> anyhow::Error {
    match error {
        LightingError::Gpu(error) => error.into(),
        other => Usage(other.to_string()).into(),
    }
}

/// Applies `--set` options.
pub fn apply_settings(renderer: &mut Renderer, settings: &[String]) -> anyhow::Result<()> {
    for [technique, key, value] in split_settings(settings)? {
        renderer.set(technique, key, value).map_err(usage)?;
    }
    Ok(())
}

/// Whether the path tracer is selected. It cannot be combined with techniques.
pub fn is_path_tracer(techniques: &[String]) -> anyhow::Result<bool> {
    let named = techniques.iter().any(|name| name == reference::INFO.name);
    if named && techniques.len() > 1 {
        return Err(Usage(
            "--technique: path-tracer computes all light by itself; name it alone".into(),
        )
        .into());
    }
    Ok(named)
}

/// The path tracer's settings from `--set` options.
pub fn path_tracer_settings(options: &[String]) -> anyhow::Result<reference::Settings> {
    let mut settings = reference::Settings::default();
    for [technique, key, value] in split_settings(options)? {
        if technique != reference::INFO.name {
            return Err(Usage(format!(
                "--set {technique}.{key}: {technique} is not in use, path-tracer is"
            ))
            .into());
        }
        settings
            .set(key, value)
            .map_err(|error| Usage(format!("--set {technique}.{error}")))?;
    }
    Ok(settings)
}

/// Renders.
pub fn run(common: &Common, arguments: &Arguments) -> anyhow::Result<()> {
    let started = Instant::now();
    let format = output::format(&arguments.output)?;
    output::check_folders(
        [Some(&arguments.output), arguments.report.as_ref()]
            .into_iter()
            .flatten()
            .map(PathBuf::as_path),
    )?;
    let picture = &arguments.picture;
    let (effects, set) = (picture.display).effects(Effects::default(), &picture.set)?;
    let picture = PictureArguments {
        set,
        ..picture.clone()
    };
    let mut aov = arguments.aov.clone();
    aov.sort();
    aov.dedup();
    let arguments = &Arguments {
        picture,
        aov,
        ..arguments.clone()
    };
    let picture = &arguments.picture;
    is_path_tracer(&picture.technique)?;
    let (scene, mut notes) = scene_argument::load(&picture.scene)?;
    let size = arguments.size;
    let camera = scene_argument::camera(
        &scene,
        picture.camera.as_deref(),
        size[0] as f32 / size[1] as f32,
    )?;
    let gpu = Gpu::open(&common.adapter)?;
    interrupt::catch();
    // A PNG leaves the GPU as it is displayed.
    let shown = (format == Format::Png).then_some(&effects);
    let still = StillPicture::of(&scene, &gpu.adapter);
    let rendered = match path_tracing(arguments, format, &effects, still)? {
        Some(tracing) => render_reference(
            common, arguments, &tracing, &gpu, &scene, &camera, shown, &mut notes,
        )?,
        None => render_techniques(common, arguments, &gpu, &scene, &camera, shown, &mut notes)?,
    };
    match &rendered.image {
        Image::Pixels(pixels) => output::write_png(&arguments.output, size, pixels)?,
        Image::Radiance(_) if format == Format::Exr && rendered.layers.is_some() => {}
        Image::Radiance(radiance) => {
            output::write_radiance(&arguments.output, format, size, radiance)?
        }
    }
    if let Some(Layers { radiance, seen }) = &rendered.layers {
        let path = arguments.output.with_extension("exr");
        output::write_layers(&path, size, radiance, seen, &arguments.aov, &scene)?;
    }
    let seconds = started.elapsed().as_secs_f64();
    let samples = rendered.samples;
    if let Some(path) = &arguments.report {
        let report = Report {
            scene: scene.statistics(),
            scene_bytes_on_gpu: rendered.scene_bytes_on_gpu,
            adapter: gpu.adapter.name.clone(),
            driver: gpu.adapter.driver.clone(),
            size,
            samples,
            techniques: rendered.techniques,
            left_out: rendered.left_out,
            notes,
            maps_seconds: rendered.maps_seconds,
            passes_of_last_sample: rendered.passes_of_last_sample,
            estimated_rel_mse: rendered.estimated_rel_mse,
            path_segments: rendered.path_segments,
            seconds,
        };
        write_json(path, &report)?;
    }
    if !common.quiet {
        println!(
            "{}: {}x{}, {samples} samples, {seconds:.2} s on {}",
            arguments.output.display(),
            size[0],
            size[1],
            gpu.adapter.name
        );
    }
    if let Some(rival) = rendered
        .rival
        .filter(|_| !common.quiet && !interrupt::asked())
    {
        match rival.in_words(&gpu, arguments, (&scene, &camera)) {
            Ok(Some(words)) => println!("{words}"),
            Ok(None) => {}
            Err(error) => eprintln!("note: the other way to make the picture fails: {error:#}"),
        }
    }
    Ok(())
}

/// Prints notes for the user.
pub fn print_notes(common: &Common, notes: &[String]) {
    if !common.quiet {
        for note in notes {
            eprintln!("note: {note}");
        }
    }
}

/// Brings the maps to their final state, until the user presses Ctrl-C. Returns how far they are.
fn converge(
    common: &Common,
    renderer: &mut Renderer,
    camera: &Camera,
    timed: bool,
    costs: &mut Costs,
) -> Result<Readiness, LightingError> {
    let mut progress = Progress::new(common.quiet);
    let readiness = renderer.converge(camera, timed, |readiness, passes| {
        costs.add_to_maps(&passes);
        let message = match readiness {
            Readiness::Pending { what, .. } => format!("maps: {what}"),
            Readiness::Refining { .. } | Readiness::Ready => "maps".to_owned(),
        };
        progress.show(f64::from(readiness.progress()), &message);
        if interrupt::asked() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    })?;
    progress.finish();
    Ok(readiness)
}

/// Adds as many `samples` to a picture, or fewer if the user presses Ctrl-C, and waits for them. `report` is called after
/// each with its number, from 1, and the GPU times of its passes if it is `timed`.
pub fn add_samples(
    gpu: &Gpu,
    renderer: &mut Renderer,
    camera: &Camera,
    samples: u32,
    timed: impl Fn(u32) -> bool,
    mut report: impl FnMut(u32, Vec<Timing>),
) -> Result<(), LightingError> {
    for sample in 1..=samples {
        let timings = renderer.render_sample(camera, samples, None, timed(sample))?;
        let passes = timings.wait()?;
        if sample % 8 == 0 {
            // Wait regularly, so that the progress bar is accurate and the queue stays short.
            gpu.wait()?;
        }
        report(sample, passes);
        if interrupt::asked() {
            break;
        }
    }
    Ok(gpu.wait()?)
}

fn render_techniques(
    common: &Common,
    arguments: &Arguments,
    gpu: &Gpu,
    scene: &Scene,
    camera: &Camera,
    shown: Option<&Effects>,
    notes: &mut Vec<String>,
) -> anyhow::Result<Rendered> {
    let (size, settings) = (arguments.size, &arguments.picture.set);
    let mut chosen = Chosen::new(
        gpu,
        scene,
        size,
        Purpose::StillPicture,
        &arguments.picture.technique,
        settings,
    )?;
    print_notes(common, notes);
    let motion = Motion::seen_by(camera, scene, arguments.picture.scene.time);
    let is_blurred = !camera.lens.is_pinhole() || motion.is_some();
    let started = Instant::now();
    let (maps, left_out, mut costs) = loop {
        if !arguments.aov.is_empty() {
            chosen.renderer.keep_features().map_err(usage)?;
        }
        chosen.renderer.set_seed(arguments.picture.seed);
        let motion = motion.clone();
        (chosen.renderer).set_motion(motion, arguments.picture.shutter_steps)?;
        let left_out = chosen.renderer.left_out();
        let of_set = chosen.notes();
        print_notes(common, &of_set);
        let mut costs = Costs::default();
        let renderer = &mut chosen.renderer;
        match converge(common, renderer, camera, arguments.explain, &mut costs) {
            Ok(maps) => {
                notes.extend(of_set);
                break (maps, left_out, costs);
            }
            Err(error) => chosen.without_atlas(error)?,
        }
    };
    let Chosen {
        mut renderer, set, ..
    } = chosen;
    let maps_seconds = started.elapsed().as_secs_f64();
    let samples = arguments.samples.unwrap_or(match is_blurred {
        true => BLURRED_SAMPLES,
        false => TECHNIQUE_SAMPLES,
    });
    let mut progress = Progress::new(common.quiet);
    let mut passes_of_last_sample = Vec::new();
    let timed = |sample| arguments.explain || (sample == samples && arguments.report.is_some());
    add_samples(
        gpu,
        &mut renderer,
        camera,
        samples,
        timed,
        |sample, passes| {
            costs.add_sample(&passes);
            passes_of_last_sample = passes;
            progress.show(
                f64::from(sample) / f64::from(samples),
                &format!("{sample} of {samples} samples"),
            );
        },
    )?;
    progress.finish();
    if interrupt::asked() && !common.quiet {
        eprintln!(
            "interrupted: the maps were {:.0} % done, the picture has {} of {samples} samples per pixel",
            maps.progress() * 100.0,
            renderer.samples()
        );
    }
    let warnings = renderer.warnings();
    print_notes(common, &warnings);
    notes.extend(warnings);
    if arguments.explain && !common.quiet {
        explain(
            gpu,
            &renderer,
            set.as_ref(),
            &left_out,
            &costs,
            maps_seconds,
        );
    }
    let seconds = started.elapsed().as_secs_f64();
    let rival = match arguments.explain && set.is_some() {
        true => Some(Rival::PathTracer(renderer.radiance()?, seconds)),
        false => None,
    };
    let layers = match arguments.aov.is_empty() {
        true => None,
        false => Some(Layers {
            radiance: renderer.radiance()?,
            seen: output::Seen {
                features: renderer.features()?,
                variance: Vec::new(),
            },
        }),
    };
    if let Some(folder) = &arguments.dump_maps {
        output::dump_maps(gpu, &renderer.maps(), folder)?;
    }
    Ok(Rendered {
        image: match shown {
            Some(effects) => {
                renderer.display(Shown::Picture, effects)?;
                Image::Pixels(renderer.pixels()?)
            }
            None => Image::Radiance(renderer.radiance()?),
        },
        layers,
        samples: renderer.samples(),
        scene_bytes_on_gpu: renderer.scene().bytes,
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
        left_out,
        maps_seconds: Some(maps_seconds),
        passes_of_last_sample,
        estimated_rel_mse: None,
        path_segments: None,
        rival,
    })
}

#[allow(clippy::too_many_arguments)]
fn render_reference(
    common: &Common,
    arguments: &Arguments,
    tracing: &Tracing,
    gpu: &Gpu,
    scene: &Scene,
    camera: &Camera,
    shown: Option<&Effects>,
    notes: &mut Vec<String>,
) -> anyhow::Result<Rendered> {
    if !tracing.is_default && (arguments.dump_maps.is_some() || arguments.explain) {
        return Err(Usage(
            "--dump-maps and --explain are about techniques and what they keep; path-tracer keeps nothing and adds all light"
                .into(),
        )
        .into());
    }
    let settings = &tracing.settings;
    let mut tracer = PathTracer::new(gpu, scene, arguments.size, settings).map_err(usage)?;
    let left_out = reference::left_out(scene, settings);
    if !left_out.is_empty() {
        notes.push(format!("not in this picture: {}", left_out.join("; ")));
    }
    print_notes(common, notes);
    if tracing.is_denoised || !arguments.aov.is_empty() {
        tracer.keep_features()?;
    }
    tracer.restart(arguments.picture.seed)?;
    tracer.set_motion(Motion::seen_by(camera, scene, arguments.picture.scene.time))?;
    let mut progress = Progress::new(common.quiet);
    let samples = tracing.samples;
    let done = tracer.render(camera, samples, &mut |state| {
        let noise = state.noise.map_or(String::new(), |noise| {
            format!(", estimated rel-mse {noise:.2e}")
        });
        progress.show(
            state.fraction,
            &format!("{} of {} samples{noise}", state.samples, state.of),
        );
        if interrupt::asked() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    })?;
    progress.finish();
    if interrupt::asked() && !common.quiet {
        eprintln!(
            "interrupted: the picture has {} of {samples} samples per pixel, and some pixels more",
            done.samples
        );
    }
    let noise = tracer.noise()?;
    let mut techniques = serde_json::Map::new();
    techniques.insert(
        reference::INFO.name.to_owned(),
        serde_json::to_value(tracer.settings())?,
    );
    // One sample says nothing about its noise.
    let is_denoised = tracing.is_denoised && done.samples > 1;
    if arguments.explain && !common.quiet {
        explain_path_tracer(gpu, &done, [noise, settings.noise], is_denoised);
    }
    let radiance = match is_denoised {
        true => tracer.denoised()?,
        false => tracer.radiance()?,
    };
    let rival = (arguments.explain).then(|| Rival::Techniques(radiance.clone()));
    let layers = match arguments.aov.is_empty() {
        true => None,
        false => Some(Layers {
            radiance: match arguments.denoise {
                true => radiance.clone(),
                false => tracer.radiance()?,
            },
            seen: output::Seen {
                features: tracer.features()?,
                variance: tracer.variance()?,
            },
        }),
    };
    Ok(Rendered {
        image: match shown {
            Some(effects) => {
                let size = arguments.size;
                Image::Pixels(picture::developed_of(
                    gpu, size, &radiance, camera, effects,
                )?)
            }
            None => Image::Radiance(radiance),
        },
        layers,
        samples: done.samples,
        scene_bytes_on_gpu: tracer.scene().bytes,
        techniques,
        left_out,
        maps_seconds: None,
        passes_of_last_sample: Vec::new(),
        estimated_rel_mse: Some(noise).filter(|_| done.samples > 1),
        path_segments: Some(tracer.segments()?),
        rival,
    })
}
