//! Imports a glTF file and exports a bake of it in which all vertices are split. The result is Ok or Err, never a
//! panic, a hang or unbounded memory.

#![no_main]

use gpugi_scene::atlas::{Atlas, InstanceUvs};
use gpugi_scene::export::{BakedPage, Original, export_bake};
use gpugi_scene::{Limits, Resolver, import};
use libfuzzer_sys::fuzz_target;

const LIMITS: Limits = Limits {
    file_bytes: 1 << 24,
    image_side: 1024,
    image_bytes: 1 << 24,
    scene_bytes: 1 << 24,
    expansion: 1024,
    displaced_triangles: 10_000,
};

/// A resolver without other files.
struct Nothing;

impl Resolver for Nothing {
    fn read(&self, _uri: &str) -> Result<Vec<u8>, String> {
        Err("no such file".to_owned())
    }
}

fuzz_target!(|bytes: &[u8]| {
    for name in ["fuzz.gltf", "fuzz.glb"] {
        let Ok(scene) = import(name, bytes, &Nothing, &LIMITS) else {
            continue;
        };
        let instances = scene.instances.iter().map(|instance| {
            let corners = 0..scene.meshes[instance.mesh].indices.len();
            Some(InstanceUvs {
                corners: corners.map(|corner| glam::Vec2::splat(corner as f32)).collect(),
                page: 0,
                charts: Vec::new(),
            })
        });
        let atlas = Atlas {
            size: 1,
            pages: 1,
            instances: instances.collect(),
            backs: Vec::new(),
        };
        let page = BakedPage {
            obscurance: Some(vec![0.5]),
            ..BakedPage::default()
        };
        let original = Original {
            name,
            bytes,
            resolver: &Nothing,
            limits: LIMITS,
        };
        let _ = export_bake(Some(original), &scene, &atlas, &[page]);
    }
});
