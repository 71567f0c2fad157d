//! `gpugi measure` as a user runs it.

use crate::common::{folder, gpugi, skip_gpu};

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

const SMALL: [&str; 8] = [
    "measure",
    "cornell",
    "--size",
    "32x24",
    "--samples",
    "8",
    "--reference-samples",
    "32",
];

#[test]
fn prints_and_writes_error_time_and_memory() {
    if skip_gpu() {
        return;
    }
    let folder = folder("measure-report");
    let path = |name: &str| folder.join(name).display().to_string();
    let [cache, json, diff, beside] = ["cache", "report.json", "diff.png", "beside.png"].map(path);
    let mut arguments = SMALL.to_vec();
    arguments.extend([
        "--technique",
        "shadow-map",
        "--cache",
        &cache,
        "--json",
        &json,
    ]);
    arguments.extend(["--diff", &diff, "--side-by-side", &beside]);
    let first = gpugi(&arguments);
    assert!(first.status.success(), "{}", text(&first.stderr));
    let printed = text(&first.stdout);
    for part in [
        "cornell: shadow-map against the path tracer, 32x24, 8 samples, on ",
        "rel-mse ",
        "flip ",
        "reference: estimated rel-mse ",
        "LE|L[DG]E (area): 32 samples on ",
        "memory: scene ",
    ] {
        assert!(printed.contains(part), "{part:?} is not in {printed}");
    }
    let read = || -> serde_json::Value {
        let text = std::fs::read_to_string(&json).expect("the report");
        serde_json::from_str(&text).expect("JSON")
    };
    let report = read();
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    assert!(number(&report["metrics"]["rel-mse"]["value"]) > 0.0);
    assert!(number(&report["metrics"]["psnr"]["peak"]) > 1.0);
    assert_eq!(report["size"], serde_json::json!([32, 24]));
    assert_eq!(report["samples"], 8);
    assert_eq!(report["techniques"]["shadow-map"]["taps"], 16);
    let reference = &report["reference"];
    assert_eq!(reference["cached"], false);
    assert_eq!(reference["parts"][0]["pattern"], "LE|L[DG]E");
    assert_eq!(
        reference["parts"][0]["classes"],
        serde_json::json!(["area"])
    );
    assert_eq!(reference["parts"][0]["max_bounces"], 1);
    assert!(number(&reference["estimated_rel_mse"]) > 0.0);
    for kind in ["scene", "maps", "picture"] {
        assert!(number(&report["memory_bytes"][kind]) > 0.0, "{kind}");
    }
    let limits = gpugi_scene::Limits::default();
    for (path, width) in [(&diff, 32), (&beside, 3 * 32 + 8)] {
        let picture = gpugi_scene::image::load_radiance(path.as_ref(), &limits);
        let picture = picture.expect("a picture");
        assert_eq!([picture.width, picture.height], [width, 24], "{path}");
    }

    // Again, from the cache, without a word.
    arguments.push("--quiet");
    let again = gpugi(&arguments);
    assert!(again.status.success(), "{}", text(&again.stderr));
    assert_eq!(text(&again.stdout) + &text(&again.stderr), "");
    let second = read();
    assert_eq!(second["reference"]["cached"], true);
    assert_eq!(second["metrics"], report["metrics"]);

    // A damaged reference is said, and not believed.
    let kept = std::fs::read_dir(&cache).expect("the cache").next();
    let kept = kept.expect("a file").expect("an entry").path();
    let mut bytes = std::fs::read(&kept).expect("the file");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&kept, bytes).expect("the damage");
    arguments.pop();
    let third = gpugi(&arguments);
    assert!(third.status.success(), "{}", text(&third.stderr));
    let notes = text(&third.stderr);
    assert!(
        notes.contains("checksum") && notes.contains(&kept.display().to_string()),
        "{notes}"
    );
    assert_eq!(read()["reference"]["cached"], false);
    assert_eq!(read()["metrics"], report["metrics"]);
}

#[test]
fn settings_change_the_error_and_the_cache_can_be_left_alone() {
    if skip_gpu() {
        return;
    }
    let folder = folder("measure-settings");
    let json = folder.join("report.json").display().to_string();
    let error = |more: &[&str]| {
        let mut arguments = SMALL.to_vec();
        arguments.extend(["--technique", "shadow-map", "--no-cache", "--json", &json]);
        arguments.extend(more);
        let output = gpugi(&arguments);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let report = std::fs::read_to_string(&json).expect("the report");
        let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
        report["metrics"]["rel-mse"]["value"]
            .as_f64()
            .expect("a number")
    };
    let many = error(&[]);
    let few = error(&["--set", "shadow-map.area-samples=1"]);
    assert!(few > 2.0 * many, "{few} with one sample, {many} with 64");
    let files = std::fs::read_dir(&folder).expect("the folder").count();
    assert_eq!(files, 1, "more than the report");
}

#[test]
fn light_that_is_missing_counts_as_error_with_all_light() {
    if skip_gpu() {
        return;
    }
    let folder = folder("measure-all-light");
    let json = folder.join("report.json").display().to_string();
    let flip = |more: &[&str]| {
        let mut arguments = SMALL.to_vec();
        arguments.extend(["--technique", "shadow-map", "--no-cache", "--json", &json]);
        arguments.extend(more);
        let output = gpugi(&arguments);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let report = std::fs::read_to_string(&json).expect("the report");
        let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
        let pattern = report["reference"]["parts"][0]["pattern"].as_str();
        let flip = report["metrics"]["flip"]["value"].as_f64();
        (
            pattern.expect("a pattern").to_owned(),
            flip.expect("a number"),
        )
    };
    let (own_pattern, own) = flip(&[]);
    let (all_pattern, all) = flip(&["--all-light"]);
    assert_eq!([&*own_pattern, &*all_pattern], ["LE|L[DG]E", "L.*E"]);
    assert!(all > 2.0 * own, "{all} with all light, {own} with its own");
}

#[test]
fn what_does_not_fit_together_is_refused() {
    if skip_gpu() {
        return;
    }
    for (options, part) in [
        (["--technique", "path-tracer"], "reference"),
        (["--technique", "moon-light"], "shadow-map"),
        (["--set", "shadow-map.moons=4"], "taps"),
        (["--set", "path-tracer.paths=LDE"], "takes its settings"),
        (["--noise", "0"], "above 0"),
        (["--noise", "NaN"], "above 0"),
        (["--reference-samples", "2"], "16"),
        (["--diff", "x.exr"], ".png"),
        (["--side-by-side", "x"], ".png"),
        (["--size", "0x4"], "WIDTHxHEIGHT"),
    ] {
        let mut arguments = vec!["measure", "cornell", "--no-cache"];
        arguments.extend(options);
        let output = gpugi(&arguments);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{options:?}: {message}");
        assert!(message.contains(part), "{options:?}: {message}");
    }
}

#[test]
fn live_frames_are_measured_in_motion() {
    if skip_gpu() {
        return;
    }
    let folder = folder("measure-live");
    let path = |name: &str| folder.join(name).display().to_string();
    let [json, beside] = ["live.json", "beside.png"].map(path);
    let mut arguments = SMALL.to_vec();
    arguments.extend(["--live", "--technique", "path-tracing", "--no-cache"]);
    arguments.extend(["--set", "denoise.filter=spatial", "--json", &json]);
    arguments.extend(["--side-by-side", &beside]);
    let measured = gpugi(&arguments);
    assert!(measured.status.success(), "{}", text(&measured.stderr));
    let printed = text(&measured.stdout);
    for part in [
        "cornell: path-tracing live against all light, 32x24, on ",
        "moving ",
        "still ",
        "flicker ",
        "picture.denoise.smooth",
    ] {
        assert!(printed.contains(part), "{part:?} is not in {printed}");
    }
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
    let value = |name: &str| report[name].as_f64().unwrap();
    assert!(value("moving") > 0.0 && value("moving") < 0.9);
    assert!((value("brightness") - 1.0).abs() < 0.3, "{report}");
    assert!(std::fs::metadata(&beside).is_ok());
    for (words, reason) in [
        (&["--live", "--all-light"][..], "--all-light"),
        (&["--moves", "swing=light"], "--live"),
        (&["--live", "--moves", "light"], "swing=NAMES"),
        (&["--live", "--moves", "swing=lights"], "\"lights\""),
        (&["--live", "--moves", "animation"], "nothing moves"),
    ] {
        let refused = gpugi(&[&["measure", "cornell"], words].concat());
        assert_eq!(refused.status.code(), Some(2), "{words:?}");
        assert!(text(&refused.stderr).contains(reason), "{words:?}");
    }
    // Other frames, and so another error.
    arguments.extend(["--moves", "swing=light"]);
    assert!(gpugi(&arguments).status.success());
    let swinging: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
    assert_ne!(swinging["moving"], report["moving"]);
}

/// Tables, JSON and chart hold the same; what is not in time is left out. How much is in time depends on the machine.
/// It takes three seconds for the orbit's frames and four references.
#[test]
fn sets_are_compared_at_equal_time() {
    if skip_gpu() {
        return;
    }
    let folder = folder("measure-equal-time");
    let path = |name: &str| folder.join(name).display().to_string();
    let [json, svg] = ["times.json", "times.svg"].map(path);
    let mut arguments = vec!["measure", "cornell", "--size", "24x20", "--no-cache"];
    arguments.extend(["--reference-samples", "16", "--equal-time", "100,0.001,50"]);
    arguments.extend([
        "--techniques",
        "shadow-map,shadow-map.area-samples=4;path-tracer",
    ]);
    arguments.extend(["--json", &json, "--svg", &svg]);
    let measured = gpugi(&arguments);
    assert!(measured.status.success(), "{}", text(&measured.stderr));
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
    assert_eq!(
        report["budgets_ms"],
        serde_json::json!([0.001, 50.0, 100.0])
    );
    let sets = |kind: &str| -> Vec<String> {
        let rows = report[kind].as_array().unwrap().iter();
        rows.map(|row| row["set"].as_str().unwrap().to_owned())
            .collect()
    };
    let set = "shadow-map,shadow-map.area-samples=4";
    assert_eq!(sets("still"), [set, "path-tracer", "path-tracer, denoised"]);
    assert_eq!(sets("live"), [set]);
    let printed = text(&measured.stdout);
    for kind in ["still", "live"] {
        for row in report[kind].as_array().unwrap() {
            let points = row["points"].as_array().unwrap();
            for point in points {
                let [budget, took] =
                    ["budget", "milliseconds"].map(|name| point[name].as_f64().unwrap());
                // Live frames may take a tenth longer.
                assert!(budget > 0.1 && took <= 1.1 * budget, "{point}");
            }
            let set = row["set"].as_str().unwrap();
            let cells = |line: &&str| {
                line.split(" | ")
                    .skip(1)
                    .filter(|cell| *cell != "-")
                    .count()
            };
            let mut lines = printed.lines().filter(|line| {
                line.strip_prefix("| ")
                    .is_some_and(|line| line.starts_with(&format!("{set} |")))
            });
            let line = if kind == "live" {
                lines.next_back()
            } else {
                lines.next()
            };
            let line = line.unwrap().trim_end_matches(" |");
            assert_eq!(cells(&line), points.len(), "{printed}");
        }
    }
    let chart = std::fs::read_to_string(&svg).unwrap();
    for part in [
        "<svg",
        "path-tracer, denoised",
        "frame in motion",
        "HDR-FLIP",
        "</svg>",
    ] {
        assert!(chart.contains(part), "{part:?}");
    }
    for (options, reason) in [
        (&["--equal-time", "0"][..], "above 0"),
        (
            &["--equal-time", "5", "--techniques", ","],
            "sets are separated by semicolons",
        ),
        (
            &["--equal-time", "5", "--set", "shadow-map.taps=4"],
            "belong in --techniques",
        ),
        (&["--techniques", "default"], "--equal-time"),
        (
            &["--equal-time", "5", "--samples", "4"],
            "cannot be used with",
        ),
    ] {
        let refused = gpugi(&[&["measure", "cornell"], options].concat());
        let message = text(&refused.stderr);
        assert_eq!(refused.status.code(), Some(2), "{message}");
        assert!(message.contains(reason), "{message}");
    }
}
