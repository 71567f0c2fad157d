//! What only a browser can do.

use eframe::egui::DroppedFileHandle;
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

export function showAddress(address) {
    history.replaceState(null, "", `#${address}`);
}
"#)]
extern "C" {
    /// Lets the browser do what is due: input, callbacks of the GPU, a frame.
    pub async fn pause();

    /// Hands a file to the person who looks at the page.
    pub fn download(name: &str, bytes: &[u8]);

    /// Changes what follows `#` in the page's address.
    #[wasm_bindgen(js_name = showAddress)]
    pub fn show_address(address: &str);
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
