//! Accessors, topologies, attributes, normals and tangents.

use glam::{Vec2, Vec3, Vec4};
use gpugi_scene::Limits;
use serde_json::json;

use crate::builder::{File, Files, U16, png};

const CORNERS: [Vec3; 3] = [Vec3::ZERO, Vec3::X, Vec3::Y];

/// A strip of vertices along x, alternating between y = 0 and y = 1.
fn zigzag(count: usize) -> Vec<f32> {
    (0..count)
        .flat_map(|i| [(i / 2) as f32, (i % 2) as f32, 0.0])
        .collect()
}

/// A file with the zigzag, normals (so that vertices stay shared) and the given mode and indices.
fn topology(mode: u32, count: usize, indices: Option<&[u16]>) -> File {
    let mut file = File::triangle();
    let positions = file.floats("VEC3", &zigzag(count));
    file.attribute("POSITION", positions);
    let normals = file.floats("VEC3", &[0.0, 0.0, 1.0].repeat(count));
    file.attribute("NORMAL", normals);
    if let Some(indices) = indices {
        file.primitive()["indices"] = json!(file.clone().indices(indices));
        file.indices(indices);
    }
    file.primitive()["mode"] = json!(mode);
    file
}

#[test]
fn missing_normals_are_flat() {
    let mut file = File::triangle();
    // Two triangles at a right angle share an edge.
    let positions = [0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1.];
    let positions = file.floats("VEC3", &positions);
    file.attribute("POSITION", positions);
    let indices = file.indices(&[0, 1, 2, 0, 3, 1]);
    file.primitive()["indices"] = json!(indices);
    let mesh = &file.import().meshes[0];
    assert_eq!(mesh.indices, [0, 1, 2, 3, 4, 5]);
    assert_eq!(mesh.normals, [[Vec3::Z; 3], [Vec3::Y; 3]].concat());
}

#[test]
fn triangles_share_vertices() {
    let mesh = &topology(4, 4, Some(&[0, 2, 1, 1, 2, 3])).import().meshes[0];
    assert_eq!(mesh.indices, [0, 2, 1, 1, 2, 3]);
    assert_eq!(mesh.positions.len(), 4);
}

#[test]
fn strips_keep_their_orientation() {
    let mesh = &topology(5, 5, None).import().meshes[0];
    assert_eq!(mesh.indices, [0, 1, 2, 1, 3, 2, 2, 3, 4]);
}

#[test]
fn fans_turn_around_the_first_vertex() {
    let mesh = &topology(6, 4, Some(&[3, 0, 1, 2])).import().meshes[0];
    assert_eq!(mesh.indices, [0, 1, 3, 1, 2, 3]);
}

#[test]
fn points_and_lines_are_left_out_with_a_warning() {
    for mode in 0..4 {
        let scene = topology(mode, 4, None).import();
        assert!(scene.instances.is_empty());
        assert!(scene.warnings[0].contains("points and lines"));
    }
    topology(7, 4, None).assert_error("meshes[0].primitives[0].mode", "7");
}

#[test]
fn loose_indices_are_left_out_with_a_warning() {
    let scene = topology(4, 4, Some(&[0, 2, 1, 1])).import();
    assert_eq!(scene.meshes[0].indices, [0, 2, 1]);
    assert_eq!(scene.warnings.len(), 1);
}

#[test]
fn indices_come_in_three_widths() {
    for (component, bytes) in [
        (5121, vec![0_u8, 2, 1]),
        (5123, vec![0, 0, 2, 0, 1, 0]),
        (5125, vec![0, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0]),
    ] {
        let mut file = topology(4, 3, None);
        let indices = file.accessor("SCALAR", component, 3, &bytes);
        file.primitive()["indices"] = json!(indices);
        assert_eq!(file.import().meshes[0].indices, [0, 2, 1]);
    }
}

#[test]
fn quantized_positions_of_every_type() {
    for (component, normalized, bytes, scale) in [
        (
            5120,
            false,
            vec![0_u8, 0, 0, 0, 127, 0, 0, 0, 0, 0x81, 0, 0],
            127.0,
        ),
        (
            5120,
            true,
            vec![0, 0, 0, 0, 127, 0, 0, 0, 0, 0x80, 0, 0],
            1.0,
        ),
        (
            5121,
            false,
            vec![0, 0, 0, 0, 255, 0, 0, 0, 0, 255, 0, 0],
            255.0,
        ),
        (
            5121,
            true,
            vec![0, 0, 0, 0, 255, 0, 0, 0, 0, 255, 0, 0],
            1.0,
        ),
    ] {
        let mut file = File::triangle();
        let positions = file.accessor("VEC3", component, 3, &bytes);
        file.json["accessors"][positions]["normalized"] = json!(normalized);
        file.json["bufferViews"][positions]["byteStride"] = json!(4);
        file.attribute("POSITION", positions);
        let mesh = &file.import().meshes[0];
        let sign = if component == 5120 { -1.0 } else { 1.0 };
        let expected = [Vec3::ZERO, Vec3::X * scale, Vec3::Y * scale * sign];
        assert_eq!(mesh.positions, expected, "{component} {normalized}");
    }
}

#[test]
fn shorts_and_words_normalize() {
    let mut file = File::triangle();
    let shorts: [i16; 12] = [0, 0, 0, 0, 32767, 0, 0, 0, -32768, 16384, 0, 0];
    let positions = file.accessor("VEC3", 5122, 3, bytemuck::cast_slice(&shorts));
    file.json["accessors"][positions]["normalized"] = json!(true);
    file.json["bufferViews"][positions]["byteStride"] = json!(8);
    file.attribute("POSITION", positions);
    let shorts: [u16; 6] = [0, 65535, 13107, 0, 0, 0];
    let uvs = file.accessor("VEC2", U16, 3, bytemuck::cast_slice(&shorts));
    file.json["accessors"][uvs]["normalized"] = json!(true);
    file.attribute("TEXCOORD_0", uvs);
    let mesh = &file.import().meshes[0];
    assert_eq!(
        mesh.positions[1..],
        [Vec3::X, Vec3::new(-1.0, 16384.0 / 32767.0, 0.0)]
    );
    assert_eq!(mesh.uvs[0], [Vec2::Y, Vec2::new(0.2, 0.0), Vec2::ZERO]);
}

#[test]
fn attributes_may_interleave() {
    let mut file = File::triangle();
    let corners = CORNERS.map(|corner| [corner, Vec3::Z]).concat();
    let view = file.view(bytemuck::cast_slice(&corners));
    file.json["bufferViews"][view]["byteStride"] = json!(24);
    for (name, offset) in [("POSITION", 0), ("NORMAL", 12)] {
        let accessor = file.push(
            "accessors",
            json!({ "bufferView": view, "byteOffset": offset, "componentType": 5126, "count": 3, "type": "VEC3" }),
        );
        file.attribute(name, accessor);
    }
    let mesh = &file.import().meshes[0];
    assert_eq!(mesh.positions, CORNERS);
    assert_eq!(mesh.normals, [Vec3::Z; 3]);
}

#[test]
fn sparse_accessors_replace_elements() {
    let mut file = File::triangle();
    let indices = file.view(&[2, 0]);
    let values = file.view(bytemuck::cast_slice(&[0.0_f32, 5.0, 0.0]));
    let sparse = json!({
        "count": 1,
        "indices": { "bufferView": indices, "componentType": 5123 },
        "values": { "bufferView": values },
    });
    file.json["accessors"][0]["sparse"] = sparse.clone();
    assert_eq!(
        file.import().meshes[0].positions,
        [Vec3::ZERO, Vec3::X, Vec3::Y * 5.0]
    );
    // Without a buffer view the rest is zero.
    file.json["accessors"][0]
        .as_object_mut()
        .unwrap()
        .remove("bufferView");
    assert_eq!(
        file.import().meshes[0].positions,
        [Vec3::ZERO, Vec3::ZERO, Vec3::Y * 5.0]
    );
}

#[test]
fn colors_have_three_or_four_channels() {
    let mut file = File::triangle();
    let colors = file.accessor(
        "VEC4",
        5121,
        3,
        &[255, 0, 0, 51, 0, 255, 0, 255, 0, 0, 255, 0],
    );
    file.json["accessors"][colors]["normalized"] = json!(true);
    file.attribute("COLOR_0", colors);
    assert_eq!(
        file.import().meshes[0].colors[0],
        Vec4::new(1.0, 0.0, 0.0, 0.2)
    );
    let colors = file.floats("VEC3", &[0.5, 0.25, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    file.attribute("COLOR_0", colors);
    assert_eq!(
        file.import().meshes[0].colors[0],
        Vec4::new(0.5, 0.25, 2.0, 1.0)
    );
}

#[test]
fn both_sets_of_texture_coordinates() {
    let mut file = File::triangle();
    let first = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let second = file.floats("VEC2", &[0.5, 0.5, 1.0, 0.0, 0.0, 1.0]);
    file.attribute("TEXCOORD_0", first);
    file.attribute("TEXCOORD_1", second);
    let mesh = &file.import().meshes[0];
    assert_eq!(mesh.uvs[0][0], Vec2::ZERO);
    assert_eq!(mesh.uvs[1][0], Vec2::splat(0.5));
}

/// A triangle with a normal map, normals, and u to the right, v down as images have it.
fn normal_mapped() -> File {
    let mut file = File::with_material(json!({ "normalTexture": { "index": 0 } }));
    let view = file.view(&png(1, 1, &[128, 128, 255, 255]));
    file.push("images", json!({ "bufferView": view }));
    file.push("textures", json!({ "source": 0 }));
    let normals = file.floats("VEC3", &[0.0, 0.0, 1.0].repeat(3));
    file.attribute("NORMAL", normals);
    let uvs = file.floats("VEC2", &[0.0, 1.0, 1.0, 1.0, 0.0, 0.0]);
    file.attribute("TEXCOORD_0", uvs);
    file
}

#[test]
fn tangents_are_generated_for_normal_maps_alone() {
    // u grows along +X, and "up" in the image is +Y: so the bitangent, cross(normal, tangent) w, needs w = 1.
    let mut file = normal_mapped();
    let mesh = &file.import().meshes[0];
    assert_eq!(mesh.tangents, [Vec4::new(1.0, 0.0, 0.0, 1.0); 3]);
    assert_eq!(mesh.positions, CORNERS);
    let mirrored = file.floats("VEC2", &[1.0, 1.0, 0.0, 1.0, 1.0, 0.0]);
    file.attribute("TEXCOORD_0", mirrored);
    assert_eq!(
        file.import().meshes[0].tangents,
        [Vec4::new(-1.0, 0.0, 0.0, -1.0); 3]
    );
    file.json["materials"][0] = json!({});
    assert!(file.import().meshes[0].tangents.is_empty());
}

#[test]
fn tangents_of_the_file_are_kept() {
    let mut file = normal_mapped();
    let tangents = file.floats("VEC4", &[0.0, 2.0, 0.0, -1.0].repeat(3));
    file.attribute("TANGENT", tangents);
    assert_eq!(
        file.import().meshes[0].tangents,
        [Vec4::new(0.0, 1.0, 0.0, -1.0); 3]
    );
}

#[test]
fn vertices_split_where_tangents_part() {
    // Two triangles share an edge, the texture is mirrored at it: the shared vertices need two tangents each.
    let mut file = normal_mapped();
    let positions = [0., 0., 0., 0., 1., 0., -1., 0., 0., 1., 0., 0.];
    let positions = file.floats("VEC3", &positions);
    file.attribute("POSITION", positions);
    let normals = file.floats("VEC3", &[0.0, 0.0, 1.0].repeat(4));
    file.attribute("NORMAL", normals);
    let uvs = file.floats("VEC2", &[0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]);
    file.attribute("TEXCOORD_0", uvs);
    let indices = file.indices(&[0, 1, 2, 0, 3, 1]);
    file.primitive()["indices"] = json!(indices);
    let mesh = &file.import().meshes[0];
    assert_eq!(mesh.positions.len(), 6);
    for (triangle, u_direction) in [([0, 1, 2], -1.0), ([3, 4, 5], 1.0)] {
        for corner in triangle {
            let tangent = mesh.tangents[mesh.indices[corner] as usize];
            assert_eq!(tangent, Vec4::new(u_direction, 0.0, 0.0, u_direction));
        }
    }
}

#[test]
fn a_normal_map_without_coordinates_is_a_warning() {
    let mut file = normal_mapped();
    file.json["materials"][0]["normalTexture"]["texCoord"] = json!(1);
    let scene = file.import();
    assert!(scene.meshes[0].tangents.is_empty());
    assert!(
        scene.warnings[0].contains("TEXCOORD_1"),
        "{:?}",
        scene.warnings
    );
}

#[test]
fn degenerate_triangles_stay_and_stay_finite() {
    let mut file = normal_mapped();
    let positions = file.floats("VEC3", &[1.0; 9]);
    file.attribute("POSITION", positions);
    let normals = file.floats("VEC3", &[0.0; 9]);
    file.attribute("NORMAL", normals);
    for _ in 0..2 {
        let mesh = &file.import().meshes[0];
        assert_eq!(mesh.indices.len(), 3);
        let is_unit = |vector: Vec3| (vector.length() - 1.0).abs() < 1e-5;
        assert!(mesh.normals.iter().all(|normal| is_unit(*normal)));
        assert!(
            mesh.tangents
                .iter()
                .all(|tangent| is_unit(tangent.truncate()))
        );
        // Again without normals.
        file.primitive()["attributes"]
            .as_object_mut()
            .unwrap()
            .remove("NORMAL");
    }
}

#[test]
fn wrong_geometry_is_named() {
    let place = "meshes[0].primitives[0].attributes.POSITION";
    let mut file = File::triangle();
    file.primitive()["attributes"] = json!({});
    file.assert_error(place, "no positions");
    let mut file = File::triangle();
    file.attribute("POSITION", 9);
    file.assert_error(place, "accessor 9 is out of range: there are 1");
    let mut file = File::triangle();
    let nan = file.floats("VEC3", &[0.0, 0.0, 0.0, 0.0, f32::NAN, 0.0, 0.0, 0.0, 0.0]);
    file.attribute("POSITION", nan);
    file.assert_error(place, "element 1 of accessors[1]");
    let mut file = File::triangle();
    file.json["accessors"][0]["type"] = json!("VEC2");
    file.assert_error(place, "VEC2");
    let mut file = File::triangle();
    let normals = file.floats("VEC3", &[0.0; 6]);
    file.attribute("NORMAL", normals);
    let place = "meshes[0].primitives[0].attributes.NORMAL";
    file.assert_error(place, "2 elements for 3 positions");
    let mut file = topology(4, 3, Some(&[0, 1, 3]));
    file.assert_error("meshes[0].primitives[0].indices", "index 3 at position 2");
    let floats = file.floats("SCALAR", &[0.0, 1.0, 2.0]);
    file.primitive()["indices"] = json!(floats);
    file.assert_error("meshes[0].primitives[0].indices", "unsigned integers");
}

#[test]
fn huge_counts_are_refused_before_allocation() {
    for count in [4_u64, 1 << 40, u64::MAX] {
        let mut file = File::triangle();
        file.json["accessors"][0]["count"] = json!(count);
        file.try_import().expect_err("there are three positions");
        // Elements that exist nowhere: all zero by definition.
        file.json["accessors"][0]
            .as_object_mut()
            .unwrap()
            .remove("bufferView");
        if count > 4 {
            file.try_import().expect_err("more than the limit");
        }
    }
    let mut file = File::triangle();
    file.json["accessors"][0]["byteOffset"] = json!(u64::MAX);
    file.assert_error("accessors[0]", "exceed the 36 bytes");
    let mut file = File::triangle();
    file.json["bufferViews"][0]["byteLength"] = json!(37);
    file.assert_error("bufferViews[0]", "exceed the 36 bytes of buffers[0]");
    let limits = Limits {
        scene_bytes: 1 << 10,
        ..Limits::default()
    };
    let bytes = File::triangle().glb();
    gpugi_scene::import("a.glb", &bytes, &Files::default(), &limits)
        .expect_err("three vertices exceed a limit of two");
}

#[test]
fn sparse_accessors_are_checked() {
    let mut file = File::triangle();
    let view = file.view(&[3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    let sparse = |count: u64| {
        json!({
            "count": count,
            "indices": { "bufferView": view, "componentType": 5121 },
            "values": { "bufferView": view },
        })
    };
    file.json["accessors"][0]["sparse"] = sparse(1);
    file.assert_error("accessors[0].sparse.indices", "element 3 is out of range");
    file.json["accessors"][0]["sparse"] = sparse(u64::MAX);
    file.assert_error("accessors[0].sparse", "of 3 elements");
}

#[test]
fn values_that_no_surface_has_are_replaced() {
    let place = "meshes[0].primitives[0]";
    let mut file = File::triangle();
    let (nan, inf) = (f32::NAN, f32::INFINITY);
    let normals = file.floats("VEC3", &[nan, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    file.attribute("NORMAL", normals);
    let scene = file.import_with_replaced(place, 2);
    assert_eq!(scene.meshes[0].normals, [Vec3::Z, Vec3::Z, Vec3::Y]);

    let mut file = File::triangle();
    let normals = file.floats("VEC3", &[0.0, 0.0, 1.0].repeat(3));
    let tangents = [0.0, 2.0, 0.0, -1.0, nan, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let tangents = file.floats("VEC4", &tangents);
    file.attribute("NORMAL", normals);
    file.attribute("TANGENT", tangents);
    let scene = file.import_with_replaced(place, 2);
    let tangents = &scene.meshes[0].tangents;
    assert_eq!(tangents[0].to_array(), [0.0, 1.0, 0.0, -1.0]);
    assert!(
        tangents
            .iter()
            .all(|tangent| tangent.z == 0.0 && tangent.truncate().is_normalized())
    );

    let mut file = File::triangle();
    let uvs = file.floats("VEC2", &[0.5, nan, 0.5, 0.25, inf, 0.0]);
    file.attribute("TEXCOORD_0", uvs);
    let scene = file.import_with_replaced(&format!("{place}.attributes.TEXCOORD_0"), 2);
    let expected = [Vec2::ZERO, Vec2::new(0.5, 0.25), Vec2::ZERO];
    assert_eq!(scene.meshes[0].uvs[0], expected);

    let mut file = File::triangle();
    let colors = file.floats("VEC3", &[0.5, 0.5, 0.5, nan, 0.0, 0.0, 0.25, 0.0, 0.0]);
    file.attribute("COLOR_0", colors);
    let scene = file.import_with_replaced(&format!("{place}.attributes.COLOR_0"), 1);
    let red: Vec<f32> = scene.meshes[0].colors.iter().map(|color| color.x).collect();
    assert_eq!(red, [0.5, 1.0, 0.25]);

    let mut file = File::triangle();
    let offsets = file.floats("VEC3", &[nan; 9]);
    file.primitive()["targets"] = json!([{ "NORMAL": offsets }]);
    file.import_with_replaced(&format!("{place}.targets[0].NORMAL"), 3);
}

#[test]
fn a_kind_of_broken_values_costs_one_note() {
    let mut file = File::triangle();
    let uvs = file.floats("VEC2", &[f32::NAN; 6]);
    file.attribute("TEXCOORD_0", uvs);
    let primitive = file.primitive().clone();
    file.json["meshes"][0]["primitives"] = json!(vec![primitive; 50]);
    file.import_with_replaced("meshes[0].primitives[0].attributes.TEXCOORD_0", 150);
}
