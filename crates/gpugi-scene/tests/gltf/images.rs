//! Images of textures.

use gpugi_scene::{Limits, Pixels, import};
use serde_json::{Value, json};

use crate::builder::{File, Files, png};

const TEXEL: [u8; 4] = [10, 20, 30, 40];

/// A file whose material shows texture 0 of image 0.
fn showing(image: Value) -> File {
    let mut file = File::with_material(json!({ "emissiveTexture": { "index": 0 } }));
    file.push("images", image);
    file.push("textures", json!({ "source": 0 }));
    file
}

#[test]
fn images_come_from_views_files_and_data() {
    let bytes = png(1, 1, &TEXEL);
    let mut in_view = showing(json!({}));
    let view = in_view.view(&bytes);
    in_view.json["images"][0] = json!({ "bufferView": view, "mimeType": "image/png" });
    use base64::Engine;
    let data = base64::engine::general_purpose::STANDARD_NO_PAD.encode(&bytes);
    let in_data = showing(json!({ "uri": format!("data:image/png;base64,{data}") }));
    let in_file = showing(json!({ "uri": "a%20b.png" }));
    let mut files = Files::default();
    files.0.insert("a b.png".to_owned(), bytes);
    for file in [in_view, in_data, in_file] {
        let scene = import("a.glb", &file.glb(), &files, &Limits::default()).unwrap();
        assert_eq!(scene.images.len(), 1);
        assert_eq!(scene.images[0].pixels, Pixels::Rgba8(TEXEL.to_vec()));
    }
}

#[test]
fn a_missing_or_damaged_image_is_named() {
    showing(json!({ "uri": "gone.png" })).assert_error("images[0].uri", "gone.png");
    showing(json!({})).assert_error("images[0]", "neither uri nor bufferView");
    let mut file = showing(json!({}));
    let bytes = png(1, 1, &TEXEL);
    let view = file.view(&bytes[..bytes.len() / 2]);
    file.json["images"][0] = json!({ "bufferView": view, "name": "half" });
    file.assert_error("images[0]", "half");
}

#[test]
fn optional_formats_fall_back() {
    let mut file = showing(json!({}));
    let view = file.view(&png(1, 1, &TEXEL));
    file.json["images"][0] = json!({ "bufferView": view });
    file.push("images", json!({ "uri": "never-read.ktx2" }));
    file.json["extensionsUsed"] = json!(["KHR_texture_basisu"]);
    file.json["textures"][0]["extensions"] = json!({ "KHR_texture_basisu": { "source": 1 } });
    let scene = file.import();
    assert_eq!(scene.images[0].pixels, Pixels::Rgba8(TEXEL.to_vec()));
    assert!(scene.warnings[0].contains("KHR_texture_basisu"));
    // Nothing to fall back on.
    file.json["textures"][0]
        .as_object_mut()
        .unwrap()
        .remove("source");
    file.assert_error("textures[0]", "KHR_texture_basisu");
}

#[test]
fn images_that_no_material_shows_are_not_read() {
    let mut file = File::triangle();
    file.push("images", json!({ "uri": "gone.png" }));
    file.push("textures", json!({ "source": 0 }));
    assert!(file.import().images.is_empty());
}

#[test]
fn all_images_together_are_limited() {
    let mut file = showing(json!({}));
    let view = file.view(&png(8, 8, &[7; 256]));
    file.json["images"][0] = json!({ "bufferView": view });
    file.push("images", json!({ "bufferView": view }));
    file.push("textures", json!({ "source": 1 }));
    file.json["materials"][0]["pbrMetallicRoughness"] =
        json!({ "baseColorTexture": { "index": 1 } });
    let with_limit = |image_bytes: u64| {
        let limits = Limits {
            image_bytes,
            ..Limits::default()
        };
        import("a.glb", &file.glb(), &Files::default(), &limits)
    };
    with_limit(512).unwrap();
    let error = with_limit(511).unwrap_err();
    assert!(error.reason.contains("255"), "{error}");
}
