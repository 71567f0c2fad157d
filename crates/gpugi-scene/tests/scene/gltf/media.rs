//! `extras.gpugi.medium`.

use glam::{Mat4, Vec3};
use gpugi_scene::builtin::builtin;
use gpugi_scene::export::export_scene;
use gpugi_scene::{Limits, Medium, PhaseFunction, import};
use serde_json::{Value, json};

use crate::builder::{File, Files};

/// A KTX2 3D texture. `format`: VkFormat.
fn volume(format: u32, size: [u32; 3], texels: &[u8]) -> Vec<u8> {
    let mut bytes = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
    let [width, height, depth] = size;
    for word in [format, 4, width, height, depth, 0, 1, 1, 0] {
        bytes.extend(word.to_le_bytes());
    }
    // No descriptor, key or supercompression data.
    bytes.extend([0; 32]);
    for word in [104, texels.len() as u64, texels.len() as u64] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(texels);
    bytes
}

fn data_uri(bytes: &[u8]) -> String {
    use base64::Engine;
    let data = base64::engine::general_purpose::STANDARD.encode(bytes);
    format!("data:image/ktx2;base64,{data}")
}

/// A file with one node that holds `medium`.
fn filled(medium: Value) -> File {
    let mut file = File::empty();
    file.push(
        "nodes",
        json!({ "name": "fog", "scale": [2.0, 3.0, 4.0], "extras": { "gpugi": { "medium": medium } } }),
    );
    file
}

const R8: u32 = 9;
const R16F: u32 = 76;
const R32F: u32 = 100;

#[test]
fn a_node_and_a_scene_hold_media() {
    let mut file = filled(json!({
        "extinction": [1.0, 2.0, 3.0], "albedo": [0.5, 0.6, 0.7], "g": 0.25, "emission": [0.0, 0.0, 1.0],
    }));
    let everywhere =
        json!({ "extinction": [0.1, 0.1, 0.1], "phase": "cornette-shanks", "g": -0.5 });
    file.json["scenes"] =
        json!([{ "nodes": [0], "extras": { "gpugi": { "medium": everywhere } } }]);
    let media = file.import().media;
    let fog = Medium {
        name: "fog".into(),
        world_from_box: Some(Mat4::from_scale(Vec3::new(2.0, 3.0, 4.0))),
        extinction: Vec3::new(1.0, 2.0, 3.0),
        albedo: Vec3::new(0.5, 0.6, 0.7),
        phase: PhaseFunction::HenyeyGreenstein(0.25),
        emission: Vec3::Z,
        density: None,
        node: None,
    };
    let thin = Medium {
        world_from_box: None,
        extinction: Vec3::splat(0.1),
        albedo: Vec3::ONE,
        phase: PhaseFunction::CornetteShanks(-0.5),
        emission: Vec3::ZERO,
        ..fog.clone()
    };
    assert_eq!(media, [fog, thin]);
}

#[test]
fn densities_have_8_16_or_32_bits() {
    let halves: Vec<u8> = [0x3800_u16, 0x4000]
        .iter()
        .flat_map(|half| half.to_le_bytes())
        .collect();
    let floats: Vec<u8> = [0.5_f32, 2.0]
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    for (format, texels, expected) in [
        (R8, &[0, 255][..], [0.0, 1.0]),
        (R16F, &halves, [0.5, 2.0]),
        (R32F, &floats, [0.5, 2.0]),
    ] {
        let uri = data_uri(&volume(format, [1, 2, 1], texels));
        let file = filled(json!({ "extinction": [1.0, 1.0, 1.0], "density": uri }));
        let scene = file.import();
        let density = scene.media[0].density.as_ref().unwrap();
        assert_eq!(
            (density.size, &density.values[..]),
            ([1, 2, 1], &expected[..])
        );
    }
}

/// A NanoVDB grid of one tile of density 2, with two active voxels.
#[test]
fn densities_may_be_nanovdb_files() {
    let mut grid = vec![0; 672 + 64 + 64 + 32];
    let mut put = |at: usize, value: &[u8]| grid[at..at + value.len()].copy_from_slice(value);
    put(0, b"NanoVDB1");
    put(16, &(32_u32 << 21).to_le_bytes());
    // Of 32-bit floats; the root, the greatest corner of its box, and its tile.
    put(636, &[1]);
    put(672 + 24, &[64]);
    put(736 + 16, &[1]);
    put(736 + 24, &[1]);
    put(736 + 64 + 20, &2.0_f32.to_le_bytes());
    let imported = |density: &[u8]| {
        let uri = data_uri(density);
        filled(json!({ "extinction": [1.0, 1.0, 1.0], "density": uri })).try_import()
    };
    let scene = imported(&grid).unwrap();
    let density = scene.media[0].density.as_ref().unwrap();
    assert_eq!(
        (density.size, &density.values[..]),
        ([1, 2, 1], &[2.0, 2.0][..])
    );
    let error = imported(&grid[..700]).unwrap_err();
    assert_eq!(error.place, "nodes[0].extras.gpugi.medium.density");
    assert!(error.reason.contains("the file ends too early"), "{error}");
}

#[test]
fn media_without_meaning_are_refused() {
    let place = "nodes[0].extras.gpugi.medium";
    let with = |key: &str, value: Value| {
        let mut medium = json!({ "extinction": [1.0, 1.0, 1.0] });
        medium[key] = value;
        filled(medium)
    };
    with("extinction", json!([1.0, -1.0, 1.0])).assert_error(place, "extinction");
    with("albedo", json!([1.5, 0.0, 0.0])).assert_error(place, "albedo");
    with("emission", json!([1e40, 0.0, 0.0])).assert_error(place, "");
    with("g", json!(2.0)).assert_error(place, "g is not");
    with("anisotropy", json!(0.5)).assert_error(place, "anisotropy");
    with("phase", json!("rayleigh")).assert_error(place, "rayleigh");
    let mut flat = with("g", json!(0.0));
    flat.json["nodes"][0]["scale"] = json!([1.0, 0.0, 1.0]);
    flat.assert_error(place, "volume");

    let density = |bytes: &[u8]| with("density", json!(data_uri(bytes)));
    let place = "nodes[0].extras.gpugi.medium.density";
    with("density", json!("missing.ktx2")).assert_error(place, "missing.ktx2");
    density(b"noise").assert_error(place, "header");
    // 10^10 texels, and as many as no address space holds.
    density(&volume(R32F, [100_000, 100_000, 1], &[])).assert_error(place, "--limits");
    density(&volume(R32F, [u32::MAX; 3], &[])).assert_error(place, "--limits");
    density(&volume(R32F, [2, 2, 2], &[0; 31])).assert_error(place, "31 bytes");
    density(&volume(R32F, [2, 2, 0], &[0; 32])).assert_error(place, "3D");
    density(&volume(37, [1, 1, 1], &[0; 4])).assert_error(place, "one linear channel");
    let place = "nodes[0].extras.gpugi.medium";
    for value in [f32::NAN, -1.0] {
        let texels = value.to_le_bytes();
        density(&volume(R32F, [1, 1, 1], &texels)).assert_error(place, "density");
    }
    let mut everywhere = File::empty();
    let medium = json!({ "extinction": [1.0, 1.0, 1.0], "density": "x" });
    everywhere.json["scenes"] = json!([{ "extras": { "gpugi": { "medium": medium } } }]);
    everywhere.assert_error("scenes[0].extras.gpugi.medium", "no box");
}

/// Before the 65th of many media, nothing of it or of those after it is read.
#[test]
fn a_scene_has_at_most_64_media() {
    let medium = json!({ "extinction": [1.0, 1.0, 1.0] });
    let mut file = filled(medium.clone());
    for _ in 1..64 {
        file.push(
            "nodes",
            json!({ "extras": { "gpugi": { "medium": medium } } }),
        );
    }
    assert_eq!(file.import().media.len(), 64);
    let missing = json!({ "extinction": [1.0, 1.0, 1.0], "density": "missing.ktx2" });
    for _ in 64..10_000 {
        file.push(
            "nodes",
            json!({ "extras": { "gpugi": { "medium": missing } } }),
        );
    }
    file.assert_error("nodes[64].extras.gpugi.medium", "at most 64 media");
}

#[test]
fn written_media_come_back() {
    for name in ["cloud", "fog-room"] {
        let mut scene = builtin(name, 1).unwrap();
        scene.media.push(Medium {
            name: "fog".into(),
            world_from_box: None,
            density: None,
            ..scene.media[0].clone()
        });
        let glb = export_scene(&scene).unwrap().glb;
        let read = import("back.glb", &glb, &Files::default(), &Limits::default()).unwrap();
        assert_eq!(read.media, scene.media);
    }
}

#[test]
fn a_box_follows_its_node() {
    let mut file = filled(json!({ "extinction": [1.0, 1.0, 1.0] }));
    let times = file.floats("SCALAR", &[0.0, 1.0]);
    let places = file.floats("VEC3", &[0.0, 0.0, 0.0, 4.0, 0.0, 0.0]);
    file.push(
        "animations",
        json!({
            "samplers": [{ "input": times, "output": places }],
            "channels": [{ "sampler": 0, "target": { "node": 0, "path": "translation" } }],
        }),
    );
    let mut scene = file.import();
    scene.pose(0.5);
    let place = scene.media[0].world_from_box.unwrap();
    assert_eq!(place.w_axis.truncate(), Vec3::new(2.0, 0.0, 0.0));
    let bounds = scene.bounds();
    assert_eq!((bounds.min.x, bounds.max.x), (1.0, 3.0));
}
