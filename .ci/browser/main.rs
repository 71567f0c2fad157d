//! Renders with gpugi-web in headless Chromium, on the software adapter that Chromium brings along, once in a page and
//! once in a worker. Called by .ci/browser-test, which compares the pictures.

mod server;

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, bail, ensure};
use server::{Message, Server};

/// Longest time for both pictures.
const PATIENCE: Duration = Duration::from_secs(180);
/// Width and height of the pictures (pixels).
const SIZE: [u32; 2] = [64, 64];

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [module, page, browser, asked, folder] = &arguments[..] else {
        bail!("usage: gpugi-browser-test MODULE.wasm PAGE_FOLDER CHROMIUM QUERY OUTPUT_FOLDER");
    };
    let folder = Path::new(folder);
    let site = folder.join("site");
    fs::create_dir_all(&site)?;
    for entry in fs::read_dir(page)? {
        let entry = entry?;
        fs::copy(entry.path(), site.join(entry.file_name()))?;
    }
    wasm_bindgen_cli_support::Bindgen::new()
        .input_path(module)
        .web(true)?
        .out_name("gpugi_web")
        .omit_default_module_path(false)
        .typescript(false)
        .generate(&site)?;
    let server = Server::start(site)?;
    let url = format!(
        "{}/index.html?{asked}&size={}x{}",
        server.address, SIZE[0], SIZE[1]
    );
    let _browser = Browser::open(browser, &url, &folder.join("profile"))?;
    let deadline = Instant::now() + PATIENCE;
    for picture in ["page", "worker"] {
        let left = deadline.saturating_duration_since(Instant::now());
        let Message { name, body } = server
            .messages
            .recv_timeout(left)
            .context("the browser says nothing")?;
        ensure!(
            name == picture,
            "{name}: {}",
            String::from_utf8_lossy(&body)
        );
        let (values, rest) = body.as_chunks::<4>();
        let values: Vec<f32> = values.iter().copied().map(f32::from_le_bytes).collect();
        ensure!(
            rest.is_empty(),
            "{picture}: {} bytes are no floats",
            body.len()
        );
        image::Rgb32FImage::from_raw(SIZE[0], SIZE[1], values)
            .with_context(|| format!("{picture}: {} bytes are no picture", body.len()))?
            .save(folder.join(format!("{picture}.exr")))?;
    }
    Ok(())
}

/// A headless Chromium, which ends with this.
struct Browser(Child);

impl Browser {
    fn open(program: &str, url: &str, profile: &Path) -> anyhow::Result<Self> {
        let child = Command::new(program)
            .args([
                "--headless=new",
                // It may run as root in a container, and opens nothing but our own page.
                "--no-sandbox",
                "--enable-unsafe-webgpu",
                "--use-webgpu-adapter=swiftshader",
                "--disable-background-networking",
                "--disable-component-update",
                "--no-first-run",
            ])
            .arg(format!("--user-data-dir={}", profile.display()))
            .arg(url)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .with_context(|| format!("{program}: does not start"))?;
        Ok(Self(child))
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}
