//! Small pictures of built-in scenes against stored ones: they detect change, not error. `GPUGI_UPDATE_GOLDEN=1` stores them anew.

mod common;

use std::path::PathBuf;

use common::gpu;
use gpugi::Renderer;
use gpugi_scene::builtin::builtin;
use gpugi_scene::image::{decode_color, save_png};
use gpugi_scene::{Limits, Pixels};

const SIDE: u32 = 64;

fn golden(name: &str) {
    let Some(gpu) = gpu() else { return };
    let scene = builtin(name, 1).expect("a built-in scene");
    let mut renderer = Renderer::new(&gpu, &scene, [SIDE, SIDE], &[]).expect("a renderer");
    for _ in 0..4 {
        renderer
            .render_sample(&scene.cameras[0], 4, None, false)
            .expect("a sample");
    }
    let radiance = renderer.radiance().expect("radiance");
    let encoded = |value: &f32| (value.powf(1.0 / 2.2).clamp(0.0, 1.0) * 255.0).round() as u8;
    let picture: Vec<u8> = radiance
        .chunks_exact(3)
        .flat_map(|color| {
            [
                encoded(&color[0]),
                encoded(&color[1]),
                encoded(&color[2]),
                255,
            ]
        })
        .collect();
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/{name}.png"));
    if std::env::var_os("GPUGI_UPDATE_GOLDEN").is_some_and(|value| value == "1") {
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        save_png(&path, SIDE, SIDE, &picture).expect("a stored picture");
        return;
    }
    let bytes = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let stored = decode_color(name, &bytes, &Limits::default()).expect("a PNG");
    let Pixels::Rgba8(stored) = &stored.pixels else {
        panic!("{} is no 8-bit picture", path.display())
    };
    let differences: Vec<u8> = picture
        .iter()
        .zip(stored)
        .map(|(a, b)| a.abs_diff(*b))
        .collect();
    let mean =
        differences.iter().map(|&one| f32::from(one)).sum::<f32>() / differences.len() as f32;
    let largest = differences.iter().copied().max().expect("pixels");
    println!("{name}: mean difference {mean} / 255, largest {largest} / 255");
    if mean >= 1.0 || largest >= 24 {
        let seen = std::env::temp_dir().join(format!("gpugi-golden-{name}.png"));
        save_png(&seen, SIDE, SIDE, &picture).expect("a picture to look at");
        panic!(
            "{name} changed: mean {mean} / 255, largest {largest} / 255. Compare {} with {}; GPUGI_UPDATE_GOLDEN=1 stores it.",
            seen.display(),
            path.display()
        );
    }
}

#[test]
fn cornell() {
    golden("cornell");
}

#[test]
fn room() {
    golden("room");
}

#[test]
fn shapes() {
    golden("shapes");
}
