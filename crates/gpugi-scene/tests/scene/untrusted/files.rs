//! What the tests share.

use std::time::{Duration, Instant};

use glam::{Mat4, Vec3};
use gpugi_scene::{ImportError, Limits, Material, Mesh, Resolver, Scene, import};
use serde_json::json;

/// No other files.
pub struct Nothing;

impl Resolver for Nothing {
    fn read(&self, _uri: &str) -> Result<Vec<u8>, String> {
        Err("no such file".to_owned())
    }
}

/// Runs what must be over soon.
#[track_caller]
pub fn soon<T>(work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = work();
    let took = start.elapsed();
    assert!(took < Duration::from_secs(2), "{took:?}");
    result
}

pub fn refused(name: &str, bytes: &[u8]) -> ImportError {
    let read = soon(|| import(name, bytes, &Nothing, &Limits::default()));
    match read {
        Ok(_) => panic!("the file asks for too much"),
        Err(error) => error,
    }
}

/// A triangle whose document `change` changes.
pub fn triangle(change: impl FnOnce(&mut serde_json::Value)) -> Vec<u8> {
    let mut document = json!({
        "asset": { "version": "2.0" },
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
        "buffers": [{
            "byteLength": 36, "uri": "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA",
        }],
    });
    change(&mut document);
    document.to_string().into_bytes()
}

/// One triangle with a material.
pub fn shown(material: Material) -> Scene {
    let mut scene = Scene::new("one");
    let mesh = scene.add_mesh(Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        normals: vec![Vec3::Z; 3],
        indices: vec![0, 1, 2],
        ..Mesh::default()
    });
    let material = scene.add_material(material);
    scene.add_instance("one", mesh, material, Mat4::IDENTITY);
    scene
}
