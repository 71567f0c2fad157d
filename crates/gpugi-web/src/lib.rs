//! gpugi in a browser.
//!
//! Nothing here blocks between frames. But a scene that is uploaded for texels or rays (radiosity, obscurances) is
//! unwrapped and gets its hierarchies in one go, which can take seconds. Call [`render`] in a worker then, or the page
//! freezes meanwhile.

use gpugi::gpu::{AdapterChoice, Gpu};
use gpugi::{Readiness, Renderer};
use gpugi_scene::builtin::builtin;
use js_sys::Float32Array;
use wasm_bindgen::prelude::*;

#[wasm_bindgen(
    inline_js = "export function turn() { return new Promise(resolve => setTimeout(resolve)); }"
)]
extern "C" {
    /// Lets the browser do what is due: input, callbacks of the GPU.
    async fn turn();
}

/// Panics become exceptions, which the page sees as `error` events.
#[wasm_bindgen(start)]
fn throw_panics() {
    std::panic::set_hook(Box::new(|panic| {
        wasm_bindgen::throw_str(&panic.to_string())
    }));
}

/// Renders what the first camera of a built-in scene sees, as the command does: `gpugi render SCENE --technique ...
/// --set ... --size ... --samples ...`: maps converge, then samples accumulate. Without `techniques`, by the scene's
/// default set for a live view: unwrapping an atlas is slow in a browser. A setting is `technique.key=value`; `width`
/// and `height` are in pixels. Resolves to linear radiance, three floats per pixel, row by row from the top.
///
/// # Errors
/// Rejects where the browser has no WebGPU, for unknown names, and for what the GPU refuses.
#[wasm_bindgen]
pub async fn render(
    scene: &str,
    techniques: Vec<String>,
    settings: Vec<String>,
    width: u32,
    height: u32,
    samples: u32,
) -> Result<Float32Array, JsError> {
    let scene =
        builtin(scene, 1).ok_or_else(|| JsError::new(&format!("{scene}: is no built-in scene")))?;
    let gpu = Gpu::open_async(&AdapterChoice::Best).await?;
    let mut renderer = Renderer::new(&gpu, &scene, [width, height], &techniques)?;
    for setting in &settings {
        let parts = setting
            .split_once('=')
            .and_then(|(name, value)| Some((name.split_once('.')?, value)));
        let ((technique, key), value) =
            parts.ok_or_else(|| JsError::new(&format!("{setting}: is not technique.key=value")))?;
        renderer.set(technique, key, value)?;
    }
    let camera = &scene.cameras[0];
    while renderer.try_converge(camera)? != Readiness::Ready {
        turn().await;
    }
    while renderer.samples() < samples {
        renderer.try_render_sample(camera, samples, None, false)?;
        turn().await;
    }
    let radiance = renderer.begin_radiance()?.await?;
    // What failed in the last frames has been reported by now.
    gpu.check()?;
    Ok(Float32Array::from(&radiance[..]))
}
