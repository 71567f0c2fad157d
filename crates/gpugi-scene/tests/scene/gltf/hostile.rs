//! Damaged files give an error or a scene, soon, and never a panic.

use std::time::{Duration, Instant};

use gpugi_scene::{Limits, import};
use serde_json::json;

use crate::builder::{File, Files, U16, png};

/// Marsaglia's xorshift: the same damage in every run.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % bound as u64) as usize
    }
}

/// A file that uses every part of the importer.
fn everything() -> File {
    let mut file = File::with_material(json!({
        "normalTexture": { "index": 0 },
        "extensions": {
            "KHR_materials_pbrSpecularGlossiness": { "specularGlossinessTexture": { "index": 0 } },
            "KHR_materials_volume": { "thicknessFactor": 1.0 },
        },
        "extras": { "gpugi": { "phong": { "kd": [0.5, 0.5, 0.5], "ks": [0.1, 0.1, 0.1], "shininess": 10 } } },
    }));
    let view = file.view(&png(2, 2, &[200; 16]));
    file.push("images", json!({ "bufferView": view }));
    file.push("textures", json!({ "source": 0, "sampler": 0 }));
    file.push("samplers", json!({ "wrapS": 33071 }));
    let uvs = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    file.attribute("TEXCOORD_0", uvs);
    let indices = file.indices(&[0, 1, 2, 2, 1]);
    file.primitive()["indices"] = json!(indices);
    file.primitive()["mode"] = json!(5);
    let joints = file.accessor("VEC4", U16, 3, &[0; 24]);
    file.attribute("JOINTS_0", joints);
    let weights = file.floats("VEC4", &[0.25; 12]);
    file.attribute("WEIGHTS_0", weights);
    let target = file.floats("VEC3", &[0.5; 9]);
    file.primitive()["targets"] = json!([{ "POSITION": target }]);
    let sparse_indices = file.view(&[1, 0, 0, 0]);
    let sparse_values = file.view(&[0; 12]);
    file.json["accessors"][0]["sparse"] = json!({
        "count": 1,
        "indices": { "bufferView": sparse_indices, "componentType": 5121 },
        "values": { "bufferView": sparse_values },
    });
    let matrices = file.floats("MAT4", &glam::Mat4::IDENTITY.to_cols_array());
    file.push(
        "skins",
        json!({ "joints": [1], "inverseBindMatrices": matrices }),
    );
    file.json["nodes"][0] = json!({ "mesh": 0, "skin": 0, "children": [1] });
    file.push("cameras", json!({ "perspective": { "yfov": 1.0 } }));
    file.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "spot" }] } });
    file.push("nodes", json!({
        "camera": 0, "scale": [1.0, 2.0, 3.0], "extensions": { "KHR_lights_punctual": { "light": 0 } },
    }));
    let input = file.floats("SCALAR", &[0.0, 1.0]);
    let output = file.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
    file.push(
        "animations",
        json!({
            "channels": [{ "sampler": 0, "target": { "node": 1, "path": "translation" } }],
            "samplers": [{ "input": input, "output": output }],
        }),
    );
    file.push("scenes", json!({ "nodes": [0] }));
    file
}

/// Damages `bytes` in one to four places, sometimes cuts them, and imports them under limits that a test can afford.
fn survives(name: &str, bytes: &[u8], cases: u64) {
    let limits = Limits {
        file_bytes: 1 << 20,
        image_side: 1024,
        image_bytes: 1 << 22,
        scene_bytes: 1 << 24,
        expansion: 1024,
        displaced_triangles: 0,
    };
    let mut imported = 0;
    for case in 1..=cases {
        let mut random = Random(case.wrapping_mul(0x9E37_79B9_7F4A_7C15));
        let mut damaged = bytes.to_vec();
        for _ in 0..=random.below(4) {
            let at = random.below(damaged.len());
            let rest = &mut damaged[at..];
            if random.below(4) == 0 {
                rest[0] = random.below(256) as u8;
            } else if let Some(digit) = rest.iter_mut().find(|byte| byte.is_ascii_digit()) {
                // Another digit keeps JSON valid, so that the damage reaches what stands behind it.
                *digit = b'0' + random.below(10) as u8;
            }
        }
        if random.below(8) == 0 {
            damaged.truncate(random.below(damaged.len()));
        }
        let start = Instant::now();
        if let Ok(mut scene) = import(name, &damaged, &Files::default(), &limits) {
            imported += 1;
            scene.pose(0.3);
            for mesh in &scene.meshes {
                mesh.check()
                    .unwrap_or_else(|reason| panic!("case {case}: {reason}"));
            }
        }
        let took = start.elapsed();
        assert!(took < Duration::from_secs(2), "case {case} took {took:?}");
    }
    println!("{name}: {imported} of {cases} damaged files imported");
}

#[test]
fn the_undamaged_file_uses_everything() {
    let scene = everything().import();
    assert_eq!(scene.warnings, Vec::<String>::new());
    assert!(
        scene
            .rig
            .is_some_and(|rig| rig.deformers.len() == 1 && rig.animations.len() == 1)
    );
    assert_eq!(
        (scene.lights.len(), scene.cameras.len(), scene.images.len()),
        (1, 1, 2)
    );
}

#[test]
fn damaged_json_survives() {
    survives("a.gltf", &everything().gltf_with_data(), 2000);
}

#[test]
fn damaged_binaries_survive() {
    survives("a.glb", &everything().glb(), 2000);
}

#[test]
fn replaced_numbers_survive() {
    // Every number of the JSON, one after the other, becomes each of these.
    let bytes = everything().gltf_with_data();
    let text = String::from_utf8(bytes).unwrap();
    let numbers = [
        "0",
        "1",
        "-1",
        "3",
        "255",
        "4294967295",
        "18446744073709551615",
        "1e38",
        "-0.5",
        "null",
    ];
    let characters: Vec<char> = text.chars().collect();
    let mut at = 0;
    let mut cases = 0;
    while at < characters.len() {
        let starts = characters[at].is_ascii_digit() && ":[,".contains(characters[at - 1]);
        if !starts {
            at += 1;
            continue;
        }
        let length = characters[at..]
            .iter()
            .take_while(|c| c.is_ascii_digit() || **c == '.')
            .count();
        for number in numbers {
            let before: String = characters[..at].iter().collect();
            let after: String = characters[at + length..].iter().collect();
            let damaged = format!("{before}{number}{after}");
            let limits = Limits {
                scene_bytes: 1 << 24,
                ..Limits::default()
            };
            let start = Instant::now();
            let _ = import("a.gltf", damaged.as_bytes(), &Files::default(), &limits);
            assert!(start.elapsed() < Duration::from_secs(2), "{number} at {at}");
            cases += 1;
        }
        at += length;
    }
    assert!(cases > 500, "{cases} cases");
}

#[test]
fn lists_that_multiply_are_limited() {
    // 3,000 nodes show a mesh of 3,000 primitives: nine million instances of a small file.
    let mut file = File::triangle();
    let primitive = file.primitive().clone();
    file.json["meshes"][0]["primitives"] = json!(vec![primitive; 3000]);
    file.json["nodes"] = json!(vec![json!({ "mesh": 0 }); 3000]);
    let limits = Limits {
        scene_bytes: 100 << 20,
        ..Limits::default()
    };
    let error = import("a.glb", &file.glb(), &Files::default(), &limits).unwrap_err();
    assert!(error.reason.contains("exceed the limit"), "{error}");
}

#[test]
fn deeply_nested_json_is_an_error() {
    let nested = "[".repeat(100_000) + &"]".repeat(100_000);
    let json = format!(r#"{{"asset":{{"version":"2.0"}},"materials":[{{"extras":{nested}}}]}}"#);
    let error = import(
        "a.gltf",
        json.as_bytes(),
        &Files::default(),
        &Limits::default(),
    );
    let place = error.unwrap_err().place;
    assert!(
        place.starts_with("materials[0].extras") && place.len() < 80,
        "{place}"
    );
}

#[test]
fn extreme_coordinates_stay_finite() {
    let huge = [0.0, 1e-45, -1e-20, 1.0, 1e18, -3e38, f32::MAX];
    let mut random = Random(7);
    for _ in 0..200 {
        let mut file = File::with_material(json!({ "normalTexture": { "index": 0 } }));
        let view = file.view(&png(1, 1, &[128; 4]));
        file.push("images", json!({ "bufferView": view }));
        file.push("textures", json!({ "source": 0 }));
        let mut values = |count: usize| -> Vec<f32> {
            (0..count).map(|_| huge[random.below(huge.len())]).collect()
        };
        let (positions, normals, uvs) = (values(36), values(36), values(24));
        for (name, kind, values) in [
            ("POSITION", "VEC3", positions),
            ("NORMAL", "VEC3", normals),
            ("TEXCOORD_0", "VEC2", uvs),
        ] {
            let accessor = file.floats(kind, &values);
            file.attribute(name, accessor);
        }
        let mesh = &file.import().meshes[0];
        mesh.check().unwrap();
        assert!(mesh.tangents.iter().all(|tangent| tangent.is_finite()));
        assert!(!mesh.tangents.is_empty());
    }
}
