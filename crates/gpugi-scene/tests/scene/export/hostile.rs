//! Parts that do not fit together, and damaged files, give an error and never a panic.

use gpugi_scene::atlas::Atlas;
use gpugi_scene::export::{BakedPage, export_bake};
use gpugi_scene::{Limits, Scene, import};
use serde_json::json;

use crate::builder::{File, Files};
use crate::export::baking::{obscured, shredded, try_bake, whole};

#[track_caller]
fn assert_refused(file: &File, scene: &Scene, atlas: &Atlas, page: BakedPage, reason: &str) {
    let error = try_bake(&file.glb(), &Files::default(), scene, atlas, page)
        .expect_err("the parts do not fit");
    assert!(error.to_string().contains(reason), "{error}");
}

#[test]
fn parts_that_do_not_fit_together() {
    let file = File::triangle();
    let scene = file.import();
    let good = whole(&scene);
    let broken = |change: fn(&mut Atlas)| {
        let mut atlas = good.clone();
        change(&mut atlas);
        atlas
    };
    let refused = |atlas: Atlas, reason: &str| {
        assert_refused(&file, &scene, &atlas, obscured(), reason);
    };
    refused(broken(|atlas| atlas.instances.clear()), "0 instances");
    refused(broken(|atlas| atlas.pages = 2), "2 pages");
    refused(broken(|atlas| atlas.size = 5), "16 texels");
    refused(broken(|atlas| atlas.size = 0), "16 texels");
    refused(
        broken(|atlas| atlas.instances[0].as_mut().unwrap().page = 1),
        "page does not exist",
    );
    refused(
        broken(|atlas| atlas.instances[0].as_mut().unwrap().corners[1].x = f32::NAN),
        "not finite",
    );
    refused(
        broken(|atlas| atlas.instances[0].as_mut().unwrap().corners.truncate(2)),
        "2 corners",
    );
}

#[test]
fn scenes_of_other_files() {
    let file = File::triangle();
    let scene = file.import();
    let mut other = scene.clone();
    other.instances[0].origin = None;
    assert_refused(
        &file,
        &other,
        &whole(&scene),
        obscured(),
        "does not come from",
    );
    let mut other = scene.clone();
    other.instances[0].origin.as_mut().unwrap().node = 9;
    assert_refused(
        &file,
        &other,
        &whole(&scene),
        obscured(),
        "not what this file gives",
    );
    let mut other = scene.clone();
    other.instances[0].origin.as_mut().unwrap().primitive = 9;
    assert_refused(
        &file,
        &other,
        &whole(&scene),
        obscured(),
        "not what this file gives",
    );
    let mut other = scene.clone();
    other.instances.push(scene.instances[0].clone());
    assert_refused(
        &file,
        &other,
        &whole(&other),
        obscured(),
        "same part of the file",
    );
}

#[test]
fn attributes_that_are_too_short_to_split() {
    let mut file = File::triangle();
    let indices = file.indices(&[0, 1, 2, 0, 1, 2]);
    file.primitive()["indices"] = json!(indices);
    let short = file.floats("SCALAR", &[1.0]);
    file.attribute("_SHORT", short);
    let scene = file.import();
    assert_refused(
        &file,
        &scene,
        &shredded(&scene),
        obscured(),
        "1 elements for 3",
    );
}

#[test]
fn copies_of_large_meshes_are_bounded() {
    let mut file = File::triangle();
    file.json["meshes"][0]["extras"] = json!("x".repeat(1 << 20));
    file.json["nodes"] = json!(vec![json!({ "mesh": 0 }); 600]);
    let scene = file.import();
    assert_refused(
        &file,
        &scene,
        &whole(&scene),
        obscured(),
        "too large to be copied",
    );
}

#[test]
fn long_lists_of_which_many_nodes_use_little_are_bounded() {
    let mut file = File::triangle();
    // Without a view all are zero, and a million cost nothing to write down.
    let million = json!({ "componentType": 5126, "count": 1_000_000, "type": "VEC3" });
    let positions = file.push("accessors", million.clone());
    file.attribute("POSITION", positions);
    let mut coordinates = million;
    coordinates["type"] = json!("VEC2");
    let coordinates = file.push("accessors", coordinates);
    for set in 0..4500 {
        file.attribute(&format!("TEXCOORD_{set}"), coordinates);
    }
    let indices = file.indices(&[0, 1, 2]);
    file.primitive()["indices"] = json!(indices);
    let scene = file.import();
    assert_refused(
        &file,
        &scene,
        &shredded(&scene),
        obscured(),
        "nodes share more vertices",
    );
}

/// Marsaglia's xorshift: the same damage in every run.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % bound as u64) as usize
    }
}

#[test]
fn damaged_files_do_not_panic() {
    let mut file = File::with_material(json!({
        "emissiveTexture": { "index": 0 }, "extras": { "gpugi": {} }, "alphaMode": "MASK",
    }));
    let indices = file.indices(&[0, 1, 2, 2, 1]);
    file.primitive()["indices"] = json!(indices);
    file.primitive()["mode"] = json!(5);
    let target = file.floats("VEC3", &[0.5; 9]);
    file.primitive()["targets"] = json!([{ "POSITION": target }]);
    let view = file.view(&crate::builder::png(1, 1, &[200; 4]));
    file.push(
        "images",
        json!({ "bufferView": view, "mimeType": "image/png" }),
    );
    file.push("textures", json!({ "source": 0 }));
    file.push("nodes", json!({ "mesh": 0, "extensions": {} }));
    let intact = file.glb();
    let limits = Limits {
        scene_bytes: 1 << 22,
        image_bytes: 1 << 20,
        ..Limits::default()
    };
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let (mut exported, mut refused) = (0, 0);
    for _ in 0..20_000 {
        let mut bytes = intact.clone();
        for _ in 0..1 + random.below(3) {
            let at = 12 + random.below(bytes.len() - 12);
            bytes[at] = random.below(256) as u8;
        }
        let Ok(scene) = import("test.glb", &bytes, &Files::default(), &limits) else {
            continue;
        };
        let original = gpugi_scene::export::Original {
            name: "test.glb",
            bytes: &bytes,
            resolver: &Files::default(),
            limits,
        };
        match export_bake(Some(original), &scene, &shredded(&scene), &[obscured()]) {
            Ok(_) => exported += 1,
            Err(_) => refused += 1,
        }
    }
    assert!(exported > 100, "{exported} exported, {refused} refused");
}
