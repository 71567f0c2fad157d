//! Which corner of the file a corner of the scene is: it must be found for every way in which files store triangles.

use serde_json::json;

use crate::builder::{File, U16};
use crate::export::baking::{assert_mapped, bake, obscured, shredded, whole};

/// Five points in a plane, no three in a line.
const POINTS: [f32; 15] = [
    0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.2, 1.1, 0.0, 0.1, 2.0, 0.0,
];

/// A node with a mesh over five points.
fn points(primitive: serde_json::Value) -> File {
    let mut file = File::empty();
    let positions = file.floats("VEC3", &POINTS);
    file.json["accessors"][positions]["min"] = json!([0.0, 0.0, 0.0]);
    file.json["accessors"][positions]["max"] = json!([1.2f32, 2.0, 0.0]);
    file.push("meshes", json!({ "primitives": [primitive] }));
    file.attribute("POSITION", positions);
    file.push("nodes", json!({ "mesh": 0 }));
    file
}

fn primitive() -> serde_json::Value {
    json!({ "attributes": {} })
}

/// Both when every corner is cut off and when none is.
#[track_caller]
fn assert_found(file: &File) {
    let scene = file.import();
    assert!(!scene.instances.is_empty());
    for atlas in [shredded(&scene), whole(&scene)] {
        let baked = bake(file, &scene, &atlas, obscured());
        assert_mapped(&scene, &atlas, &baked.scene, 1);
    }
}

#[test]
fn indices_of_each_width() {
    for (component, bytes) in [
        (5121, vec![0, 1, 2, 2, 1, 3, 4, 2, 3]),
        (U16, vec![0, 0, 1, 0, 2, 0, 2, 0, 1, 0, 3, 0]),
        (5125, vec![1, 0, 0, 0, 3, 0, 0, 0, 2, 0, 0, 0]),
    ] {
        let mut file = points(primitive());
        let width = match component {
            5121 => 1,
            U16 => 2,
            _ => 4,
        };
        let indices = file.accessor("SCALAR", component, bytes.len() / width, &bytes);
        file.primitive()["indices"] = json!(indices);
        assert_found(&file);
    }
}

#[test]
fn strips_and_fans_with_and_without_indices() {
    for mode in [5, 6] {
        let mut file = points(primitive());
        file.primitive()["mode"] = json!(mode);
        assert_found(&file);
        let indices = file.indices(&[4, 3, 2, 1, 0]);
        file.primitive()["indices"] = json!(indices);
        assert_found(&file);
    }
}

#[test]
fn triangles_without_indices() {
    let mut file = points(primitive());
    let positions = file.floats("VEC3", &[&POINTS[..9], &POINTS[6..]].concat());
    file.json["accessors"][positions]["min"] = json!([0.0, 0.0, 0.0]);
    file.json["accessors"][positions]["max"] = json!([1.2f32, 2.0, 0.0]);
    file.attribute("POSITION", positions);
    assert_found(&file);
}

#[test]
fn sparse_positions_and_indices() {
    let mut file = points(primitive());
    let indices = file.indices(&[0, 1, 2, 0, 0, 0]);
    file.primitive()["indices"] = json!(indices);
    let places = file.view(&[3, 4, 5]);
    let values = file.view(&[2, 0, 1, 0, 3, 0]);
    file.json["accessors"][indices]["sparse"] = json!({
        "count": 3,
        "indices": { "bufferView": places, "componentType": 5121 },
        "values": { "bufferView": values },
    });
    let places = file.view(&[1, 0]);
    let values = file.view(bytemuck::cast_slice(&[1.1_f32, 0.25, -1.0]));
    file.json["accessors"][0]["sparse"] = json!({
        "count": 1,
        "indices": { "bufferView": places, "componentType": U16 },
        "values": { "bufferView": values },
    });
    file.json["accessors"][0]["min"] = json!([0.0, 0.0, -1.0]);
    assert_found(&file);
}

#[test]
fn mirrored_nodes_and_nodes_that_share_a_mesh() {
    let mut file = points(primitive());
    let indices = file.indices(&[0, 1, 2, 2, 1, 3]);
    file.primitive()["indices"] = json!(indices);
    file.json["nodes"][0]["scale"] = json!([-1.0, 1.0, 1.0]);
    file.push(
        "nodes",
        json!({ "mesh": 0, "translation": [0.0, 0.0, 3.0] }),
    );
    file.push(
        "nodes",
        json!({ "mesh": 0, "translation": [0.0, 0.0, 5.0] }),
    );
    assert_found(&file);
}

/// The importer splits vertices itself where tangents part, or where normals are missing.
#[test]
fn meshes_whose_vertices_the_importer_splits() {
    let mut file = points(json!({ "attributes": {}, "material": 0 }));
    file.push("materials", json!({ "normalTexture": { "index": 0 } }));
    let view = file.view(&crate::builder::png(1, 1, &[128, 128, 255, 255]));
    file.push(
        "images",
        json!({ "bufferView": view, "mimeType": "image/png" }),
    );
    file.push("textures", json!({ "source": 0 }));
    let indices = file.indices(&[3, 2, 1, 0, 1, 2, 2, 3, 4]);
    file.primitive()["indices"] = json!(indices);
    let normals = file.floats("VEC3", &[0.0, 0.0, 1.0].repeat(5));
    file.attribute("NORMAL", normals);
    // Mirrored across an edge, so that the tangents turn round there.
    let uvs = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0]);
    file.attribute("TEXCOORD_0", uvs);
    let scene = file.import();
    assert!(
        scene.meshes[0].positions.len() > 5,
        "tangents split nothing"
    );
    assert_found(&file);
    file.primitive()["attributes"]
        .as_object_mut()
        .unwrap()
        .remove("NORMAL");
    assert_found(&file);
}

#[test]
fn several_primitives_of_which_some_draw_no_triangles() {
    let mut file = points(primitive());
    let mut more = file.primitive().clone();
    more["mode"] = json!(1);
    let lines = file.indices(&[0, 1]);
    more["indices"] = json!(lines);
    let indices = file.indices(&[4, 2, 0]);
    let mut third = file.primitive().clone();
    third["indices"] = json!(indices);
    *file.primitive() = more;
    let primitives = file.json["meshes"][0]["primitives"].as_array_mut().unwrap();
    primitives.push(third);
    let scene = file.import();
    assert_eq!(scene.instances.len(), 1);
    assert_eq!(scene.instances[0].origin.unwrap().primitive, 1);
    assert_found(&file);
}
