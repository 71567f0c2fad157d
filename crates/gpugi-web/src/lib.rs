//! The viewer as a page: what page/index.html calls.

#![cfg(target_arch = "wasm32")]

use std::cell::RefMut;
use std::io::Cursor;

use eframe::egui_wgpu::{WgpuConfiguration, WgpuSetup, WgpuSetupExisting};
use eframe::web_sys::HtmlCanvasElement;
use eframe::{WebOptions, WebRunner, wgpu};
use gpugi::gpu::{AdapterChoice, AdapterSummary, Gpu, GpuError, instance_descriptor};
use gpugi_scene::image::write_exr;
use gpugi_viewer::app::App;
use gpugi_viewer::arguments::of_address;
use gpugi_viewer::command::command;
use gpugi_viewer::script::Script;
use gpugi_viewer::session::Session;
use gpugi_viewer::worker;
use js_sys::Uint8Array;
use wasm_bindgen::prelude::*;

/// The viewer on a canvas.
#[wasm_bindgen]
pub struct Page(WebRunner);

#[wasm_bindgen]
impl Page {
    /// Starts the viewer. `address` is what follows `#` in the page's: `scene=cornell&technique=shadow-map`, options as
    /// those of `gpugi view`.
    ///
    /// # Errors
    /// Rejects with a sentence where there is no WebGPU that gpugi can use.
    pub async fn start(canvas: HtmlCanvasElement, address: &str) -> Result<Page, JsError> {
        gpugi::jobs::do_elsewhere(worker::begin);
        let (start, wrong) = match of_address(address) {
            Ok(start) => (start, None),
            Err(reason) => (of_address("").map_err(error)?, Some(reason)),
        };
        let options = WebOptions {
            wgpu_options: WgpuConfiguration {
                wgpu_setup: WgpuSetup::Existing(setup().await?),
                ..Default::default()
            },
            ..Default::default()
        };
        let app = move |context: &eframe::CreationContext<'_>| {
            let render_state = context.wgpu_render_state.as_ref();
            let render_state = render_state.ok_or("the page has no GPU")?;
            let mut app = App::new(&context.egui_ctx, render_state, start);
            if let Some(reason) = wrong {
                app.complain(format!("the address: {reason}"));
            }
            Ok(Box::new(app) as Box<dyn eframe::App>)
        };
        let runner = WebRunner::new();
        let started = runner.start(canvas, options, Box::new(app)).await;
        started.map_err(|reason| error(format!("{reason:?}")))?;
        Ok(Self(runner))
    }

    /// Opens what another address says, or says what is wrong with it.
    ///
    /// # Errors
    /// gpugi has failed.
    pub fn open(&self, address: &str) -> Result<(), JsError> {
        let mut app = self.app()?;
        match of_address(address) {
            Ok(start) => app.viewer().start(start),
            Err(reason) => app.complain(format!("the address: {reason}")),
        }
        Ok(())
    }

    /// Does a step of a script (docs/viewer.md), such as `orbit 20 10`.
    ///
    /// # Errors
    /// Why it cannot be done.
    pub fn run(&self, step: &str) -> Result<(), JsError> {
        let script = Script::parse(&format!("0 {step}")).map_err(error)?;
        let mut app = self.app()?;
        let mut steps = script.steps(0);
        steps
            .try_for_each(|step| step.run(app.viewer()))
            .map_err(error)
    }

    /// Whether the picture is complete: nothing is being opened, all maps are made and all samples taken, those of the
    /// path tracer, too.
    ///
    /// # Errors
    /// What the page says that is wrong.
    #[wasm_bindgen(js_name = isComplete)]
    pub fn is_complete(&self) -> Result<bool, JsError> {
        let mut app = self.app()?;
        if let Some(reason) = app.error() {
            return Err(error(reason.to_owned()));
        }
        let viewer = app.viewer();
        let is_opening = viewer.opening().is_some();
        let session = viewer.session();
        Ok(!is_opening && session.is_some_and(|session| session.is_complete()))
    }

    /// Samples that the path tracer has of every pixel of what is seen.
    ///
    /// # Errors
    /// gpugi has failed.
    #[wasm_bindgen(js_name = tracedSamples)]
    pub fn traced_samples(&self) -> Result<u32, JsError> {
        let mut app = self.app()?;
        let session = app.viewer().session();
        let reference = session.as_deref().and_then(Session::reference);
        Ok(reference.map_or(0, |reference| reference.samples))
    }

    /// Why the device was lost, if it was. Nothing is drawn any more then.
    pub fn lost(&self) -> Option<String> {
        let lost = self.app().ok()?.gpu().check_lost();
        let Err(GpuError::Lost { reason }) = lost else {
            return None;
        };
        self.0.destroy();
        Some(reason)
    }

    /// The command line that renders what is seen.
    ///
    /// # Errors
    /// Nothing is on show.
    pub fn command(&self) -> Result<String, JsError> {
        let mut app = self.app()?;
        let session = app.viewer().session().ok_or_else(nothing)?;
        Ok(command(session, session.loaded().renderer.size()))
    }

    /// Linear radiance of what is seen, as an EXR file.
    ///
    /// # Errors
    /// Nothing is on show, or the GPU has failed.
    pub async fn exr(&self) -> Result<Uint8Array, JsError> {
        let (gpu, [width, height], radiance) = {
            let mut app = self.app()?;
            let session = app.viewer().session().ok_or_else(nothing)?;
            let renderer = &session.loaded().renderer;
            let radiance = session.begin_radiance()?;
            (session.gpu().clone(), renderer.size(), radiance)
        };
        let radiance = radiance.await?;
        // What failed in the last frames has been reported by now.
        gpu.check()?;
        let mut file = Cursor::new(Vec::new());
        write_exr(&mut file, width, height, &radiance)?;
        Ok(Uint8Array::from(&file.into_inner()[..]))
    }
}

/// Does a job of a page: what page/worker.js calls. Nothing is returned if the job is unknown.
#[wasm_bindgen]
pub fn work(name: &str, job: &[u8]) -> Option<Vec<u8>> {
    worker::work(name, job)
}

impl Page {
    fn app(&self) -> Result<RefMut<'_, App>, JsError> {
        let app = self.0.app_mut::<App>();
        app.ok_or_else(|| error("gpugi failed; please report it".into()))
    }
}

/// A device as gpugi opens it.
async fn setup() -> Result<WgpuSetupExisting, JsError> {
    let instance = wgpu::Instance::new(instance_descriptor());
    let adapters = instance.enumerate_adapters(wgpu::Backends::all()).await;
    let adapter = AdapterChoice::Best.choose(adapters)?;
    let missing = AdapterSummary::of(&adapter).missing();
    if !missing.is_empty() {
        return Err(error(format!(
            "This GPU lacks what gpugi needs: {}.",
            missing.join("; ")
        )));
    }
    let descriptor = Gpu::device_descriptor(&adapter);
    let (device, queue) = adapter.request_device(&descriptor).await?;
    Ok(WgpuSetupExisting {
        instance,
        adapter,
        device,
        queue,
    })
}

fn nothing() -> JsError {
    error("nothing is on show yet".into())
}

fn error(reason: String) -> JsError {
    JsError::new(&reason)
}
