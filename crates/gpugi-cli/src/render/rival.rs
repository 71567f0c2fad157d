//! What the other way to make a picture would have come to, for `--explain`: the path tracer beside the techniques, or these
//! beside the path tracer.

use std::ops::ControlFlow;
use std::time::Instant;

use gpugi::gpu::Gpu;
use gpugi::reference::{PathTracer, Settings};
use gpugi::{Motion, Purpose};
use gpugi_scene::image::metrics::{Metric, Picture, compare};
use gpugi_scene::{Camera, Scene};

use super::{Arguments, Chosen, TECHNIQUE_SAMPLES, add_samples};
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

/// The path tracer in the `seconds` that techniques took for `radiance`: a sentence. `None`: interrupted.
pub(super) fn path_tracer(
    gpu: &Gpu,
    arguments: &Arguments,
    (scene, camera): (&Scene, &Camera),
    (radiance, seconds): (&[f32], f64),
) -> anyhow::Result<Option<String>> {
    let size = arguments.size;
    let mut tracer = PathTracer::new(gpu, scene, size, &Settings::default())?;
    // Another seed: noise that both have would not count. One sample compiles the shaders.
    let seed = arguments.picture.seed.wrapping_add(1);
    for most in [1, MOST_SAMPLES] {
        tracer.restart(seed)?;
        tracer.set_motion(Motion::seen_by(camera, scene, arguments.picture.scene.time))?;
        let began = Instant::now();
        tracer.render(camera, most, &mut |state| {
            let is_late = state.samples >= 2 && began.elapsed().as_secs_f64() >= seconds;
            match is_late || interrupt::asked() {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            }
        })?;
        if interrupt::asked() {
            return Ok(None);
        }
    }
    let noise = tracer.noise()?;
    let traced = tracer.radiance()?;
    let apart = error(Metric::RelMse, size, [radiance, &traced])?;
    let samples = tracer.samples();
    let own = match apart > noise {
        true => format!("about {:.1e}", apart - noise),
        false => "less than that noise".to_owned(),
    };
    Ok(Some(format!(
        "in the same {seconds:.1} s, the path tracer takes {samples} samples: estimated rel-mse {noise:.1e}, without a filter. The two \
         pictures are {apart:.1e} apart: {own} of it is the techniques' error"
    )))
}

/// The techniques of the default set beside the path tracer's `radiance`: a sentence. `None`: interrupted.
pub(super) fn techniques(
    gpu: &Gpu,
    arguments: &Arguments,
    (scene, camera): (&Scene, &Camera),
    radiance: &[f32],
) -> anyhow::Result<Option<String>> {
    let size = arguments.size;
    let began = Instant::now();
    let mut chosen = Chosen::new(gpu, scene, size, Purpose::StillPicture, &[], &[])?;
    loop {
        let go_on = |_, _| match interrupt::asked() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        };
        match chosen.renderer.converge(camera, false, go_on) {
            Ok(_) => break,
            Err(error) => chosen.without_atlas(error)?,
        }
    }
    let renderer = &mut chosen.renderer;
    add_samples(
        gpu,
        renderer,
        camera,
        TECHNIQUE_SAMPLES,
        |_| false,
        |_, _| {},
    )?;
    if interrupt::asked() {
        return Ok(None);
    }
    let seconds = began.elapsed().as_secs_f64();
    let made = renderer.radiance()?;
    let [flip, apart] = [Metric::Flip, Metric::RelMse];
    let flip = error(flip, size, [&made, radiance])?;
    let apart = error(apart, size, [&made, radiance])?;
    Ok(Some(format!(
        "the techniques take {seconds:.1} s for maps and {TECHNIQUE_SAMPLES} samples, shaders included, and differ from this picture by \
         HDR-FLIP {flip:.3}, rel-mse {apart:.1e}"
    )))
}
