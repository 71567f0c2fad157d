//! The command as a user runs it: what it writes, and how it refuses.

use crate::common::{command, folder, gpugi, skip_gpu};

#[test]
fn files_of_another_folder_need_an_option() {
    let folder = folder("files-from");
    for below in ["scenes", "textures"] {
        std::fs::create_dir(folder.join(below)).expect("a folder");
    }
    let triangle = "mtllib ../textures/a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n";
    std::fs::write(folder.join("textures/a.mtl"), "newmtl a\nKd 1 0 0\n").expect("a library");
    let scene = folder.join("scenes/a.obj");
    std::fs::write(&scene, triangle).expect("a scene");
    let scene = scene.display().to_string();
    let notes = |more: &[&str]| {
        let output = gpugi(&[&["info", &scene], more].concat());
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(notes(&[]).contains("--files-from FOLDER allows it"));
    let root = folder.display().to_string();
    let allowed = notes(&["--files-from", &root]);
    assert!(!allowed.contains("library"), "{allowed}");
    assert!(notes(&["--files-from", "nowhere"]).contains("there is no such folder"));
}

#[test]
fn drivers_say_nothing() {
    if skip_gpu() {
        return;
    }
    for folder in ["", "relative"] {
        let mut list = command(&["list", "adapters", "--quiet"]);
        list.env("XDG_RUNTIME_DIR", folder);
        if folder.is_empty() {
            list.env_remove("XDG_RUNTIME_DIR");
        }
        let output = list.output().expect("the binary runs");
        assert!(output.status.success());
        assert_eq!(String::from_utf8_lossy(&output.stderr), "");
    }
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
        "shadow-map.area-samples=4",
        "--set",
        "radiosity.iterations=8",
        "--explain",
    ]);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let explained = String::from_utf8_lossy(&output.stdout).into_owned();
    for part in [
        "shadow-map\n  chosen: the scene has lights (area)\n",
        "radiosity\n  chosen: nothing moves, and 288 triangles are soon unwrapped\n",
        "steps=16",
        "adds: light reflected between diffuse surfaces (area)",
        "per sample",
        "maps were final after ",
        "no kind of light of the scene is left out",
        "the path tracer takes ",
        "the techniques' own error is about ",
    ] {
        assert!(explained.contains(part), "{part:?} is not in {explained}");
    }
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
        "cornell.exr",
        "maps/shadow-map.atlas.exr",
        "maps/radiosity.irradiance.exr",
    ] {
        let image = gpugi_scene::image::load_radiance(folder.join(name).as_path(), &limits)
            .map(|image| image.width);
        assert!(image.is_ok(), "{name}: {image:?}");
    }
    let report = std::fs::read_to_string(path("report.json")).expect("the report");
    let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
    assert_eq!(report["samples"], 2);
    assert_eq!(report["techniques"]["shadow-map"]["area-samples"], 4);
    // Chosen for the still picture, then set.
    assert_eq!(report["techniques"]["radiosity"]["steps"], 16);
    assert_eq!(report["techniques"]["radiosity"]["iterations"], 8);
    assert_eq!(report["left_out"], serde_json::json!([]));
    assert!(report["maps_seconds"].as_f64() > Some(0.0), "{report}");
    // All light paths of a matt room: under the lamp, the ceiling has indirect light alone.
    let ceiling = texel(24, 3);
    assert!(ceiling.iter().all(|&value| value > 10), "{ceiling:?}");
}

/// One sample shows all iterates of radiosity, however many frames they take.
#[test]
fn maps_converge_before_the_first_sample() {
    if skip_gpu() {
        return;
    }
    let folder = folder("converge");
    let render = |name: &str, setting: &str| {
        let path = folder.join(name);
        let path_text = path.display().to_string();
        let mut arguments = vec!["render", "cornell", "-o", &path_text, "--size", "16x12"];
        arguments.extend(["--samples", "1", "--technique", "radiosity"]);
        arguments.extend(["--set", "radiosity.resolution=32", "--set", setting]);
        let output = gpugi(&arguments);
        assert!(output.status.success(), "{output:?}");
        let limits = gpugi_scene::Limits::default();
        let picture = gpugi_scene::image::load_radiance(&path, &limits);
        picture.expect("an EXR").pixels
    };
    let one_by_one = render("one-by-one.exr", "radiosity.steps=1");
    assert_eq!(one_by_one, render("at-once.exr", "radiosity.steps=256"));
    assert_ne!(one_by_one, render("few.exr", "radiosity.iterations=1"));
}

/// Only unwrapping tells that a scene has no atlas; here because of an absurd density.
#[test]
fn a_picture_without_an_atlas_takes_another_technique_and_says_so() {
    if skip_gpu() {
        return;
    }
    let picture = folder("without-atlas").join("cornell.png");
    let picture = picture.to_str().expect("a path");
    let mut arguments = vec!["render", "cornell", "--size", "8x8", "--samples", "1"];
    arguments.extend(["--set", "radiosity.density=1e6", "-o", picture]);
    let rendered = gpugi(&arguments);
    let said = String::from_utf8_lossy(&rendered.stderr);
    assert!(rendered.status.success(), "{said}");
    for part in [
        "final-gather stands in for radiosity: the atlas needs ",
        "--set radiosity.density=1e6 has no effect",
    ] {
        assert!(said.contains(part), "{part:?} is not in {said}");
    }
}

#[test]
fn dumped_domains_cover_the_sky() {
    if skip_gpu() {
        return;
    }
    let folder = folder("domains");
    let path = |name: &str| folder.join(name).display().to_string();
    let output = gpugi(&[
        "render",
        "spheres",
        "-o",
        &path("spheres.png"),
        "--size",
        "8x6",
        "--samples",
        "1",
        "--technique",
        "image-based-lighting",
        "--set",
        "image-based-lighting.samples=20",
        "--set",
        "image-based-lighting.resolution=32",
        "--dump-maps",
        &path("maps"),
    ]);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let map = folder.join("maps/image-based-lighting.domains.exr");
    let map = gpugi_scene::image::load_radiance(&map, &gpugi_scene::Limits::default());
    let map = map.expect("the map of domains");
    assert_eq!((map.width, map.height), (256, 128));
    let gpugi_scene::Pixels::Rgba32Float(values) = &map.pixels else {
        panic!("floats")
    };
    let numbers: std::collections::BTreeSet<u32> = values
        .chunks_exact(4)
        .map(|texel| texel[0] as u32)
        .collect();
    assert!(numbers.iter().all(|&number| number < 20), "{numbers:?}");
    assert!(numbers.len() >= 18, "{numbers:?}");
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
            "--technique",
            "shadow-map",
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
fn measures_rays_a_second() {
    if skip_gpu() {
        return;
    }
    let json = folder("rays").join("rays.json");
    let output = gpugi(&[
        "bench",
        "--technique",
        "bvh",
        "--scene",
        "cornell",
        "--size",
        "24x16",
        "--json",
        &json.display().to_string(),
    ]);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let table = String::from_utf8_lossy(&output.stdout).into_owned();
    for kind in ["primary", "diffuse", "shadow", "Mrays/s"] {
        assert!(table.contains(kind), "no {kind} in {table}");
    }
    let json = std::fs::read_to_string(json).expect("the table as JSON");
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(json["rates"][0]["rays"], 24 * 16);
}

#[test]
fn measures_what_cones_exclude() {
    if skip_gpu() {
        return;
    }
    let json = folder("cones").join("cones.json");
    let output = gpugi(&[
        "bench",
        "--technique",
        "ray-tracing",
        "--set",
        "ray-tracing.tracer=cones",
        "--set",
        "ray-tracing.bounces=2",
        "--scene",
        "ornaments",
        "--size",
        "96x64",
        "--frames",
        "1",
        "--json",
        &json.display().to_string(),
    ]);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let json = std::fs::read_to_string(json).expect("the table as JSON");
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    let figure = |name: &str| {
        let figures = json["figures"].as_array().expect("figures");
        let found = figures.iter().find(|figure| figure["name"] == name);
        found.unwrap_or_else(|| panic!("no {name}")).clone()
    };
    let rays = figure("ray-tracing.rays");
    let generations = ["1", "2"].map(|number| {
        let name = format!("ray-tracing.rays of generation {number}");
        figure(&name)["value"].as_f64().expect("a number")
    });
    assert!(generations[1] > 0.0 && generations[0] > generations[1]);
    assert_eq!(rays["value"], generations[0] + generations[1]);
    assert!(rays["per_second"].as_f64().expect("a rate") > 0.0);
    let culled = figure("ray-tracing.culled by cones")["value"].as_f64();
    assert!(culled.is_some_and(|share| share > 10.0 && share < 100.0));
    assert!(json["cpu_record_ms"].as_f64().expect("a time") > 0.0);
    assert_eq!(json["cpu_wait_ms"], 0.0, "no map waits for the GPU");
}

#[test]
fn measures_edits() {
    if skip_gpu() {
        return;
    }
    let json = folder("edits").join("edits.json");
    let path = json.display().to_string();
    let few = ["--frames", "2", "--json", &path];
    let output = gpugi(&[&["bench", "--technique", "edits"], &few[..]].concat());
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let json = std::fs::read_to_string(json).expect("the table as JSON");
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(json["instances"], 10_000);
    let edits = json["edits"].as_array().expect("rows");
    assert_eq!(edits.len(), 10);
    for edit in edits {
        let is_all = edit["edit"] == "move all instances";
        let bytes = edit["bytes"].as_u64().expect("a number");
        assert_eq!(bytes > 1000, is_all, "{edit}");
    }
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
        (
            vec!["render", "room", "-o", "x.png", "--without", "box,ball"],
            "\"ball\"; there are: back wall, box",
        ),
        (vec!["measure", "room", "--without", "b*x*x"], "sphere"),
        (
            vec!["bench", "--scene", "room", "--without", "crate"],
            "sphere",
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
fn a_folder_that_is_missing_is_said_before_the_work() {
    let started = std::time::Instant::now();
    for arguments in [
        vec![
            "render",
            "cornell",
            "-o",
            "nowhere/x.png",
            "--samples",
            "16777216",
        ],
        vec![
            "render",
            "cornell",
            "-o",
            "x.png",
            "--report",
            "nowhere/x.json",
            "--samples",
            "16777216",
        ],
        vec![
            "measure",
            "cornell",
            "--technique",
            "shadow-map",
            "--json",
            "nowhere/x.json",
        ],
    ] {
        let output = gpugi(&arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {message}");
        assert!(message.contains("there is no folder nowhere"), "{message}");
    }
    assert!(started.elapsed().as_secs() < 30);
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

#[test]
fn leaves_out_what_it_is_told_to() {
    let instances = |arguments: &[&str]| {
        let output = gpugi(arguments);
        assert!(output.status.success(), "{arguments:?}");
        let facts: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
        facts["instances"].as_u64().expect("a number")
    };
    let all = instances(&["info", "room"]);
    assert_eq!(instances(&["info", "room", "--without", "box"]), all - 1);
    assert_eq!(
        instances(&["info", "room", "--without", "*wall, box"]),
        all - 5
    );
}

/// docs/settings.md is what `gpugi list settings --markdown` prints.
#[test]
fn settings_are_listed_and_documented() {
    let output = gpugi(&["list", "settings", "--markdown"]);
    let page = String::from_utf8(output.stdout).expect("UTF-8");
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/settings.md");
    let written = std::fs::read_to_string(path).expect("docs/settings.md");
    assert!(
        page == written,
        "write docs/settings.md again: gpugi list settings --markdown > docs/settings.md"
    );
    let output = gpugi(&["list", "settings", "shadow-map"]);
    let listed = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(listed.contains("shadow-map.resolution=1024"), "{listed}");
    assert!(!listed.contains("radiosity."), "{listed}");
    let output = gpugi(&["list", "settings", "shadows"]);
    assert_eq!(output.status.code(), Some(2));
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(error.contains("there are: shadow-map"), "{error}");
}

#[test]
fn output_may_be_cut_short() {
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_gpugi"))
        .args(["list", "settings"])
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("the command");
    // Nobody reads.
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("its end");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && errors.is_empty(), "{errors}");
}
