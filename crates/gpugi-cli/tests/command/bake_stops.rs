//! Bakes that Ctrl-C, a kill or a full disk stops.

use std::process::{Command, Stdio};
use std::time::Instant;

use crate::common::{command, folder, gpugi, skip_gpu};

/// What Ctrl-C stops goes on where it was, or says why it cannot.
#[test]
fn a_bake_that_was_stopped_goes_on() {
    if skip_gpu() {
        return;
    }
    let folder = folder("bake-stopped");
    let output = folder.join("x.glb");
    let name = output.display().to_string();
    let checkpoint = folder.join("x.glb.checkpoint");
    let arguments = |samples: &str, more: &[&str]| {
        let bake = ["bake", "cornell", "-o", &name, "--atlas-size", "64"];
        let light = ["--include", "direct", "--set", "shadow-map.area-samples=4"];
        let samples = ["--samples", samples];
        [&bake[..], &light, &samples, more]
            .concat()
            .into_iter()
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    let run = |samples: &str, more: &[&str]| {
        let arguments = arguments(samples, more);
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let done = gpugi(&arguments);
        let errors = String::from_utf8_lossy(&done.stderr).into_owned();
        (done.status.code(), errors)
    };
    // As many samples as take a while on whatever this runs on, and as long as it takes to begin.
    let tries = [1, 3, 9, 27]
        .into_iter()
        .flat_map(|seconds| ["256", "4096", "65536"].map(|samples| (samples, seconds)));
    let mut tries = tries.skip_while(|&(samples, seconds)| {
        let arguments = arguments(samples, &[]);
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        // What was too fast is there.
        std::fs::remove_file(&output).ok();
        let mut child = command(&arguments).spawn().expect("a process");
        std::thread::sleep(std::time::Duration::from_secs(seconds));
        let mut kill = Command::new("kill");
        let number = child.id().to_string();
        kill.args(["-INT", &number]).status().expect("a signal");
        let status = child.wait().expect("an end");
        !(checkpoint.exists() && status.code() == Some(1))
    });
    let (samples, _) = tries.next().expect("a bake that can be stopped");
    assert!(!output.exists());
    let whole = std::fs::read(&checkpoint).expect("a checkpoint");

    let (code, errors) = run("7", &["--resume"]);
    assert_eq!(code, Some(1), "{errors}");
    assert!(errors.contains("of another bake"), "{errors}");
    let mut damaged = whole.clone();
    damaged[whole.len() / 2] ^= 1;
    std::fs::write(&checkpoint, damaged).expect("the damage");
    let (code, errors) = run(samples, &["--resume"]);
    assert_eq!(code, Some(1), "{errors}");
    assert!(errors.contains("checksum"), "{errors}");
    assert!(!output.exists());

    std::fs::write(&checkpoint, whole).expect("mended");
    let (code, errors) = run(samples, &["--resume"]);
    assert_eq!(code, Some(0), "{errors}");
    assert!(!checkpoint.exists());
    let resumed = std::fs::read(&output).expect("a bake");
    let (code, errors) = run(samples, &[]);
    assert_eq!(code, Some(0), "{errors}");
    assert!(resumed == std::fs::read(&output).expect("a bake"));
    // Without a checkpoint it starts, and says so.
    std::fs::remove_file(&output).expect("a bake");
    let (code, errors) = run(samples, &["--resume"]);
    assert_eq!(code, Some(0), "{errors}");
    assert!(errors.contains("x.glb.checkpoint"), "{errors}");
    assert!(resumed == std::fs::read(&output).expect("a bake"));
}

/// Interrupted and killed at random times, and called with the same line until it succeeds, a bake gives the bits of a
/// bake that ran through; nothing else ever has its name. `what`: what is baked, `times`: how often it is stopped.
fn stop_at_random_times(name: &str, what: &[&str], times: u32) {
    if skip_gpu() {
        return;
    }
    let folder = folder(name);
    let output = folder.join("x.glb");
    let path = output.display().to_string();
    let bake = ["bake", "cornell", "-o", &path, "--atlas-size", "64"];
    let arguments = [&bake[..], what, &["--resume"]].concat();
    let began = Instant::now();
    assert!(gpugi(&arguments).status.success());
    let took = began.elapsed();
    let expected = std::fs::read(&output).expect("a bake");
    std::fs::remove_file(&output).expect("a bake");
    let assert_whole = |attempt: u32| {
        let found = std::fs::read(&output).expect("a bake");
        assert!(found == expected, "attempt {attempt} gave other bits");
        std::fs::remove_file(&output).expect("a bake");
    };
    let mut state = 7_u64;
    let (mut stopped, mut attempt) = (0, 0);
    while stopped < times {
        attempt += 1;
        let mut child = command(&arguments).spawn().expect("a process");
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        // Mostly before its end, which comes sooner the more is done.
        std::thread::sleep(took.mul_f64((state >> 33) as f64 / f64::from(1_u32 << 31)));
        let signal = if attempt % 2 == 0 { "-KILL" } else { "-INT" };
        let mut kill = Command::new("kill");
        kill.args([signal, &child.id().to_string()]);
        kill.stderr(Stdio::null()).status().expect("a signal");
        let is_done = child.wait().expect("an end").success();
        stopped += u32::from(!is_done);
        // It may also be stopped after it has written its file.
        if is_done || output.exists() {
            assert_whole(attempt);
        }
    }
    assert!(gpugi(&arguments).status.success());
    assert_whole(attempt + 1);
}

const LIGHT: [&str; 6] = [
    "--include",
    "direct",
    "--set",
    "shadow-map.area-samples=4",
    "--samples",
    "256",
];

#[test]
fn a_bake_that_is_interrupted_and_killed_gives_the_same_bits() {
    stop_at_random_times("bake-killed", &LIGHT, 6);
}

#[test]
fn transfer_vectors_that_are_interrupted_and_killed_are_the_same_bits() {
    let vectors = [
        "--technique",
        "radiance-transfer",
        "--set",
        "radiance-transfer.rays=256",
        "--set",
        "radiance-transfer.bounces=3",
    ];
    stop_at_random_times("transfer-killed", &vectors, 2);
}

#[test]
fn panes_that_are_interrupted_and_killed_are_the_same_bits() {
    let panes = [
        "--technique",
        "light-path-map",
        "--set",
        "light-path-map.entries=1024",
        "--set",
        "light-path-map.clusters=32",
    ];
    stop_at_random_times("panes-killed", &panes, 2);
}

#[test]
#[ignore = "minutes: cargo test --test command -- --ignored bake_stops"]
fn a_bake_that_is_stopped_a_hundred_times_gives_the_same_bits() {
    stop_at_random_times("bake-killed-often", &LIGHT, 100);
}

/// The folder of the result is removed while the bake runs: an error that names the file.
#[test]
fn a_folder_that_vanishes_is_an_error() {
    if skip_gpu() {
        return;
    }
    let folder = folder("bake-vanished");
    let below = folder.join("below");
    std::fs::create_dir(&below).expect("a folder");
    let path = below.join("x.glb").display().to_string();
    let arguments = ["bake", "cornell", "-o", &path, "--atlas-size", "64"];
    let more = ["--include", "direct", "--samples", "1"];
    let mut command = command(&[&arguments[..], &more].concat());
    let child = command.stderr(Stdio::piped()).spawn().expect("a process");
    std::fs::remove_dir(&below).expect("an empty folder");
    let done = child.wait_with_output().expect("an end");
    let errors = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(1), "{errors}");
    // The folder may be gone before the command looks for it the first time.
    let is_told = ["cannot be written", "there is no folder"].map(|words| errors.contains(words));
    assert!(
        errors.contains("x.glb") && is_told.contains(&true),
        "{errors}"
    );
    assert_eq!(std::fs::read_dir(&folder).expect("a folder").count(), 0);
}

/// A limit on the size of files stands for a full disk: an error that names the file, and none broken.
#[test]
fn a_full_disk_is_an_error_and_leaves_no_file() {
    if skip_gpu() {
        return;
    }
    let folder = folder("full-disk");
    for (name, arguments) in [
        (
            "x.glb",
            "bake cornell --atlas-size 64 --include direct --samples 1",
        ),
        (
            "x.exr",
            "render cornell --size 64x64 --technique shadow-map --samples 1",
        ),
    ] {
        let output = folder.join(name);
        let program = env!("CARGO_BIN_EXE_gpugi");
        let script = format!(
            "trap '' XFSZ; ulimit -f 8; exec '{program}' {arguments} -o '{}'",
            output.display()
        );
        let mut shell = Command::new("sh");
        shell.args(["-c", &script]);
        // Shaders that the driver keeps on disk are files, too.
        shell.env("MESA_SHADER_CACHE_DISABLE", "true");
        let done = shell.output().expect("a shell");
        let errors = String::from_utf8_lossy(&done.stderr);
        assert_eq!(done.status.code(), Some(1), "{errors}");
        assert!(
            errors.contains(name) && errors.contains("cannot be written"),
            "{errors}"
        );
    }
    assert_eq!(std::fs::read_dir(&folder).expect("a folder").count(), 0);
}
