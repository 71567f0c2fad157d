//! The `gpugi` command: parses arguments, calls the library and prints. A library, so that the viewer takes the same
//! arguments.

/// As the standard library's, which panics if nobody reads on: `gpugi list settings | head -1`.
macro_rules! println {
    ($($text:tt)*) => {
        crate::output::print_line(format_args!($($text)*))
    };
}

pub mod bake;
mod bench;
mod bench_edits;
mod bench_path_tracer;
mod bench_rays;
mod compare;
mod convert;
mod doctor;
mod explain;
mod film;
mod interrupt;
mod measure;
pub mod output;
pub mod progress;
pub mod render;

pub use gpugi_arguments::{Usage, scene_argument};

use std::ffi::OsString;
use std::io::IsTerminal;
use std::path::Path;

use clap::{Parser, Subcommand};
use gpugi::gpu::AdapterChoice;

/// Real-time and baked global illumination on any GPU.
#[derive(Debug, Parser)]
#[command(
    name = "gpugi",
    version,
    about,
    after_help = "./gpugi view [SCENE] opens a window (docs/viewer.md)."
)]
struct Arguments {
    #[command(flatten)]
    common: Common,
    #[command(subcommand)]
    command: Command,
}

/// Options of every command.
#[derive(Debug, Clone, clap::Args)]
pub struct Common {
    /// GPU to use: part of its name, its place in `gpugi list adapters` from #0 on, `software` or `discrete` (default: the fastest)
    #[arg(
        long,
        global = true,
        value_name = "NAME|#N|software|discrete",
        default_value = "best",
        hide_default_value = true
    )]
    pub adapter: AdapterChoice,
    /// Print only errors
    #[arg(long, global = true)]
    pub quiet: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Render an image of a scene
    Render(render::Arguments),
    /// Render a film of a scene: its animation, a camera's tour, or a turn around it
    Film(film::Arguments),
    /// Bake a scene's light into textures, or an environment into maps, for use in other programs
    Bake(bake::Arguments),
    /// Write a scene as one .glb for other programs
    Convert(convert::Arguments),
    /// Measure the error of an image against its reference
    Compare(compare::Arguments),
    /// Measure the error of techniques against the path tracer on the same light paths, and their cost
    Measure(measure::Arguments),
    /// Print a scene's contents
    Info(scene_argument::SceneArguments),
    /// List techniques, their settings, built-in scenes or adapters
    List {
        /// What to list
        what: What,
        /// For settings: those of this technique alone
        technique: Option<String>,
        /// For settings: a table for documents
        #[arg(long)]
        markdown: bool,
    },
    /// List adapters, what they lack and how to get it
    Doctor,
    /// Measure the GPU time of each technique
    Bench(bench::Arguments),
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum What {
    Techniques,
    Settings,
    Scenes,
    Adapters,
}

/// Prints warnings, or with `--quiet` only errors, to the standard error.
pub fn log_to_stderr(common: &Common) {
    let level = if common.quiet {
        tracing::Level::ERROR
    } else {
        tracing::Level::WARN
    };
    tracing_subscriber::fmt()
        .with_max_level(level)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .without_time()
        .with_target(false)
        .init();
}

/// Keeps Mesa silent where no display can be: its layer that sorts adapters looks for one, and complains on the
/// standard error. gpugi sorts adapters itself. To be called before threads start: they may read the environment.
pub fn silence_mesa() {
    let folder = std::env::var_os("XDG_RUNTIME_DIR");
    if folder.is_some_and(|folder| Path::new(&folder).is_absolute()) {
        return;
    }
    // SAFETY: no other thread runs yet.
    #[allow(unsafe_code)]
    unsafe {
        std::env::set_var("NODEVICE_SELECT", "1");
    }
}

/// The exit code of a program: prints the error, if there is one.
pub fn exit_code(result: anyhow::Result<()>) -> u8 {
    match result {
        Ok(()) => 0,
        Err(error) => {
            eprintln!("gpugi: {error:#}");
            let wrong_arguments = error.downcast_ref::<Usage>().is_some();
            if wrong_arguments { 2 } else { 1 }
        }
    }
}

/// The command, with the arguments of a process, the program's name first. Returns its exit code. To be called once, before threads
/// start.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    silence_mesa();
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        // What was asked for, such as the help, or what is wrong.
        Err(message) => {
            message.print().ok();
            return message.exit_code() as u8;
        }
    };
    log_to_stderr(&arguments.common);
    let common = &arguments.common;
    let result = match &arguments.command {
        Command::Render(render) => render::run(common, render),
        Command::Film(film) => film::run(common, film),
        Command::Bake(bake) => bake::run(common, bake),
        Command::Compare(compare) => compare::run(common, compare),
        Command::Measure(measure) => measure::run(common, measure),
        Command::Convert(arguments) => convert::run(common, arguments),
        Command::Info(scene) => info(scene),
        Command::List {
            what: What::Settings,
            technique,
            markdown,
        } => list_settings(technique.as_deref(), *markdown),
        Command::List { what, .. } => {
            list(*what);
            Ok(())
        }
        Command::Doctor => doctor::run(),
        Command::Bench(bench) => bench::run(common, bench),
    };
    exit_code(result)
}

/// `gpugi info`.
fn info(arguments: &scene_argument::SceneArguments) -> anyhow::Result<()> {
    let (scene, notes) = scene_argument::load(arguments)?;
    println!("{}", serde_json::to_string_pretty(&scene.statistics())?);
    for note in notes {
        eprintln!("note: {note}");
    }
    Ok(())
}

fn list(what: What) {
    match what {
        What::Settings => {}
        What::Techniques => {
            let registry = gpugi::techniques::Registry::default();
            let infos = registry.all().iter().map(|registration| registration.info);
            for info in infos.chain([&gpugi::reference::INFO]) {
                let paths: Vec<String> = info
                    .paths
                    .iter()
                    .map(|paths| format!("{} ({})", paths.pattern, paths.class))
                    .collect();
                println!(
                    "{:22} {} [{}; {}]",
                    info.name,
                    info.summary,
                    paths.join(", "),
                    info.source
                );
            }
        }
        What::Scenes => {
            for scene in gpugi_scene::builtin::SCENES {
                println!("{:10} {}", scene.name, scene.summary);
            }
        }
        What::Adapters => {
            for (number, adapter) in gpugi::gpu::list_adapters().iter().enumerate() {
                println!("#{number} {}", doctor::adapter_line(adapter));
            }
        }
    }
}

/// Prints what can be set: names, defaults, allowed values, help.
fn list_settings(technique: Option<&str>, markdown: bool) -> anyhow::Result<()> {
    let registry = gpugi::techniques::Registry::default();
    let tracer = (
        gpugi::reference::INFO.name,
        gpugi::reference::Settings::fields(),
    );
    let techniques = registry.all().iter();
    let techniques =
        techniques.map(|registration| (registration.info.name, (registration.fields)()));
    let effects = gpugi::picture::Effects::default();
    let effects = effects
        .all()
        .map(|(name, settings)| (name, settings.fields()));
    let all: Vec<_> = techniques.chain([tracer]).chain(effects).collect();
    if let Some(name) = technique
        && !all.iter().any(|(owner, _)| *owner == name)
    {
        let known: Vec<&str> = all.iter().map(|(owner, _)| *owner).collect();
        let message = format!(
            "there is no technique or effect {name:?}; there are: {}",
            known.join(", ")
        );
        return Err(Usage(message).into());
    }
    if markdown {
        println!(
            "# Settings\n\n`gpugi list settings --markdown` writes this page. Set one with `--set technique.setting=value`, or with\n`--set effect.setting=value` for what happens to pictures before they are shown."
        );
    }
    for (owner, fields) in all {
        if technique.is_some_and(|name| name != owner) {
            continue;
        }
        if markdown {
            println!("\n## {owner}\n\n| setting | default | values | meaning |\n|---|---|---|---|");
        }
        for field in fields {
            let default = match (&field.default, field.default.as_f64()) {
                (serde_json::Value::String(text), _) => text.clone(),
                // 0.1 as a 32-bit float has more digits than anybody wrote.
                (value, Some(number)) if value.is_f64() => format!("{:?}", number as f32),
                (value, _) => value.to_string(),
            };
            let mut values = field.values();
            if !field.unit.is_empty() {
                values = format!("{values} [{}]", field.unit).trim_start().to_owned();
            }
            if markdown {
                let values = values.replace('|', "\\|");
                println!(
                    "| `{}` | {default} | {values} | {} |",
                    field.name,
                    field.help.replace('|', "\\|")
                );
            } else {
                println!("{owner}.{}={default}", field.name);
                if !values.is_empty() {
                    println!("    {values}");
                }
                println!("    {}", field.help);
            }
        }
    }
    Ok(())
}
