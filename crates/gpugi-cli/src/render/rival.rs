//! What the other way to make a picture would have come to, for `--explain`: the path tracer beside the techniques, or these
//! beside the path tracer.

use std::ops::ControlFlow;
use std::time::Instant;

use gpugi::gpu::Gpu;
use gpugi::reference::{PathTracer, Settings};
use gpugi::{Motion, Purpose};
use gpugi_scene::image::metrics::{Metric, Picture, compare};
use gpugi_scene::{Camera, Scene};

use super::{Arguments, BLURRED_SAMPLES, Chosen, TECHNIQUE_SAMPLES, add_samples};
use crate::interrupt;

/// Most samples of the path tracer: more than any picture takes.
const MOST_SAMPLES: u32 = 1 << 24;

/// Error of a picture against another one.
fn error(
    metric: Metric,
    [width, height]: [u32; 2],
    [test, reference]: [&[f32]; 2],
) -> anyhow::Result<f64> {
    let picture = |radiance: &[f32]| {
        Picture::of_radiance(width, height, radiance.to_vec()).map_err(anyhow::Error::msg)
    };
    Ok(compare(metric, &picture(test)?, &picture(reference)?)?.value)
}

/// The way in which a picture was not made, and what it is compared with: radiance.
pub(super) enum Rival {
    /// Techniques made the picture in so many seconds.
    PathTracer(Vec<f32>, f64),
    Techniques(Vec<f32>),
}

impl Rival {
    /// What it gives, in a sentence. `None`: interrupted.
    pub fn in_words(
        &self,
        gpu: &Gpu,
        arguments: &Arguments,
        seen: (&Scene, &Camera),
    ) -> anyhow::Result<Option<String>> {
        match self {
            Self::PathTracer(radiance, seconds) => {
                path_tracer(gpu, arguments, seen, (radiance, *seconds))
            }
            Self::Techniques(radiance) => techniques(gpu, arguments, seen, radiance),
        }
    }
}

fn flow() -> ControlFlow<()> {
    match interrupt::asked() {
        true => ControlFlow::Break(()),
        false => ControlFlow::Continue(()),
    }
}

/// The path tracer in the `seconds` that techniques took for `radiance`. Both compile their shaders in that time.
fn path_tracer(
    gpu: &Gpu,
    arguments: &Arguments,
    (scene, camera): (&Scene, &Camera),
    (radiance, seconds): (&[f32], f64),
) -> anyhow::Result<Option<String>> {
    let size = arguments.size;
    let began = Instant::now();
    let mut tracer = PathTracer::new(gpu, scene, size, &Settings::default())?;
    // Another seed: noise that both have would not count.
    tracer.restart(arguments.picture.seed.wrapping_add(1))?;
    tracer.set_motion(Motion::seen_by(camera, scene, arguments.picture.scene.time))?;
    tracer.render(camera, MOST_SAMPLES, &mut |state| {
        // One sample says nothing about its noise.
        let is_late = state.samples >= 2 && began.elapsed().as_secs_f64() >= seconds;
        match is_late {
            true => ControlFlow::Break(()),
            false => flow(),
        }
    })?;
    if interrupt::asked() {
        return Ok(None);
    }
    let took = began.elapsed().as_secs_f64();
    let (noise, samples) = (tracer.noise()?, tracer.samples());
    let apart = error(Metric::RelMse, size, [radiance, &tracer.radiance()?])?;
    let own = match apart > noise {
        true => format!("{:.1e}", apart - noise),
        false => "less than that noise".to_owned(),
    };
    Ok(Some(format!(
        "the path tracer takes {samples} samples in {took:.1} s, without a filter: estimated rel-mse {noise:.1e}. The two pictures are \
         {apart:.1e} apart, so the techniques' own error is about {own}"
    )))
}

/// The techniques of the default set beside the path tracer's `radiance`.
fn techniques(
    gpu: &Gpu,
    arguments: &Arguments,
    (scene, camera): (&Scene, &Camera),
    radiance: &[f32],
) -> anyhow::Result<Option<String>> {
    let size = arguments.size;
    let motion = Motion::seen_by(camera, scene, arguments.picture.scene.time);
    let samples = match !camera.lens.is_pinhole() || motion.is_some() {
        true => BLURRED_SAMPLES,
        false => TECHNIQUE_SAMPLES,
    };
    let began = Instant::now();
    let mut chosen = Chosen::new(gpu, scene, size, Purpose::StillPicture, &[], &[])?;
    loop {
        let renderer = &mut chosen.renderer;
        renderer.set_seed(arguments.picture.seed);
        renderer.set_motion(motion.clone(), arguments.picture.shutter_steps)?;
        match renderer.converge(camera, false, |_, _| flow()) {
            Ok(_) => break,
            Err(error) => chosen.without_atlas(error)?,
        }
    }
    let renderer = &mut chosen.renderer;
    add_samples(gpu, renderer, camera, samples, |_| false, |_, _| {})?;
    if interrupt::asked() {
        return Ok(None);
    }
    let took = began.elapsed().as_secs_f64();
    let made = renderer.radiance()?;
    let [flip, apart] = [Metric::Flip, Metric::RelMse].map(|by| error(by, size, [&made, radiance]));
    Ok(Some(format!(
        "the techniques take {took:.1} s for maps and {samples} samples, and differ from this picture by HDR-FLIP {:.3}, rel-mse {:.1e}",
        flip?, apart?
    )))
}
