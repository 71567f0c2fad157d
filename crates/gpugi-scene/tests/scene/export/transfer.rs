//! Transfer vectors come back from files as they went, and files that do not fit are refused.

use std::sync::Arc;

use gpugi_scene::builtin::builtin;
use gpugi_scene::export::{Original, TransferFormat, export_transfer};
use gpugi_scene::{Atlas, AtlasOptions, Limits, Scene, TransferVectors};
use half::f16;
use serde_json::{Value, json};

use crate::builder::Files;
use crate::export::baking::{edited, keep, read};

/// Vectors whose coefficients tell texel and function.
fn vectors(scene: &Scene, order: u32) -> TransferVectors {
    let options = AtlasOptions {
        size: 64,
        ..AtlasOptions::default()
    };
    let atlas = Arc::new(Atlas::new(scene, &options).unwrap());
    let texels = (atlas.size * atlas.size * atlas.pages) as usize;
    let value = |index: usize| f16::from_f32((index % 1999) as f32 / 1000.0 - 1.0);
    let coefficients = (0..texels * (order * order) as usize).map(|index| {
        let point = f16::from_f32((index % 3).min(1) as f32);
        [value(index), value(index + 1), value(3 * index), point]
    });
    TransferVectors {
        order,
        bounces: 3,
        atlas,
        coefficients: coefficients.collect(),
        geometry: [0; 32],
    }
}

/// A file of the built-in room.
fn exported(format: TransferFormat) -> (TransferVectors, Vec<u8>) {
    let scene = builtin("cornell", 1).unwrap();
    let vectors = vectors(&scene, 2);
    let exported = export_transfer(None, &scene, &vectors, format).unwrap();
    (vectors, exported.glb)
}

fn extras(json: &mut Value) -> &mut Value {
    &mut json["extras"]["gpugi"]["radianceTransfer"]
}

#[test]
fn transfer_vectors_come_back() {
    let (vectors, glb) = exported(TransferFormat::Half);
    keep(&glb);
    let scene = read(&glb).unwrap();
    let found = scene.transfer.as_ref().expect("vectors");
    assert_eq!((found.order, found.bounces), (2, 3));
    assert!(found.coefficients == vectors.coefficients);
    let corners = |atlas: &Atlas| {
        let instances = atlas.instances.iter().flatten();
        let corners = instances.map(|uvs| (uvs.page, uvs.corners.clone()));
        corners.collect::<Vec<_>>()
    };
    assert!(corners(&found.atlas) == corners(&vectors.atlas));
    found.check(&scene).unwrap();

    let (vectors, glb) = exported(TransferFormat::Byte);
    keep(&glb);
    let found = read(&glb).unwrap().transfer.expect("vectors");
    for (texel, expected) in found.coefficients.iter().zip(&vectors.coefficients) {
        let pairs = texel.iter().zip(expected);
        let furthest = pairs.map(|(a, b)| (a.to_f32() - b.to_f32()).abs());
        // Half a step of 1 / 127, and the rounding of both to 16 bits.
        assert!(furthest.fold(0.0, f32::max) < 0.5 / 127.0 + 1e-3);
        assert_eq!(texel[3], expected[3]);
    }
}

/// What was baked may be baked again, with another atlas and order; nothing of the first bake is read.
#[test]
fn a_file_is_baked_again() {
    let (_, first) = exported(TransferFormat::Half);
    let scene = read(&first).unwrap();
    let mut again = vectors(&scene, 3);
    Arc::make_mut(&mut again.atlas).instances[0] = None;
    let original = Original {
        name: "first.glb",
        bytes: &first,
        resolver: &Files::default(),
        limits: Limits::default(),
    };
    let second = export_transfer(Some(original), &scene, &again, TransferFormat::Half).unwrap();
    keep(&second.glb);
    let found = read(&second.glb).unwrap().transfer.expect("vectors");
    assert_eq!(found.order, 3);
    assert!(found.atlas.instances[0].is_none() && found.atlas.instances[1].is_some());
}

#[test]
fn vectors_that_do_not_fit_are_refused() {
    let (_, glb) = exported(TransferFormat::Byte);
    let reason = |glb: &[u8]| read(glb).map(|_| ()).expect_err("an error");
    let of_edit = |edit: &dyn Fn(&mut Value)| reason(&edited(&glb, edit));
    for (member, value, expected) in [
        ("version", json!(2), "version 2 is not read"),
        ("basis", json!("haar"), "the basis \"haar\" is not read"),
        ("order", json!(9), "order 9"),
        ("order", json!(3), "scale needs 9"),
        ("bounces", json!(0), "0 bounces"),
        ("size", json!(0), "texels a side"),
        ("size", json!(1 << 20), "texels a side"),
        ("size", json!(32), "not an uncompressed array"),
        ("pages", json!([]), "0 pages"),
        ("scale", json!([1.0]), "scale needs 4"),
        ("scale", Value::Null, "not an uncompressed array"),
        ("scale", json!([1.0, 1e30, 1.0, 1.0]), "not finite"),
        ("geometry", json!("none"), "geometry"),
        ("geometry", json!("0".repeat(64)), "another mesh"),
    ] {
        let found = of_edit(&|json| extras(json)[member] = value.clone());
        assert!(found.contains(expected), "{member} {value}: {found}");
    }
    let page = |member: &'static str, value: Value| {
        move |json: &mut Value| extras(json)["pages"][0][member] = value.clone()
    };
    assert!(of_edit(&page("bufferView", json!(9999))).contains("out of range"));
    assert!(of_edit(&page("bufferView", json!(0))).contains("checksum"));
    let material = |member: &'static str| {
        move |json: &mut Value| {
            json["materials"][0]["extras"]["gpugi"]["radianceTransfer"][member] = json!(7);
        }
    };
    assert!(of_edit(&material("page")).contains("page 7 of 1"));
    assert!(of_edit(&material("texCoord")).contains("there is no TEXCOORD_7"));
    // Something has moved, or was exchanged.
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
    // The coefficients are the last that was written.
    let mut damaged = glb.clone();
    let at = damaged.len() - 100;
    damaged[at] ^= 1;
    assert!(reason(&damaged).contains("checksum"));
    assert!(read(&glb[..glb.len() - 100]).is_err());
}

#[test]
fn vectors_without_texels_or_with_too_few_coefficients_are_not_written() {
    let scene = builtin("cornell", 1).unwrap();
    let whole = vectors(&scene, 2);
    let refused = |vectors: &TransferVectors| {
        let exported = export_transfer(None, &scene, vectors, TransferFormat::Half);
        exported.map(|_| ()).expect_err("an error").to_string()
    };
    let mut fewer = whole.clone();
    fewer.coefficients.pop();
    assert!(refused(&fewer).contains("coefficients for"));
    let mut empty = whole.clone();
    empty.coefficients.clear();
    Arc::make_mut(&mut empty.atlas).pages = 0;
    assert!(refused(&empty).contains("0 coefficients"));
    let order = TransferVectors { order: 9, ..whole };
    assert!(refused(&order).contains("order 9"));
}
