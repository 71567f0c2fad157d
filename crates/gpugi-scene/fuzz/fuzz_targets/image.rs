//! Images as textures and as radiance: Ok or Err, never a panic, a hang or a flood of memory.

#![no_main]

use gpugi_scene::Limits;
use gpugi_scene::image::{decode_color, decode_radiance};
use libfuzzer_sys::fuzz_target;

const LIMITS: Limits = Limits {
    file_bytes: 1 << 24,
    image_side: 1024,
    image_bytes: 1 << 24,
    scene_bytes: 1 << 24,
    expansion: 1024,
    displaced_triangles: 10_000,
};

fuzz_target!(|bytes: &[u8]| {
    let _ = decode_color("fuzz", bytes, &LIMITS);
    let _ = decode_radiance("fuzz", bytes, &LIMITS);
});
