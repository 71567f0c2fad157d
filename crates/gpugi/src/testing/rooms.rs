//! Imports run one way: ARCHITECTURE.md's table, read from the sources.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use regex::Regex;

/// Rooms from the lowest up. A room imports from those before it, and rooms of one entry not from each other.
const ORDER: &[&[&str]] = &[
    &["gpu", "jobs", "light_paths", "sequences"],
    &["settings", "shared", "shutter", "stage"],
    &["scene"],
    &["capture", "prefiltered", "ray_bench"],
    &["denoise", "impostor", "lights", "probes"],
    &["paths"],
    &["techniques"],
    &["lighting", "picture"],
    &["default_set", "reference", "bake"],
    &["renderer"],
    &["measure"],
];

/// Rust files below a folder that are not tests.
fn sources(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        if name.ends_with("tests") || name == "testing" {
            continue;
        }
        if path.is_dir() {
            sources(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}

#[test]
fn imports_run_one_way() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&source, &mut files);
    assert!(files.len() > 100);
    let floors = ORDER.iter().enumerate();
    let floors = floors.flat_map(|(floor, rooms)| rooms.iter().map(move |room| (*room, floor)));
    let floors: BTreeMap<&str, usize> = floors.collect();
    let import = Regex::new(r"crate::([a-z_0-9]+)::").unwrap();
    let comment = Regex::new(r"//.*").unwrap();
    let mut wrong = Vec::new();
    for file in files {
        let path = file.strip_prefix(&source).unwrap();
        let room = path.iter().next().unwrap().to_string_lossy();
        let room = room.trim_end_matches(".rs");
        if room == "lib" {
            continue;
        }
        let Some(own) = floors.get(room) else {
            panic!("which rooms may {room} import?");
        };
        let text = std::fs::read_to_string(&file).unwrap();
        // What follows belongs to tests.
        let text = text
            .split("#[cfg(test)]\nmod tests {")
            .next()
            .unwrap_or_default();
        let text = comment.replace_all(text, "");
        for found in import.captures_iter(&text) {
            let imported = &found[1];
            let is_below = floors.get(imported).is_some_and(|floor| floor < own);
            if imported != room && imported != "testing" && !is_below {
                wrong.push(format!("{} imports {imported}", path.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
