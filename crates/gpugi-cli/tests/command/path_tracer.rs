//! The path tracer as a user runs it.

use std::path::Path;
use std::process::{Command, Stdio};

use crate::common::{channel, command, folder, gpugi, skip_gpu};

/// Linear radiance of a picture.
fn radiance(path: &Path) -> Vec<f32> {
    let image = gpugi_scene::image::load_radiance(path, &gpugi_scene::Limits::default());
    match image.expect("a picture").pixels {
        gpugi_scene::Pixels::Rgba32Float(values) => values,
        gpugi_scene::Pixels::Rgba8(_) => panic!("radiance has floats"),
    }
}

fn mean(values: &[f32]) -> f32 {
    values.iter().sum::<f32>() / values.len() as f32
}

#[test]
fn renders_with_settings_and_report() {
    if skip_gpu() {
        return;
    }
    let folder = folder("path-tracer");
    let path = |name: &str| folder.join(name).display().to_string();
    let render = |output: &str, more: &[&str]| {
        let mut arguments = vec![
            "render",
            "cornell",
            "--technique",
            "path-tracer",
            "--size",
            "32x32",
            "--samples",
            "8",
            "-o",
            output,
        ];
        arguments.extend(more);
        let output = gpugi(&arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{message}");
    };
    render(&path("all.exr"), &["--report", &path("report.json")]);
    render(&path("direct.exr"), &["--set", "path-tracer.max-bounces=1"]);
    render(
        &path("other-lights.exr"),
        &["--set", "path-tracer.lights=punctual,environment"],
    );
    render(&path("all.png"), &[]);
    let [all, direct, none] = ["all.exr", "direct.exr", "other-lights.exr"]
        .map(|name| mean(&radiance(&folder.join(name))));
    assert!(direct < 0.95 * all, "no indirect light: {direct} of {all}");
    // The only light is a lamp; alpha is 1.
    assert!(direct > 1.1 * none && (none - 0.25).abs() < 1e-6, "{none}");
    let picture = std::fs::read(folder.join("all.png")).expect("the picture");
    assert!(picture.starts_with(b"\x89PNG"));

    let report = std::fs::read_to_string(folder.join("report.json")).expect("the report");
    let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
    assert_eq!(report["samples"], 8);
    assert_eq!(report["techniques"]["path-tracer"]["max-bounces"], 64);
    assert!(report["estimated_rel_mse"].as_f64() > Some(0.0));
    assert!(report["path_segments"].as_u64() > Some(32 * 32 * 8));
}

#[test]
fn refuses_what_does_not_fit_together() {
    if skip_gpu() {
        return;
    }
    for (options, part) in [
        (["--technique", "path-tracer,shadow-map"], "alone"),
        (["--set", "path-tracer.paths=L(E"], "paths"),
        (["--set", "path-tracer.lights=moon"], "punctual"),
        (["--set", "path-tracer.max-bounces=-1"], "range"),
        (["--set", "shadow-map.taps=4"], "shadow-map"),
        (["--dump-maps", "maps"], "--dump-maps"),
    ] {
        let mut arguments = vec!["render", "cornell", "-o", "x.png", "--size", "8x8"];
        if options[0] != "--technique" {
            arguments.extend(["--technique", "path-tracer"]);
        }
        arguments.extend(options);
        let output = gpugi(&arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{options:?}: {message}");
        assert!(message.contains(part), "{options:?}: {message}");
    }
}

#[test]
fn a_picture_too_large_for_memory_is_refused_with_the_numbers() {
    if skip_gpu() {
        return;
    }
    let output = gpugi(&[
        "render",
        "cornell",
        "-o",
        "x.exr",
        "--technique",
        "path-tracer",
        "--size",
        "4000000x4000000",
    ]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("4000000 x 4000000"), "{message}");
}

#[cfg(unix)]
#[test]
fn interrupted_it_keeps_what_is_done() {
    if skip_gpu() {
        return;
    }
    let path = folder("interrupted").join("half.exr");
    std::fs::remove_file(&path).ok();
    let path_text = path.display().to_string();
    let child = command(&[
        "render",
        "cornell",
        "-o",
        &path_text,
        "--technique",
        "path-tracer",
        "--size",
        "32x32",
        "--samples",
        "1000000",
    ])
    .stdout(Stdio::piped())
    .stderr(Stdio::piped())
    .spawn()
    .expect("the binary runs");
    // Time to begin; a slow machine's picture may be without a sample, but must be there.
    std::thread::sleep(std::time::Duration::from_secs(6));
    let interrupted = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status()
        .expect("kill runs");
    assert!(interrupted.success());
    let output = child.wait_with_output().expect("it ends");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{message}");
    assert!(message.contains("of 1000000 samples"), "{message}");
    assert!(mean(&radiance(&path)) > 0.26, "black");
}

#[test]
fn layers_hold_what_samples_see() {
    if skip_gpu() {
        return;
    }
    let folder = folder("layers");
    let render = |name: &str, technique: &str, more: &[&str]| {
        let path = folder.join(name);
        let text = path.display().to_string();
        let fixed = [
            "render",
            "room",
            "-o",
            &text,
            "--size",
            "32x24",
            "--samples",
            "8",
        ];
        let output = gpugi(&[&fixed, &["--technique", technique][..], more].concat());
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{message}");
        path.with_extension("exr")
    };
    let all = "albedo,normal,depth,position,denoising-albedo,denoising-normal";
    let traced = render(
        "traced.exr",
        "path-tracer",
        &["--aov", &format!("{all},variance")],
    );
    // The file of layers lies beside a PNG.
    let rastered = render("rastered.png", "none", &["--aov", all]);
    for name in [
        "Albedo.G",
        "Normal.Y",
        "Depth.Z",
        "Position.X",
        "Combined.A",
    ] {
        let [traced, rastered] = [&traced, &rastered].map(|path| channel(path, name));
        let pairs = traced.iter().zip(&rastered);
        let is_alike = |(a, b): (&f32, &f32)| (a - b).abs() < 0.02 * b.abs().max(1.0);
        // At edges, 8 samples of one and of the other differ.
        let alike = pairs.filter(|pair| is_alike(*pair)).count();
        assert!(
            alike * 10 > traced.len() * 8,
            "{name}: {alike} of {}",
            traced.len()
        );
    }
    // The mirror ball is white and shows the walls, which are not.
    let at_ball = 15 * 32 + 10;
    let [ball, shown] =
        ["Albedo.B", "Denoising Albedo.B"].map(|name| channel(&traced, name)[at_ball]);
    assert!(ball > 0.9 && shown < 0.75, "{ball}, {shown}");
    assert_eq!(
        channel(&rastered, "Denoising Albedo.B")[at_ball],
        channel(&rastered, "Albedo.B")[at_ball]
    );
    assert!(channel(&traced, "Variance.R").iter().sum::<f32>() > 0.0);
}

#[test]
fn denoised_pictures_are_less_noisy() {
    if skip_gpu() {
        return;
    }
    let folder = folder("denoised");
    let render = |name: &str, more: &[&str]| {
        let path = folder.join(name);
        let text = path.display().to_string();
        let fixed = ["render", "cornell", "-o", &text, "--size", "48x40"];
        let output = gpugi(&[&fixed, more].concat());
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.code(), message, path)
    };
    let traced = ["--technique", "path-tracer"];
    let (_, _, noisy) = render("noisy.exr", &[&traced[..], &["--samples", "8"]].concat());
    let denoised = [&traced[..], &["--samples", "8", "--denoise"]].concat();
    let (_, _, denoised) = render("denoised.exr", &denoised);
    let (_, _, truth) = render(
        "truth.exr",
        &[&traced[..], &["--samples", "256", "--seed", "1"]].concat(),
    );
    let truth = radiance(&truth);
    let error = |path: &Path| {
        let pairs = radiance(path).into_iter().zip(&truth);
        pairs
            .map(|(a, b)| (a - b).powi(2) / (b * b + 0.01))
            .sum::<f32>()
            / truth.len() as f32
    };
    let [noisy, denoised] = [error(&noisy), error(&denoised)];
    assert!(denoised < 0.4 * noisy, "{denoised}, not far below {noisy}");
    // Techniques have no noise that a filter could tell from the picture, and do not know its variance.
    for (option, part) in [
        ("--denoise", "path-tracer"),
        ("--aov=variance", "path-tracer"),
    ] {
        let (code, message, _) = render("refused.png", &["--technique", "shadow-map", option]);
        assert!(
            code == Some(2) && message.contains(part),
            "{option}: {message}"
        );
    }
}
