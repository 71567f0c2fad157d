//! The command as a user runs it: what it writes, and how it refuses.

use std::path::PathBuf;
use std::process::{Command, Output};

fn gpugi(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gpugi"))
        .args(arguments)
        .output()
        .expect("the binary runs")
}

/// A folder of this test's own.
fn folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    folder
}

fn skip_gpu() -> bool {
    std::env::var("GPUGI_SKIP_GPU").is_ok_and(|value| value == "1")
}

#[test]
fn renders_a_picture_with_report_and_quantities() {
    if skip_gpu() {
        return;
    }
    let folder = folder("render");
    let path = |name: &str| folder.join(name).display().to_string();
    let output = gpugi(&[
        "render",
        "cornell",
        "-o",
        &path("cornell.png"),
        "--size",
        "48x40",
        "--samples",
        "2",
        "--aov",
        "normal,depth",
        "--report",
        &path("report.json"),
        "--dump-maps",
        &path("maps"),
        "--set",
        "shadow-map.area_samples=4",
    ]);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let limits = gpugi_scene::Limits::default();
    let picture = std::fs::read(path("cornell.png")).expect("the picture");
    let picture =
        gpugi_scene::image::decode_color("cornell.png", &picture, &limits).expect("a PNG");
    assert_eq!((picture.width, picture.height), (48, 40));
    let gpugi_scene::Pixels::Rgba8(texels) = &picture.pixels else {
        panic!("8 bits")
    };
    // Red wall on the left, green wall on the right.
    let texel = |x: usize, y: usize| &texels[(y * 48 + x) * 4..][..3];
    assert!(
        texel(8, 20)[0] > 2 * texel(8, 20)[1],
        "left {:?}",
        texel(8, 20)
    );
    assert!(
        texel(39, 20)[1] > texel(39, 20)[0] + 30,
        "right {:?}",
        texel(39, 20)
    );
    for name in [
        "cornell-normal.exr",
        "cornell-depth.exr",
        "maps/shadow-map.atlas.exr",
    ] {
        let image = gpugi_scene::image::load_radiance(folder.join(name).as_path(), &limits)
            .map(|image| image.width);
        assert!(image.is_ok(), "{name}: {image:?}");
    }
    let report = std::fs::read_to_string(path("report.json")).expect("the report");
    let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
    assert_eq!(report["samples"], 2);
    assert_eq!(report["techniques"]["shadow-map"]["area_samples"], 4);
}

#[test]
fn radiance_files_hold_what_the_exposure_does_not_touch() {
    if skip_gpu() {
        return;
    }
    let folder = folder("radiance");
    let render = |name: &str, exposure: &str| {
        let path = folder.join(name);
        let path_text = path.display().to_string();
        let arguments = [
            "render",
            "room",
            "-o",
            &path_text,
            "--size",
            "16x16",
            "--samples",
            "1",
            "--exposure",
            exposure,
        ];
        assert!(gpugi(&arguments).status.success());
        gpugi_scene::image::load_radiance(&path, &gpugi_scene::Limits::default())
            .expect("an EXR")
            .pixels
    };
    assert_eq!(render("a.exr", "0"), render("b.exr", "-3"));
}

#[test]
fn wrong_arguments_exit_with_2_and_say_what_there_is() {
    for (arguments, part) in [
        (vec!["render", "nowhere", "-o", "x.png"], "cornell"),
        (vec!["render", "cornell", "-o", "x.tiff"], ".png"),
        (
            vec!["render", "cornell", "-o", "x.png", "--size", "0x5"],
            "WIDTHxHEIGHT",
        ),
        (
            vec!["render", "cornell", "-o", "x.png", "--camera", "nobody"],
            "camera",
        ),
        (
            vec!["render", "cornell", "-o", "x.png", "--tone-map", "sepia"],
            "tone-map",
        ),
    ] {
        let output = gpugi(&arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(message.contains(part), "{arguments:?}: {message}");
    }
}

#[test]
fn wrong_settings_and_techniques_exit_with_2() {
    if skip_gpu() {
        return;
    }
    for (option, value, part) in [
        ("--technique", "magic", "shadow-map"),
        ("--set", "shadow-map.taps=9999", "range"),
        ("--set", "shadow-map.nothing=1", "resolution"),
        ("--set", "taps=1", "technique.key=value"),
    ] {
        let output = gpugi(&[
            "render", "cornell", "-o", "x.png", "--size", "8x8", option, value,
        ]);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{value}: {message}");
        assert!(message.contains(part), "{value}: {message}");
    }
}

#[test]
fn damaged_files_exit_with_1_and_leave_the_picture_alone() {
    let folder = folder("damaged");
    let file = folder.join("damaged.glb");
    std::fs::write(&file, b"glTF\x02\0\0\0\xff\xff\xff\xff").expect("a file");
    let picture = folder.join("picture.png");
    std::fs::write(&picture, b"precious").expect("a file");
    let output = gpugi(&[
        "render",
        &file.display().to_string(),
        "-o",
        &picture.display().to_string(),
        "--size",
        "8x8",
    ]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("damaged.glb"), "{message}");
    assert_eq!(std::fs::read(&picture).expect("still there"), b"precious");
}

#[test]
fn lists_and_describes() {
    for (arguments, part) in [
        (vec!["list", "techniques"], "shadow-map"),
        (vec!["list", "scenes"], "cornell"),
        (vec!["info", "cornell"], "\"emissive_triangles\""),
    ] {
        let output = gpugi(&arguments);
        assert!(output.status.success());
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(text.contains(part), "{arguments:?}: {text}");
    }
}
