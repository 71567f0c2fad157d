//! Channels, skins and morph targets.

use glam::{Mat4, Quat, Vec3};
use gpugi_scene::Scene;
use serde_json::json;

use crate::builder::{File, U16};

/// Animates `path` of node 0.
fn animate(file: &mut File, path: &str, kind: &str, mode: &str, times: &[f32], values: &[f32]) {
    let input = file.floats("SCALAR", times);
    let output = file.floats(kind, values);
    file.push(
        "animations",
        json!({
            "channels": [{ "sampler": 0, "target": { "node": 0, "path": path } }],
            "samplers": [{ "input": input, "output": output, "interpolation": mode }],
        }),
    );
}

/// A triangle that moves along x.
fn moving(mode: &str, times: &[f32], x: &[f32]) -> Scene {
    let mut file = File::triangle();
    let values: Vec<f32> = x.iter().flat_map(|&x| [x, 0.0, 0.0]).collect();
    animate(&mut file, "translation", "VEC3", mode, times, &values);
    file.import()
}

#[track_caller]
fn assert_x(scene: &mut Scene, time: f32, x: f32) {
    scene.pose(time);
    let found = scene.instances[0].world_from_mesh.w_axis.x;
    assert!(
        (found - x).abs() < 1e-5,
        "at {time} s: x = {found}, not {x}"
    );
}

/// 32-bit keys hold a short way in map coordinates in steps.
#[test]
fn keys_far_from_the_origin_are_said_to_be_coarse() {
    let scene = moving("LINEAR", &[0.0, 1.0], &[5e5, 5e5 + 2.0]);
    let [warning] = &scene.warnings[..] else {
        panic!("{:?}", scene.warnings);
    };
    assert!(warning.contains("animations[0]") && warning.contains("steps of 3 cm"));
    assert_eq!(moving("LINEAR", &[0.0, 1.0], &[0.0, 5e5]).warnings, [""; 0]);
}

#[test]
fn steps_hold() {
    let mut scene = moving("STEP", &[0.0, 1.0, 2.0], &[5.0, 7.0, 9.0]);
    assert_x(&mut scene, 0.0, 5.0);
    assert_x(&mut scene, 0.99, 5.0);
    assert_x(&mut scene, 1.0, 7.0);
}

#[test]
fn lines_interpolate_and_loop() {
    let mut scene = moving("LINEAR", &[1.0, 3.0, 4.0], &[0.0, 4.0, 0.0]);
    assert_x(&mut scene, 0.5, 0.0);
    assert_x(&mut scene, 2.0, 2.0);
    assert_x(&mut scene, 3.25, 3.0);
    assert_x(&mut scene, 4.0 + 2.0, 2.0);
    assert_x(&mut scene, -1.0 + 0.25, 3.0);
    assert_x(&mut scene, f32::NAN, 0.0);
}

#[test]
fn splines_follow_their_tangents() {
    // In-tangent, value, out-tangent: from 0 to 1 over 2 s, leaving with slope 1, arriving with slope 0.
    let mut scene = moving("CUBICSPLINE", &[0.0, 2.0], &[0.0, 0.0, 1.0, 0.0, 1.0, 0.0]);
    assert_x(&mut scene, 0.0, 0.0);
    // s = 1/2: v0/2 + 2 s (1/8 b0) + v1/2 = 0.25 + 0.5 with td = 2.
    assert_x(&mut scene, 1.0, 0.75);
    // Arriving with slope 2 instead: td (s^3 - s^2) a1 = 2 (-1/8) 2 less.
    let mut scene = moving("CUBICSPLINE", &[0.0, 2.0], &[0.0, 0.0, 1.0, 2.0, 1.0, 0.0]);
    assert_x(&mut scene, 1.0, 0.25);
}

#[test]
fn import_ends_at_time_zero() {
    let scene = moving("LINEAR", &[0.0, 1.0], &[3.0, 4.0]);
    assert_eq!(scene.instances[0].world_from_mesh.w_axis.x, 3.0);
    assert_eq!(scene.instances[0].node, Some(0));
    assert_eq!(scene.rig.unwrap().duration(), 1.0);
}

#[test]
fn rotations_take_the_shortest_arc() {
    let mut file = File::triangle();
    let quarter = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2);
    // The same rotation with the opposite sign: a straight line would go through nothing.
    let values = [Quat::IDENTITY.to_array(), (-quarter).to_array()].concat();
    animate(
        &mut file,
        "rotation",
        "VEC4",
        "LINEAR",
        &[0.0, 2.0],
        &values,
    );
    let mut scene = file.import();
    scene.pose(1.0);
    let turned = scene.instances[0]
        .world_from_mesh
        .transform_vector3(Vec3::X);
    let expected = Quat::from_rotation_z(std::f32::consts::FRAC_PI_4) * Vec3::X;
    assert!(turned.abs_diff_eq(expected, 1e-5), "{turned}");
}

#[test]
fn all_animations_play_and_carry_children_lights_and_cameras() {
    let mut file = File::triangle();
    animate(
        &mut file,
        "translation",
        "VEC3",
        "LINEAR",
        &[0.0, 2.0],
        &[0.0, 0.0, 0.0, 2.0, 0.0, 0.0],
    );
    animate(
        &mut file,
        "scale",
        "VEC3",
        "LINEAR",
        &[0.0, 1.0],
        &[1.0, 1.0, 1.0, 3.0, 3.0, 3.0],
    );
    file.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "point" }] } });
    file.json["nodes"][0]["children"] = json!([1]);
    file.push("nodes", json!({
        "translation": [1.0, 0.0, 0.0], "camera": 0, "extensions": { "KHR_lights_punctual": { "light": 0 } },
    }));
    file.push(
        "cameras",
        json!({ "type": "perspective", "perspective": { "yfov": 1.0, "znear": 0.1 } }),
    );
    let mut scene = file.import();
    // The second animation has started again: scale 2. The child sits one scaled metre from its parent.
    scene.pose(1.5);
    assert_eq!(scene.instances[0].world_from_mesh.w_axis.x, 1.5);
    assert_eq!(scene.instances[0].world_from_mesh.x_axis.x, 2.0);
    assert_eq!(scene.lights[0].position(), Vec3::X * 3.5);
    assert_eq!(
        scene.cameras[0].world_from_view,
        Mat4::from_translation(Vec3::X * 3.5)
    );
}

/// A triangle with normals and one morph target that lifts it along z and tilts its normals toward x.
fn morphing(with_normals: bool) -> File {
    let mut file = File::triangle();
    if with_normals {
        let normals = file.floats("VEC3", &[0.0, 0.0, 1.0].repeat(3));
        file.attribute("NORMAL", normals);
    }
    let lift = file.floats("VEC3", &[0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0]);
    let tilt = file.floats("VEC3", &[1.0, 0.0, 0.0].repeat(3));
    file.primitive()["targets"] = json!([{ "POSITION": lift, "NORMAL": tilt }]);
    file
}

#[test]
fn morph_targets_have_default_weights() {
    let mut file = morphing(true);
    let corner = |file: &File| file.import().meshes[0].positions[1];
    assert_eq!(corner(&file), Vec3::X);
    file.json["meshes"][0]["weights"] = json!([0.5]);
    assert_eq!(corner(&file), Vec3::new(1.0, 0.0, 1.0));
    file.json["nodes"][0]["weights"] = json!([1.0]);
    assert_eq!(corner(&file), Vec3::new(1.0, 0.0, 2.0));
    let normal = file.import().meshes[0].normals[0];
    assert!(normal.abs_diff_eq(Vec3::new(1.0, 0.0, 1.0).normalize(), 1e-6));
    file.json["nodes"][0]["weights"] = json!([1.0, 0.0]);
    file.assert_error("nodes[0].weights", "2 weights for 1 morph targets");
}

#[test]
fn morph_weights_are_animated() {
    let mut file = morphing(true);
    animate(
        &mut file,
        "weights",
        "SCALAR",
        "LINEAR",
        &[0.0, 1.0],
        &[0.0, 1.0],
    );
    let mut scene = file.import();
    scene.pose(0.25);
    assert_eq!(scene.meshes[0].positions[1], Vec3::new(1.0, 0.0, 0.5));
    scene.pose(0.0);
    assert_eq!(scene.meshes[0].positions[1], Vec3::X);
}

#[test]
fn flat_normals_follow_morph_targets() {
    let mut file = morphing(false);
    file.json["nodes"][0]["weights"] = json!([0.5]);
    let mesh = &file.import().meshes[0];
    // (1, 0, 1) x (0, 1, 0)
    let expected = Vec3::new(-1.0, 0.0, 1.0).normalize();
    assert!(
        mesh.normals
            .iter()
            .all(|normal| normal.abs_diff_eq(expected, 1e-6))
    );
}

#[test]
fn morph_targets_and_skins_follow_split_vertices() {
    // Flat normals reorder the vertices to 2, 0, 1; what bends them must follow.
    let mut file = morphing(false);
    let indices = file.indices(&[2, 0, 1]);
    file.primitive()["indices"] = json!(indices);
    file.json["nodes"][0]["weights"] = json!([1.0]);
    let expected = [Vec3::Y, Vec3::ZERO, Vec3::new(1.0, 0.0, 2.0)];
    assert_eq!(file.import().meshes[0].positions, expected);
    let mut file = skinned();
    file.primitive()["attributes"]
        .as_object_mut()
        .unwrap()
        .remove("NORMAL");
    let indices = file.indices(&[2, 0, 1]);
    file.primitive()["indices"] = json!(indices);
    // Joint 2 moves away: corner 1 goes along, corner 2 half the way.
    file.json["nodes"][2]["translation"] = json!([3.0, 0.0, 0.0]);
    let expected = [Vec3::new(1.0, 1.0, 1.0), Vec3::Z, Vec3::new(3.0, 0.0, 1.0)];
    assert_eq!(file.import().meshes[0].positions, expected);
}

#[test]
fn a_mesh_for_skins_stands_still_without_one() {
    let mut file = skinned();
    file.json["nodes"][0]
        .as_object_mut()
        .unwrap()
        .remove("skin");
    let scene = file.import();
    assert!(scene.rig.is_none());
    assert_eq!(scene.instances[0].world_from_mesh.w_axis.x, 100.0);
}

#[test]
fn instances_morph_apart() {
    let mut file = morphing(true);
    file.json["nodes"][0]["weights"] = json!([1.0]);
    file.push("nodes", json!({ "mesh": 0 }));
    let scene = file.import();
    assert_eq!(scene.meshes.len(), 2);
    let corner = |instance: usize| scene.meshes[scene.instances[instance].mesh].positions[1].z;
    assert_eq!((corner(0), corner(1)), (2.0, 0.0));
}

/// A triangle whose corner 0 follows joint 1, corner 1 joint 2, corner 2 both. Node 0 is the mesh, far away.
fn skinned() -> File {
    let mut file = File::triangle();
    let normals = file.floats("VEC3", &[0.0, 0.0, 1.0].repeat(3));
    file.attribute("NORMAL", normals);
    let joints: [u16; 12] = [0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 99, 0];
    let joints = file.accessor("VEC4", U16, 3, bytemuck::cast_slice(&joints));
    file.attribute("JOINTS_0", joints);
    // The last corner's weights do not sum to 1, and name a joint that does not exist with weight 0.
    let weights = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 2.0, 0.0, 0.0];
    let weights = file.floats("VEC4", &weights);
    file.attribute("WEIGHTS_0", weights);
    let inverse = Mat4::from_translation(-Vec3::X);
    let matrices = [Mat4::IDENTITY.to_cols_array(), inverse.to_cols_array()].concat();
    let matrices = file.floats("MAT4", &matrices);
    file.push(
        "skins",
        json!({ "joints": [1, 2], "inverseBindMatrices": matrices }),
    );
    file.json["nodes"][0] = json!({ "mesh": 0, "skin": 0, "translation": [100.0, 0.0, 0.0] });
    file.push(
        "nodes",
        json!({ "children": [2], "translation": [0.0, 0.0, 1.0] }),
    );
    file.push("nodes", json!({ "translation": [1.0, 0.0, 0.0] }));
    file
}

#[test]
fn skins_blend_joints_and_ignore_their_own_node() {
    let scene = skinned().import();
    assert_eq!(scene.instances[0].world_from_mesh, Mat4::IDENTITY);
    // At rest, joint 2 stands where its inverse bind matrix expects it: everything moves with joint 1.
    assert_eq!(
        scene.meshes[0].positions,
        [Vec3::Z, Vec3::new(1.0, 0.0, 1.0), Vec3::new(0.0, 1.0, 1.0)]
    );
}

#[test]
fn animated_joints_bend_positions_and_normals() {
    let mut file = skinned();
    let quarter = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2).to_array();
    file.json["nodes"][2]["rotation"] = json!(quarter);
    let mesh = &file.import().meshes[0];
    // Corner 1 is joint 2's origin; its normal turns with the joint, from +Z to +X.
    assert!(mesh.positions[1].abs_diff_eq(Vec3::new(1.0, 0.0, 1.0), 1e-6));
    assert!(
        mesh.normals[1].abs_diff_eq(Vec3::X, 1e-6),
        "{}",
        mesh.normals[1]
    );
    assert_eq!(mesh.normals[0], Vec3::Z);
    // Corner 2 at (-1, 1, 0) from joint 2 turns to (0, 1, 1): half way between (1, 1, 2) and (0, 1, 1).
    let corner = mesh.positions[2];
    assert!(
        corner.abs_diff_eq(Vec3::new(0.5, 1.0, 1.5), 1e-6),
        "{corner}"
    );
}

#[test]
fn wrong_rigs_are_named() {
    let mut file = skinned();
    file.json["skins"][0]["joints"] = json!([1]);
    file.assert_error("nodes[0].skin", "joint 1 of 1");
    let mut file = skinned();
    file.json["skins"][0]["joints"] = json!([1, 2, 1]);
    file.assert_error("skins[0].inverseBindMatrices", "2 matrices for 3 joints");
    let mut file = skinned();
    file.json["skins"][0]["joints"] = json!([1, 7]);
    file.assert_error("skins[0].joints", "node 7");
    let mut file = skinned();
    file.primitive()["attributes"]
        .as_object_mut()
        .unwrap()
        .remove("WEIGHTS_0");
    file.assert_error("meshes[0].primitives[0].attributes", "WEIGHTS_0");
    let with_keys = |times: &[f32], values: &[f32]| {
        let mut file = File::triangle();
        animate(&mut file, "translation", "VEC3", "LINEAR", times, values);
        file
    };
    let place = "animations[0].channels[0].sampler";
    with_keys(&[0.0, 0.0], &[0.0; 6]).assert_error(&format!("{place}.input"), "increase");
    with_keys(&[], &[]).assert_error(&format!("{place}.input"), "no keys");
    with_keys(&[0.0, 1.0], &[0.0; 3])
        .assert_error(&format!("{place}.output"), "3 numbers for 2 keys");
}

#[test]
fn a_joint_that_overflows_leaves_finite_vertices() {
    let mut file = skinned();
    file.json["nodes"][0]["children"] = json!([]);
    animate(
        &mut file,
        "scale",
        "VEC3",
        "LINEAR",
        &[0.0, 1.0],
        &[1.0, 1.0, 1.0, 3e38, 3e38, 3e38],
    );
    file.json["animations"][0]["channels"][0]["target"]["node"] = json!(2);
    let mut scene = file.import();
    for step in 0..10 {
        scene.pose(step as f32 / 10.0);
        scene.meshes[0].check().unwrap();
    }
}
