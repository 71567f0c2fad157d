//! The hierarchy, instances, lights and cameras.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

use glam::{Mat4, Quat, Vec3};
use gpugi_scene::{Lens, LightKind, Projection};
use serde_json::{Value, json};

use crate::builder::File;

/// A file with one light on one node.
fn lit(light: Value) -> File {
    let mut file = File::empty();
    file.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    file.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [light] } });
    file.push(
        "nodes",
        json!({ "extensions": { "KHR_lights_punctual": { "light": 0 } } }),
    );
    file
}

#[test]
fn transforms_multiply_from_the_root() {
    let mut file = File::triangle();
    let half = std::f32::consts::FRAC_1_SQRT_2;
    // A quarter turn about +Z, then a step along +X.
    file.json["nodes"][0]["translation"] = json!([0.0, 1.0, 0.0]);
    file.push(
        "nodes",
        json!({ "children": [0], "rotation": [0.0, 0.0, half, half], "translation": [10.0, 0.0, 0.0], "scale": [2.0, 2.0, 2.0] }),
    );
    let world_from_mesh = file.import().instances[0].world_from_mesh;
    let point = world_from_mesh.transform_point3(Vec3::X);
    assert!(point.abs_diff_eq(Vec3::new(8.0, 2.0, 0.0), 1e-5), "{point}");
}

#[test]
fn matrices_are_column_major() {
    let mut file = File::triangle();
    let matrix = Mat4::from_translation(Vec3::new(1.0, 2.0, 3.0));
    file.json["nodes"][0]["matrix"] = json!(matrix.to_cols_array());
    assert_eq!(file.import().instances[0].world_from_mesh, matrix);
}

#[test]
fn instances_share_a_mesh() {
    let mut file = File::triangle();
    file.push(
        "nodes",
        json!({ "mesh": 0, "name": "second", "translation": [1.0, 0.0, 0.0] }),
    );
    let scene = file.import();
    assert_eq!(scene.meshes.len(), 1);
    assert_eq!(scene.instances.len(), 2);
    assert_eq!((scene.instances[0].mesh, scene.instances[1].mesh), (0, 0));
    assert_eq!(scene.instances[1].name, "second");
    assert!(scene.rig.is_none());
    assert_eq!(scene.instances[0].node, None);
}

#[test]
fn each_primitive_is_an_instance() {
    let mut file = File::triangle();
    file.push("materials", json!({ "name": "red" }));
    let mut second = file.primitive().clone();
    second["material"] = json!(0);
    file.json["meshes"][0]["primitives"]
        .as_array_mut()
        .unwrap()
        .push(second);
    let scene = file.import();
    assert_eq!((scene.meshes.len(), scene.instances.len()), (2, 2));
    assert_eq!(scene.materials[scene.instances[1].material].name, "red");
    assert_eq!(scene.materials[scene.instances[0].material].name, "default");
}

#[test]
fn only_the_default_scene_is_read() {
    let mut file = File::triangle();
    file.push("nodes", json!({ "name": "parent", "children": [2] }));
    file.push("nodes", json!({ "name": "child", "mesh": 0 }));
    file.push("scenes", json!({ "nodes": [0] }));
    file.push("scenes", json!({ "nodes": [1] }));
    file.json["scene"] = json!(1);
    let scene = file.import();
    assert_eq!(scene.instances.len(), 1);
    assert_eq!(scene.instances[0].name, "child");
    file.json["scene"] = json!(2);
    file.assert_error("scene", "out of range");
}

/// What hides a node hides what hangs on it: meshes and lights, but no cameras.
#[test]
fn hidden_nodes_show_nothing() {
    let mut file = lit(json!({ "type": "point" }));
    let positions = file.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    let mesh = json!({ "primitives": [{ "attributes": { "POSITION": positions } }] });
    file.push("meshes", mesh);
    let camera = json!({ "type": "perspective", "perspective": { "yfov": 1.0, "znear": 0.1 } });
    file.push("cameras", camera);
    let light = file.json["nodes"].as_array().unwrap().len() - 1;
    file.push("nodes", json!({ "mesh": 0, "children": [light] }));
    file.push("nodes", json!({ "camera": 0, "children": [light + 1] }));
    let counts = |file: &File| {
        let scene = file.import();
        [
            scene.instances.len(),
            scene.lights.len(),
            scene.cameras.len(),
        ]
    };
    let all = counts(&file);
    assert_eq!(all[1..], [1, 1]);
    file.json["extensionsUsed"]
        .as_array_mut()
        .unwrap()
        .push(json!("KHR_node_visibility"));
    for (visible, expected) in [(true, all), (false, [all[0] - 1, 0, 1])] {
        file.json["nodes"][light + 2]["extensions"] =
            json!({ "KHR_node_visibility": { "visible": visible } });
        assert_eq!(counts(&file), expected);
    }
}

#[test]
fn cycles_and_second_parents_are_errors() {
    let mut file = File::triangle();
    file.push("nodes", json!({ "children": [2] }));
    file.push("nodes", json!({ "children": [1] }));
    file.assert_error("nodes[1]", "cyclic");
    let mut file = File::triangle();
    file.json["nodes"][0]["children"] = json!([0]);
    file.assert_error("nodes[0]", "cyclic");
    let mut file = File::triangle();
    file.push("nodes", json!({ "children": [0] }));
    file.push("nodes", json!({ "children": [0] }));
    file.assert_error("nodes[2].children", "already a child of nodes[1]");
    let mut file = File::triangle();
    file.json["nodes"][0]["children"] = json!([7]);
    file.assert_error("nodes[0].children", "node 7 is out of range");
}

#[test]
fn deep_hierarchies_do_not_overflow_the_stack() {
    let mut file = File::triangle();
    for parent in 0..100_000 {
        file.push("nodes", json!({ "children": [parent] }));
    }
    assert_eq!(file.import().instances.len(), 1);
}

#[test]
fn degenerate_matrices_are_kept_with_a_warning() {
    let mut file = File::triangle();
    file.json["nodes"][0]["scale"] = json!([1.0, 0.0, 1.0]);
    let scene = file.import();
    assert_eq!(scene.instances.len(), 1);
    assert!(
        scene.warnings[0].contains("flattens"),
        "{:?}",
        scene.warnings
    );
}

#[test]
fn infinite_matrices_are_errors() {
    let mut file = File::triangle();
    file.json["nodes"][0]["scale"] = json!([1e30, 1e30, 1e30]);
    file.push(
        "nodes",
        json!({ "children": [0], "scale": [1e30, 1e30, 1e30] }),
    );
    file.assert_error("nodes[0]", "not finite");
}

#[test]
fn point_lights() {
    let mut file = lit(json!({
        "type": "point", "name": "lamp", "color": [1.0, 0.5, 0.25], "intensity": 8.0, "range": 20.0,
        "extras": { "gpugi": { "radius": 0.25 } },
    }));
    file.json["nodes"][0]["translation"] = json!([1.0, 2.0, 3.0]);
    let light = &file.import().lights[0];
    assert_eq!(light.name, "lamp");
    assert_eq!(light.kind, LightKind::Point);
    assert_eq!(light.intensity, Vec3::new(8.0, 4.0, 2.0));
    assert_eq!((light.range, light.radius), (Some(20.0), 0.25));
    assert_eq!(light.position(), Vec3::new(1.0, 2.0, 3.0));
}

#[test]
fn spot_and_directional_lights() {
    let light = |source| lit(source).import().lights.remove(0);
    let spot =
        light(json!({ "type": "spot", "spot": { "innerConeAngle": 0.25, "outerConeAngle": 0.5 } }));
    let cone = LightKind::Spot {
        inner_cone_angle: 0.25,
        outer_cone_angle: 0.5,
    };
    assert_eq!((spot.kind, spot.range, spot.radius), (cone, None, 0.0));
    let default = LightKind::Spot {
        inner_cone_angle: 0.0,
        outer_cone_angle: std::f32::consts::FRAC_PI_4,
    };
    assert_eq!(light(json!({ "type": "spot" })).kind, default);
    assert_eq!(
        light(json!({ "type": "directional" })).kind,
        LightKind::Directional
    );
}

#[test]
fn wrong_lights_are_left_out_or_mended() {
    let place = "extensions.KHR_lights_punctual.lights[0]";
    for (light, reason) in [
        (json!({ "type": "laser" }), "\"laser\" is no kind"),
        (
            json!({ "type": "point", "intensity": -1.0 }),
            "[-1, -1, -1] is no intensity",
        ),
        (
            json!({ "type": "point", "intensity": 1e39 }),
            "[inf, inf, inf] is no",
        ),
        (
            json!({ "type": "point", "intensity": null }),
            "[NaN, NaN, NaN] is no",
        ),
    ] {
        let scene = lit(light).import_with_note(&format!("{place}: {reason}"));
        assert!(scene.lights.is_empty());
    }
    let mended = |light: serde_json::Value, note: &str| {
        let scene = lit(light).import_with_note(&format!("{place}{note}"));
        scene.lights[0].clone()
    };
    let light = mended(json!({ "type": "point", "range": 0.0 }), ": the range");
    assert_eq!(light.range, None);
    let radius = json!({ "type": "point", "extras": { "gpugi": { "radius": -1.0 } } });
    assert_eq!(mended(radius, ".extras.gpugi: radius").radius, 0.0);
    for (inner, outer, used) in [
        (json!(0.5), json!(0.25), [0.25, 0.25]),
        (json!(-0.5), json!(0.25), [0.0, 0.25]),
        (json!(0.5), json!(3.0), [0.5, FRAC_PI_2]),
        (json!(0.5), json!(-1.0), [0.5, FRAC_PI_4]),
        (json!(null), json!(0.25), [0.0, 0.25]),
    ] {
        let spot = json!({ "innerConeAngle": inner, "outerConeAngle": outer });
        let light = mended(
            json!({ "type": "spot", "spot": spot }),
            ".spot: cone angles",
        );
        let [inner_cone_angle, outer_cone_angle] = used;
        let cone = LightKind::Spot {
            inner_cone_angle,
            outer_cone_angle,
        };
        assert_eq!(light.kind, cone);
    }
    let mut file = lit(json!({ "type": "point" }));
    file.json["nodes"][0]["extensions"]["KHR_lights_punctual"]["light"] = json!(1);
    file.assert_error("nodes[0].extensions.KHR_lights_punctual", "light 1");
}

#[test]
fn a_spot_may_have_a_hard_edge() {
    let spot = json!({ "innerConeAngle": 0.25, "outerConeAngle": 0.25 });
    let scene = lit(json!({ "type": "spot", "spot": spot })).import();
    let cone = LightKind::Spot {
        inner_cone_angle: 0.25,
        outer_cone_angle: 0.25,
    };
    assert_eq!(scene.lights[0].kind, cone);
    assert!(scene.warnings.is_empty());
}

#[test]
fn scale_does_not_reach_lights_and_cameras() {
    let mut file = lit(json!({ "type": "directional" }));
    let turn = Quat::from_rotation_y(1.0);
    file.json["nodes"][0]["rotation"] = json!(turn.to_array());
    file.json["nodes"][0]["scale"] = json!([2.0, 3.0, -4.0]);
    file.json["nodes"][0]["camera"] = json!(0);
    file.push(
        "cameras",
        json!({ "type": "perspective", "perspective": { "yfov": 1.0, "znear": 0.1 } }),
    );
    let scene = file.import();
    for matrix in [
        scene.lights[0].world_from_light,
        scene.cameras[0].world_from_view,
    ] {
        assert!((matrix.determinant() - 1.0).abs() < 1e-5, "{matrix}");
        assert!(matrix.x_axis.truncate().is_normalized());
        // The negative scale turns the light around, but must not mirror it.
        assert!(matrix.z_axis.truncate().abs_diff_eq(turn * -Vec3::Z, 1e-5));
    }
}

#[test]
fn cameras() {
    let mut file = File::empty();
    let camera = json!({ "type": "perspective", "perspective": { "yfov": 0.75, "znear": 0.1 } });
    file.push("cameras", camera);
    let camera = json!({ "type": "orthographic", "name": "plan",
        "orthographic": { "xmag": 1.0, "ymag": 2.5, "znear": 0.1, "zfar": 9.0 } });
    file.push("cameras", camera);
    file.push(
        "nodes",
        json!({ "camera": 0, "name": "eye", "translation": [0.0, 0.0, 5.0] }),
    );
    file.push("nodes", json!({ "camera": 1 }));
    let cameras = file.import().cameras;
    assert_eq!(cameras[0].name, "eye");
    assert_eq!(
        cameras[0].projection,
        Projection::Perspective { vertical_fov: 0.75 }
    );
    assert_eq!(
        cameras[0].world_from_view,
        Mat4::from_translation(Vec3::Z * 5.0)
    );
    assert_eq!(cameras[1].name, "plan");
    assert_eq!(
        cameras[1].projection,
        Projection::Orthographic { height: 5.0 }
    );
    file.json["cameras"][0]["perspective"]["yfov"] = json!(4.0);
    file.assert_error("cameras[0].perspective.yfov", "pi");
    file.json["cameras"][0] = json!({ "type": "perspective" });
    file.assert_error("cameras[0]", "either");
}

/// A file whose node stands where `attributes` say.
fn in_places(attributes: Value) -> File {
    let mut file = File::triangle();
    file.json["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"]);
    file.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    file.json["nodes"][0]["extensions"] =
        json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
    file
}

#[test]
fn a_mesh_stands_in_many_places() {
    let mut file = in_places(json!({}));
    let translations = file.floats("VEC3", &[1.0, 0.0, 0.0, 0.0, 0.0, 5.0]);
    // A half turn about +Z, in normalised bytes.
    let rotations = file.accessor("VEC4", 5120, 2, &[0, 0, 0, 127, 0, 0, 127, 0]);
    file.json["accessors"][rotations]["normalized"] = json!(true);
    let scales = file.floats("VEC3", &[1.0, 1.0, 1.0, 2.0, 2.0, 2.0]);
    let ids = file.floats("SCALAR", &[7.0, 8.0]);
    file.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] =
        json!({ "TRANSLATION": translations, "ROTATION": rotations, "SCALE": scales, "_ID": ids });
    file.json["nodes"][0]["translation"] = json!([0.0, 10.0, 0.0]);
    let children = json!({ "children": [0, 2], "translation": [0.0, 0.0, 100.0] });
    file.push("nodes", children);
    file.push("nodes", json!({ "mesh": 0 }));
    let scene = file.import();
    assert_eq!(scene.warnings, [""; 0]);
    assert_eq!((scene.meshes.len(), scene.instances.len()), (1, 3));
    let places = scene.instances.iter().map(|instance| {
        let origin = instance.origin.unwrap();
        (
            origin.node,
            origin.place,
            instance.world_from_mesh.transform_point3(Vec3::X),
        )
    });
    let places: Vec<_> = places.collect();
    assert_eq!(places[0], (2, None, Vec3::new(1.0, 0.0, 100.0)));
    assert_eq!(places[1], (0, Some(0), Vec3::new(2.0, 10.0, 100.0)));
    assert_eq!((places[2].0, places[2].1), (0, Some(1)));
    assert!(places[2].2.abs_diff_eq(Vec3::new(-2.0, 10.0, 105.0), 1e-5));

    // They move with their node.
    let times = file.floats("SCALAR", &[0.0, 1.0]);
    let values = file.floats("VEC3", &[0.0, 0.0, 0.0, 0.0, 20.0, 0.0]);
    file.push(
        "animations",
        json!({
            "channels": [{ "sampler": 0, "target": { "node": 0, "path": "translation" } }],
            "samplers": [{ "input": times, "output": values }],
        }),
    );
    let mut scene = file.import();
    scene.pose(0.5);
    let at = scene.instances[1].world_from_mesh.transform_point3(Vec3::X);
    assert_eq!(at, Vec3::new(2.0, 10.0, 100.0));
    let at = scene.instances[2]
        .world_from_mesh
        .transform_point3(Vec3::ZERO);
    assert_eq!(at, Vec3::new(0.0, 10.0, 105.0));
}

#[test]
fn places_that_make_no_sense_are_refused() {
    let place = "nodes[0].extensions.EXT_mesh_gpu_instancing";
    in_places(json!({})).assert_error(place, "no attributes");
    let scale = format!("{place}.attributes.SCALE");
    in_places(json!({ "SCALE": 9 })).assert_error(&scale, "out of range");
    let mut file = in_places(json!({ "SCALE": 1, "TRANSLATION": 2 }));
    file.floats("VEC3", &[1.0; 3]);
    file.floats("VEC3", &[1.0; 6]);
    let translation = format!("{place}.attributes.TRANSLATION");
    file.assert_error(&translation, "2 elements for 1 instances");
    let mut file = in_places(json!({ "SCALE": 1 }));
    file.floats("VEC3", &[f32::INFINITY; 3]);
    file.assert_error(&scale, "finite");
    // Nothing is stored for so many.
    let mut file = in_places(json!({ "SCALE": 1 }));
    file.push(
        "accessors",
        json!({ "componentType": 5126, "count": 1_u64 << 40, "type": "VEC3" }),
    );
    file.assert_error(place, "exceed the limit");
}

#[test]
fn what_bends_stands_where_its_node_is() {
    let mut file = in_places(json!({ "TRANSLATION": 1 }));
    let offsets = file.floats("VEC3", &[0.0; 9]);
    file.primitive()["targets"] = json!([{ "POSITION": offsets }]);
    let scene = file.import();
    assert_eq!(scene.instances.len(), 1);
    assert_eq!(scene.instances[0].origin.unwrap().place, None);
    assert!(scene.warnings[0].contains("bends"));
}

/// A file with a camera that has these extras.
fn seen_through(extras: Value) -> File {
    let mut file = File::empty();
    let perspective = json!({ "yfov": 0.75, "znear": 0.1 });
    file.push(
        "cameras",
        json!({ "type": "perspective", "perspective": perspective, "extras": { "gpugi": extras } }),
    );
    file.push("nodes", json!({ "camera": 0 }));
    file
}

#[test]
fn cameras_have_lenses_and_shutters() {
    let all = json!({ "aperture": 0.05, "focus": 2.5, "blades": 6, "shutter": 0.02 });
    let camera = &seen_through(all).import().cameras[0];
    assert_eq!(camera.lens, Lens::new(0.05, 2.5, 6).unwrap());
    assert_eq!(camera.shutter, 0.02);
    let camera = &seen_through(json!({ "aperture": 0, "focus": 0 }))
        .import()
        .cameras[0];
    assert_eq!((camera.lens, camera.shutter), (Lens::PINHOLE, 0.0));
    for (extras, place, reason) in [
        (
            json!({ "aperture": -1, "focus": 1 }),
            "",
            "an aperture of -1 m",
        ),
        (
            json!({ "aperture": 1e39, "focus": 1 }),
            "",
            "an aperture of inf m",
        ),
        (json!({ "aperture": 0.1 }), ".focus", "needs the distance"),
        (json!({ "aperture": 0.1, "focus": 0 }), "", "a focus of 0 m"),
        (json!({ "blades": 2 }), "", "2 blades"),
        (json!({ "shutter": -0.5 }), "", "a shutter of -0.5 s"),
        (json!({ "iris": 1 }), "", "iris"),
    ] {
        let file = seen_through(extras);
        file.assert_error(&format!("cameras[0].extras.gpugi{place}"), reason);
    }
}
