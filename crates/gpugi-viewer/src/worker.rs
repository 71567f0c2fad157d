//! A page's workers: each does one job, in an instance of the page's WebAssembly that shares no memory with it, and ends.

use gpugi::jobs::{self, Job, Report};
use gpugi::scene::LayOut;
use wasm_bindgen::prelude::*;

use crate::browser::pause;
use crate::reading::{ReadEnvironment, ReadScene};

#[wasm_bindgen(module = "/src/worker.js")]
extern "C" {
    type JobWorker;

    #[wasm_bindgen(constructor)]
    fn new(module: JsValue, name: &str, job: &[u8]) -> JobWorker;

    #[wasm_bindgen(method, getter)]
    fn progress(this: &JobWorker) -> f32;

    #[wasm_bindgen(method, getter, js_name = hasBegun)]
    fn has_begun(this: &JobWorker) -> bool;

    #[wasm_bindgen(method, getter, js_name = hasEnded)]
    fn has_ended(this: &JobWorker) -> bool;

    #[wasm_bindgen(method, getter)]
    fn result(this: &JobWorker) -> Option<Vec<u8>>;

    #[wasm_bindgen(method)]
    fn terminate(this: &JobWorker);

    fn say(progress: f32);
}

/// Begins a job in a worker; on the page itself, which then stands still, where the browser starts none. For
/// [`jobs::do_elsewhere`].
pub fn begin(name: &'static str, job: Vec<u8>, report: Report) {
    wasm_bindgen_futures::spawn_local(async move {
        let worker = JobWorker::new(wasm_bindgen::module(), name, &job);
        let mut job = Some(job);
        while !worker.has_ended() {
            if worker.has_begun() {
                job = None;
            }
            if !report.goes_on(worker.progress()) {
                return worker.terminate();
            }
            pause().await;
        }
        let result = match job.filter(|_| !worker.has_begun()) {
            Some(job) => run(name, &job, &|_| true),
            None => worker.result(),
        };
        report.end(result);
    });
}

/// In a worker: does the job of this name.
pub fn work(name: &str, job: &[u8]) -> Option<Vec<u8>> {
    let goes_on = |progress| {
        say(progress);
        true
    };
    run(name, job, &goes_on)
}

fn run(name: &str, job: &[u8], goes_on: &(dyn Fn(f32) -> bool + Sync)) -> Option<Vec<u8>> {
    match name {
        LayOut::NAME => jobs::run::<LayOut>(job, goes_on),
        ReadScene::NAME => jobs::run::<ReadScene>(job, goes_on),
        ReadEnvironment::NAME => jobs::run::<ReadEnvironment>(job, goes_on),
        _ => None,
    }
}
