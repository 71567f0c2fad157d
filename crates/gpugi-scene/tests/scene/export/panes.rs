//! Panes come back from files as they went, and files that do not fit are refused.

use std::sync::Arc;

use gpugi_scene::builtin::builtin;
use gpugi_scene::export::{Original, export_panes};
use gpugi_scene::{Atlas, AtlasOptions, LightPathPanes, Limits, Scene, SurfacePlace};
use serde_json::{Value, json};

use crate::builder::Files;
use crate::export::baking::{edited, keep, read};

/// Two panes whose values tell texel and pane, and six points.
fn panes(scene: &Scene) -> LightPathPanes {
    let options = AtlasOptions {
        size: 64,
        ..AtlasOptions::default()
    };
    let atlas = Arc::new(Atlas::new(scene, &options).unwrap());
    let texels = atlas.size * atlas.size * atlas.pages;
    let point = |number: u32| SurfacePlace {
        instance: number,
        triangle: number % 2,
        barycentrics: [0.25, 0.1 * number as f32],
    };
    LightPathPanes {
        atlas,
        depth: 7,
        entries: vec![point(0), point(1)],
        samples: vec![point(2), point(3), point(4), point(5)],
        firsts: vec![0, 1, 2],
        first_samples: vec![0, 4, 4],
        panes: (0..2 * texels).map(|index| index * 7919).collect(),
        geometry: [0; 32],
        materials: [0; 32],
    }
}

/// A file of the built-in room.
fn exported() -> (LightPathPanes, Vec<u8>) {
    let scene = builtin("cornell", 1).unwrap();
    let panes = panes(&scene);
    let glb = export_panes(None, &scene, &panes).unwrap().glb;
    (panes, glb)
}

fn extras(json: &mut Value) -> &mut Value {
    &mut json["extras"]["gpugi"]["lightPathMap"]
}

#[test]
fn panes_come_back() {
    let (panes, glb) = exported();
    keep(&glb);
    let scene = read(&glb).unwrap();
    let found = scene.panes.as_ref().expect("panes");
    assert!(scene.transfer.is_none());
    assert!(found.panes == panes.panes);
    assert_eq!(
        (found.depth, &found.firsts, &found.first_samples),
        (7, &panes.firsts, &panes.first_samples)
    );
    assert_eq!(found.entries, panes.entries);
    assert_eq!(found.samples, panes.samples);
    let corners = |atlas: &Atlas| {
        let instances = atlas.instances.iter().flatten();
        let corners = instances.map(|uvs| (uvs.page, uvs.corners.clone()));
        corners.collect::<Vec<_>>()
    };
    assert!(corners(&found.atlas) == corners(&panes.atlas));
    found.check(&scene).unwrap();
}

/// Another bake of the file takes the place of the first one.
#[test]
fn a_file_is_baked_again() {
    let (_, first) = exported();
    let scene = read(&first).unwrap();
    let mut again = panes(&scene);
    again.depth = 32;
    let original = Original {
        name: "first.glb",
        bytes: &first,
        resolver: &Files::default(),
        limits: Limits::default(),
    };
    let second = export_panes(Some(original), &scene, &again).unwrap();
    keep(&second.glb);
    assert_eq!(read(&second.glb).unwrap().panes.expect("panes").depth, 32);
}

#[test]
fn panes_that_do_not_fit_are_refused() {
    let (_, glb) = exported();
    let reason = |glb: &[u8]| read(glb).map(|_| ()).expect_err("an error");
    let of_edit = |edit: &dyn Fn(&mut Value)| reason(&edited(&glb, edit));
    for (member, value, expected) in [
        ("version", json!(2), "version 2 is not read"),
        ("depth", json!(33), "depth 33"),
        ("size", json!(0), "texels a side"),
        ("size", json!(1 << 20), "texels a side"),
        ("size", json!(32), "not an uncompressed array"),
        ("entries", json!(0), "0 entry points"),
        ("entries", json!(3), "divide the points"),
        ("entries", json!(7), "6 points, of which 7"),
        ("pages", json!([]), "0 pages"),
        ("geometry", json!("none"), "geometry"),
        ("geometry", json!("0".repeat(64)), "another mesh"),
        ("materials", json!("0".repeat(64)), "other materials"),
    ] {
        let found = of_edit(&|json| extras(json)[member] = value.clone());
        assert!(found.contains(expected), "{member} {value}: {found}");
    }
    for part in ["clusters", "points"] {
        let found = of_edit(&|json| extras(json)[part]["bufferView"] = json!(0));
        assert!(found.contains("checksum"), "{part}: {found}");
    }
    // Whole and right, but something else.
    let exchanged = |to: &'static str, from: &'static str| {
        move |json: &mut Value| extras(json)[to] = extras(json)[from].clone()
    };
    assert!(of_edit(&exchanged("points", "clusters")).contains("5 for each point"));
    assert!(of_edit(&exchanged("clusters", "points")).contains("an uncompressed array of 14"));
    // A surface that reflects something else, or has moved.
    let painted = of_edit(&|json| {
        let material = &mut json["materials"][0]["pbrMetallicRoughness"];
        material["baseColorFactor"] = json!([0.1, 0.2, 0.3, 1.0]);
    });
    assert!(painted.contains("other materials"), "{painted}");
    let moved = of_edit(&|json| {
        let node = json["nodes"].as_array_mut().unwrap();
        let node = node
            .iter_mut()
            .find(|node| node.get("mesh").is_some())
            .unwrap();
        node.as_object_mut().unwrap().shift_remove("matrix");
        node["translation"] = json!([0.0, 0.5, 0.0]);
    });
    assert!(moved.contains("another mesh"), "{moved}");
    // The panes are the last that was written.
    let mut damaged = glb.clone();
    let at = damaged.len() - 100;
    damaged[at] ^= 1;
    assert!(reason(&damaged).contains("checksum"));
    assert!(read(&glb[..glb.len() - 100]).is_err());
}

#[test]
fn panes_that_are_not_whole_are_not_written() {
    let scene = builtin("cornell", 1).unwrap();
    let refused = |change: &dyn Fn(&mut LightPathPanes)| {
        let mut changed = panes(&scene);
        change(&mut changed);
        let exported = export_panes(None, &scene, &changed);
        exported.map(|_| ()).expect_err("an error").to_string()
    };
    assert!(refused(&|panes| panes.panes.truncate(9)).contains("9 values for"));
    assert!(refused(&|panes| panes.firsts.clear()).contains("0 clusters"));
    assert!(refused(&|panes| panes.samples.truncate(3)).contains("3 light samples"));
    assert!(refused(&|panes| panes.firsts = vec![0, 3, 2]).contains("divide the points"));
    let outside = |panes: &mut LightPathPanes| {
        Arc::make_mut(&mut panes.atlas).instances[1] = None;
    };
    assert!(refused(&outside).contains("instances[1]"));
}
