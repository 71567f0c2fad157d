//! Compares small pictures of built-in scenes, and an environment's maps, with stored ones: they detect change, not
//! error. `GPUGI_UPDATE_GOLDEN=1` stores them again.

use std::ops::ControlFlow;
use std::path::PathBuf;

use crate::common::{direct, gpu};
use gpugi::techniques::Registry;
use gpugi::techniques::environment_map::{Settings, export};
use gpugi::{Purpose, Renderer, default_set};
use gpugi_scene::builtin::builtin;
use gpugi_scene::image::{HalfTexture, decode_color, save_png};
use gpugi_scene::{Image, Limits, Pixels, Scene};
use serde_json::{Value, json};

const SIDE: u32 = 64;

fn stored(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("tests/pictures/golden")
        .join(name)
}

fn is_update() -> bool {
    std::env::var_os("GPUGI_UPDATE_GOLDEN").is_some_and(|value| value == "1")
}

/// Direct light of a built-in scene.
fn golden(name: &str) {
    let Some(gpu) = gpu() else { return };
    let scene = builtin(name, 1).expect("a built-in scene");
    let names = direct(&gpu, &scene);
    let renderer = Renderer::new(&gpu, &scene, [SIDE, SIDE], &names).expect("a renderer");
    is_as_stored(name, &scene, renderer);
}

/// All light that live views have where no paths are traced.
fn golden_live(name: &str) {
    let Some(gpu) = gpu() else { return };
    let scene = builtin(name, 1).expect("a built-in scene");
    let mut adapter = gpu.adapter.clone();
    if !adapter.is_software() {
        adapter.device_type = wgpu::DeviceType::IntegratedGpu;
    }
    let set = default_set(&scene, &adapter, Purpose::LiveView, &Registry::default());
    let renderer = Renderer::new(&gpu, &scene, [SIDE, SIDE], &set);
    let mut renderer = renderer.expect("a renderer");
    let ready = renderer.converge(&scene.cameras[0], false, |_, _| ControlFlow::Continue(()));
    ready.expect("maps");
    is_as_stored(&format!("{name}-live"), &scene, renderer);
}

fn is_as_stored(name: &str, scene: &Scene, mut renderer: Renderer) {
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
    let path = stored(&format!("{name}.png"));
    if is_update() {
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
    let mean = differences
        .iter()
        .map(|&difference| f32::from(difference))
        .sum::<f32>()
        / differences.len() as f32;
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

/// With indirect light of probes.
#[test]
fn cornell_live() {
    golden_live("cornell");
}

#[test]
fn room() {
    golden("room");
}

#[test]
fn shapes() {
    golden("shapes");
}

/// A sky with one bright texel, uneven everywhere.
fn uneven_sky() -> Image {
    const WIDTH: usize = 32;
    let texel = |index: usize| {
        let (x, y) = ((index % WIDTH) as f32, (index / WIDTH) as f32);
        let sun = if index == 5 * WIDTH + 21 { 60.0 } else { 0.0 };
        [
            sun + 0.3 + 0.02 * x,
            sun + 1.2 - 0.06 * y,
            0.2 + 0.01 * x * (1.0 + y % 3.0),
            1.0,
        ]
    };
    Image {
        name: "uneven sky".into(),
        width: WIDTH as u32,
        height: 16,
        pixels: Pixels::Rgba32Float((0..WIDTH * 16).flat_map(texel).collect()),
    }
}

/// Mean and a dozen texels of each level.
fn samples(texture: &HalfTexture) -> Value {
    let levels = texture.levels.iter().map(|level| {
        let rgb = |i: usize| [0, 1, 2].map(|c| level[i][c].to_f32());
        let mean = [0, 1, 2]
            .map(|c| level.iter().map(|texel| texel[c].to_f32()).sum::<f32>() / level.len() as f32);
        let texels: Vec<_> = (0..12)
            .map(|i| rgb((2 * i + 1) * level.len() / 24))
            .collect();
        json!({ "mean": mean, "texels": texels })
    });
    levels.collect()
}

/// Pairs every number of one value with that of the other: its place, and both numbers.
fn pairs(place: String, found: &Value, kept: &Value, all: &mut Vec<(String, [f64; 2])>) {
    match (found, kept) {
        (Value::Object(a), Value::Object(b)) => {
            assert!(
                a.len() == b.len() && a.keys().all(|key| b.contains_key(key)),
                "{place} has other parts than before"
            );
            for (key, value) in a {
                pairs(format!("{place} {key}"), value, &b[key], all);
            }
        }
        (Value::Array(a), Value::Array(b)) => {
            assert_eq!(
                a.len(),
                b.len(),
                "{place} has more or fewer parts than before"
            );
            for (i, (a, b)) in a.iter().zip(b).enumerate() {
                pairs(format!("{place} {i}"), a, b, all);
            }
        }
        _ => {
            let [a, b] = [found, kept].map(|value| value.as_f64().expect("a number"));
            all.push((place, [a, b]));
        }
    }
}

#[test]
fn environment_maps() {
    let Some(gpu) = gpu() else { return };
    let settings = Settings {
        resolution: 32,
        samples: 32,
        ..Settings::default()
    };
    let baked = export::bake(&gpu, &uneven_sky().into(), &settings).expect("maps");
    let found = json!({
        "radiance": samples(&baked.radiance),
        "irradiance": samples(&baked.irradiance),
        "ggx": samples(&baked.ggx),
        "phong": samples(&baked.phong),
        "albedo": samples(&baked.albedo),
        "harmonics": baked.description.radiance_coefficients,
    });
    let path = stored("environment-maps.json");
    if is_update() {
        let text = serde_json::to_string(&found).expect("JSON");
        std::fs::write(&path, text).expect("a stored file");
        return;
    }
    let text = std::fs::read_to_string(&path);
    let text = text.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let kept = serde_json::from_str(&text).expect("JSON");
    let mut all = Vec::new();
    pairs(String::new(), &found, &kept, &mut all);
    assert!(all.len() > 500, "{}", all.len());
    // Drivers filter and round slightly differently.
    for (place, [found, kept]) in all {
        assert!(
            (found - kept).abs() < 0.01 * kept.abs() + 0.005,
            "{place} changed: {found}, not {kept}. GPUGI_UPDATE_GOLDEN=1 stores it."
        );
    }
}
