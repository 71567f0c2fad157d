//! Vertices that the atlas cuts apart keep everything else that they have, bit for bit.

use glam::{Vec3, vec2};
use gpugi_scene::export::{BakedLight, BakedPage};
use serde_json::{Value, json};

use crate::builder::{File, U16};
use crate::export::baking::{Baked, atlas, bake, obscured, positions, shredded, try_bake, whole};

/// Two triangles over four vertices, with every kind of attribute, a skin and a morph target.
fn quad() -> File {
    let mut file = File::empty();
    let positions: Vec<u8> = [[0_i16, 0, 0], [100, 0, 0], [0, 100, 0], [100, 100, 0]]
        .iter()
        .flat_map(|[x, y, z]| [*x, *y, *z, 0])
        .flat_map(i16::to_le_bytes)
        .collect();
    let position = file.accessor("VEC3", 5122, 4, &positions);
    file.json["bufferViews"][0]["byteStride"] = json!(8);
    file.json["accessors"][position]["min"] = json!([0, 0, 0]);
    file.json["accessors"][position]["max"] = json!([100, 100, 0]);
    file.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    file.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let indices = file.indices(&[0, 1, 2, 2, 1, 3]);
    file.push(
        "meshes",
        json!({
            "name": "quad", "weights": [0.25], "extras": { "targetNames": ["smile"] },
            "primitives": [{ "attributes": { "POSITION": position }, "indices": indices }],
        }),
    );
    let normals = file.floats("VEC3", &[0.0, 0.0, 1.0].repeat(4));
    file.attribute("NORMAL", normals);
    let colors = file.accessor("VEC3", 5121, 4, &(0..16).collect::<Vec<u8>>());
    let view = file.json["accessors"][colors]["bufferView"]
        .as_u64()
        .unwrap() as usize;
    file.json["bufferViews"][view]["byteStride"] = json!(4);
    file.json["accessors"][colors]["normalized"] = json!(true);
    file.attribute("COLOR_0", colors);
    let ids = file.floats("SCALAR", &[0.1, 0.2, 0.3, 0.4]);
    file.json["accessors"][ids]["extras"] = json!("mine");
    file.attribute("_ID", ids);
    let joints = file.accessor("VEC4", 5121, 4, &[0, 1, 0, 0].repeat(4));
    file.attribute("JOINTS_0", joints);
    let weights: Vec<u16> = [16_000, 49_535, 0, 0].repeat(4);
    let weights = file.accessor("VEC4", U16, 4, bytemuck::cast_slice(&weights));
    file.json["accessors"][weights]["normalized"] = json!(true);
    file.attribute("WEIGHTS_0", weights);
    // A target of which the file stores one vertex.
    let places = file.view(&[2]);
    let values = file.view(bytemuck::cast_slice(&[0.0_f32, 5.0, 0.5]));
    let target = file.push(
        "accessors",
        json!({
            "componentType": 5126, "count": 4, "type": "VEC3", "min": [0.0, 0.0, 0.0], "max": [0.0, 5.0, 0.5],
            "sparse": {
                "count": 1,
                "indices": { "bufferView": places, "componentType": 5121 },
                "values": { "bufferView": values },
            },
        }),
    );
    file.primitive()["targets"] = json!([{ "POSITION": target }]);
    file.push("nodes", json!({ "mesh": 0, "skin": 0 }));
    file.push("nodes", json!({ "name": "hip", "children": [2] }));
    file.push(
        "nodes",
        json!({ "name": "knee", "translation": [1.0, 0.0, 0.0] }),
    );
    file.push("skins", json!({ "joints": [1, 2] }));
    file.push("scenes", json!({ "nodes": [0, 1] }));
    file.json["scene"] = json!(0);
    file
}

/// The seam runs along the diagonal: vertices 1 and 2 become two each.
fn cut() -> (File, Baked) {
    let file = quad();
    let scene = file.import();
    let mut atlas = whole(&scene);
    let corners = &mut atlas.instances[0].as_mut().unwrap().corners;
    corners[3..].iter_mut().for_each(|uv| uv.y += 0.5);
    let baked = bake(&file, &scene, &atlas, obscured());
    (file, baked)
}

fn primitive(baked: &Baked) -> &Value {
    &baked.json["meshes"][0]["primitives"][0]
}

#[test]
fn copies_carry_every_attribute() {
    let (_, baked) = cut();
    let attributes = &primitive(&baked)["attributes"];
    let sources = [0, 1, 2, 3, 2, 1];
    let of = |accessor: &Value, size: usize, original: [&[u8]; 4]| {
        let expected: Vec<Vec<u8>> = sources.iter().map(|&at| original[at].to_vec()).collect();
        assert_eq!(baked.elements(accessor, size), expected);
        &baked.json["accessors"][accessor.as_u64().unwrap() as usize]
    };
    let position = of(
        &attributes["POSITION"],
        6,
        [
            &[0; 6],
            &[100, 0, 0, 0, 0, 0],
            &[0, 0, 100, 0, 0, 0],
            &[100, 0, 100, 0, 0, 0],
        ],
    );
    assert_eq!(position["componentType"], 5122);
    assert_eq!(position["min"], json!([0, 0, 0]));
    assert_eq!(position["max"], json!([100, 100, 0]));
    let colors: [&[u8]; 4] = [&[0, 1, 2], &[4, 5, 6], &[8, 9, 10], &[12, 13, 14]];
    assert_eq!(of(&attributes["COLOR_0"], 3, colors)["normalized"], true);
    let ids = [0.1_f32, 0.2, 0.3, 0.4].map(f32::to_le_bytes);
    let ids = of(&attributes["_ID"], 4, [&ids[0], &ids[1], &ids[2], &ids[3]]);
    assert_eq!(ids["extras"], "mine");
    of(&attributes["JOINTS_0"], 4, [&[0, 1, 0, 0]; 4]);
    let weights = [128, 62, 127, 193, 0, 0, 0, 0];
    of(&attributes["WEIGHTS_0"], 8, [&weights; 4]);
    let moved = [0.0_f32, 5.0, 0.5].map(f32::to_le_bytes).concat();
    let target = &primitive(&baked)["targets"][0]["POSITION"];
    let target = of(target, 12, [&[0; 12], &[0; 12], &moved, &[0; 12]]);
    assert_eq!(target["max"], json!([0.0, 5.0, 0.5]));
    let uvs = baked.elements(&attributes["TEXCOORD_0"], 8);
    let expected = [0.0, 1.0, 2.0, 3.0, 2.0, 1.0].map(|vertex| vertex / 64.0);
    for (vertex, (uv, y)) in uvs.iter().zip(expected).enumerate() {
        let y: f32 = if vertex > 2 { y + 0.5 } else { y };
        assert_eq!(bytemuck::pod_collect_to_vec::<u8, f32>(uv), [0.0, y]);
    }
}

#[test]
fn what_bends_still_bends() {
    let (file, baked) = cut();
    assert_eq!(baked.json["nodes"], file.json["nodes"]);
    assert_eq!(baked.json["skins"], file.json["skins"]);
    let (mut before, mut after) = (file.import(), baked.scene);
    let rig = after.rig.as_mut().unwrap();
    rig.nodes[0].weights = vec![1.0];
    before.rig.as_mut().unwrap().nodes[0].weights = vec![1.0];
    before.pose(0.0);
    after.pose(0.0);
    assert_eq!(positions(&before), positions(&after));
}

#[test]
fn without_a_cut_only_coordinates_are_added() {
    let file = quad();
    let scene = file.import();
    let baked = bake(&file, &scene, &whole(&scene), obscured());
    let mut expected = file.json["meshes"][0].clone();
    // The second set, and because the file has no first one, that too.
    for set in ["TEXCOORD_0", "TEXCOORD_1"] {
        let uvs = primitive(&baked)["attributes"]["TEXCOORD_0"].clone();
        expected["primitives"][0]["attributes"][set] = uvs;
    }
    expected["primitives"][0]["material"] = json!(0);
    assert_eq!(baked.json["meshes"], json!([expected]));
}

#[test]
fn a_set_that_fits_is_used() {
    let mut file = quad();
    let uvs = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
    file.attribute("TEXCOORD_0", uvs);
    let scene = file.import();
    let baked = bake(&file, &scene, &shredded(&scene), obscured());
    assert!(primitive(&baked)["attributes"].get("TEXCOORD_1").is_some());
    assert_eq!(
        baked.json["materials"][0]["occlusionTexture"]["texCoord"],
        1
    );

    let fitting = atlas(&scene, |_, vertex| {
        vec2((vertex % 2) as f32, (vertex / 2) as f32)
    });
    let baked = bake(&file, &scene, &fitting, obscured());
    assert_eq!(baked.json["accessors"], file.json["accessors"]);
    let attributes = &primitive(&baked)["attributes"];
    assert_eq!(attributes["TEXCOORD_1"], attributes["TEXCOORD_0"]);
    assert_eq!(
        baked.json["materials"][0]["occlusionTexture"]["texCoord"],
        1
    );
    // Two sets that hold it the other way round change places.
    let other = file.floats("VEC2", &[0.5; 8]);
    file.attribute("TEXCOORD_1", other);
    let emissive = BakedPage {
        light: Some(BakedLight::Emissive(vec![Vec3::ONE; 16])),
        ..BakedPage::default()
    };
    let moved = atlas(&scene, |_, _| vec2(0.5, 0.5));
    let baked = bake(&file, &scene, &moved, emissive);
    let attributes = &primitive(&baked)["attributes"];
    let [first, second] = ["TEXCOORD_0", "TEXCOORD_1"].map(|set| attributes[set].clone());
    assert_eq!([first, second], [json!(other), json!(uvs)]);
}

/// Other variants read the file's own sets.
#[test]
fn beside_variants_the_first_free_set_is_taken() {
    let mut file = quad();
    let mappings = json!([{ "material": 0, "variants": [0] }]);
    file.push("materials", json!({}));
    let used = file.json["extensionsUsed"].as_array_mut().unwrap();
    used.push(json!("KHR_materials_variants"));
    let variants = json!({ "variants": [{ "name": "other" }] });
    file.json["extensions"] = json!({ "KHR_materials_variants": variants });
    file.primitive()["extensions"] = json!({ "KHR_materials_variants": { "mappings": mappings } });
    for set in 0..2 {
        let uvs = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
        file.attribute(&format!("TEXCOORD_{set}"), uvs);
    }
    let scene = file.import();
    let files = crate::builder::Files::default();
    let page = BakedPage {
        light: Some(BakedLight::Emissive(vec![Vec3::ONE; 16])),
        ..obscured()
    };
    let atlas = shredded(&scene);
    let exported = try_bake(&file.glb(), &files, &scene, &atlas, page).unwrap();
    assert!(exported.warnings[0].contains("TEXCOORD_2"));
    let baked = Baked::new(&exported.glb);
    let material = &baked.json["materials"][1];
    assert_eq!(material["occlusionTexture"]["texCoord"], 2);
    let slot = baked.scene.instances[0].material;
    let slot = baked.scene.materials[slot].emissive_texture.unwrap().uv_set;
    let mesh = &baked.scene.meshes[0];
    let read: Vec<_> = mesh
        .indices
        .iter()
        .map(|&index| mesh.uvs[slot as usize][index as usize])
        .collect();
    assert_eq!(read, atlas.instances[0].as_ref().unwrap().corners);
}

/// A hundred vertices that the primitive shares with others must not be copied for three.
#[test]
fn few_of_many_shared_vertices_are_copied() {
    let mut file = File::empty();
    let values: Vec<f32> = (0..300).map(|at| ((at * at) % 97) as f32).collect();
    let positions = file.floats("VEC3", &values);
    file.json["accessors"][positions]["min"] = json!([0.0, 0.0, 0.0]);
    file.json["accessors"][positions]["max"] = json!([96.0, 96.0, 96.0]);
    let indices = file.indices(&[70, 3, 41]);
    let primitive_json = json!({ "attributes": { "POSITION": positions }, "indices": indices });
    file.push("meshes", json!({ "primitives": [primitive_json] }));
    file.push("nodes", json!({ "mesh": 0 }));
    let scene = file.import();
    let baked = bake(&file, &scene, &whole(&scene), obscured());
    let position = &primitive(&baked)["attributes"]["POSITION"];
    let accessor = &baked.json["accessors"][position.as_u64().unwrap() as usize];
    assert_eq!(accessor["count"], 3);
    let vertex = |at: usize| &values[at * 3..at * 3 + 3];
    let range = |axis: usize| [70, 3, 41].map(|at| vertex(at)[axis]);
    for axis in 0..3 {
        let (min, max) = range(axis)
            .iter()
            .fold((f32::MAX, f32::MIN), |(min, max), value| {
                (min.min(*value), max.max(*value))
            });
        assert_eq!(accessor["min"][axis], json!(min));
        assert_eq!(accessor["max"][axis], json!(max));
    }
    crate::export::baking::assert_mapped(&scene, &whole(&scene), &baked.scene, 1);
}
