//! The same loop without a window: frames follow each other as fast as they can, and their times are written.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use gpugi::gpu::{AdapterChoice, Gpu};
use serde::Serialize;

use crate::recording::STEP_SECONDS;
use crate::script::Script;
use crate::session::Session;
use crate::viewer::{Start, Viewer};

/// Times of a run's frames.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrameTimes {
    /// Name of the adapter.
    pub adapter: String,
    /// Width and height (pixels).
    pub size: [u32; 2],
    /// From the start to the first picture (s).
    pub first_picture_seconds: f64,
    /// Middle of the times (ms).
    pub median_ms: f64,
    /// Time of the slowest frame (ms).
    pub slowest_ms: f64,
    /// The slowest frame.
    pub slowest_frame: usize,
    /// Time of each frame, until the GPU has run the one before (ms).
    pub frames_ms: Vec<f64>,
    /// Work on maps in each frame, in units of [`gpugi::lighting::Budget`].
    pub work: Vec<u64>,
    /// GPU time of each pass in each frame (ms). Empty if passes were not timed.
    pub gpu_ms: Vec<BTreeMap<String, f64>>,
}

/// Takes each frame of a recording: its number, and the session that shows it.
pub type Recorder<'a> = &'a mut dyn FnMut(u32, &Session) -> Result<(), String>;

/// What a run shows.
#[derive(Debug, Clone, Copy, Default)]
pub struct Frames {
    /// Frames after the first picture.
    pub count: u32,
    /// Width and height (pixels); the resolution stays the same.
    pub size: [u32; 2],
    /// More frames follow until the picture at rest has so many samples per pixel.
    pub samples: Option<u32>,
    /// Whether the GPU times its passes, which makes frames a little slower.
    pub are_timed: bool,
}

/// Shows `frames` after the first picture, while `script` runs. Before `recorder` takes a frame, time stands still until
/// it is complete. A device that is lost is made anew, once.
///
/// # Errors
/// Why it cannot be shown.
pub fn run(
    gpu: &Gpu,
    start: Start,
    frames: Frames,
    script: &Script,
    mut recorder: Option<Recorder<'_>>,
) -> Result<(Viewer, FrameTimes), String> {
    let Frames { size, samples, .. } = frames;
    let started = Instant::now();
    let mut viewer = Viewer::new(gpu, start, || {});
    viewer.finish_opening()?;
    let session = viewer.session().ok_or("there is no scene")?;
    session.pace.is_adaptive = false;
    session.samples = samples.unwrap_or(session.samples);
    session.is_timed = frames.are_timed;
    let mut took = STEP_SECONDS;
    while !show(&mut viewer, size, &mut took)? {}
    let first_picture_seconds = started.elapsed().as_secs_f64();
    let (mut times, mut work, mut gpu_ms) = (Vec::new(), Vec::new(), Vec::new());
    let mut device = Device::First;
    for frame in 0..frames.count {
        let began = Instant::now();
        for step in script.steps(frame) {
            let done = device.outlive(&mut viewer, |viewer| step.run(viewer));
            done.map_err(|reason| format!("frame {frame}: {reason}"))?;
        }
        device.outlive(&mut viewer, |viewer| {
            let Some(recorder) = &mut recorder else {
                viewer.take_opened()?;
                return show(viewer, size, &mut took).map(drop);
            };
            viewer.finish_opening()?;
            show(viewer, size, &mut took)?;
            hold(viewer, true)?;
            finish(viewer, size, &mut took)?;
            recorder(frame, hold(viewer, false)?)
        })?;
        times.push(began.elapsed().as_secs_f64() * 1e3);
        // What is opened takes time: frames that show nothing new must not run ahead of it.
        if viewer.opening().is_some() {
            let due = Duration::from_secs_f32(STEP_SECONDS);
            std::thread::sleep(due.saturating_sub(began.elapsed()));
        }
        let session = viewer.session().ok_or("nothing is on show")?;
        work.push(session.loaded().renderer.work());
        session.pass_times.update();
        gpu_ms.extend(session.pass_times.history().back().cloned());
    }
    if samples.is_some() {
        device.outlive(&mut viewer, |viewer| {
            viewer.finish_opening()?;
            let session = viewer.session().ok_or("nothing is on show")?;
            session.clock.is_playing = false;
            session.is_game_paused = true;
            finish(viewer, size, &mut took)
        })?;
    }
    let slowest = times.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
    let (slowest_frame, slowest_ms) = slowest.map_or((0, 0.0), |(frame, time)| (frame, *time));
    let times = FrameTimes {
        adapter: gpu.adapter.name.clone(),
        size,
        first_picture_seconds,
        median_ms: gpugi_cli::output::median(times.clone()),
        slowest_ms,
        slowest_frame,
        frames_ms: times,
        work,
        gpu_ms,
    };
    Ok((viewer, times))
}

/// The device of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Device {
    /// As the run began.
    First,
    /// The first was lost.
    Second,
}

impl Device {
    /// Does some work. If that fails because the first device is lost, makes what is on show anew on a second one, and
    /// does the work there.
    fn outlive(
        &mut self,
        viewer: &mut Viewer,
        mut work: impl FnMut(&mut Viewer) -> Result<(), String>,
    ) -> Result<(), String> {
        let time = viewer
            .session()
            .map(|session| (session.clock, session.is_held));
        let done = work(viewer);
        let is_lost = viewer.gpu().check_lost().is_err();
        // What was being opened is not opened again: it may be what the device was lost by.
        if done.is_ok() || !is_lost || *self == Self::Second || viewer.opening().is_some() {
            return done;
        }
        *self = Self::Second;
        let choice = AdapterChoice::Named(viewer.gpu().adapter.name.clone());
        let gpu = Gpu::open(&choice).map_err(|error| error.to_string())?;
        viewer.renew(&gpu, || {});
        viewer.finish_opening()?;
        if let (Some(session), Some(time)) = (viewer.session(), time) {
            // The same moment once more.
            (session.clock, session.is_held) = time;
        }
        work(viewer)
    }
}

/// A frame, until the GPU has run the one before: as in a window, the host prepares a frame while the GPU runs another.
/// `took`: how long the last one and this one take (s). Returns whether the picture changed.
fn show(viewer: &mut Viewer, size: [u32; 2], took: &mut f32) -> Result<bool, String> {
    let is_disturbed = viewer.opening().is_some();
    let session = viewer.session().ok_or("nothing is on show")?;
    session.is_disturbed = is_disturbed;
    let began = Instant::now();
    let before = session.gpu().last_submission();
    let shown = session
        .frame_after(size, STEP_SECONDS, *took)
        .map_err(|error| error.to_string())?;
    let gpu = session.gpu();
    match before {
        Some(before) if !session.is_picking() => gpu.wait_for(before),
        // Before the next step, the camera knows what it orbits around.
        _ => gpu.wait(),
    }
    .map_err(|error| error.to_string())?;
    *took = began.elapsed().as_secs_f32();
    session.picked();
    Ok(shown.is_new)
}

/// Stops time, or lets it go on.
fn hold(viewer: &mut Viewer, is_held: bool) -> Result<&Session, String> {
    let session = viewer.session().ok_or("nothing is on show")?;
    session.is_held = is_held;
    Ok(session)
}

/// Frames until all samples of the scene at rest are there.
fn finish(viewer: &mut Viewer, size: [u32; 2], took: &mut f32) -> Result<(), String> {
    loop {
        show(viewer, size, took)?;
        let session = viewer.session().ok_or("nothing is on show")?;
        if session.is_complete() {
            return Ok(());
        }
    }
}
