//! Scenes and meshes far from the origin.

use glam::{DVec3, Mat4, Vec3};
use gpugi_scene::{Limits, Scene, export, import};
use serde_json::json;

use crate::builder::{File, Files, U16};

/// Map coordinates with fractions that 32 bits do not hold.
const MAP: [f64; 3] = [500_000.125, 100.3, -4_200_000.7];

/// A room under a root node at `root`: a turned triangle, one without a turn, a camera, a light and a fog.
fn room(root: [f64; 3]) -> File {
    let mut file = File::triangle();
    file.json["nodes"][0]["translation"] = json!([0.5, 0.25, 0.0]);
    file.json["nodes"][0]["rotation"] = json!([0.0, 0.6, 0.0, 0.8]);
    file.push(
        "nodes",
        json!({ "mesh": 0, "translation": [-1.0, 2.0, 1.0] }),
    );
    file.push(
        "cameras",
        json!({ "type": "perspective", "perspective": { "yfov": 1.0, "znear": 0.1 } }),
    );
    file.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "point" }] } });
    let fog = json!({ "gpugi": { "medium": { "extinction": [1.0, 1.0, 1.0] } } });
    let light = json!({ "KHR_lights_punctual": { "light": 0 } });
    file.push(
        "nodes",
        json!({ "camera": 0, "translation": [0.0, 1.0, 4.2], "extensions": light }),
    );
    file.push(
        "nodes",
        json!({ "translation": [0.0, 0.5, 0.0], "extras": fog }),
    );
    file.push(
        "nodes",
        json!({ "children": [0, 1, 2, 3], "translation": root }),
    );
    file.push("scenes", json!({ "nodes": [4] }));
    file
}

fn places(scene: &Scene) -> Vec<Mat4> {
    let instances = scene
        .instances
        .iter()
        .map(|instance| instance.world_from_mesh);
    let cameras = scene.cameras.iter().map(|camera| camera.world_from_view);
    let lights = scene.lights.iter().map(|light| light.world_from_light);
    let media = scene
        .media
        .iter()
        .filter_map(|medium| medium.world_from_box);
    instances
        .chain(cameras)
        .chain(lights)
        .chain(media)
        .collect()
}

/// Whether both scenes stand in the same places in their files' coordinates, but for `moved`.
#[track_caller]
fn assert_moved(far: &Scene, near: &Scene, moved: DVec3, tolerance: f64) {
    let (far_places, near_places) = (places(far), places(near));
    assert_eq!(far_places.len(), near_places.len());
    for (a, b) in far_places.iter().zip(&near_places) {
        let (a, b) = (far.file_from(*a), near.file_from(*b));
        assert!(
            (a.w_axis - b.w_axis)
                .truncate()
                .abs_diff_eq(moved, tolerance),
            "{a} {b}"
        );
        let turned = |place: glam::DMat4| glam::DMat3::from_mat4(place);
        assert!(turned(a).abs_diff_eq(turned(b), 1e-6), "{a} {b}");
    }
}

#[test]
fn a_far_root_node_gives_the_same_scene_and_an_origin() {
    let near = room([0.0; 3]).import();
    assert_eq!(near.origin, DVec3::ZERO);
    for root in [[1e4, 0.0, 2e4], MAP, [1e6, 1e6, 1e6]] {
        let far = room(root).import();
        assert_eq!(far.warnings, [""; 0]);
        assert_eq!(far.origin, far.origin.round());
        assert!(far.bounds().center().length() < 3.0);
        assert_moved(&far, &near, DVec3::from(root), 1e-6);
        let statistics = far.statistics();
        let low = DVec3::from(near.statistics().bounds_min) + DVec3::from(root);
        assert!(
            low.abs_diff_eq(statistics.bounds_min.into(), 1e-6),
            "{statistics:?}"
        );
        assert_eq!(statistics.origin, far.origin.to_array());
    }
}

#[test]
fn a_written_scene_stands_where_its_file_stood() {
    let far = room(MAP).import();
    let written = export::export_scene(&far).unwrap();
    let again = import("a.glb", &written.glb, &Files::default(), &Limits::default()).unwrap();
    assert_eq!(again.origin, far.origin);
    assert_moved(&again, &far, DVec3::ZERO, 1e-6);
}

/// Channels move nodes within the far root, and skins follow their joints.
#[test]
fn what_moves_far_away_moves_as_it_does_at_the_origin() {
    let moving = |root: [f64; 3]| {
        let mut file = room(root);
        let input = file.floats("SCALAR", &[0.0, 1.0]);
        let output = file.floats("VEC3", &[0.5, 0.25, 0.0, 0.7, 0.25, 0.0]);
        let channel = |node: usize| json!({ "sampler": 0, "target": { "node": node, "path": "translation" } });
        file.push("animations", json!({
            "channels": [channel(0), channel(2), channel(3)], "samplers": [{ "input": input, "output": output }],
        }));
        file.import()
    };
    let (mut near, mut far) = (moving([0.0; 3]), moving(MAP));
    for time in [0.0, 0.3, 0.9] {
        near.pose(time);
        far.pose(time);
        assert_moved(&far, &near, DVec3::from(MAP), 1e-6);
    }

    let skinned = |root: [f64; 3]| {
        let mut file = File::triangle();
        let joints = file.accessor("VEC4", U16, 3, bytemuck::cast_slice(&[0_u16; 12]));
        file.attribute("JOINTS_0", joints);
        let weights = file.floats("VEC4", &[1.0, 0.0, 0.0, 0.0].repeat(3));
        file.attribute("WEIGHTS_0", weights);
        file.json["nodes"][0]["skin"] = json!(0);
        file.push("nodes", json!({ "translation": [0.125, 1.0, 0.0] }));
        file.push("nodes", json!({ "children": [0, 1], "translation": root }));
        file.push("skins", json!({ "joints": [1] }));
        file.import()
    };
    let (near, far) = (skinned([0.0; 3]), skinned(MAP));
    for (a, b) in far.meshes[0]
        .positions
        .iter()
        .zip(&near.meshes[0].positions)
    {
        let moved = far.in_file(*a) - near.in_file(*b);
        assert!(moved.abs_diff_eq(MAP.into(), 1e-6), "{moved}");
    }
}

/// A file whose vertices hold the coordinates, with or without a node that brings them back.
#[test]
fn far_vertices_become_near_ones() {
    let at = Vec3::new(500_000.0, 128.0, -4_200_000.0);
    let file = |corner: Vec3, node: Vec3| {
        let mut file = File::empty();
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y].map(|offset| (offset + corner).to_array());
        let positions = file.floats("VEC3", corners.as_flattened());
        file.push(
            "meshes",
            json!({ "primitives": [{ "attributes": { "POSITION": positions } }] }),
        );
        file.push(
            "nodes",
            json!({ "mesh": 0, "translation": node.to_array() }),
        );
        file.import()
    };
    let corners = |scene: &Scene| {
        let one = &scene.instances[0];
        let positions = scene.meshes[one.mesh].positions.iter();
        let in_world = positions.map(|position| one.world_from_mesh.transform_point3(*position));
        in_world
            .map(|position| scene.in_file(position))
            .collect::<Vec<_>>()
    };
    let near = file(Vec3::ZERO, Vec3::ZERO);
    assert_eq!(near.meshes[0].origin, DVec3::ZERO);
    for node in [Vec3::ZERO, -at] {
        let far = file(at, node);
        assert!(far.meshes[0].bounds().diagonal() < 2.0);
        assert!(far.meshes[0].bounds().center().length() < 2.0);
        for (a, b) in corners(&far).iter().zip(corners(&near)) {
            assert_eq!(*a, b + (at + node).as_dvec3());
        }
        // 32 bits have steps of half a metre there.
        assert_eq!(far.warnings.len(), 1, "{:?}", far.warnings);
        assert!(
            far.warnings[0].contains("steps of 50 cm"),
            "{:?}",
            far.warnings
        );
    }
}

#[test]
fn what_lies_far_from_the_rest_is_said() {
    let mut file = room([0.0; 3]);
    file.push(
        "nodes",
        json!({ "mesh": 0, "name": "stray", "translation": [5e5, 0.0, 0.0] }),
    );
    file.json["scenes"][0]["nodes"] = json!([4, 5]);
    let scene = file.import();
    assert_eq!(scene.origin, DVec3::ZERO);
    assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
    for said in ["one object lies far", "3 cm", "\"stray\""] {
        assert!(scene.warnings[0].contains(said), "{:?}", scene.warnings);
    }
}
