//! gpugi command
fn main() {}
