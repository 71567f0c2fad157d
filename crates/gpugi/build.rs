//! Links every WESL module with an entry point, the shared bindings, and the library for gathers of other crates, each
//! to one plain WGSL file.
//!
//! `src/techniques/shadow_map/gather.wesl` becomes `$OUT_DIR/techniques.shadow_map.gather.wgsl`. `shaders.rs` in
//! `OUT_DIR` lists all of them, so that a test can validate each.
//!
//! In debug builds, the viewer runs this program again when a source changes: `gpu::shader_linker` says where it is.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

fn main() {
    let source = Path::new("src");
    let out = PathBuf::from(std::env::var("OUT_DIR").expect("cargo sets OUT_DIR"));
    // Remove the outputs of shaders that no longer exist.
    for old in std::fs::read_dir(&out)
        .expect("OUT_DIR is readable")
        .flatten()
    {
        if old
            .path()
            .extension()
            .is_some_and(|extension| extension == "wgsl")
        {
            std::fs::remove_file(old.path()).expect("OUT_DIR is writable");
        }
    }
    let mut modules = Vec::new();
    collect(source, &mut modules);
    modules.sort();
    let mut table = String::from("&[\n");
    for path in modules {
        let text = std::fs::read_to_string(&path).expect("a shader is readable");
        let has_entry_point = ["@compute", "@vertex", "@fragment"]
            .iter()
            .any(|stage| text.contains(stage));
        let is_library = [
            "scene/bindings.wesl",
            "scene/ray_bindings.wesl",
            "techniques/library.wesl",
        ]
        .iter()
        .any(|library| path.ends_with(library));
        if !has_entry_point && !is_library {
            continue;
        }
        let relative = path
            .strip_prefix(source)
            .expect("below src")
            .with_extension("");
        let parts: Vec<_> = relative
            .components()
            .map(|part| part.as_os_str().to_string_lossy().into_owned())
            .collect();
        let name = parts.join(".");
        std::fs::write(
            out.join(format!("{name}.wgsl")),
            link(source, &parts.join("::")),
        )
        .expect("OUT_DIR is writable");
        writeln!(
            table,
            "    ({name:?}, include_str!(concat!(env!(\"OUT_DIR\"), \"/{name}.wgsl\"))),"
        )
        .expect("a string grows");
    }
    table.push(']');
    std::fs::write(out.join("shaders.rs"), table).expect("OUT_DIR is writable");
    println!("cargo:rerun-if-changed=src");
    if std::env::var("PROFILE").is_ok_and(|profile| profile == "debug") {
        let program = std::env::current_exe().expect("a program has a path");
        println!("cargo:rustc-env=GPUGI_LINKER={}", program.display());
        let folder = std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets it");
        println!("cargo:rustc-env=GPUGI_LINKER_FOLDER={folder}");
    }
}

fn link(source: &Path, module: &str) -> String {
    let mut wesl = wesl::Wesl::new(source);
    wesl.set_options(wesl::CompileOptions {
        keep_root: true,
        ..Default::default()
    });
    let root = format!("package::{module}").parse().expect("a module path");
    match wesl.compile(&root) {
        Ok(linked) => linked.to_string(),
        Err(error) => {
            eprintln!("{error}");
            std::process::exit(1);
        }
    }
}

fn collect(folder: &Path, modules: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder)
        .expect("src is readable")
        .flatten()
    {
        let path = entry.path();
        if path.is_dir() {
            collect(&path, modules);
        } else if path
            .extension()
            .is_some_and(|extension| extension == "wesl")
        {
            modules.push(path);
        }
    }
}
