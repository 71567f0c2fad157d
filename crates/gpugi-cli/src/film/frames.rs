//! The frames of a film, one after the other: as a live view shows motion, as still pictures, or by the path tracer.

use std::f32::consts::TAU;
use std::future::Future;
use std::ops::ControlFlow;
use std::pin::Pin;

use glam::{Mat4, Vec3};
use gpugi::gpu::{Gpu, GpuError};
use gpugi::picture::{self, Effects, Shown};
use gpugi::reference::{PathTracer, Settings};
use gpugi::{Motion, Purpose};
use gpugi_arguments::edits;
use gpugi_scene::{Camera, Scene};

use crate::interrupt;
use crate::render::{
    Chosen, PATH_TRACER_SAMPLES, PictureArguments, add_samples, is_path_tracer,
    path_tracer_settings, usage,
};

/// The pixels of a frame, on their way to the host: 8-bit sRGB, RGBA.
pub type Pixels = Pin<Box<dyn Future<Output = Result<Vec<u8>, GpuError>>>>;

/// When frames are.
#[derive(Debug, Clone, Copy)]
pub struct Times {
    /// Animation time of the first frame (s).
    pub start: f64,
    /// Frames per second.
    pub fps: f64,
    /// Number of frames.
    pub frames: u32,
}

impl Times {
    /// Animation time of a frame (s).
    fn of(&self, frame: i64) -> f32 {
        (self.start + frame as f64 / self.fps) as f32
    }

    /// Time from frame to frame (s).
    fn step(&self) -> f32 {
        (1.0 / self.fps) as f32
    }
}

/// A camera's way around something, once.
#[derive(Debug, Clone, Copy)]
pub struct Turn {
    /// World space (m).
    pub center: Vec3,
    /// Frames that it takes.
    pub frames: u32,
}

/// How a film is seen.
#[derive(Debug, Clone)]
pub struct Shot {
    /// The camera. What moves it in the scene moves it here, too.
    pub camera: Camera,
    /// How it also turns, if it does.
    pub turn: Option<Turn>,
    /// When.
    pub times: Times,
    /// Width and height (pixels).
    pub size: [u32; 2],
}

impl Shot {
    /// The camera of a frame.
    fn camera(&self, scene: &Scene, frame: i64) -> Camera {
        let camera = scene.camera_at(&self.camera, self.times.of(frame));
        let Some(Turn { center, frames }) = self.turn else {
            return camera;
        };
        let turned = Mat4::from_rotation_y(TAU * frame as f32 / frames as f32);
        let turned = Mat4::from_translation(center) * turned * Mat4::from_translation(-center);
        Camera {
            world_from_view: turned * camera.world_from_view,
            // What moves while the shutter is open would forget the turn.
            node: None,
            ..camera
        }
    }
}

/// What makes frames.
enum Maker {
    /// Techniques, and the samples of each still picture. Without, each frame has one, and continues those before it.
    Techniques(Box<Chosen>, Option<u32>),
    /// The path tracer, its settings, and so many samples.
    PathTracer(Box<PathTracer>, Settings, u32),
}

/// Makes the frames of a film.
pub struct Frames<'a> {
    gpu: &'a Gpu,
    /// The scene at the time of the last frame.
    scene: Scene,
    shot: Shot,
    arguments: &'a PictureArguments,
    effects: Effects,
    maker: Maker,
}

impl<'a> Frames<'a> {
    /// Of `scene`; with `samples`, each a still picture. The settings of `arguments` are those of techniques alone.
    ///
    /// # Errors
    /// [`crate::Usage`], or why the GPU does not hold the scene.
    pub fn new(
        gpu: &'a Gpu,
        scene: &'a Scene,
        shot: Shot,
        arguments: &'a PictureArguments,
        effects: Effects,
        samples: Option<u32>,
    ) -> anyhow::Result<Self> {
        let (named, set, seed) = (&arguments.technique, &arguments.set, arguments.seed);
        let maker = if is_path_tracer(named)? {
            let settings = path_tracer_settings(set)?;
            let tracer = path_tracer(gpu, scene, shot.size, &settings, seed)?;
            let samples = samples.unwrap_or(PATH_TRACER_SAMPLES);
            Maker::PathTracer(Box::new(tracer), settings, samples)
        } else {
            let purpose = match samples {
                Some(_) => Purpose::StillPicture,
                None => Purpose::LiveView,
            };
            let chosen = Chosen::new(gpu, scene, shot.size, purpose, named, set)?;
            Maker::Techniques(Box::new(chosen), samples)
        };
        Ok(Self {
            gpu,
            scene: scene.clone(),
            shot,
            arguments,
            effects,
            maker,
        })
    }

    /// How many frames before the first one are to be made, too: it then continues as many as the others do, and those of
    /// a loop continue its end.
    pub fn lead(&self) -> u32 {
        match self.maker {
            Maker::Techniques(_, None) => self.effects.temporal_antialiasing.frames - 1,
            Maker::Techniques(..) | Maker::PathTracer(..) => 0,
        }
    }

    /// Makes a frame. Those before the film have negative numbers. `None` if the user pressed Ctrl-C.
    ///
    /// # Errors
    /// Why it cannot be made.
    pub fn make(&mut self, frame: i64) -> anyhow::Result<Option<Pixels>> {
        let time = self.shot.times.of(frame);
        self.scene.pose(time);
        edits::apply(&self.arguments.scene.edit, &mut self.scene)?;
        let camera = self.shot.camera(&self.scene, frame);
        let motion = Motion::seen_by(&camera, &self.scene, time);
        let (gpu, size) = (self.gpu, self.shot.size);
        let pixels: Pixels = match &mut self.maker {
            Maker::Techniques(chosen, samples) => {
                converge(chosen, &self.scene, &camera, motion, self.arguments)?;
                let renderer = &mut chosen.renderer;
                renderer.pass_time(self.shot.times.step());
                match *samples {
                    Some(samples) => {
                        add_samples(gpu, renderer, &camera, samples, |_| false, |_, _| {})?;
                        renderer.display(Shown::Picture, &self.effects)?;
                    }
                    None => {
                        renderer.render_sample(&camera, 1, Some(&self.effects), false)?;
                    }
                }
                Box::pin(renderer.begin_pixels()?)
            }
            Maker::PathTracer(tracer, settings, samples) => {
                if !tracer.update(&self.scene)? {
                    let seed = self.arguments.seed;
                    **tracer = path_tracer(gpu, &self.scene, size, settings, seed)?;
                }
                tracer.set_motion(motion)?;
                tracer.render(&camera, *samples, &mut |_| flow())?;
                let radiance = tracer.radiance()?;
                let pixels = picture::developed_of(gpu, size, &radiance, &camera, &self.effects)?;
                Box::pin(std::future::ready(Ok(pixels)))
            }
        };
        Ok((!interrupt::asked()).then_some(pixels))
    }

    /// What is to be known of the light in all frames, one sentence each, once there is a frame.
    pub fn notes(&self) -> Vec<String> {
        let Maker::Techniques(chosen, _) = &self.maker else {
            return Vec::new();
        };
        let mut notes = chosen.notes();
        notes.extend(chosen.renderer.warnings());
        notes
    }
}

/// Brings the maps to their final state for what `camera` sees of `scene`, or stops at Ctrl-C. What has no atlas is
/// replaced.
fn converge(
    chosen: &mut Chosen,
    scene: &Scene,
    camera: &Camera,
    motion: Option<Motion>,
    arguments: &PictureArguments,
) -> anyhow::Result<()> {
    loop {
        let renderer = &mut chosen.renderer;
        renderer.set_seed(arguments.seed);
        renderer.update(scene).map_err(usage)?;
        renderer.set_motion(motion.clone(), arguments.shutter_steps)?;
        match renderer.converge(camera, false, |_, _| flow()) {
            Ok(_) => return Ok(()),
            Err(error) => chosen.without_atlas(error)?,
        }
    }
}

/// A path tracer of the scene as it is now.
fn path_tracer(
    gpu: &Gpu,
    scene: &Scene,
    size: [u32; 2],
    settings: &Settings,
    seed: u32,
) -> anyhow::Result<PathTracer> {
    let mut tracer = PathTracer::new(gpu, scene, size, settings).map_err(usage)?;
    tracer.restart(seed)?;
    Ok(tracer)
}

/// Goes on until the user presses Ctrl-C.
fn flow() -> ControlFlow<()> {
    match interrupt::asked() {
        true => ControlFlow::Break(()),
        false => ControlFlow::Continue(()),
    }
}
