//! `gpugi compare`: metrics, bounds, and what cannot be compared.

use crate::common::{folder, gpugi};

/// Two 16x12 pictures as PNG: grey, and with one bright pixel at (3, 2).
fn grey_and_spotted(folder: &std::path::Path) -> [String; 2] {
    let grey = [100, 100, 100, 255].repeat(16 * 12);
    let mut spotted = grey.clone();
    spotted[4 * (2 * 16 + 3)..][..3].fill(255);
    [("grey.png", grey), ("spotted.png", spotted)].map(|(name, texels)| {
        let path = folder.join(name);
        gpugi_scene::image::save_png(&path, 16, 12, &texels).expect("a picture");
        path.display().to_string()
    })
}

#[test]
fn compares_pictures() {
    let folder = folder("compare");
    let path = |name: &str| folder.join(name).display().to_string();
    let [grey, spotted] = grey_and_spotted(&folder);
    let (diff, json) = (path("diff.png"), path("result.json"));
    let output = gpugi(&["compare", &spotted, &grey, "--diff", &diff, "--json", &json]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{output:?}");
    let result = std::fs::read_to_string(json).expect("the result");
    let result: serde_json::Value = serde_json::from_str(&result).expect("JSON");
    for metric in ["rel-mse", "rel-mse-4", "rmse", "psnr", "ssim", "flip"] {
        assert!(text.contains(metric), "{text}");
        let value = result["metrics"][metric]["value"].as_f64();
        assert!(value.is_some_and(|value| value > 0.0), "{metric}: {result}");
    }
    assert_eq!(result["metrics"]["rel-mse"]["epsilon"], 0.01);
    assert_eq!(result["metrics"]["psnr"]["peak"], 1.0);
    assert_eq!(result["compared_as"], "display");
    // One pixel of 192 differs by 155/255.
    let rmse = result["metrics"]["rmse"]["value"]
        .as_f64()
        .expect("a number");
    assert!(
        (rmse - 155.0 / 255.0 / 192.0_f64.sqrt()).abs() < 1e-6,
        "{rmse}"
    );
    let diff = std::fs::read(diff).expect("the heat map");
    let diff = gpugi_scene::image::decode_color("diff", &diff, &Default::default()).expect("a PNG");
    assert_eq!((diff.width, diff.height), (16, 12));
    let gpugi_scene::Pixels::Rgba8(texels) = &diff.pixels else {
        panic!("8 bits")
    };
    for (at, texel) in texels.chunks_exact(4).enumerate() {
        assert_eq!(texel[0] > 200, at == 2 * 16 + 3, "texel {at}: {texel:?}");
    }
    let quiet = gpugi(&["compare", &spotted, &grey, "--quiet"]);
    assert!(quiet.status.success() && quiet.stdout.is_empty() && quiet.stderr.is_empty());
}

#[test]
fn bounds_decide_the_exit_code() {
    let folder = folder("compare-bounds");
    let [grey, spotted] = grey_and_spotted(&folder);
    for (a, metric, bound, code) in [
        (&spotted, "rel-mse", "0.5", 0),
        (&spotted, "rel-mse", "1e-4", 1),
        (&spotted, "flip", "1e-4", 1),
        (&grey, "rel-mse", "0", 0),
        (&grey, "flip", "0", 0),
        // Larger is better.
        (&spotted, "psnr", "50", 1),
        (&spotted, "psnr", "20", 0),
        (&grey, "psnr", "1000", 0),
        (&spotted, "ssim", "0.999", 1),
        (&spotted, "ssim", "-1", 0),
    ] {
        let output = gpugi(&["compare", a, &grey, "--metric", metric, "--max", bound]);
        let case = format!("{metric} {bound}: {output:?}");
        assert_eq!(output.status.code(), Some(code), "{case}");
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(code == 0 || message.contains("the bound"), "{case}");
    }
    // What was asked for is written even so.
    let json = folder.join("result.json");
    let json_text = json.display().to_string();
    let arguments = ["--metric", "rmse", "--max", "0", "--json", &json_text];
    let output = gpugi(&[&["compare", &spotted, &grey][..], &arguments].concat());
    assert_eq!(output.status.code(), Some(1));
    assert!(std::fs::read_to_string(json).is_ok_and(|text| text.contains("rmse")));
}

#[test]
fn pictures_that_cannot_be_compared_exit_with_1_and_are_named() {
    let folder = folder("compare-bad");
    let [grey, _] = grey_and_spotted(&folder);
    let exr = |name: &str, width: u32, rgb: &[f32]| {
        let path = folder.join(name);
        gpugi_scene::image::save_exr(&path, width, 1, rgb).expect("a picture");
        path.display().to_string()
    };
    let fine = exr("fine.exr", 2, &[1.0; 6]);
    let mut broken = [1.0; 6];
    broken[4] = f32::NAN;
    let with_nan = exr("nan.exr", 2, &broken);
    broken[4] = f32::INFINITY;
    let infinite = exr("infinite.exr", 2, &broken);
    let damaged = folder.join("damaged.exr");
    std::fs::write(&damaged, b"\x76\x2f\x31\x01nothing").expect("a file");
    let damaged = damaged.display().to_string();
    for (a, b, parts) in [
        (&grey, &fine, ["grey.png", "16x12"]),
        (&fine, &grey, ["fine.exr", "2x1"]),
        (&with_nan, &fine, ["nan.exr", "(1, 0)"]),
        (&fine, &infinite, ["infinite.exr", "(1, 0)"]),
        (&fine, &damaged, ["damaged.exr", "header"]),
        (&"nowhere.hdr".to_owned(), &fine, ["nowhere.hdr", "open"]),
    ] {
        let output = gpugi(&["compare", a, b]);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{message}");
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    }
    // Too small for the window of SSIM only.
    let output = gpugi(&["compare", &fine, &fine]);
    assert!(output.status.success());
    assert!(String::from_utf8_lossy(&output.stderr).contains("11x11"));
    let output = gpugi(&["compare", &fine, &fine, "--metric", "ssim"]);
    assert_eq!(output.status.code(), Some(1));
}

#[test]
fn wrong_comparisons_exit_with_2() {
    for (arguments, part) in [
        (&["--metric", "magic"][..], "rel-mse-4"),
        (&["--max", "1"], "--metric"),
        (&["--metric", "rmse", "--max", "NaN"], "--max"),
        (&["--diff", "diff.jpg"], ".png"),
    ] {
        let output = gpugi(&[&["compare", "a.png", "b.png"][..], arguments].concat());
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(message.contains(part), "{arguments:?}: {message}");
    }
}

#[test]
fn a_picture_beside_radiance_is_linearised_with_a_note() {
    let folder = folder("compare-mixed");
    let [grey, _] = grey_and_spotted(&folder);
    let linear = ((100.0_f32 / 255.0 + 0.055) / 1.055).powf(2.4);
    let exr = folder.join("grey.exr");
    gpugi_scene::image::save_exr(&exr, 16, 12, &[linear; 16 * 12 * 3]).expect("a picture");
    let exr = exr.display().to_string();
    let output = gpugi(&[
        "compare", &grey, &exr, "--metric", "rel-mse", "--max", "1e-9",
    ]);
    assert!(output.status.success(), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("sRGB"));
    assert!(String::from_utf8_lossy(&output.stdout).contains("as radiance"));
}
