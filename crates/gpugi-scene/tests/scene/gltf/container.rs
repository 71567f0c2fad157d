//! Files, buffers, versions and extensions.

use gpugi_scene::{Limits, import};
use serde_json::json;

use crate::builder::{File, Files};

#[test]
fn binary_embedded_and_separate_buffers_agree() {
    let file = File::triangle();
    let mut files = Files::default();
    files
        .0
        .insert("my buffer.bin".to_owned(), file.binary.clone());
    let limits = Limits::default();
    let binary = import("a.glb", &file.glb(), &files, &limits).unwrap();
    let embedded = import("a.gltf", &file.gltf_with_data(), &files, &limits).unwrap();
    let separate = import("a.gltf", &file.gltf("my%20buffer.bin"), &files, &limits).unwrap();
    assert_eq!(binary.meshes[0].positions.len(), 3);
    assert_eq!(binary.meshes, embedded.meshes);
    assert_eq!(binary.meshes, separate.meshes);
}

#[test]
fn a_missing_buffer_is_named() {
    let bytes = File::triangle().gltf("gone.bin");
    let error = import("a.gltf", &bytes, &Files::default(), &Limits::default()).unwrap_err();
    assert_eq!(error.place, "buffers[0].uri");
    assert!(error.reason.contains("gone.bin"), "{error}");
}

#[test]
fn a_remote_buffer_is_refused() {
    let bytes = File::triangle().gltf("https://example.com/a.bin");
    let error = import("a.gltf", &bytes, &Files::default(), &Limits::default()).unwrap_err();
    assert!(error.reason.contains("https"), "{error}");
}

#[test]
fn a_short_buffer_is_named() {
    let mut files = Files::default();
    files.0.insert("a.bin".to_owned(), vec![0; 35]);
    let bytes = File::triangle().gltf("a.bin");
    let error = import("a.gltf", &bytes, &files, &Limits::default()).unwrap_err();
    assert_eq!(error.place, "buffers[0]");
    assert!(error.reason.contains("35 bytes"), "{error}");
}

#[test]
fn every_truncation_is_an_error() {
    let bytes = File::triangle().glb();
    for length in 0..bytes.len() {
        import(
            "a.glb",
            &bytes[..length],
            &Files::default(),
            &Limits::default(),
        )
        .expect_err("a truncated file");
    }
}

#[test]
fn other_versions_are_refused() {
    let mut file = File::triangle();
    file.json["asset"]["version"] = json!("1.0");
    file.assert_error("asset.version", "glTF 2.0");
    file.json["asset"] = json!({ "version": "2.1", "minVersion": "2.1" });
    file.assert_error("asset.version", "glTF 2.0");
    file.json["asset"] = json!({ "version": "2.1", "minVersion": "2.0" });
    file.import();
}

#[test]
fn a_required_extension_is_an_error_that_names_it() {
    let mut file = File::triangle();
    file.json["extensionsRequired"] = json!(["KHR_texture_transform", "EXT_unheard_of"]);
    file.assert_error("extensionsRequired[1]", "EXT_unheard_of");
}

#[test]
fn an_optional_extension_is_a_warning_that_names_it() {
    let mut file = File::triangle();
    file.json["extensionsUsed"] = json!(["KHR_materials_ior", "EXT_unheard_of"]);
    let warnings = file.import().warnings;
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(warnings[0].contains("EXT_unheard_of"));
}

#[test]
fn a_file_may_hold_nothing() {
    let scene = File::empty().import();
    assert!(scene.instances.is_empty() && scene.rig.is_none());
}

#[test]
fn numbers_beyond_floats_are_refused() {
    let mut file = File::triangle();
    file.json["nodes"][0]["translation"] = json!([1e99, 0.0, 0.0]);
    file.assert_error("nodes[0].translation", "exceeds 32-bit floats");
}

/// Without the feature, the error says how to get it.
#[cfg(not(feature = "meshopt"))]
#[test]
fn meshopt_needs_its_feature() {
    let mut file = File::triangle();
    file.json["extensionsRequired"] = json!(["EXT_meshopt_compression"]);
    file.assert_error("extensionsRequired[0]", "cargo feature meshopt");
}

#[test]
fn text_may_begin_with_a_byte_order_mark() {
    let text = File::triangle().gltf_with_data();
    let read = |bytes: &[u8]| import("a.gltf", bytes, &Files::default(), &Limits::default());
    let scene = read(&[b"\xef\xbb\xbf", &text[..]].concat()).unwrap();
    assert_eq!(scene, read(&text).unwrap());
    let wide = String::from_utf8(text).unwrap();
    let wide: Vec<u8> = wide.encode_utf16().flat_map(u16::to_le_bytes).collect();
    for bytes in [&wide[..], &[b"\xff\xfe", &wide[..]].concat()] {
        let error = read(bytes).unwrap_err().to_string();
        assert_eq!(error, "a.gltf: JSON: this is UTF-16 text; save it as UTF-8");
    }
}
