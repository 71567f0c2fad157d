//! What a bake does not touch stays as it was.

use base64::Engine;
use gpugi_scene::Scene;
use gpugi_scene::builtin::builtin;
use gpugi_scene::export::export_scene;
use serde_json::{Value, json};

use crate::builder::{File, Files, png};
use crate::export::baking::{Baked, assert_mapped, bake, obscured, shredded, try_bake, whole};

/// A file full of things that gpugi knows nothing of.
fn rich() -> File {
    let mut file = File::with_material(json!({ "name": "paint", "extras": { "mine": 1 } }));
    file.json["asset"]["generator"] = json!("somebody");
    file.json["extensionsUsed"] = json!(["VENDOR_things"]);
    file.json["extensions"] =
        json!({ "VENDOR_things": { "z": [1e-7, 0.1, 5e300], "a": "\u{e9}" } });
    file.json["unheard of"] = json!({ "z": 1, "a": 2, "m": null });
    file.json["meshes"][0]["extras"] = json!({ "kept": [true] });
    file.json["meshes"][0]["name"] = json!("shared");
    file.primitive()["extensions"] = json!({ "VENDOR_things": { "much": 3 } });
    file.json["nodes"][0] = json!({ "name": "left", "mesh": 0, "extras": 7 });
    file.push(
        "nodes",
        json!({ "name": "right", "mesh": 0, "translation": [2.0, 0.0, 0.0] }),
    );
    file.push("nodes", json!({ "name": "elsewhere", "mesh": 0 }));
    file.push("scenes", json!({ "nodes": [0, 1] }));
    file.push("scenes", json!({ "nodes": [2] }));
    let input = file.floats("SCALAR", &[0.0, 1.0]);
    file.json["accessors"][input]["min"] = json!([0.0]);
    file.json["accessors"][input]["max"] = json!([1.0]);
    let output = file.floats("VEC3", &[0.0; 6]);
    file.push(
        "animations",
        json!({
            "channels": [{ "sampler": 0, "target": { "node": 1, "path": "translation" } }],
            "samplers": [{ "input": input, "output": output }], "name": "still",
        }),
    );
    file
}

/// `after` begins with `before`, member by member in their order, but for what `changed` names at the root.
#[track_caller]
fn assert_kept(before: &Value, after: &Value, changed: &[&str]) {
    let (before, after) = (before.as_object().unwrap(), after.as_object().unwrap());
    for (name, value) in before {
        if !changed.contains(&name.as_str()) {
            assert_eq!(value.to_string(), after[name].to_string(), "{name}");
        }
    }
    let order: Vec<&String> = after
        .keys()
        .filter(|name| before.contains_key(*name))
        .collect();
    let expected: Vec<&String> = before.keys().collect();
    assert_eq!(order, expected);
}

/// The lists of `after` begin with those of `before`.
#[track_caller]
fn assert_appended(before: &Value, after: &Value, lists: &[&str]) {
    for list in lists {
        let before = before[list].as_array().unwrap();
        let after = &after[list].as_array().unwrap()[..before.len()];
        assert_eq!(
            Value::from(before.clone()).to_string(),
            Value::from(after).to_string(),
            "{list}"
        );
    }
}

#[test]
fn nodes_that_share_get_their_own_and_all_else_stays() {
    let file = rich();
    let scene = file.import();
    assert_eq!(scene.instances.len(), 2);
    let atlas = shredded(&scene);
    let baked = bake(&file, &scene, &atlas, obscured());
    assert_mapped(&scene, &atlas, &baked.scene, 1);
    let lists = ["accessors", "bufferViews", "meshes", "materials"];
    let mut changed = lists.to_vec();
    changed.push("nodes");
    assert_kept(&file.json, &baked.json, &changed);
    assert_appended(&file.json, &baked.json, &lists);
    assert_eq!(baked.binary[..file.binary.len()], file.binary);

    let mut nodes = file.json["nodes"].clone();
    nodes[0]["mesh"] = json!(1);
    nodes[1]["mesh"] = json!(2);
    assert_eq!(baked.json["nodes"].to_string(), nodes.to_string());
    for mesh in [1, 2] {
        let mesh = &baked.json["meshes"][mesh];
        assert_eq!(mesh["name"], "shared");
        assert_eq!(mesh["extras"], json!({ "kept": [true] }));
        let primitive = &mesh["primitives"][0];
        assert_eq!(
            primitive["extensions"],
            json!({ "VENDOR_things": { "much": 3 } })
        );
        assert_eq!(primitive["material"], 1);
    }
    let material = &baked.json["materials"][1];
    assert_eq!(material["name"], "paint");
    assert_eq!(material["extras"], json!({ "mine": 1 }));
}

#[test]
fn instances_outside_the_atlas_keep_what_they_share() {
    let file = rich();
    let scene = file.import();
    let mut atlas = whole(&scene);
    atlas.instances[0] = None;
    let baked = bake(&file, &scene, &atlas, obscured());
    assert_eq!(baked.json["nodes"][0], file.json["nodes"][0]);
    assert_eq!(baked.json["nodes"][1]["mesh"], 1);
    assert_appended(
        &file.json,
        &baked.json,
        &["accessors", "meshes", "materials"],
    );
}

#[test]
fn what_only_baked_instances_use_changes_in_place() {
    let mut file = rich();
    file.json["nodes"] = json!([{ "mesh": 0 }]);
    for list in ["animations", "scenes"] {
        file.json.as_object_mut().unwrap().remove(list);
    }
    let scene = file.import();
    let baked = bake(&file, &scene, &shredded(&scene), obscured());
    assert_kept(
        &file.json,
        &baked.json,
        &["accessors", "bufferViews", "meshes", "materials"],
    );
    assert_eq!(baked.json["meshes"].as_array().unwrap().len(), 1);
    assert_eq!(baked.json["materials"].as_array().unwrap().len(), 1);
    assert_eq!(baked.json["materials"][0]["extras"], json!({ "mine": 1 }));
}

#[test]
fn densities_beside_come_into_the_file() {
    let mut cloud = builtin("cloud", 1).unwrap();
    cloud.media.truncate(1);
    let written = Baked::new(&export_scene(&cloud).unwrap().glb);
    let nodes = written.json["nodes"].as_array().unwrap();
    let medium = nodes
        .iter()
        .find_map(|node| node.pointer("/extras/gpugi/medium"));
    let medium = medium.unwrap().clone();
    let (_, data) = medium["density"].as_str().unwrap().split_once(',').unwrap();
    let volume = base64::engine::general_purpose::STANDARD
        .decode(data)
        .unwrap();

    let mut file = File::triangle();
    file.json["nodes"][0]["extras"] = json!({ "gpugi": { "medium": medium } });
    file.json["nodes"][0]["extras"]["gpugi"]["medium"]["density"] = json!("a%20b.ktx2");
    let files = Files([("a b.ktx2".to_owned(), volume)].into());
    let limits = gpugi_scene::Limits::default();
    let scene = gpugi_scene::import("test.glb", &file.glb(), &files, &limits).unwrap();
    assert_eq!(scene.media[0].density, cloud.media[0].density);
    let exported = try_bake(&file.glb(), &files, &scene, &shredded(&scene), obscured()).unwrap();
    assert_eq!(exported.warnings, [""; 0]);
    assert_eq!(Baked::new(&exported.glb).scene.media, scene.media);
}

#[test]
fn buffers_and_images_beside_come_into_the_file() {
    let mut file = rich();
    let picture = png(1, 1, &[1, 2, 3, 255]);
    file.push("images", json!({ "name": "beside", "uri": "a%20b.png" }));
    let data = base64::engine::general_purpose::STANDARD.encode(&picture);
    let data = format!("data:image/png;base64,{data}");
    file.push("images", json!({ "uri": data }));
    file.push("images", json!({ "uri": "gone.png" }));
    // The positions in a second buffer, all else in the first.
    let positions = file.binary[..36].to_vec();
    file.json["bufferViews"][0]["buffer"] = json!(1);
    file.json["buffers"] = json!([
        { "byteLength": file.binary.len(), "uri": "all.bin", "name": "first" },
        { "byteLength": 36, "uri": "positions.bin" },
    ]);
    let mut first = file.binary.clone();
    first[..36].fill(0xff);
    let files = Files(
        [
            ("all.bin".to_owned(), first),
            ("positions.bin".to_owned(), positions.clone()),
            ("a b.png".to_owned(), picture.clone()),
        ]
        .into(),
    );
    let bytes = file.gltf("");
    let limits = gpugi_scene::Limits::default();
    let scene = gpugi_scene::import("test.gltf", &bytes, &files, &limits).unwrap();
    let atlas = shredded(&scene);
    let exported = try_bake(&bytes, &files, &scene, &atlas, obscured()).unwrap();
    assert_eq!(exported.warnings.len(), 1);
    assert!(
        exported.warnings[0].contains("images[2]"),
        "{:?}",
        exported.warnings
    );
    let baked = Baked::new(&exported.glb);
    assert_mapped(&scene, &atlas, &baked.scene, 1);
    let buffer = &baked.json["buffers"];
    assert_eq!(buffer.as_array().unwrap().len(), 1);
    assert_eq!(buffer[0]["name"], "first");
    assert_eq!(buffer[0].get("uri"), None);
    assert_eq!(baked.view(&json!(0)), positions);
    let image = &baked.json["images"][0];
    assert_eq!(image["mimeType"], "image/png");
    assert_eq!(baked.view(&image["bufferView"]), picture);
    assert_eq!(baked.json["images"][1], file.json["images"][1]);
    assert_eq!(baked.json["images"][2], file.json["images"][2]);
}

#[test]
fn chunks_that_follow_the_binary_one_stay() {
    let file = rich();
    let mut glb = file.glb();
    let chunk = [&8_u32.to_le_bytes()[..], b"NEWSunheard!"].concat();
    glb.extend(&chunk);
    let length = (glb.len() as u32).to_le_bytes();
    glb[8..12].copy_from_slice(&length);
    let scene = file.import();
    let exported = try_bake(&glb, &Files::default(), &scene, &whole(&scene), obscured()).unwrap();
    assert!(exported.glb.ends_with(&chunk));
}

/// The first node stands in three places.
fn in_three_places() -> File {
    let mut file = rich();
    let translations = [0.0, -3.0, 0.0, 0.0, 3.0, 0.0, 0.0, 6.0, 0.0];
    let translations = file.floats("VEC3", &translations);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let rotations = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0 * half, 2.0 * half];
    let rotations = [&rotations[..], &[0.0, 0.0, 0.0, 1.0]].concat();
    let rotations = file.floats("VEC4", &rotations);
    let scales = file.floats("VEC3", &[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, -1.0, 2.0, 1.0]);
    file.json["extensionsUsed"] = json!(["VENDOR_things", "EXT_mesh_gpu_instancing"]);
    file.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    let attributes = json!({ "TRANSLATION": translations, "ROTATION": rotations, "SCALE": scales });
    file.json["nodes"][0]["extensions"] =
        json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
    file
}

#[test]
fn a_node_in_many_places_becomes_many_with_a_bake_each() {
    let file = in_three_places();
    let scene = file.import();
    let atlas = shredded(&scene);
    assert_eq!(atlas.instances.len(), 4);
    let baked = bake(&file, &scene, &atlas, obscured());
    let nodes = &baked.json["nodes"];
    let first = json!({ "name": "left", "extras": 7, "children": [3, 4, 5] });
    assert_eq!(nodes[0], first);
    for (number, node) in [3, 4, 5].into_iter().enumerate() {
        assert_eq!(nodes[node]["name"], format!("left {number}"));
    }
    assert_eq!(nodes[3].get("scale"), None);
    assert_eq!(nodes[5]["translation"], json!([0.0, 6.0, 0.0]));
    assert_eq!(nodes[5]["scale"], json!([-1.0, 2.0, 1.0]));
    assert_eq!(baked.json["extensionsUsed"], json!(["VENDOR_things"]));
    assert_eq!(baked.json.get("extensionsRequired"), None);
    // Where the scene has the places last, the bake has them first or last: their order does not matter.
    let by_place = |scene: &Scene| {
        let mut positions = crate::export::baking::positions(scene);
        positions.sort_by(|a, b| a.to_array().partial_cmp(&b.to_array()).unwrap());
        positions
    };
    for (found, expected) in by_place(&baked.scene).into_iter().zip(by_place(&scene)) {
        assert!(found.abs_diff_eq(expected, 1e-6), "{found}, not {expected}");
    }
    for (instance, uvs) in scene.instances.iter().zip(&atlas.instances) {
        let shown = baked.scene.instances.iter().find(|shown| {
            let (a, b) = (shown.world_from_mesh, instance.world_from_mesh);
            a.abs_diff_eq(b, 1e-6)
        });
        let mesh = &baked.scene.meshes[shown.unwrap().mesh];
        let found = mesh
            .indices
            .iter()
            .map(|&index| mesh.uvs[0][index as usize]);
        let found: Vec<_> = found.collect();
        assert_eq!(found, uvs.as_ref().unwrap().corners);
    }
}

#[test]
fn nodes_that_nobody_bakes_stay_in_many_places() {
    let mut file = in_three_places();
    file.json["nodes"][2]["extensions"] = file.json["nodes"][0]["extensions"].clone();
    let scene = file.import();
    let baked = bake(&file, &scene, &whole(&scene), obscured());
    assert_eq!(baked.json["nodes"][2], file.json["nodes"][2]);
    for list in ["extensionsUsed", "extensionsRequired"] {
        assert_eq!(baked.json[list], file.json[list]);
    }
    // One that bends is read, and stays, as one.
    let mut file = in_three_places();
    let offsets = file.floats("VEC3", &[0.0; 9]);
    file.json["accessors"][offsets]["min"] = json!([0.0, 0.0, 0.0]);
    file.json["accessors"][offsets]["max"] = json!([0.0, 0.0, 0.0]);
    file.primitive()["targets"] = json!([{ "POSITION": offsets }]);
    let scene = file.import();
    assert_eq!(scene.instances.len(), 2);
    let files = Files::default();
    let exported = try_bake(&file.glb(), &files, &scene, &whole(&scene), obscured());
    let exported = exported.unwrap();
    assert!(exported.warnings[0].contains("EXT_mesh_gpu_instancing"));
    let baked = Baked::new(&exported.glb);
    assert_eq!(baked.json["nodes"][0], file.json["nodes"][0]);
    assert_eq!(baked.json["meshes"][0], file.json["meshes"][0]);
}

/// Draco's data lacks the new coordinates.
#[test]
fn compression_gives_way_to_what_stands_beside_it() {
    let mut file = rich();
    file.json["extensionsUsed"] = json!(["VENDOR_things", "KHR_draco_mesh_compression"]);
    file.primitive()["extensions"]["KHR_draco_mesh_compression"] =
        json!({ "bufferView": 0, "attributes": { "POSITION": 0 } });
    let scene = file.import();
    let baked = bake(&file, &scene, &whole(&scene), obscured());
    let expected = json!({ "VENDOR_things": { "much": 3 } });
    assert_eq!(
        baked.json["meshes"][1]["primitives"][0]["extensions"],
        expected
    );
    assert_eq!(baked.json["meshes"][0], file.json["meshes"][0]);
}

#[cfg(feature = "meshopt")]
#[test]
fn packed_views_are_read_and_stay() {
    let vertices = [
        [0.0_f32, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [1.0, 1.0, 0.0],
    ];
    let encoded = meshopt::encode_vertex_buffer(&vertices).unwrap();
    let mut file = File::empty();
    file.view(&encoded);
    let length = file.binary.len();
    file.json["bufferViews"][0] = json!({
        "buffer": 0, "byteLength": 48, "byteStride": 12,
        "extensions": { "EXT_meshopt_compression": {
            "buffer": 1, "byteLength": encoded.len(), "byteStride": 12, "count": 4, "mode": "ATTRIBUTES",
        } },
    });
    file.json["buffers"] = json!([
        { "byteLength": 48, "extensions": { "EXT_meshopt_compression": { "fallback": true } } },
        { "byteLength": length, "uri": "packed.bin" },
    ]);
    file.json["extensionsUsed"] = json!(["EXT_meshopt_compression"]);
    file.json["extensionsRequired"] = json!(["EXT_meshopt_compression"]);
    let positions = json!({
        "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3",
        "min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 0.0],
    });
    file.push("accessors", positions);
    let mut bytes = file.clone();
    bytes.push(
        "meshes",
        json!({ "primitives": [{ "mode": 5, "attributes": { "POSITION": 0 } }] }),
    );
    bytes.push("nodes", json!({ "mesh": 0 }));
    let files = Files([("packed.bin".to_owned(), file.binary.clone())].into());
    let bytes = bytes.gltf("");
    let limits = gpugi_scene::Limits::default();
    let scene = gpugi_scene::import("test.gltf", &bytes, &files, &limits).unwrap();
    for atlas in [shredded(&scene), whole(&scene)] {
        let exported = try_bake(&bytes, &files, &scene, &atlas, obscured()).unwrap();
        let baked = Baked::new(&exported.glb);
        assert_mapped(&scene, &atlas, &baked.scene, 1);
        // The .glb's own buffer comes first.
        let view = &baked.json["bufferViews"][0];
        assert_eq!(view["buffer"], 1);
        assert_eq!(view["extensions"]["EXT_meshopt_compression"]["buffer"], 0);
        assert_eq!(baked.json["buffers"][1]["byteLength"], 48);
    }
}
