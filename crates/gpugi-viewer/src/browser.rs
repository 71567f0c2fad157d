//! What only a browser can do.

use std::future::poll_fn;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Poll, Waker};

use eframe::egui::DroppedFileHandle;
use gpugi::gpu::Gpu;
use gpugi_arguments::files::Files;
use wasm_bindgen::prelude::*;

/// Most bytes that are read of what is dropped: they, what they hold and its copies share the 4 GiB of a page.
const MOST_BYTES: f64 = (1_u64 << 30) as f64;

#[wasm_bindgen(inline_js = r#"
export function pause() {
    return new Promise(resolve => setTimeout(resolve, 20));
}

export function download(name, bytes) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([bytes]));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

export function gamepad() {
    const pad = [...navigator.getGamepads()].find(pad => pad?.connected && pad.mapping === "standard");
    return new Float32Array(pad ? [...pad.axes.slice(0, 4), ...[0, 1, 2].map(i => pad.buttons[i].value)] : []);
}

export function showAddress(address) {
    history.replaceState(null, "", `#${address}`);
}
"#)]
extern "C" {
    /// Lets the browser do what is due: input, callbacks of the GPU, a frame.
    pub async fn pause();

    /// Hands a file to the person who looks at the page.
    pub fn download(name: &str, bytes: &[u8]);

    /// Four axes and three buttons of the first gamepad that the browser knows the layout of; nothing without one.
    pub fn gamepad() -> Vec<f32>;

    /// Changes what follows `#` in the page's address.
    #[wasm_bindgen(js_name = showAddress)]
    pub fn show_address(address: &str);
}

/// Whether the GPU is at work on the page's last frame. If it were given more, the page would stand still until the
/// browser's GPU process takes that.
#[derive(Debug, Clone, Default)]
pub struct Busy(Arc<AtomicBool>);

impl Busy {
    /// Is busy until the GPU has done what was submitted so far, and calls `done` then.
    pub fn begin(&self, gpu: &Gpu, done: impl FnOnce() + Send + 'static) {
        self.0.store(true, Ordering::Relaxed);
        let busy = self.0.clone();
        gpu.queue.on_submitted_work_done(move || {
            busy.store(false, Ordering::Relaxed);
            done();
        });
    }

    /// Whether it is busy.
    pub fn get(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Waits until the GPU has done what was submitted, and the browser has compiled what was made.
pub async fn gpu_done(gpu: &Gpu) {
    let (busy, waker) = (Busy::default(), Arc::new(Mutex::new(None::<Waker>)));
    let to_wake = waker.clone();
    busy.begin(gpu, move || {
        let mut waker = to_wake.lock().unwrap_or_else(PoisonError::into_inner);
        waker.take().into_iter().for_each(Waker::wake);
    });
    poll_fn(|context| {
        if !busy.get() {
            return Poll::Ready(());
        }
        *waker.lock().unwrap_or_else(PoisonError::into_inner) = Some(context.waker().clone());
        Poll::Pending
    })
    .await;
}

/// Reads what was dropped on the page.
///
/// # Errors
/// Why it cannot be read.
pub async fn read(dropped: &[DroppedFileHandle]) -> Result<Files, String> {
    let sizes = dropped.iter().filter_map(|file| file.web_file());
    let bytes: f64 = sizes.map(|file| file.size()).sum();
    if bytes > MOST_BYTES {
        return Err(format!(
            "{bytes} bytes are more than a page can open; ./gpugi view opens them"
        ));
    }
    let mut files = Files::default();
    for file in dropped {
        let name = file.path().display().to_string();
        let bytes = file.bytes_async().await;
        let bytes = bytes.map_err(|reason| format!("{name}: {reason}"))?;
        files.insert(name, bytes);
    }
    Ok(files)
}
