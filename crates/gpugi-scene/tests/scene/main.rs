//! Tests of import, export, atlases, images and metrics: one program, so that it links once.

mod assets;
mod atlas;
mod basis;
mod builder;
mod builtin;
mod digest;
mod export;
mod exr;
mod gltf;
mod hdr;
mod images;
mod ktx2;
mod mesh;
mod metrics;
mod obj;
mod ply;
mod random;
mod relief;
mod serialized;
mod station;
mod untrusted;
