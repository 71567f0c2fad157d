//! OBJ, with the same bytes as its material library: Ok or Err, never a panic, a hang or a flood of memory.

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

/// Every file that the fuzzed one names is the fuzzed one.
struct Same<'a>(&'a [u8]);

impl Resolver for Same<'_> {
    fn read(&self, _uri: &str) -> Result<Vec<u8>, String> {
        Ok(self.0.to_vec())
    }
}

fuzz_target!(|bytes: &[u8]| {
    let _ = import("fuzz.obj", bytes, &Same(bytes), &LIMITS);
});
