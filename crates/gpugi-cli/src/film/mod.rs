//! `gpugi film`.

mod encoder;
mod frames;

use std::ops::Range;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;
use std::time::Instant;

use anyhow::bail;
use gpugi::gpu::Gpu;
use gpugi::picture::Effects;
use gpugi_arguments::parse_size;
use gpugi_scene::Scene;

use crate::progress::Progress;
use crate::render::{PictureArguments, print_notes};
use crate::scene_argument;
use crate::{Common, Usage, interrupt};
use encoder::Output;
use frames::{Frames, Pixels, Shot, Times, Turn};

/// Options of `gpugi film`.
#[derive(Debug, Clone, clap::Args)]
#[command(
    mut_arg("time", |time| time.long("start").alias("time").help("Animation time of the first frame (s)")),
    after_help = "Examples:\n  gpugi film station --camera hall -o hall.mp4\n\
        \u{20} gpugi film helmet.glb --turn --size 640x480 -o helmet.webp\n\
        \u{20} gpugi film station --seconds 2 --samples 64 --camera \"from=gallery;shutter=0.02\" -o frames/"
)]
pub struct Arguments {
    /// Film to write: .webp (animated), .mp4 or .webm (by ffmpeg), or a folder of PNGs: a name that ends in / or has no
    /// extension
    #[arg(short, long, value_name = "FILM|FOLDER")]
    output: PathBuf,
    /// Width and height in pixels; even for .mp4 and .webm
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = parse_size)]
    size: [u32; 2],
    /// Length (s) (default: that of the scene's longest animation; with --turn, 6 where nothing moves)
    #[arg(long)]
    seconds: Option<f64>,
    /// Frames per second
    #[arg(long, value_name = "HZ", default_value_t = 30.0, value_parser = parse_rate)]
    fps: f64,
    /// Only these frames of the film, counted from 0, into files of their numbers: a share of a render farm's job (-o a folder)
    #[arg(long, value_name = "FIRST-LAST", value_parser = parse_frames)]
    frames: Option<[u32; 2]>,
    /// Turn the camera once around its target, or the middle of the scene, while the film lasts
    #[arg(long)]
    turn: bool,
    #[command(flatten)]
    picture: PictureArguments,
    /// Make each frame as gpugi render --technique default does, with so many samples per pixel (default: as gpugi view
    /// shows motion, one sample that continues the frames before; 256 samples for the path tracer)
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=16_777_216))]
    samples: Option<u32>,
    /// Quality of .webp, .mp4 and .webm: 0 (smallest) to 100
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=100))]
    quality: Option<u8>,
}

/// Least and most frames per second: WebP counts milliseconds.
const RATES: [f64; 2] = [0.1, 1000.0];
/// Most frames of a film: nearly an hour at 30 per second.
const MOST_FRAMES: f64 = 100_000.0;
/// Length of a turn around what stands still (s).
const TURN_SECONDS: f64 = 6.0;
/// Frames that wait for the encoder, beside the one that it has: a slow encoder holds the GPU up, not the memory.
const QUEUE: usize = 2;

fn parse_rate(text: &str) -> Result<f64, String> {
    let [least, most] = RATES;
    let rate = text.parse().ok();
    rate.filter(|rate| (least..=most).contains(rate))
        .ok_or_else(|| format!("expected frames per second, {least} to {most}"))
}

fn parse_frames(text: &str) -> Result<[u32; 2], String> {
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    match (first.parse(), last.parse()) {
        (Ok(first), Ok(last)) if first <= last => Ok([first, last]),
        _ => Err("expected FIRST-LAST, such as 0-99, or the number of one frame".to_owned()),
    }
}

/// Renders the film.
pub fn run(common: &Common, arguments: &Arguments) -> anyhow::Result<()> {
    let started = Instant::now();
    let size = arguments.size;
    let output = Output::new(&arguments.output, size, arguments.fps, arguments.quality)?;
    let of_frames = match arguments.samples {
        Some(_) => Effects::default(),
        None => Effects::of_live_view(),
    };
    let picture = &arguments.picture;
    let (effects, set) = (picture.display).effects(of_frames, &picture.set)?;
    let picture = &PictureArguments {
        set,
        ..picture.clone()
    };
    let (scene, notes) = scene_argument::load(&picture.scene)?;
    let times = times(arguments, &scene)?;
    let aspect = size[0] as f32 / size[1] as f32;
    let (camera, target) = scene_argument::view(&scene, picture.camera.as_deref(), aspect)?;
    let turn = arguments.turn.then(|| Turn {
        center: target.unwrap_or_else(|| scene.bounds().center()),
        frames: times.frames,
    });
    let shot = Shot {
        camera,
        turn,
        times,
        size,
    };
    let of_film = 0..times.frames;
    let share = match arguments.frames {
        None => of_film,
        Some([first, last]) if last < of_film.end && output.is_folder() => first..last + 1,
        Some([first, last]) => {
            let frames = times.frames;
            let message = match output.is_folder() {
                true => format!(
                    "--frames {first}-{last}: the film has frames 0 to {}",
                    frames - 1
                ),
                false => "--frames: shares of a film are PNGs in a folder".to_owned(),
            };
            return Err(Usage(message).into());
        }
    };
    // Others may have written what comes after a share.
    output.check(arguments.frames.is_none().then_some(times.frames))?;
    let gpu = Gpu::open(&common.adapter)?;
    interrupt::catch();
    print_notes(common, &notes);
    let mut frames = Frames::new(&gpu, &scene, shot, picture, effects, arguments.samples)?;
    let count = thread::scope(|scope| {
        let (sender, receiver) = sync_channel(QUEUE);
        let output = &output;
        let first = share.start;
        let encoding = scope.spawn(move || encode(output, first, &receiver));
        let sent = send(common, &mut frames, share, sender);
        let encoded = encoding.join();
        // If the encoder fails, nothing can be sent: what it says comes first.
        (encoded.unwrap_or_else(|panic| std::panic::resume_unwind(panic))).and(sent)
    })?;
    if !common.quiet {
        println!(
            "{}: {count} frames of {}x{}, {:.2} s at {} per second; {:.2} s on {}",
            arguments.output.display(),
            size[0],
            size[1],
            f64::from(count) / times.fps,
            times.fps,
            started.elapsed().as_secs_f64(),
            gpu.adapter.name
        );
    }
    Ok(())
}

/// When the film's frames are. The last one comes a step before the end, so that a loop shows no moment twice.
fn times(arguments: &Arguments, scene: &Scene) -> anyhow::Result<Times> {
    let rig = scene.rig.as_ref().filter(|rig| rig.moves());
    let of_scene = rig.map(|rig| f64::from(rig.duration()));
    let of_scene = of_scene.filter(|seconds| *seconds > 0.0);
    let of_turn = arguments.turn.then_some(TURN_SECONDS);
    let seconds = arguments.seconds.or(of_scene).or(of_turn);
    let seconds = seconds.ok_or_else(|| {
        let scene = &arguments.picture.scene.scene;
        Usage(format!(
            "nothing moves in {scene}: --turn turns the camera around it, --seconds N films it as it is"
        ))
    })?;
    if !(seconds > 0.0 && seconds.is_finite()) {
        return Err(Usage(format!("--seconds {seconds}: a film takes longer than 0 s")).into());
    }
    let fps = arguments.fps;
    let frames = (seconds * fps).round().max(1.0);
    if frames > MOST_FRAMES {
        return Err(Usage(format!(
            "{seconds} s at {fps} frames per second are more than {MOST_FRAMES} frames: ask for less with --seconds or --fps"
        ))
        .into());
    }
    Ok(Times {
        start: arguments.picture.scene.time.into(),
        fps,
        frames: frames as u32,
    })
}

/// What the encoder is told.
enum Told {
    /// The next frame: 8-bit sRGB, RGBA.
    Frame(Vec<u8>),
    /// That there are no more. Without this word, the film is given up.
    End,
}

/// Makes frames and sends them, until all are sent, the user presses Ctrl-C, or the encoder listens no more. Returns their
/// number.
fn send(
    common: &Common,
    frames: &mut Frames<'_>,
    share: Range<u32>,
    sender: SyncSender<Told>,
) -> anyhow::Result<u32> {
    let mut progress = Progress::new(common.quiet);
    let mut sent = 0;
    let mut send = |pixels: Pixels| {
        let is_sent = sender
            .send(Told::Frame(pollster::block_on(pixels)?))
            .is_ok();
        sent += u32::from(is_sent);
        anyhow::Ok(is_sent)
    };
    let [first, end] = [share.start, share.end].map(i64::from);
    let count = end - first;
    let lead = i64::from(frames.lead());
    // A frame's pixels come to the host while the next one is made.
    let mut last: Option<Pixels> = None;
    for frame in first - lead..end {
        let done = (frame - first + lead) as f64 / (count + lead) as f64;
        progress.show(
            done,
            &format!("frame {} of {count}", (frame - first).max(0) + 1),
        );
        let Some(pixels) = frames.make(frame)? else {
            break;
        };
        if frame == first - lead {
            print_notes(common, &frames.notes());
        }
        if frame >= first
            && let Some(last) = last.replace(pixels)
            && !send(last)?
        {
            break;
        }
    }
    if let Some(last) = last {
        send(last)?;
    }
    progress.finish();
    if interrupt::asked() && i64::from(sent) < count {
        if sent == 0 {
            bail!("interrupted before the first frame");
        }
        if !common.quiet {
            eprintln!("interrupted: the film has {sent} of {count} frames");
        }
    }
    sender.send(Told::End).ok();
    Ok(sent)
}

/// Writes the frames that it is sent.
fn encode(output: &Output, first: u32, told: &Receiver<Told>) -> anyhow::Result<()> {
    let mut encoder = output.begin(first)?;
    while let Ok(told) = told.recv() {
        match told {
            Told::Frame(pixels) => encoder.add(&pixels)?,
            Told::End => return encoder.finish(),
        }
    }
    Ok(())
}
