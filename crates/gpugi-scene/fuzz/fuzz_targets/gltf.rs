//! glTF, JSON or binary, and one pose of what it holds: Ok or Err, never a panic, a hang or a flood of memory.

#![no_main]

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

/// There are no other files.
struct Nothing;

impl Resolver for Nothing {
    fn read(&self, _uri: &str) -> Result<Vec<u8>, String> {
        Err("no such file".to_owned())
    }
}

fuzz_target!(|bytes: &[u8]| {
    for name in ["fuzz.gltf", "fuzz.glb"] {
        if let Ok(mut scene) = import(name, bytes, &Nothing, &LIMITS) {
            scene.pose(0.5);
        }
    }
});
