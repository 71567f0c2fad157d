//! `gpugi-view`: opens a window. `./gpugi view` builds and runs it.

use std::cell::RefCell;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;
use std::rc::Rc;
use std::sync::Arc;

use anyhow::{Context, anyhow};
use clap::Parser;
use clap::error::ErrorKind;
use eframe::egui;
use eframe::egui_wgpu::{
    RenderState, SurfaceErrorAction, WgpuConfiguration, WgpuSetup, WgpuSetupCreateNew,
};
use gpugi::gpu::{Gpu, instance_descriptor};
use gpugi_arguments::parse_size;
use gpugi_cli::output::{self, Format};
use gpugi_cli::{Common, exit_code, log_to_stderr, silence_mesa};
use gpugi_viewer::app::App;
use gpugi_viewer::arguments::{ViewArguments, of_view_file};
use gpugi_viewer::headless::{self, Frames, Recorder};
use gpugi_viewer::script::Script;
use gpugi_viewer::session::Session;
use gpugi_viewer::viewer::Start;

/// Global illumination live, in a window.
#[derive(Debug, Parser)]
#[command(name = "gpugi view", version, about)]
struct Arguments {
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    view: ViewArguments,
    /// Width and height of the window
    #[arg(long, value_name = "WxH", default_value = "1280x800", value_parser = parse_size)]
    size: [u32; 2],
    /// Show N frames without a window; with --samples, more follow until the last picture has so many
    #[arg(long, value_name = "N")]
    headless_frames: Option<u32>,
    #[command(flatten)]
    headless: Headless,
}

/// Options of a run without a window.
#[derive(Debug, clap::Args)]
struct Headless {
    /// What happens in which frame (docs/viewer.md)
    #[arg(long, value_name = "FILE", requires = "headless_frames")]
    script: Option<PathBuf>,
    /// Write the times of the frames
    #[arg(long, value_name = "FILE.json", requires = "headless_frames")]
    frame_times: Option<PathBuf>,
    /// Write every frame, complete, as FOLDER/0000.png and so on; --samples are those of each
    #[arg(long, value_name = "FOLDER", requires = "headless_frames")]
    record: Option<PathBuf>,
    /// Write the last picture: .png (tone-mapped), .exr or .hdr (linear radiance)
    #[arg(short, long, value_name = "FILE", requires = "headless_frames")]
    output: Option<PathBuf>,
}

fn main() -> ExitCode {
    silence_mesa();
    let arguments = arguments();
    log_to_stderr(&arguments.common);
    exit_code(run(&arguments)).into()
}

/// Those of the process; without a scene, the Cornell box.
fn arguments() -> Arguments {
    let all = || std::env::args_os();
    Arguments::try_parse_from(all()).unwrap_or_else(|error| match error.kind() {
        ErrorKind::MissingRequiredArgument => {
            Arguments::parse_from(all().chain([OsString::from("cornell")]))
        }
        _ => error.exit(),
    })
}

fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let start = match arguments.view.view_file()? {
        None => arguments.view.start()?,
        Some(path) => {
            let failed = || path.display().to_string();
            let text = std::fs::read(path).with_context(failed)?;
            let start = of_view_file(&text).map_err(|reason| anyhow!(reason));
            start.with_context(failed)?
        }
    };
    if let Some(frames) = arguments.headless_frames {
        return run_headless(arguments, start, frames);
    }
    let app = run_window(arguments, |context, device| {
        App::new(context, device, start)
    })?;
    let Err(lost) = app.gpu().check_lost() else {
        return Ok(());
    };
    // eframe cannot give a window another device: another window opens.
    eprintln!("note: {lost}; another window opens on another device");
    let app = run_window(arguments, |context, device| app.renewed(context, device))?;
    Ok(app.gpu().check_lost()?)
}

/// Shows what `make` makes in a window until that closes, because somebody closes it or its device is lost.
fn run_window(
    arguments: &Arguments,
    make: impl FnOnce(&egui::Context, &RenderState) -> App,
) -> anyhow::Result<App> {
    let [width, height] = arguments.size.map(|side| side as f32);
    let viewport = egui::ViewportBuilder::default()
        .with_app_id("gpugi")
        .with_inner_size([width, height]);
    let options = eframe::NativeOptions {
        viewport,
        wgpu_options: WgpuConfiguration {
            wgpu_setup: WgpuSetup::CreateNew(setup(&arguments.common)),
            on_surface_status: Arc::new(surface_status),
            ..Default::default()
        },
        ..Default::default()
    };
    let app = Rc::new(RefCell::new(None));
    let shown = Window(app.clone());
    let create = |context: &eframe::CreationContext<'_>| {
        let render_state = context.wgpu_render_state.as_ref();
        let render_state = render_state.ok_or("the window has no GPU")?;
        *shown.0.borrow_mut() = Some(make(&context.egui_ctx, render_state));
        Ok(Box::new(shown) as Box<dyn eframe::App>)
    };
    let closed = eframe::run_native("gpugi", options, Box::new(create));
    closed.map_err(|error| anyhow!("{error}"))?;
    app.take().context("the window did not open")
}

/// What to do when the surface has no texture for a frame: as egui does, but a surface that another thread's work kept
/// from being configured is configured again.
fn surface_status(status: &wgpu::CurrentSurfaceTexture) -> SurfaceErrorAction {
    match status {
        wgpu::CurrentSurfaceTexture::Validation => SurfaceErrorAction::Reconfigure,
        other => (WgpuConfiguration::default().on_surface_status)(other),
    }
}

/// What a window shows, which outlives it.
struct Window(Rc<RefCell<Option<App>>>);

impl eframe::App for Window {
    fn ui(&mut self, ui: &mut egui::Ui, frame: &mut eframe::Frame) {
        if let Some(app) = &mut *self.0.borrow_mut() {
            app.ui(ui, frame);
        }
    }
}

/// Shows frames without a window.
fn run_headless(arguments: &Arguments, start: Start, frames: u32) -> anyhow::Result<()> {
    let Headless {
        script,
        frame_times,
        record,
        output,
    } = &arguments.headless;
    let script = match script {
        Some(path) => {
            let failed = || path.display().to_string();
            let text = std::fs::read_to_string(path).with_context(failed)?;
            Script::parse(&text)
                .map_err(|reason| anyhow!(reason))
                .with_context(failed)?
        }
        None => Script::default(),
    };
    let format = output.as_deref().map(output::format).transpose()?;
    let files = [output, frame_times].into_iter().flatten();
    output::check_folders(files.map(PathBuf::as_path))?;
    let gpu = Gpu::open(&arguments.common.adapter)?;
    let size = arguments.size;
    let shown = Frames {
        count: frames,
        size,
        samples: arguments.view.samples,
        are_timed: frame_times.is_some(),
    };
    if let Some(folder) = record {
        output::make_folder(folder)?;
    }
    let mut write_frame = |frame: u32, session: &Session| {
        let Some(folder) = record else { return Ok(()) };
        let pixels = session.loaded().renderer.pixels();
        let pixels = pixels.map_err(|error| error.to_string())?;
        let path = output::frame_path(folder, frame);
        output::write_png(&path, size, &pixels).map_err(|error| format!("{error:#}"))
    };
    let recorder = record.as_ref().map(|_| &mut write_frame as Recorder<'_>);
    let (mut viewer, times) =
        headless::run(&gpu, start, shown, &script, recorder).map_err(|reason| anyhow!(reason))?;
    if !arguments.common.quiet {
        println!(
            "{frames} frames of {}x{} on {}: first picture after {:.2} s, median {:.2} ms, slowest {:.2} ms (frame {})",
            size[0],
            size[1],
            times.adapter,
            times.first_picture_seconds,
            times.median_ms,
            times.slowest_ms,
            times.slowest_frame,
        );
    }
    if let Some(path) = frame_times {
        output::write_json(path, &times)?;
    }
    if let (Some(path), Some(format), Some(session)) = (output, format, viewer.session()) {
        match format {
            Format::Png => {
                let pixels = session.loaded().renderer.pixels()?;
                output::write_png(path, size, &pixels)?;
            }
            format => {
                let radiance = session.begin_radiance()?;
                session.gpu().wait()?;
                let radiance = pollster::block_on(radiance)?;
                output::write_radiance(path, format, size, &radiance)?;
            }
        }
    }
    Ok(())
}

/// The adapter that was asked for, and a device as gpugi opens it.
fn setup(common: &Common) -> WgpuSetupCreateNew {
    let choice = common.adapter.clone();
    WgpuSetupCreateNew {
        instance_descriptor: instance_descriptor(),
        native_adapter_selector: Some(std::sync::Arc::new(move |adapters, surface| {
            let can_draw = |adapter: &&wgpu::Adapter| {
                surface.is_none_or(|surface| adapter.is_surface_supported(surface))
            };
            let adapters = adapters.iter().filter(can_draw).cloned().collect();
            choice.choose(adapters).map_err(|error| error.to_string())
        })),
        device_descriptor: std::sync::Arc::new(Gpu::device_descriptor),
        ..WgpuSetupCreateNew::without_display_handle()
    }
}
