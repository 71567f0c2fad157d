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
fn a_missing_or_damaged_texture_is_left_out() {
    let left_out = |file: &File, note: &str| {
        let scene = file.import_with_note(note);
        assert!(scene.warnings[0].ends_with("the texture is left out"));
        assert!(scene.images.is_empty() && scene.textures.is_empty());
        scene.materials[0].clone()
    };
    let missing = showing(json!({ "uri": "gone.png" }));
    left_out(&missing, "images[0].uri: cannot read \"gone.png\"");
    left_out(&showing(json!({})), "images[0]: the image has neither uri");
    let mut file = showing(json!({}));
    let bytes = png(1, 1, &TEXEL);
    let view = file.view(&bytes[..bytes.len() / 2]);
    file.json["images"][0] = json!({ "bufferView": view, "name": "half" });
    left_out(&file, "images[0]: \"half\"");
    file.json["images"][0] = json!({ "bufferView": 9 });
    left_out(&file, "images[0].bufferView: bufferView 9 is out of range");
    file.json["textures"][0]["source"] = json!(9);
    left_out(&file, "textures[0]: image 9 is out of range");
    file.json["materials"][0]["emissiveTexture"]["index"] = json!(9);
    left_out(
        &file,
        "materials[0].emissiveTexture: texture 9 is out of range",
    );
}

#[test]
fn without_its_texture_a_surface_neither_glows_nor_is_metal() {
    let info = json!({ "index": 0 });
    let mut file = File::with_material(json!({
        "emissiveFactor": [1.0, 2.0, 3.0],
        "emissiveTexture": info,
        "normalTexture": info,
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.25, 1.0, 1.0],
            "baseColorTexture": info,
            "metallicRoughnessTexture": info,
            "roughnessFactor": 0.75,
        },
    }));
    file.push("images", json!({ "uri": "gone.png" }));
    file.push("textures", json!({ "source": 0 }));
    let scene = file.import_with_note("images[0].uri: ");
    let material = &scene.materials[0];
    assert_eq!(material.base_color.to_array(), [0.5, 0.25, 1.0, 1.0]);
    assert_eq!(material.emissive, glam::Vec3::ZERO);
    assert_eq!((material.metallic, material.roughness), (0.0, 0.75));
}

#[test]
fn many_damaged_images_take_no_longer_than_many_whole_ones() {
    let side = 4096;
    let mut bytes = png(side, side, &vec![0; (side * side * 4) as usize]);
    bytes.truncate(bytes.len() - 40);
    let mut file = File::triangle();
    let view = file.view(&bytes);
    for index in 0..1000 {
        file.push("images", json!({ "bufferView": view }));
        file.push("textures", json!({ "source": index }));
        file.push("materials", json!({ "normalTexture": { "index": index } }));
    }
    let limits = Limits {
        image_bytes: u64::from(side * side * 4),
        ..Limits::default()
    };
    let scene = import("a.glb", &file.glb(), &Files::default(), &limits).unwrap();
    assert!(scene.images.is_empty());
    let said = |text: &str| scene.warnings.iter().any(|note| note.contains(text));
    assert!(
        said("images[0]") && said("images[1]: 1 bytes exceed the 0"),
        "{:?}",
        &scene.warnings[..3]
    );
}

#[test]
fn optional_formats_fall_back() {
    let mut file = showing(json!({}));
    let view = file.view(&png(1, 1, &TEXEL));
    file.json["images"][0] = json!({ "bufferView": view });
    file.push("images", json!({ "uri": "never-read.avif" }));
    file.json["extensionsUsed"] = json!(["EXT_texture_avif"]);
    file.json["textures"][0]["extensions"] = json!({ "EXT_texture_avif": { "source": 1 } });
    let scene = file.import();
    assert_eq!(scene.images[0].pixels, Pixels::Rgba8(TEXEL.to_vec()));
    assert!(scene.warnings[0].contains("EXT_texture_avif"));
    // Nothing to fall back on.
    file.json["textures"][0]
        .as_object_mut()
        .unwrap()
        .remove("source");
    let scene = file.import();
    assert!(scene.images.is_empty());
    let notes = scene.warnings.iter();
    let texture = notes.filter(|note| note.starts_with("textures[0]: the texture has no PNG"));
    assert_eq!(texture.count(), 1);
}

/// A WebP whose picture is larger than its header says, and a film, are refused before they are decoded.
#[test]
fn webp_is_as_large_as_it_says() {
    let mut plain = Vec::new();
    image::codecs::webp::WebPEncoder::new_lossless(&mut plain)
        .encode(&[TEXEL; 6].concat(), 3, 2, image::ExtendedColorType::Rgba8)
        .unwrap();
    let extended = |flags: u8, width: u8| {
        let header = [flags, 0, 0, 0, width - 1, 0, 0, 1, 0, 0];
        let chunks = [b"VP8X", &10_u32.to_le_bytes()[..], &header, &plain[12..]].concat();
        let length = (4 + chunks.len() as u32).to_le_bytes();
        [b"RIFF", &length[..], b"WEBP", &chunks].concat()
    };
    let read = |bytes: &[u8]| {
        let image = gpugi_scene::image::decode_color("a.webp", bytes, &Limits::default());
        image
            .map(|image| image.width)
            .map_err(|error| error.to_string())
    };
    assert_eq!(read(&plain), Ok(3));
    assert_eq!(read(&extended(0x10, 3)), Ok(3));
    assert!(
        read(&extended(0x10, 2))
            .unwrap_err()
            .contains("as large as")
    );
    let film = read(&extended(0x12, 3));
    assert!(film.is_err(), "{film:?}");
}

#[test]
fn webp_and_basis_universal_need_nothing_to_fall_back_on() {
    let mut webp = Vec::new();
    image::codecs::webp::WebPEncoder::new_lossless(&mut webp)
        .encode(&TEXEL, 1, 1, image::ExtendedColorType::Rgba8)
        .unwrap();
    let basis = crate::basis::file(crate::basis::UASTC);
    for (extension, bytes, size) in [
        ("EXT_texture_webp", webp, 1),
        ("KHR_texture_basisu", basis, crate::basis::WIDTH),
    ] {
        let mut file = showing(json!({}));
        let view = file.view(&bytes);
        file.json["images"][0] = json!({ "bufferView": view });
        file.json["textures"][0] = json!({ "extensions": { extension: { "source": 0 } } });
        for list in ["extensionsUsed", "extensionsRequired"] {
            file.json[list] = json!([extension]);
        }
        let scene = file.import();
        assert_eq!(scene.images[0].width, size, "{extension}");
        assert!(scene.materials[0].emissive_texture.is_some());
        if size == 1 {
            assert_eq!(scene.images[0].pixels, Pixels::Rgba8(TEXEL.to_vec()));
        }
    }
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
        import("a.glb", &file.glb(), &Files::default(), &limits).unwrap()
    };
    assert_eq!(with_limit(512).images.len(), 2);
    let scene = with_limit(511);
    assert_eq!(scene.images.len(), 1);
    assert!(scene.warnings[0].contains("255"), "{:?}", scene.warnings);
}
