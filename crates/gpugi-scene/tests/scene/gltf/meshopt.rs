//! EXT_meshopt_compression.

use glam::Vec3;
use meshopt::{
    encode_filter_exp, encode_filter_oct, encode_filter_quat, encode_index_buffer,
    encode_index_sequence, encode_vertex_buffer,
};
use serde_json::{Value, json};

use crate::builder::File;

const POSITIONS: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

/// A file with a fallback buffer, as gltfpack writes it, and positions packed in it.
pub fn packed() -> File {
    let mut file = File::triangle();
    file.json["extensionsRequired"] = json!(["EXT_meshopt_compression"]);
    let encoded = encode_vertex_buffer(&POSITIONS).unwrap();
    let positions = view(&mut file, &encoded, 3, 12, json!({ "mode": "ATTRIBUTES" }));
    file.json["accessors"][0]["bufferView"] = json!(positions);
    file
}

/// Adds a compressed view; returns its index.
fn view(file: &mut File, encoded: &[u8], count: usize, stride: usize, mut packing: Value) -> usize {
    let packed = file.view(encoded);
    let packed = file.json["bufferViews"][packed].clone();
    packing["buffer"] = json!(0);
    packing["byteOffset"] = packed["byteOffset"].clone();
    packing["byteLength"] = packed["byteLength"].clone();
    packing["byteStride"] = json!(stride);
    packing["count"] = json!(count);
    let mut view = json!({
        "buffer": 1, "byteLength": count * stride, "extensions": { "EXT_meshopt_compression": packing },
    });
    if packing_is_vertices(&view) {
        view["byteStride"] = json!(stride);
    }
    let index = file.push("bufferViews", view);
    let fallback = json!({ "byteLength": 1 << 20, "extensions": { "EXT_meshopt_compression": { "fallback": true } } });
    file.json["buffers"] = json!([{ "byteLength": file.binary.len() }, fallback]);
    index
}

fn packing_is_vertices(view: &Value) -> bool {
    view["extensions"]["EXT_meshopt_compression"]["mode"] == "ATTRIBUTES"
}

fn add_accessor(
    file: &mut File,
    view: usize,
    component: u32,
    kind: &str,
    normalized: bool,
) -> usize {
    file.push(
        "accessors",
        json!({
            "bufferView": view, "componentType": component, "count": 3, "type": kind, "normalized": normalized,
        }),
    )
}

#[test]
fn attributes() {
    let positions = packed().import().meshes[0].positions.clone();
    assert_eq!(positions, POSITIONS.map(Vec3::from));
}

#[test]
fn triangles_and_indices_in_both_widths() {
    let triangles = encode_index_buffer(&[0, 1, 2], 3).unwrap();
    let sequence = encode_index_sequence(&[0, 1, 2], 3).unwrap();
    for (mode, encoded) in [("TRIANGLES", triangles), ("INDICES", sequence)] {
        for (stride, component) in [(2, 5123), (4, 5125)] {
            let mut file = packed();
            let indices = view(&mut file, &encoded, 3, stride, json!({ "mode": mode }));
            let indices = add_accessor(&mut file, indices, component, "SCALAR", false);
            file.primitive()["indices"] = json!(indices);
            let scene = file.import();
            assert_eq!(
                scene.meshes[0].positions,
                POSITIONS.map(Vec3::from),
                "{mode} {stride}"
            );
        }
    }
}

#[test]
fn octahedral_normals() {
    let normal = Vec3::new(0.6, 0.0, -0.8);
    let vectors = [normal.extend(0.0).to_array(); 3];
    let bytes = encode_vertex_buffer(&encode_filter_oct::<i8>(&vectors, 8)).unwrap();
    let shorts = encode_vertex_buffer(&encode_filter_oct::<i16>(&vectors, 16)).unwrap();
    for (encoded, stride, component, tolerance) in [(bytes, 4, 5120, 0.02), (shorts, 8, 5122, 1e-3)]
    {
        let mut file = packed();
        let packing = json!({ "mode": "ATTRIBUTES", "filter": "OCTAHEDRAL" });
        let normals = view(&mut file, &encoded, 3, stride, packing);
        let normals = add_accessor(&mut file, normals, component, "VEC3", true);
        file.attribute("NORMAL", normals);
        let found = file.import().meshes[0].normals[0];
        assert!(found.abs_diff_eq(normal, tolerance), "{found}");
    }
}

#[test]
fn exponential_positions() {
    let vectors = POSITIONS.map(|[x, y, z]| [x * 0.1, y * 0.1, z]);
    let encoded = encode_filter_exp(&vectors, 20, meshopt::EncodeExpMode::Separate);
    let encoded = encode_vertex_buffer(&encoded).unwrap();
    let mut file = packed();
    let packing = json!({ "mode": "ATTRIBUTES", "filter": "EXPONENTIAL" });
    let positions = view(&mut file, &encoded, 3, 12, packing);
    let positions = add_accessor(&mut file, positions, 5126, "VEC3", false);
    file.attribute("POSITION", positions);
    let found = file.import().meshes[0].positions[1];
    assert!(found.abs_diff_eq(Vec3::X * 0.1, 1e-5), "{found}");
}

#[test]
fn quaternion_rotations() {
    let turn = glam::Quat::from_rotation_z(1.0);
    let encoded = encode_filter_quat(&[turn.to_array(); 3], 16);
    let encoded = encode_vertex_buffer(&encoded).unwrap();
    let mut file = packed();
    let packing = json!({ "mode": "ATTRIBUTES", "filter": "QUATERNION" });
    let rotations = view(&mut file, &encoded, 3, 8, packing);
    let output = add_accessor(&mut file, rotations, 5122, "VEC4", true);
    let input = file.floats("SCALAR", &[0.0, 1.0, 2.0]);
    file.json["buffers"][0]["byteLength"] = json!(file.binary.len());
    file.push(
        "animations",
        json!({
            "channels": [{ "sampler": 0, "target": { "node": 0, "path": "rotation" } }],
            "samplers": [{ "input": input, "output": output }],
        }),
    );
    let found = file.import().instances[0]
        .world_from_mesh
        .transform_vector3(Vec3::X);
    assert!(found.abs_diff_eq(turn * Vec3::X, 1e-3), "{found}");
}

#[test]
fn damage_is_named() {
    let place = "bufferViews[2].extensions.EXT_meshopt_compression";
    let damaged = |key: &str, value: Value, reason: &str| {
        let mut file = packed();
        file.json["bufferViews"][2]["extensions"]["EXT_meshopt_compression"][key] = value;
        file.assert_error(place, reason);
    };
    damaged("byteLength", json!(5), "damaged");
    damaged("byteLength", json!(5000), "exceed");
    damaged("count", json!(u64::MAX), "limit");
    damaged("count", json!(1 << 24), "cannot hold");
    damaged("byteStride", json!(3), "byteStride 3");
    damaged("byteStride", json!(260), "byteStride 260");
    damaged("mode", json!("MAGIC"), "MAGIC");
    damaged("filter", json!("MAGIC"), "MAGIC");
    damaged("filter", json!("QUATERNION"), "byteStride 12");
    damaged("buffer", json!(1), "no content");
}
