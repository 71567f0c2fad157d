//! A room in map coordinates looks as it does at the origin, and what goes in and out is in its file's coordinates.

use std::path::Path;

use crate::common::{channel, folder, gpugi, skip_gpu};
use gpugi::bake::HarmonicVolume;
use gpugi_scene::{Limits, builtin, export, image};

const ROOTS: [[f64; 3]; 4] = [
    [0.0; 3],
    [1e4, 0.0, 2e4],
    [500_000.25, 100.0, 400_000.5],
    [1e6, 1e6, 1e6],
];

/// The pixels of an EXR.
fn pixels(path: &Path) -> Vec<[f32; 3]> {
    let bytes = std::fs::read(path).expect("a picture");
    let picture = image::decode_radiance("picture", &bytes, &Limits::default());
    let gpugi_scene::Pixels::Rgba32Float(texels) = picture.expect("an EXR").pixels else {
        panic!("floats");
    };
    let texels = texels.as_chunks::<4>().0.iter();
    texels
        .map(|&[red, green, blue, _]| [red, green, blue])
        .collect()
}

fn mean(pixels: &[[f32; 3]]) -> f32 {
    pixels.as_flattened().iter().sum::<f32>() / (3 * pixels.len()) as f32
}

#[test]
fn a_far_room_looks_as_it_does_at_the_origin() {
    if skip_gpu() {
        return;
    }
    let folder = folder("far-from-origin");
    let mut scene = builtin::builtin("cornell", 1).expect("a scene");
    let eye = scene.cameras[0]
        .world_from_view
        .w_axis
        .truncate()
        .as_dvec3();
    scene.cameras.clear();
    let mut at_origin = Vec::new();
    for (index, root) in ROOTS.into_iter().enumerate() {
        scene.origin = root.into();
        let file = folder.join(format!("{index}.glb"));
        let glb = export::export_scene(&scene).expect("a file").glb;
        std::fs::write(&file, glb).expect("a file");
        let [from, to] = [eye, glam::DVec3::new(0.0, 1.0, 0.0)].map(|point| point + scene.origin);
        let camera = format!(
            "eye={},{},{};target={},{},{}",
            from.x, from.y, from.z, to.x, to.y, to.z
        );
        let render = |name: &str, more: &[&str]| {
            let output = folder.join(name);
            let (file, path) = (file.display().to_string(), output.display().to_string());
            let fixed = [
                "render", &file, "-o", &path, "--size", "16x16", "--camera", &camera,
            ];
            let run = gpugi(&[&fixed, more].concat());
            let said = String::from_utf8_lossy(&run.stderr).into_owned();
            assert!(run.status.success(), "{said}");
            pixels(&output)
        };
        // Two iterations are soon done, and alike everywhere.
        let quick = ["--samples", "4", "--set", "radiosity.iterations=2"];
        let default = render(
            "default.exr",
            &[&quick[..], &["--aov", "position"]].concat(),
        );
        let traced = render(
            "traced.exr",
            &["--technique", "path-tracer", "--samples", "16"],
        );
        let [x, y, z] = ["X", "Y", "Z"]
            .map(|axis| channel(&folder.join("default.exr"), &format!("Position.{axis}")));
        let positions: Vec<_> = (0..x.len()).map(|at| [x[at], y[at], z[at]]).collect();
        let found = [mean(&default), mean(&traced)];
        if index == 0 {
            at_origin = vec![default, traced, positions];
            continue;
        }
        for (found, expected) in found.iter().zip(&at_origin) {
            let expected = mean(expected);
            assert!(
                (found / expected - 1.0).abs() < 0.02,
                "{root:?}: {found}, not {expected}"
            );
        }
        // Zero where no surface is; 32 bits have steps of 6 cm there.
        for (far, near) in positions.iter().zip(&at_origin[2]) {
            let is_moved = (0..3).all(|axis| {
                let moved = f64::from(far[axis]) - f64::from(near[axis]);
                near[axis] == 0.0 || (moved - root[axis]).abs() < 0.07
            });
            assert!(is_moved, "{root:?}: {far:?}, not {near:?}");
        }
    }
}

#[test]
fn a_volume_is_in_the_coordinates_of_the_file() {
    if skip_gpu() {
        return;
    }
    let folder = folder("far-volume");
    let mut scene = builtin::builtin("cornell", 1).expect("a scene");
    let near = scene.statistics();
    scene.origin = ROOTS[2].into();
    let [file, output] = ["far.glb", "far.json"].map(|name| folder.join(name));
    let glb = export::export_scene(&scene).expect("a file").glb;
    std::fs::write(&file, glb).expect("a file");
    let [from, to] = [&file, &output].map(|path| path.display().to_string());
    let run = gpugi(&[
        "bake",
        &from,
        "-o",
        &to,
        "--technique",
        "final-gather",
        "--irradiance-volume",
        "0.5",
    ]);
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.success(), "{said}");
    let volume = std::fs::read(&output).expect("a volume");
    let volume: HarmonicVolume = serde_json::from_slice(&volume).expect("a volume");
    for (found, near) in volume.bounds.iter().zip([near.bounds_min, near.bounds_max]) {
        let expected = glam::DVec3::from(near) + scene.origin;
        assert!(found.abs_diff_eq(expected, 1e-5), "{found}, not {expected}");
    }
}
