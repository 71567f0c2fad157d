//! KHR_draco_mesh_compression.

use draco_core::{
    DataType, EncoderBuffer, EncoderOptions, FaceIndex, GeometryAttributeType, Mesh, MeshEncoder,
    PointAttribute, PointIndex,
};
use glam::{Vec3, vec2, vec3};
use serde_json::{Value, json};

use crate::builder::File;

/// Side of a patch of vertices.
const SIDE: u32 = 5;
const VERTICES: u32 = SIDE * SIDE;

fn position(vertex: u32) -> Vec3 {
    let (x, y) = (vertex % SIDE, vertex / SIDE);
    vec3(x as f32, y as f32, (x * y) as f32 * 0.125)
}

/// Two triangles for each square of the patch.
fn triangles() -> Vec<[u32; 3]> {
    let squares = (0..SIDE - 1).flat_map(|y| (0..SIDE - 1).map(move |x| y * SIDE + x));
    let triangles =
        squares.flat_map(|at| [[at, at + 1, at + SIDE + 1], [at, at + SIDE + 1, at + SIDE]]);
    triangles.collect()
}

/// The patch as Draco encodes it: positions and coordinates in 32-bit floats, colours in bytes.
fn encoded(method: i32) -> Vec<u8> {
    let mut mesh = Mesh::new();
    let mut add = |kind, data, normalized, values: Vec<Vec<u8>>, width| {
        let mut attribute = PointAttribute::new();
        attribute.init(kind, width, data, normalized, values.len());
        let bytes = values.concat();
        attribute.buffer_mut().write(0, &bytes);
        mesh.add_attribute(attribute);
    };
    let floats = |values: &[f32]| {
        values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect()
    };
    let positions = (0..VERTICES).map(|vertex| floats(&position(vertex).to_array()));
    add(
        GeometryAttributeType::Position,
        DataType::Float32,
        false,
        positions.collect(),
        3,
    );
    let uvs = (0..VERTICES).map(|vertex| floats(&[vertex as f32 / 32.0, 0.5]));
    add(
        GeometryAttributeType::TexCoord,
        DataType::Float32,
        false,
        uvs.collect(),
        2,
    );
    let colors = (0..VERTICES).map(|vertex| vec![vertex as u8 * 10, 255, 0]);
    add(
        GeometryAttributeType::Color,
        DataType::Uint8,
        true,
        colors.collect(),
        3,
    );
    let triangles = triangles();
    mesh.set_num_faces(triangles.len());
    for (number, triangle) in triangles.into_iter().enumerate() {
        mesh.set_face(FaceIndex(number as u32), triangle.map(PointIndex));
    }
    let mut encoder = MeshEncoder::new();
    encoder.set_mesh(mesh);
    let mut options = EncoderOptions::new();
    options.set_encoding_method(method);
    let mut out = EncoderBuffer::new();
    encoder.encode(&options, &mut out).unwrap();
    out.data().to_vec()
}

/// Draco's methods: triangles one after the other, and edgebreaker.
const METHODS: [i32; 2] = [0, 1];

/// The patch in a file, as exporters write it.
pub fn packed(method: i32) -> File {
    let mut file = File::triangle();
    let view = file.view(&encoded(method));
    let mut accessor = |component: u32, kind: &str, count: usize, normalized: bool| {
        file.push(
            "accessors",
            json!({ "componentType": component, "type": kind, "count": count, "normalized": normalized }),
        )
    };
    let points = VERTICES as usize;
    let positions = accessor(5126, "VEC3", points, false);
    let uvs = accessor(5126, "VEC2", points, false);
    let colors = accessor(5121, "VEC3", points, true);
    let indices = accessor(5123, "SCALAR", 3 * triangles().len(), false);
    file.json["accessors"][positions]["min"] = json!([0.0, 0.0, 0.0]);
    file.json["accessors"][positions]["max"] = json!([4.0, 4.0, 2.0]);
    *file.primitive() = json!({
        "attributes": { "POSITION": positions, "TEXCOORD_0": uvs, "COLOR_0": colors },
        "indices": indices,
        "extensions": { "KHR_draco_mesh_compression": {
            "bufferView": view, "attributes": { "POSITION": 0, "TEXCOORD_0": 1, "COLOR_0": 2 },
        } },
    });
    for list in ["extensionsUsed", "extensionsRequired"] {
        file.json[list] = json!(["KHR_draco_mesh_compression"]);
    }
    file
}

/// The corners of all triangles, in an order that does not depend on that of the file.
fn corners(scene: &gpugi_scene::Scene) -> Vec<String> {
    let mesh = &scene.meshes[0];
    let corner = |index: &u32| {
        let at = *index as usize;
        (
            mesh.positions[at],
            mesh.uvs[0][at],
            mesh.colors[at].truncate(),
        )
    };
    let mut all: Vec<String> = mesh
        .indices
        .chunks(3)
        .map(|triangle| {
            let mut corners: Vec<String> = triangle
                .iter()
                .map(|index| format!("{:.2?}", corner(index)))
                .collect();
            // Which corner is first is of no matter; the direction is.
            let least = corners.iter().min().cloned().unwrap();
            let first = corners.iter().position(|corner| *corner == least).unwrap();
            corners.rotate_left(first);
            corners.concat()
        })
        .collect();
    all.sort();
    all
}

#[test]
fn every_corner_of_every_triangle_comes_back() {
    let mut expected = crate::builder::File::triangle().import();
    let mesh = std::sync::Arc::make_mut(&mut expected.meshes[0]);
    mesh.positions = (0..VERTICES).map(position).collect();
    mesh.uvs[0] = (0..VERTICES)
        .map(|vertex| vec2(vertex as f32 / 32.0, 0.5))
        .collect();
    let color = |vertex: u32| vec3((vertex * 10) as f32 / 255.0, 1.0, 0.0).extend(1.0);
    mesh.colors = (0..VERTICES).map(color).collect();
    mesh.indices = triangles().concat();
    for method in METHODS {
        let scene = packed(method).import();
        assert_eq!(corners(&scene), corners(&expected), "method {method}");
    }
}

#[test]
fn damage_is_named() {
    let place = "meshes[0].primitives[0].extensions.KHR_draco_mesh_compression";
    let damaged = |edit: &dyn Fn(&mut File), reason: &str| {
        let mut file = packed(1);
        edit(&mut file);
        file.assert_error(place, reason);
    };
    let extension = |file: &mut File, key: &str, value: Value| {
        file.primitive()["extensions"]["KHR_draco_mesh_compression"][key] = value;
    };
    damaged(
        &|file| extension(file, "attributes", json!({ "POSITION": 9 })),
        "no attribute 9",
    );
    damaged(
        &|file| file.primitive()["mode"] = json!(5),
        "only triangles",
    );
    damaged(
        &|file| {
            let primitive = file.primitive().as_object_mut().unwrap();
            primitive.shift_remove("indices");
        },
        "no indices",
    );
    // What the accessors say bounds what may be decoded.
    damaged(
        &|file| file.json["accessors"][1]["count"] = json!(26),
        "75 numbers",
    );
    for accessor in 1..=3 {
        damaged(
            &|file| file.json["accessors"][accessor]["count"] = json!(u64::MAX),
            "limit",
        );
    }
    damaged(&|file| file.json["accessors"][4]["count"] = json!(3), "");
    damaged(
        &|file| file.json["accessors"][2]["type"] = json!("VEC4"),
        "components",
    );
    damaged(
        &|file| {
            let start = file.json["bufferViews"][1]["byteOffset"].as_u64().unwrap() as usize;
            file.binary[start..start + 5].copy_from_slice(b"DRECK");
        },
        "",
    );
}

/// Each stream has an order of vertices of its own, so two cannot be that of the same accessors.
#[test]
fn accessors_have_one_stream() {
    let mut file = packed(0);
    file.push("meshes", file.json["meshes"][0].clone());
    assert_eq!(file.import().meshes.len(), 1);
    let view = file.view(&encoded(1));
    let extensions = &mut file.json["meshes"][1]["primitives"][0]["extensions"];
    extensions["KHR_draco_mesh_compression"]["bufferView"] = json!(view);
    let place = "meshes[1].primitives[0].extensions.KHR_draco_mesh_compression";
    file.assert_error(place, "other compressed data");
    // With uncompressed data beside, no stream is read.
    for accessor in 1..=4 {
        let view = file.view(&[0; 4 * 96 * 3]);
        file.json["accessors"][accessor]["bufferView"] = json!(view);
    }
    assert_eq!(file.import().meshes.len(), 1);
}
