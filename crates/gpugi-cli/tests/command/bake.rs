//! `gpugi bake`: an environment's maps as files, and scenes whose light lies in textures.

use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::Arc;

use crate::common::{folder, gpugi, skip_gpu};
use gpugi::bake::HarmonicVolume;

const FILES: [&str; 6] = [
    "radiance.ktx2",
    "irradiance.ktx2",
    "ggx.ktx2",
    "phong.ktx2",
    "albedo.ktx2",
    "irradiance-sh.json",
];

/// A sky of 8 x 4 texels with one of its own.
fn sky(folder: &Path, name: &str, texel: f32) -> String {
    let mut texels = vec![0.5; 8 * 4 * 3];
    texels[3 * 12] = texel;
    let path = folder.join(name);
    gpugi_scene::image::save_exr(&path, 8, 4, &texels).expect("a sky");
    path.display().to_string()
}

fn bake(sky: &str, output: &Path, options: &[&str]) -> Output {
    let output = output.display().to_string();
    let first = ["bake", sky, "-o", &output];
    gpugi(&[&first[..], &["--set", "environment-map.samples=4"], options].concat())
}

const TECHNIQUE: [&str; 2] = ["--technique", "environment-map"];

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    let mut names: Vec<String> = entries
        .map(|entry| {
            entry
                .expect("an entry")
                .file_name()
                .into_string()
                .expect("a name")
        })
        .collect();
    names.sort();
    names
}

#[test]
fn writes_the_maps_of_an_environment() {
    if skip_gpu() {
        return;
    }
    let folder = folder("bake");
    let sky = sky(&folder, "sky.exr", 30.0);
    let output: PathBuf = folder.join("new").join("maps");
    let options = [&TECHNIQUE[..], &["--set", "environment-map.resolution=16"]].concat();
    let done = bake(&sky, &output, &options);
    let message = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(done.status.success(), "{message}");
    let said = String::from_utf8_lossy(&done.stdout).into_owned();
    let mut expected = FILES;
    expected.sort();
    assert_eq!(names(&output), expected, "and no temporary file");
    assert!(FILES.iter().all(|name| said.contains(name)), "{said}");
    // Width, faces, levels: words 5, 9 and 10 of the header. Half floats, RGBA: VK_FORMAT 97.
    for (name, side, faces, levels) in [
        ("radiance.ktx2", 16, 6, 5),
        ("irradiance.ktx2", 32, 6, 1),
        ("ggx.ktx2", 16, 6, 2),
        ("phong.ktx2", 16, 6, 2),
        ("albedo.ktx2", 64, 1, 1),
    ] {
        let bytes = std::fs::read(output.join(name)).expect("a file");
        let word = |i: usize| u32::from_le_bytes(bytes[4 * i..][..4].try_into().expect("a word"));
        assert_eq!(&bytes[..7], b"\xABKTX 20", "{name}");
        let found = [3, 5, 9, 10].map(word);
        assert_eq!(found, [97, side, faces, levels], "{name}");
    }
    let text = std::fs::read_to_string(output.join("irradiance-sh.json")).expect("the text");
    let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    // The mean of the sky is 0.5 but for the one bright texel, which is red.
    let first = &json["radiance_coefficients"][0];
    let mean =
        |i: usize| first[i].as_f64().expect("a number") / 4.0 / std::f64::consts::PI / 0.28209479;
    assert!(mean(0) > 0.6 && (mean(1) - 0.5).abs() < 1e-3, "{first}");

    // Again into the same folder, without a word.
    let quiet = bake(&sky, &output, &[&options[..], &["--quiet"]].concat());
    assert!(quiet.status.success() && quiet.stdout.is_empty() && quiet.stderr.is_empty());
}

#[test]
fn wrong_arguments_exit_with_2() {
    let folder = folder("bake-arguments");
    let sky = sky(&folder, "sky.exr", 1.0);
    let output = folder.join("maps");
    for (options, part) in [
        (&[][..], "--technique"),
        (&["--technique", "shadow-map"], "environment-map"),
        (&["--technique", "magic"], "environment-map"),
        (
            &[
                TECHNIQUE[0],
                TECHNIQUE[1],
                "--set",
                "environment-map.resolution=100",
            ],
            "power of two",
        ),
        (
            &[
                TECHNIQUE[0],
                TECHNIQUE[1],
                "--set",
                "environment-map.magic=1",
            ],
            "resolution",
        ),
        (
            &[TECHNIQUE[0], TECHNIQUE[1], "--set", "shadow-map.taps=1"],
            "not in use",
        ),
        (
            &[TECHNIQUE[0], TECHNIQUE[1], "--set", "resolution=64"],
            "technique.key=value",
        ),
    ] {
        let refused = bake(&sky, &output, options);
        let message = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{options:?}: {message}");
        assert!(message.contains(part), "{options:?}: {message}");
        assert!(!output.exists(), "{options:?}");
    }
}

#[test]
fn files_that_are_no_environment_exit_with_1_and_change_nothing() {
    let folder = folder("bake-files");
    let output = folder.join("maps");
    std::fs::create_dir(&output).expect("a folder");
    std::fs::write(output.join("ggx.ktx2"), b"precious").expect("a file");
    let text = folder.join("text.exr");
    std::fs::write(&text, b"nothing of the kind").expect("a file");
    let cases = [
        (
            folder.join("gone.exr").display().to_string(),
            ["gone.exr", "open"],
        ),
        (text.display().to_string(), ["text.exr", "no image"]),
        (folder.display().to_string(), ["bake-files", "not a file"]),
        (
            sky(&folder, "nan.exr", f32::NAN),
            ["nan.exr", "texel (4, 1)"],
        ),
        (
            sky(&folder, "infinite.exr", f32::INFINITY),
            ["infinite.exr", "texel (4, 1)"],
        ),
    ];
    for (file, parts) in cases {
        let refused = bake(&file, &output, &TECHNIQUE);
        let message = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(1), "{message}");
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
        assert_eq!(names(&output), ["ggx.ktx2"]);
        assert_eq!(
            std::fs::read(output.join("ggx.ktx2")).ok(),
            Some(b"precious".to_vec())
        );
    }
    // A file where the folder is to be.
    let sky = sky(&folder, "sky.exr", 1.0);
    let refused = bake(&sky, &text, &TECHNIQUE);
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(1), "{message}");
    assert!(message.contains("text.exr: cannot be made"), "{message}");
}

#[test]
fn a_file_that_cannot_be_replaced_is_named() {
    if skip_gpu() {
        return;
    }
    let folder = folder("bake-blocked");
    let sky = sky(&folder, "sky.exr", 1.0);
    let output = folder.join("maps");
    // A folder that is not empty cannot be replaced by a file.
    std::fs::create_dir_all(output.join("ggx.ktx2").join("inside")).expect("folders");
    let refused = bake(&sky, &output, &TECHNIQUE);
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(1), "{message}");
    assert!(
        message.contains("cannot be written") && message.contains("ggx.ktx2"),
        "{message}"
    );
    assert!(output.join("ggx.ktx2").join("inside").is_dir());
    assert!(names(&output).iter().all(|name| !name.contains("tmp")));
}

/// What the command says when it succeeds, as it must.
fn run(arguments: &[&str]) -> String {
    let output = gpugi(arguments);
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{arguments:?}: {errors}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn transfer_vectors_refuse_what_they_cannot_use() {
    let folder = folder("bake-transfer");
    let output = folder.join("relit.glb");
    let glb = output.display().to_string();
    let text = folder.join("relit.txt").display().to_string();
    for (file, options, part) in [
        (&text, &[][..], ".glb"),
        (
            &glb,
            &["--set", "radiance-transfer.resolution=64"],
            "--atlas-size",
        ),
        (
            &glb,
            &["--set", "radiance-transfer.density=1"],
            "--texel-density",
        ),
        (
            &glb,
            &["--set", "radiance-transfer.stored=true"],
            "a bake computes",
        ),
        (&glb, &["--set", "radiosity.rays=1"], "not in use"),
        (&glb, &["--time", "1"], "--time"),
        (&glb, &["--transfer-format", "float"], "half"),
    ] {
        let bake = [
            "bake",
            "cornell",
            "--technique",
            "radiance-transfer",
            "-o",
            file,
        ];
        let refused = gpugi(&[&bake[..], options].concat());
        let message = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{options:?}: {message}");
        assert!(message.contains(part), "{options:?}: {message}");
        assert!(!output.exists(), "{options:?}");
    }
}

/// A file of panes is shown as the scene is without them, and refuses what cannot be baked.
#[test]
fn panes_are_baked_and_used() {
    if skip_gpu() {
        return;
    }
    let folder = folder("bake-panes");
    let path = |name: &str| folder.join(name).display().to_string();
    let (glb, stored, new) = (path("panes.glb"), path("stored.exr"), path("new.exr"));
    let settings = [
        "--set",
        "light-path-map.entries=64",
        "--set",
        "light-path-map.clusters=4",
    ];
    let bake = [
        "bake",
        "cornell",
        "--technique",
        "light-path-map",
        "-o",
        &glb,
    ];
    for (option, part) in [
        (
            &["--set", "light-path-map.resolution=64"][..],
            "--atlas-size",
        ),
        (&["--set", "light-path-map.panes=2"], "how panes are added"),
        (&["--time", "1"], "panes are those"),
    ] {
        let refused = gpugi(&[&bake[..], option].concat());
        let message = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{option:?}: {message}");
        assert!(message.contains(part), "{option:?}: {message}");
    }
    let said = run(&[&bake[..], &settings, &["--atlas-size", "32"]].concat());
    assert!(said.contains("4 panes at 1 x 32 x 32 texels"), "{said}");
    let render = |output: &str, scene: &str, more: &[&str]| {
        let to = ["--technique", "shadow-map,light-path-map", "-o", output];
        let size = ["--size", "24x24", "--samples", "4"];
        run(&[&["render", scene], &to[..], &size, more].concat());
    };
    render(&stored, &glb, &[]);
    let resolution = [
        "--set",
        "light-path-map.resolution=32",
        "--set",
        "light-path-map.stored=false",
    ];
    render(&new, &glb, &[&settings[..], &resolution].concat());
    // Both have other noise, in shadows of the lamp and in panes.
    run(&[
        "compare", &stored, &new, "--metric", "rel-mse", "--max", "0.02",
    ]);
}

/// What is baked looks as what is lit.
#[test]
fn a_baked_scene_looks_as_it_is_lit() {
    if skip_gpu() {
        return;
    }
    let folder = folder("bake-scene");
    let file = |name: &str| folder.join(name).display().to_string();
    let small = ["--set", "shadow-map.area-samples=4"];
    let options = ["--atlas-size", "256", "--samples", "2"];
    let baked = file("emissive.glb");
    let bake = ["bake", "cornell", "--bake-mode", "emissive", "-o", &baked];
    let direct = ["--include", "direct"];
    run(&[&bake[..], &options, &small, &direct].concat());
    let picture = |scene: &str, technique: &str, name: &str| {
        let name = file(name);
        let of_scene = ["render", scene, "--technique", technique, "-o", &name];
        let size = ["--size", "96x96", "--samples", "2"];
        let settings = if technique == "shadow-map" {
            &small[..]
        } else {
            &[]
        };
        run(&[&of_scene[..], &size, settings].concat());
        name
    };
    let lit = picture("cornell", "shadow-map", "lit.exr");
    // Adds nothing where there is no environment: what is left is what shines.
    let shining = picture(&baked, "environment-map", "shining.exr");
    let compared = run(&["compare", &shining, &lit, "--metric", "rel-mse"]);
    let number = |text: &str| {
        let mut words = text.split_whitespace();
        let found = words.find_map(|word| word.parse::<f64>().ok());
        found.expect("a number")
    };
    let error = number(&compared);
    println!("direct light: {compared}");
    assert!(error < 1e-3, "{compared}");

    // All light, also of the corners that only other walls light.
    let options = ["--atlas-size", "128", "--samples", "2", "--set"];
    let coarse = [
        "radiosity.resolution=64",
        "--set",
        "radiosity.iterations=64",
    ];
    run(&[&bake[..], &options, &coarse].concat());
    let shining = picture(&baked, "environment-map", "all.exr");
    let truth = file("truth.exr");
    let of_truth = [
        "render",
        "cornell",
        "--technique",
        "path-tracer",
        "-o",
        &truth,
    ];
    run(&[&of_truth[..], &["--size", "96x96", "--samples", "192"]].concat());
    let compared = run(&["compare", &shining, &truth, "--metric", "rel-mse-4"]);
    let error = number(&compared);
    println!("all light: {compared}");
    assert!(error < 0.01, "{compared}");
    // The default, which in software is paths; and paths on every adapter.
    for (unasked, named) in [
        ("default", &[][..]),
        ("paths", &["--technique", "path-tracing", "--denoise"]),
    ] {
        let options = ["--atlas-size", "128", "--samples", "24"];
        run(&[&bake[..], &options, named].concat());
        let shining = picture(&baked, "environment-map", "unasked.exr");
        let compared = run(&["compare", &shining, &truth, "--metric", "rel-mse-4"]);
        let error = number(&compared);
        println!("{unasked}: {compared}");
        assert!(error < 0.01, "{unasked}: {compared}");
    }

    let few = ["--atlas-size", "64", "--samples", "1"];
    for (mode, extension) in [
        ("unlit", "KHR_materials_unlit"),
        ("lightmap", "MOZ_lightmap"),
    ] {
        let baked = file(&format!("{mode}.glb"));
        let bake = ["bake", "cornell", "--bake-mode", mode, "-o", &baked];
        run(&[&bake[..], &few, &small, &direct].concat());
        let bytes = std::fs::read(&baked).expect("a file");
        let text = String::from_utf8_lossy(&bytes);
        assert!(text.contains(extension), "{mode}");
    }
    // Texels that nothing covers continue their neighbours, of however many samples these are the mean.
    let more = file("more.glb");
    let bake = ["bake", "cornell", "--bake-mode", "lightmap", "-o", &more];
    run(&[&bake[..], &few[..2], &["--samples", "4"], &small, &direct].concat());
    let [one, four] = ["lightmap-0.exr", "more-0.exr"].map(|name| {
        let limits = gpugi_scene::Limits::default();
        let sky = gpugi_scene::import_environment(&folder.join(name), &limits);
        match &sky.expect("an image").image.pixels {
            gpugi_scene::Pixels::Rgba32Float(texels) => texels.clone(),
            _ => panic!("an .exr holds floats"),
        }
    });
    let texels = || one.chunks(4).zip(four.chunks(4));
    let alike = texels().filter(|(one, four)| (one[0] - four[0]).abs() <= 0.2 * one[0].max(0.01));
    let (alike, all) = (alike.count(), texels().count());
    println!("{alike} of {all} texels are alike with one sample and four");
    assert!(alike * 20 > all * 19);

    let occluded = file("occluded.glb");
    let bake = [
        "bake",
        "cornell",
        "--technique",
        "obscurances",
        "-o",
        &occluded,
    ];
    run(&[&bake[..], &few, &["--set", "obscurances.directions=16"]].concat());
    let bytes = std::fs::read(&occluded).expect("a file");
    assert!(String::from_utf8_lossy(&bytes).contains("occlusionTexture"));
}

/// gpugi shows an unlit bake as it was lit.
#[test]
fn an_unlit_bake_looks_as_it_is_lit() {
    if skip_gpu() {
        return;
    }
    let folder = folder("bake-unlit");
    let file = |name: &str| folder.join(name).display().to_string();
    let baked = file("unlit.glb");
    let picture = ["--exposure", "-1", "--tone-map", "none"];
    let small = ["--set", "shadow-map.area-samples=4", "--samples", "2"];
    let bake = ["bake", "cornell", "-o", &baked, "--atlas-size", "256"];
    run(&[&bake[..], &["--include", "direct"], &picture, &small].concat());
    let render = |scene: &str, name: &str, technique: &str, options: &[&str]| {
        let name = file(name);
        let render = ["render", scene, "-o", &name, "--size", "96x96"];
        run(&[&render[..], &["--technique", technique], options].concat());
        name
    };
    let lit = [&picture[..], &small].concat();
    let lit = render("cornell", "lit.png", "shadow-map", &lit);
    // It adds nothing where there is no environment: what is left is what shines. Exposure is in the bake.
    let shown = ["--exposure", "0", "--tone-map", "none"];
    let shown = render(&baked, "shown.png", "environment-map", &shown);
    let compared = run(&[
        "compare", &shown, &lit, "--metric", "rmse", "--max", "0.025",
    ]);
    println!("{compared}");
}

/// Unlit bakes keep what a mask cuts out.
#[test]
fn unlit_bakes_keep_alpha() {
    use gpugi_scene::builtin::shapes;
    use gpugi_scene::{AlphaMode, Image, Material, Pixels, Scene, Texture, TextureRef, Wrap};
    if skip_gpu() {
        return;
    }
    let folder = folder("bake-alpha");
    let mut scene = Scene::new("leaf");
    scene.images.push(Arc::new(Image {
        name: "leaf".to_owned(),
        width: 2,
        height: 1,
        pixels: Pixels::Rgba8(vec![200, 200, 200, 255, 200, 200, 200, 0]),
    }));
    scene.textures.push(Texture {
        image: 0,
        wrap: [Wrap::ClampToEdge; 2],
        nearest: true,
        has_levels: true,
    });
    let leaf = scene.add_material(Material {
        base_color_texture: Some(TextureRef::new(0)),
        alpha_mode: AlphaMode::Mask { cutoff: 0.25 },
        double_sided: true,
        ..Material::matt("leaf", glam::Vec3::ONE)
    });
    let mut mesh = shapes::cuboid(glam::Vec3::splat(-0.5), glam::Vec3::splat(0.5), 1);
    // What is at positive x is cut out.
    let right = |position: &glam::Vec3| glam::Vec2::new(position.x + 0.5, 0.5);
    mesh.uvs[0] = mesh.positions.iter().map(right).collect();
    let mesh = scene.add_mesh(mesh);
    scene.add_instance("leaf", mesh, leaf, glam::Mat4::IDENTITY);
    scene.lights.push(gpugi_scene::Light::new(
        "sun",
        gpugi_scene::LightKind::Directional,
        glam::Vec3::splat(3.0),
    ));
    let original = folder.join("leaf.glb");
    let written = gpugi_scene::export::export_scene(&scene).expect("a file");
    std::fs::write(&original, written.glb).expect("a place to write");
    for mode in ["unlit", "emissive"] {
        let baked = folder.join(format!("{mode}.glb"));
        let output = gpugi(&[
            "bake",
            &original.display().to_string(),
            "-o",
            &baked.display().to_string(),
            "--bake-mode",
            mode,
            "--atlas-size",
            "64",
            "--samples",
            "1",
            "--technique",
            "shadow-map",
        ]);
        let notes = String::from_utf8_lossy(&output.stderr);
        assert!(
            output.status.success() && !notes.contains("alpha"),
            "{notes}"
        );
        if let Ok(kept) = std::env::var("GPUGI_KEEP_EXPORTS") {
            std::fs::copy(&baked, format!("{kept}/cli-alpha-{mode}.glb")).expect("a folder");
        }
        let shown = gpugi_scene::import_file(&baked, &gpugi_scene::Limits::default());
        let shown = shown.expect("a file");
        let material = &shown.materials[shown.instances[0].material];
        assert_eq!(material.alpha_mode, AlphaMode::Mask { cutoff: 0.25 });
        assert!(material.double_sided);
        let texture = material.base_color_texture.expect("alpha");
        let image = &shown.images[shown.textures[texture.texture].image];
        let Pixels::Rgba8(texels) = &image.pixels else {
            panic!("a PNG has 8 bits");
        };
        let mesh = &shown.meshes[shown.instances[0].mesh];
        let mut seen = [0; 2];
        for triangle in mesh.indices.as_chunks::<3>().0 {
            for weights in [[0.6, 0.2, 0.2], [0.2, 0.6, 0.2], [0.2, 0.2, 0.6]] {
                let (mut at, mut position) = (glam::Vec2::ZERO, glam::Vec3::ZERO);
                for (&vertex, weight) in triangle.iter().zip(weights) {
                    at += mesh.uvs[texture.uv_set as usize][vertex as usize] * weight;
                    position += mesh.positions[vertex as usize] * weight;
                }
                if position.x.abs() > 0.1 {
                    let size = [image.width, image.height].map(|side| side as usize);
                    let x = ((at.x * size[0] as f32) as usize).min(size[0] - 1);
                    let y = ((at.y * size[1] as f32) as usize).min(size[1] - 1);
                    let texel = y * size[0] + x;
                    let is_cut_out = position.x > 0.0;
                    assert_eq!(texels[texel * 4 + 3], if is_cut_out { 0 } else { 255 });
                    seen[usize::from(is_cut_out)] += 1;
                }
            }
        }
        assert!(seen[0] > 5 && seen[1] > 5, "{seen:?}");
    }
}

#[test]
fn bakes_that_cannot_be_are_refused() {
    let folder = folder("bake-refused");
    let output = folder.join("x.glb").display().to_string();
    for (arguments, words) in [
        (vec!["cornell", "-o", "x.png"], ".glb"),
        (vec!["cornell", "-o", &output, "--atlas-size", "7"], "7"),
        (
            vec!["cornell", "-o", &output, "--texel-density=-1"],
            "density",
        ),
        (
            vec!["cornell", "-o", &output, "--texel-density", "1e5"],
            "pages",
        ),
        (
            vec!["cornell", "-o", &output, "--technique", "radiance"],
            "shadow-map",
        ),
        (
            vec![
                "cornell",
                "-o",
                &output,
                "--technique",
                "radiosity",
                "--denoise",
            ],
            "path-tracing",
        ),
        (vec!["nowhere", "-o", &output], "nowhere"),
        (
            vec![
                "cornell",
                "-o",
                &output,
                "--bake-mode",
                "lightmap",
                "--lobes",
                "all",
            ],
            "lightmap",
        ),
        (
            vec!["cornell", "-o", &output, "--lightmap-for", "bevy"],
            "--bake-mode lightmap",
        ),
        (
            vec![
                "cornell",
                "-o",
                &output,
                "--bake-mode=lightmap",
                "--lightmap-for=babylon",
            ],
            "--bake-mode emissive",
        ),
        (
            vec!["cornell", "-o", &output, "--set", "obscurances.distance=2"],
            "not in use",
        ),
        (
            vec![
                "cornell",
                "-o",
                &output,
                "--technique",
                "obscurances",
                "--set",
                "obscurances.distance=0",
            ],
            "distance",
        ),
    ] {
        let done = gpugi(&[&["bake"][..], &arguments].concat());
        let errors = String::from_utf8_lossy(&done.stderr).into_owned();
        assert_eq!(done.status.code(), Some(2), "{arguments:?}: {errors}");
        assert!(errors.contains(words), "{arguments:?}: {errors}");
    }
    assert!(!folder.join("x.glb").exists());
}

#[test]
fn an_irradiance_volume_is_a_3d_texture() {
    if skip_gpu() {
        return;
    }
    let folder = folder("volume");
    let path = folder.join("volume.ktx2");
    let output = path.display().to_string();
    let bake = |options: &[&str]| {
        let first = ["bake", "cornell", "-o", &output];
        gpugi(&[&first[..], options].concat())
    };
    let density = ["--irradiance-volume", "0.5"];
    let techniques = ["--technique", "shadow-map,final-gather"];
    let coarse = [
        "--set",
        "final-gather.density=0.3",
        "--set",
        "final-gather.resolution=16",
    ];
    let baked = bake(&[&density[..], &techniques, &coarse].concat());
    assert_eq!(baked.status.code(), Some(0), "{baked:?}");
    let said = String::from_utf8_lossy(&baked.stdout).into_owned();
    assert!(said.contains("3 x 3 x 3 ambient cubes"), "{said}");
    // Width, height and depth of KTX2's header.
    let bytes = std::fs::read(&path).expect("a file");
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
    assert_eq!([word(20), word(24), word(28)], [3, 6, 9]);
    let harmonics = [&density[..], &["--volume-as", "harmonics"]].concat();
    let baked = bake(&[&harmonics[..], &techniques, &coarse].concat());
    assert_eq!(baked.status.code(), Some(0), "{baked:?}");
    let bytes = std::fs::read(&path).expect("a file");
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
    assert_eq!([word(20), word(24), word(28)], [3, 9, 9]);
    // The same numbers in JSON.
    let json = folder.join("volume.json").display().to_string();
    let first = ["bake", "cornell", "-o", &json];
    let baked = gpugi(&[&first[..], &density, &techniques, &coarse].concat());
    assert_eq!(baked.status.code(), Some(0), "{baked:?}");
    let volume: HarmonicVolume =
        serde_json::from_slice(&std::fs::read(&json).expect("a file")).expect("a volume");
    assert_eq!(volume.counts.to_array(), [3, 3, 3]);
    let texels = volume.texture().levels.concat();
    let start = bytes.len() - 8 * texels.len();
    for (texel, stored) in texels.iter().zip(bytes[start..].chunks_exact(8)) {
        let stored: Vec<u16> = stored
            .chunks_exact(2)
            .map(|half| u16::from_le_bytes([half[0], half[1]]))
            .collect();
        assert_eq!(texel.map(half::f16::to_bits)[..], stored[..]);
    }
    assert!(
        volume
            .radiance_coefficients
            .iter()
            .all(|coefficients| coefficients[0].x > 0.0)
    );
    let cubes = ["--volume-as", "cubes"];
    let wrong = gpugi(&[&first[..], &density, &techniques, &cubes].concat());
    assert_eq!(wrong.status.code(), Some(2), "{wrong:?}");
    for wrong in [
        &density[..],
        &cubes,
        &[&density[..], &["--technique", "shadow-map"]].concat(),
        &[&["--irradiance-volume", "-1"], &techniques[..]].concat(),
    ] {
        assert_eq!(bake(wrong).status.code(), Some(2), "{wrong:?}");
    }
}

/// A square, and two triangles that are next to lines.
#[test]
fn triangles_too_thin_for_texels_are_counted() {
    if skip_gpu() {
        return;
    }
    let folder = folder("bake-thin");
    let scene = folder.join("x.obj");
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n";
    let lines = "v 0 0 1\nv 1 0 1\nv 0.5 1e-9 1\no line\nf 5 6 7\no other\nf 6 7 5\n";
    std::fs::write(&scene, [square, lines].concat()).expect("a scene");
    let output = folder.join("x.glb").display().to_string();
    let scene = scene.display().to_string();
    let options = ["--atlas-size", "32", "--technique", "obscurances"];
    let done = gpugi(&[&["bake", &scene, "-o", &output], &options[..]].concat());
    let notes = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{notes}");
    assert!(
        notes.contains("note: 2 triangles are too thin for texels of their own"),
        "{notes}"
    );
}
