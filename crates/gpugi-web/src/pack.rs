//! The page as static files.

use std::fs;
use std::path::Path;

use anyhow::Context;

/// Name of the page's script, which [`pack`] and the files of page share.
const NAME: &str = "gpugi_web";

/// Writes the page with the compiled `module` into `folder`.
pub fn pack(module: &Path, folder: &Path) -> anyhow::Result<()> {
    let failed = || format!("{}: cannot be written", folder.display());
    fs::create_dir_all(folder).with_context(failed)?;
    wasm_bindgen_cli_support::Bindgen::new()
        .input_path(module)
        .web(true)?
        .out_name(NAME)
        .omit_default_module_path(false)
        .typescript(false)
        .generate(folder)
        .with_context(|| module.display().to_string())?;
    for (name, text) in [
        ("index.html", include_str!("../page/index.html")),
        ("worker.js", include_str!("../page/worker.js")),
    ] {
        fs::write(folder.join(name), text).with_context(failed)?;
    }
    Ok(())
}
