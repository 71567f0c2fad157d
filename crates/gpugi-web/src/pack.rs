//! The page as static files.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::Context;

/// Name of the page's script, which [`pack`] and page/index.html share.
const NAME: &str = "gpugi_web";
/// npm's package of wasm-opt.
const BINARYEN: &str = "binaryen@132.0.0";

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
    let page = folder.join("index.html");
    fs::write(page, include_str!("../page/index.html")).with_context(failed)
}

/// Makes the module in `folder` smaller where wasm-opt is installed, or npm can get it.
pub fn make_smaller(folder: &Path) -> anyhow::Result<()> {
    let module = folder.join(format!("{NAME}_bg.wasm"));
    let smaller = folder.join("smaller.wasm");
    let optimize = |command: &mut Command| {
        let command = command.args(["-O1", "--all-features", "-o"]);
        command.arg(&smaller).arg(&module).stdout(Stdio::null());
        command.status().is_ok_and(|status| status.success())
    };
    let mut npm = Command::new("npm");
    npm.args(["exec", "--yes", "--package", BINARYEN, "--", "wasm-opt"]);
    if optimize(&mut Command::new("wasm-opt")) || optimize(&mut npm) {
        fs::rename(&smaller, &module).with_context(|| module.display().to_string())?;
    } else {
        eprintln!("gpugi: without wasm-opt, which npm would get, the page is larger");
    }
    Ok(())
}
