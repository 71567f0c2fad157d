//! Films as a user makes them.

use std::io::Cursor;
use std::path::Path;
use std::process::Output;
#[cfg(unix)]
use std::{
    path::PathBuf,
    process::{Command, Stdio},
    time::{Duration, Instant},
};

#[cfg(unix)]
use crate::common::command;
use crate::common::{folder, gpugi, skip_gpu};

/// A floor, above which a lamp and a camera (`tour`) go from left to right in a second.
fn scene(folder: &Path) -> String {
    let numbers: [f32; 20] = [
        -1.0, 0.0, 1.0, 1.0, 0.0, 1.0, 1.0, 0.0, -1.0, -1.0, 0.0, -1.0, // corners
        0.0, 1.0, // times
        -0.8, 0.5, 0.0, 0.8, 0.5, 0.0, // places
    ];
    let mut bytes: Vec<u8> = numbers
        .iter()
        .flat_map(|number| number.to_le_bytes())
        .collect();
    bytes.extend(
        [0u16, 1, 2, 0, 2, 3]
            .iter()
            .flat_map(|index| index.to_le_bytes()),
    );
    std::fs::write(folder.join("lamp.bin"), bytes).expect("a buffer");
    let scene = serde_json::json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "point", "intensity": 1.0 }] } },
        "buffers": [{ "uri": "lamp.bin", "byteLength": 92 }],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 8 },
            { "buffer": 0, "byteOffset": 56, "byteLength": 24 },
            { "buffer": 0, "byteOffset": 80, "byteLength": 12 }
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-1, 0, -1], "max": [1, 0, 1] },
            { "bufferView": 1, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0], "max": [1] },
            { "bufferView": 2, "componentType": 5126, "count": 2, "type": "VEC3" },
            { "bufferView": 3, "componentType": 5123, "count": 6, "type": "SCALAR" }
        ],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 3 }] }],
        "cameras": [{ "name": "tour", "type": "perspective", "perspective": { "yfov": 0.9, "znear": 0.1 } }],
        "nodes": [
            { "mesh": 0 },
            { "extensions": { "KHR_lights_punctual": { "light": 0 } } },
            { "children": [3] },
            { "camera": 0, "translation": [0.0, 1.0, 1.5], "rotation": [-0.3, 0.0, 0.0, 0.954] }
        ],
        "scenes": [{ "nodes": [0, 1, 2] }],
        "animations": [{
            "samplers": [{ "input": 1, "output": 2 }],
            "channels": [
                { "sampler": 0, "target": { "node": 1, "path": "translation" } },
                { "sampler": 0, "target": { "node": 2, "path": "translation" } }
            ]
        }]
    });
    let path = folder.join("lamp.gltf");
    std::fs::write(&path, scene.to_string()).expect("a scene");
    path.display().to_string()
}

/// Where the camera stands still.
const STILL: &str = "eye=0,2,1.5;target=0,0,0;fov=50";

/// What makes small pictures quickly.
const QUICK: [&str; 4] = ["--size", "32x24", "--exposure", "2"];
/// As few frames as show what moves, in light that takes little time.
const FRAMES: [&str; 4] = ["--fps", "3", "--technique", "shadow-map"];

/// Runs `gpugi film` or `gpugi render`.
fn make(what: &str, scene: &str, output: &Path, more: &[&[&str]]) -> Output {
    let output = output.display().to_string();
    gpugi(&[&[what, scene, "-o", &output], &QUICK, &more.concat()[..]].concat())
}

fn done(output: &Output) -> String {
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{errors}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn png(path: &Path) -> Vec<u8> {
    let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let name = path.display().to_string();
    let image = gpugi_scene::image::decode_color(&name, &bytes, &gpugi_scene::Limits::default());
    let image = image.expect("a PNG");
    assert_eq!((image.width, image.height), (32, 24));
    let gpugi_scene::Pixels::Rgba8(texels) = image.pixels else {
        panic!("8 bits")
    };
    texels.to_vec()
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    let name = |entry: std::io::Result<std::fs::DirEntry>| {
        let name = entry.expect("an entry").file_name();
        name.to_string_lossy().into_owned()
    };
    let mut names: Vec<String> = entries.map(name).collect();
    names.sort();
    names
}

/// The animation takes a second, which has three frames: a fourth would be the first once more.
fn has_still_frames(name: &str, options: &[&str]) {
    if skip_gpu() {
        return;
    }
    let folder = folder(name);
    let scene = scene(&folder);
    let frames = folder.join("frames");
    let options = [options, &["--samples", "2", "--seed", "3"]].concat();
    let said = done(&make("film", &scene, &frames, &[&options, &["--fps", "3"]]));
    let summary = "3 frames of 32x24, 1.00 s at 3 per second";
    assert!(said.contains(summary), "{said}");
    assert_eq!(names(&frames), ["0000.png", "0001.png", "0002.png"]);
    let picture = folder.join("picture.png");
    let last = ["--time", "0.6666667"];
    done(&make("render", &scene, &picture, &[&options, &last]));
    assert!(png(&picture) == png(&frames.join("0002.png")));
    // A share of the film has the frames that the film has.
    let share = folder.join("share");
    let of_share = ["--fps", "3", "--frames", "1-2"];
    done(&make("film", &scene, &share, &[&options, &of_share]));
    assert_eq!(names(&share), ["0001.png", "0002.png"]);
    assert!(png(&picture) == png(&share.join("0002.png")));
}

#[test]
fn frames_with_samples_are_still_pictures() {
    has_still_frames(
        "film-stills",
        &["--camera", "tour", "--technique", "shadow-map"],
    );
}

#[test]
fn frames_with_samples_are_blurred_by_the_shutter() {
    let options = ["--camera", "shutter=0.2", "--technique", "shadow-map"];
    has_still_frames("film-shutter", &options);
}

#[test]
fn the_path_tracer_makes_frames() {
    let options = ["--camera", "tour", "--technique", "path-tracer"];
    has_still_frames("film-traced", &options);
}

/// Which column of a frame is brightest.
fn brightest(frame: &[u8]) -> usize {
    let light = |column: usize| {
        let pixels = frame.chunks_exact(4).skip(column).step_by(32);
        pixels.map(|pixel| u32::from(pixel[1])).sum::<u32>()
    };
    (0..32)
        .max_by_key(|&column| light(column))
        .expect("a column")
}

#[test]
fn frames_follow_the_lamp_from_the_start() {
    if skip_gpu() {
        return;
    }
    let folder = folder("film-live");
    let scene = scene(&folder);
    let frames = folder.join("frames");
    done(&make(
        "film",
        &scene,
        &frames,
        &[&FRAMES, &["--camera", STILL]],
    ));
    let places = [0, 1, 2].map(|frame| brightest(&png(&frames.join(format!("000{frame}.png")))));
    assert!(
        places[0] < 10 && places.is_sorted() && places[2] > places[0] + 6,
        "{places:?}"
    );
    // The end of the loop, and its beginning.
    let later = folder.join("later");
    let loops = ["--start", "0.9", "--seconds", "0.6", "--fps", "5"];
    let options: [&[&str]; 3] = [&loops, &["--technique", "shadow-map"], &["--camera", STILL]];
    done(&make("film", &scene, &later, &options));
    let places = [0, 1].map(|frame| brightest(&png(&later.join(format!("000{frame}.png")))));
    assert!(places[0] > 20 && places[1] < 12, "{places:?}");
}

/// What the turned camera sees is what cameras see that stand where it stands then.
#[test]
fn a_turn_goes_once_around_the_target() {
    if skip_gpu() {
        return;
    }
    let folder = folder("film-turn");
    let scene = scene(&folder);
    let frames = folder.join("frames/");
    let light = ["--technique", "shadow-map", "--samples", "1"];
    let turn = [
        "--camera",
        "eye=0,1,2;target=0,0,0;fov=50",
        "--turn",
        "--fps",
        "4",
    ];
    done(&make("film", &scene, &frames, &[&light, &turn]));
    assert_eq!(names(&frames).len(), 4);
    let picture = folder.join("picture.png");
    let camera = [
        "--camera",
        "eye=2,1,0;target=0,0,0;fov=50",
        "--time",
        "0.25",
    ];
    done(&make("render", &scene, &picture, &[&light, &camera]));
    let (still, turned) = (png(&picture), png(&frames.join("0001.png")));
    let difference = |a: &[u8], b: &[u8]| {
        let pairs = a.iter().zip(b);
        pairs.map(|(a, b)| u64::from(a.abs_diff(*b))).sum::<u64>() as f64 / a.len() as f64
    };
    assert!(difference(&still, &turned) < 1.0);
    assert!(difference(&still, &png(&frames.join("0000.png"))) > 5.0);
}

#[test]
fn a_webp_has_every_frame_for_its_time() {
    if skip_gpu() {
        return;
    }
    let folder = folder("film-webp");
    let scene = scene(&folder);
    let path = folder.join("lamp.webp");
    let options: [&[&str]; 2] = [&FRAMES, &["--camera", STILL]];
    done(&make(
        "film",
        &scene,
        &path,
        &[&options.concat(), &["--quality", "90"]],
    ));
    assert_eq!(names(&folder), ["lamp.bin", "lamp.gltf", "lamp.webp"]);
    let frames = folder.join("frames");
    done(&make("film", &scene, &frames, &options));
    let bytes = std::fs::read(&path).expect("a film");
    let mut film = image_webp::WebPDecoder::new(Cursor::new(bytes)).expect("a WebP");
    assert!(film.is_animated() && film.is_lossy());
    assert_eq!((film.dimensions(), film.num_frames()), ((32, 24), 3));
    assert_eq!(film.loop_duration(), 1000);
    let channels = if film.has_alpha() { 4 } else { 3 };
    let mut seen = vec![0; film.output_buffer_size().expect("a size")];
    for (frame, milliseconds) in [333, 334, 333].into_iter().enumerate() {
        assert_eq!(film.read_frame(&mut seen).expect("a frame"), milliseconds);
        let shown = png(&frames.join(format!("000{frame}.png")));
        let pairs = seen.chunks_exact(channels).zip(shown.chunks_exact(4));
        let error: u64 = pairs.map(|(a, b)| u64::from(a[1].abs_diff(b[1]))).sum();
        assert!(error < 6 * 32 * 24, "frame {frame}: {error}");
    }
}

/// A folder with a program `ffmpeg` that has this `encoder`, notes its arguments, keeps what it is sent in place of a film
/// and ends with this `status`.
#[cfg(unix)]
fn ffmpeg(folder: &Path, encoder: &str, status: u8) -> PathBuf {
    use std::os::unix::fs::PermissionsExt;
    let script = format!(
        "#!/bin/sh\ncase $* in *-encoders*) echo ' V....D {encoder} an encoder'; exit;; esac\n\
         cd \"${{0%/*}}\"; echo \"$@\" >arguments\nfor last; do :; done\n/bin/cat >\"${{last#file:}}\"; exit {status}\n"
    );
    let path = folder.join("ffmpeg");
    std::fs::write(&path, script).expect("a program");
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).expect("rights");
    folder.to_owned()
}

#[cfg(unix)]
#[test]
fn ffmpeg_gets_every_frame() {
    if skip_gpu() {
        return;
    }
    let folder = folder("film-ffmpeg");
    let scene = scene(&folder);
    let film = |name: &str, path: &Path| {
        let output = folder.join(name).display().to_string();
        let start = ["film", &scene, "-o", &output, "--camera", STILL];
        let mut film = command(&[&start[..], &QUICK, &FRAMES].concat());
        film.env("PATH", path).output().expect("the binary runs")
    };
    let has_x264 = ffmpeg(&folder, "libx264", 0);
    done(&film("lamp.mp4", &has_x264));
    let sent = std::fs::read(folder.join("lamp.mp4")).expect("a film");
    assert_eq!(sent.len(), 3 * 32 * 24 * 4);
    let frames: Vec<usize> = sent.chunks_exact(32 * 24 * 4).map(brightest).collect();
    assert!(
        frames.is_sorted() && frames[0] + 6 < frames[2],
        "{frames:?}"
    );
    let arguments = std::fs::read_to_string(folder.join("arguments")).expect("arguments");
    for part in [
        "-f rawvideo -pixel_format rgba -video_size 32x24 -framerate 3 -i pipe:0",
        "-c:v libx264 -crf 18 -movflags +faststart -f mp4",
        "-colorspace bt709",
    ] {
        assert!(arguments.contains(part), "{part} is not in {arguments}");
    }
    // One that fails leaves the film before, and nothing else.
    let fails = ffmpeg(&folder, "libx264", 3);
    let output = film("lamp.mp4", &fails);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{errors}");
    assert!(
        errors.contains("ffmpeg failed (exit status: 3)"),
        "{errors}"
    );
    assert!(sent == std::fs::read(folder.join("lamp.mp4")).expect("a film"));
    let all = ["arguments", "ffmpeg", "lamp.bin", "lamp.gltf", "lamp.mp4"];
    assert_eq!(names(&folder), all);
    // Without one, or without the encoder, nothing is rendered.
    let without = folder.join("nowhere");
    for (name, path, said) in [
        ("a.mp4", &without, "install it"),
        ("a.webm", &fails, "an ffmpeg with the encoder libvpx-vp9"),
    ] {
        let output = film(name, path);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{errors}");
        assert!(
            errors.contains(said) && errors.contains("a .webp or a folder"),
            "{errors}"
        );
    }
}

#[cfg(unix)]
#[test]
fn a_film_that_is_interrupted_ends_there() {
    if skip_gpu() {
        return;
    }
    let folder = folder("film-interrupted");
    let scene = scene(&folder);
    let path = folder.join("lamp.mp4");
    let output = path.display().to_string();
    let start = [
        "film",
        &scene,
        "-o",
        &output,
        "--camera",
        STILL,
        "--seconds",
        "10000",
    ];
    let mut film = command(&[&start[..], &QUICK, &FRAMES].concat());
    film.env("PATH", ffmpeg(&folder, "libx264", 0));
    let film = film
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary runs");
    // Until some frames are there; as long as that takes on whatever this runs on.
    let begun = || {
        let mut files = names(&folder).into_iter();
        let file = files.find(|name| name.ends_with(".tmp") && name.contains("lamp"))?;
        let bytes = std::fs::metadata(folder.join(file)).ok()?.len();
        (bytes > 2 * 32 * 24 * 4).then_some(())
    };
    let started = Instant::now();
    while begun().is_none() && started.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(5));
    }
    let number = film.id().to_string();
    let mut kill = Command::new("kill");
    kill.args(["-INT", &number]).status().expect("a signal");
    let ended = film.wait_with_output().expect("an end");
    done(&ended);
    let said = String::from_utf8_lossy(&ended.stderr);
    let sent = std::fs::read(&path).expect("a film").len();
    let frames = sent / (32 * 24 * 4);
    assert!(sent.is_multiple_of(32 * 24 * 4) && frames >= 2, "{sent}");
    let expected = format!("interrupted: the film has {frames} of 30000 frames");
    assert!(said.contains(&expected), "{said}");
    let all = ["arguments", "ffmpeg", "lamp.bin", "lamp.gltf", "lamp.mp4"];
    assert_eq!(names(&folder), all);
}

#[test]
fn wrong_films_are_refused_before_they_are_rendered() {
    let folder = folder("film-refused");
    let scene = scene(&folder);
    let path = |name: &str| folder.join(name).display().to_string();
    let webp = path("x.webp");
    let longer = folder.join("longer");
    std::fs::create_dir(&longer).expect("a folder");
    std::fs::write(longer.join("0030.png"), "precious").expect("a file");
    std::fs::create_dir(folder.join("folder.webp")).expect("a folder");
    let longer = longer.display().to_string();
    for (code, output, more, part) in [
        (2, &webp, &["--fps", "0"][..], "0.1 to 1000"),
        (2, &webp, &["--fps", "nan"], "0.1 to 1000"),
        (2, &webp, &["--fps=-30"], "0.1 to 1000"),
        (2, &webp, &["--seconds", "0"], "longer than 0 s"),
        (2, &webp, &["--seconds=-3"], "longer than 0 s"),
        (2, &webp, &["--seconds", "nan"], "longer than 0 s"),
        (2, &webp, &["--seconds", "inf"], "longer than 0 s"),
        (2, &webp, &["--seconds", "1e9"], "more than 100000 frames"),
        (2, &webp, &["--start", "nan"], "finite number of seconds"),
        (2, &webp, &["--quality", "101"], "101"),
        (2, &webp, &["--camera", "nobody"], "there is no camera"),
        (2, &webp, &["--size", "20000x10"], "at most 16383 pixels"),
        (2, &path("x.mp4"), &["--size", "31x24"], "even sides"),
        (2, &path("x.gif"), &[], ".webp, .mp4 or .webm"),
        (2, &path("x"), &["--quality", "50"], "PNGs lose nothing"),
        (1, &path("nowhere/x.webp"), &[], "there is no folder"),
        (1, &path("lamp.gltf/x.webp"), &[], "there is no folder"),
        (1, &path("lamp.gltf/x"), &[], "cannot be made"),
        (1, &path("folder.webp"), &[], "is a folder"),
        (1, &longer, &[], "0030.png is of a longer film"),
        (2, &webp, &["--frames", "0-1"], "PNGs in a folder"),
        (2, &longer, &["--frames", "29-30"], "frames 0 to 29"),
        (2, &longer, &["--frames", "2-1"], "FIRST-LAST"),
    ] {
        let film = ["film", &scene, "-o", output];
        let film = gpugi(&[&film[..], more].concat());
        let said = String::from_utf8_lossy(&film.stderr).into_owned();
        assert_eq!(film.status.code(), Some(code), "{output} {more:?}: {said}");
        assert!(said.contains(part), "{output} {more:?}: {said}");
    }
    let still = gpugi(&["film", "cornell", "-o", &webp]);
    let said = String::from_utf8_lossy(&still.stderr).into_owned();
    assert_eq!(still.status.code(), Some(2), "{said}");
    assert!(said.contains("nothing moves in cornell: --turn"), "{said}");
}
